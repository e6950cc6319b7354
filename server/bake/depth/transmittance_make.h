/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_TRANSMITTANCE_MAKE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_TRANSMITTANCE_MAKE_H
/*
 * Transmittance maps: the share of the light that passes the translucent casters, texel by texel.
 *
 * All fragments of a texel's centre count, by the predicate of opaque casters (coverage.h) with one
 * change: a centre on an edge that two triangles share is met once. Each fragment has its opacity
 * there. The products of the fragments, sorted by depth and then by opacity, are a list
 * (format/transmittance.h), whatever the order of triangles and the number of threads. The list
 * ends where less than UMBB_TRANSMITTANCE_LEAST is left.
 *
 * Source: T. Lokovic, E. Veach, Deep Shadow Maps, 2000; truncation as in C. Yuksel, J. Keyser, Deep
 * Opacity Maps, 2008.
 */
#include "bake/depth/tile.h"
#include "format/transmittance.h"

#define UMBB_TRANSMITTANCE_LEAST 0.001

struct umbb_transmittance_input {
    /* Casters in texels of the map, depth in voxels. Every caster has a cut, which is
     * translucent. */
    const struct umbb_casters *casters;
    uint32_t level;       /* 2^level texels a side, at least 6 */
    unsigned threads;     /* 1.. */
    size_t max_bytes;     /* limit of the result */
    size_t working_bytes; /* limit of the lists of triangles and fragments */
    int (*cancelled)(void);
};

/*
 * Makes the squares of a frustum's map.
 *
 * Out:   bytes: the map is appended, or nothing if no texel has a list. too_large: 1 if the call
 *        failed because the result would be larger than max_bytes.
 * Fails: E_LIMIT (max_bytes; working_bytes), E_NO_MEMORY, E_CANCELLED.
 */
UMB_CHECKED enum umb_status umbb_transmittance_make(const struct umbb_transmittance_input *job,
                                                    struct umb__transmittance_bytes *bytes,
                                                    int *too_large, struct umb_error *error);

#endif
