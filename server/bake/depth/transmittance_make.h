/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_TRANSMITTANCE_MAKE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_TRANSMITTANCE_MAKE_H
/*
 * Deep maps: what translucent casters leave of the light, texel by texel.
 *
 * All fragments of a texel's centre count, by the predicate that opaque casters are drawn with
 * (coverage.h) but for one thing: a centre on an edge that two triangles share is met once. Each
 * takes its opacity there. Sorted by depth, then by opacity, their products are a list
 * (format/transmittance.h), whatever the order of triangles and the number of threads; it ends
 * where less than UMBB_TRANSMITTANCE_LEAST is left.
 *
 * Source: Lokovic, Veach 2000; truncation as in Yuksel, Keyser 2008 and seed 003.
 */
#include "bake/depth/tile.h"
#include "format/transmittance_write.h"

#define UMBB_TRANSMITTANCE_LEAST 0.001

struct umbb_transmittance_input {
    /* In the texels of the map; depth in voxels. Every caster has a cut, and that is translucent.
     */
    const struct umbb_casters *casters;
    uint32_t level;       /* 2^level texels a side, at least 6 */
    unsigned threads;     /* 1.. */
    size_t max_bytes;     /* of the result */
    size_t working_bytes; /* that lists of triangles and fragments may take */
    int (*cancelled)(void);
};

/*
 * Makes the squares of a frustum's map.
 *
 * Out:   bytes: appended to; nothing if no texel has a list. too_large: 1 if it failed because the
 *        result would be larger than max_bytes.
 * Fails: E_LIMIT (max_bytes; working_bytes), E_NO_MEMORY, E_CANCELLED.
 */
UMB_CHECKED enum umb_status umbb_transmittance_make(const struct umbb_transmittance_input *job,
                                                    struct umb__transmittance_bytes *bytes,
                                                    int *too_large, struct umb_error *error);

#endif
