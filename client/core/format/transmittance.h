/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_TRANSMITTANCE_H
#define UMBRAGE_CORE_FORMAT_TRANSMITTANCE_H
/*
 * Translucent casters: how much light is left along each texel's ray (deep shadow maps).
 *
 * A map of a frustum has 2^m texels a side, of 2^(n-m) voxels each. A texel's list is a falling
 * staircase: steps (z, drop), z ascending; voxel z' gets 1 less the drops of all steps with z <=
 * z', in units of 2^-21. Texels without a list get all light. An entry TRNS of the canonical block
 * holds the maps of all frusta (docs/reference/umb-format.md, section 3):
 *
 * - a byte for each frustum: m, or 0: nothing translucent lies before it;
 * - for each frustum with a map its squares of 64x64 texels, row by row: u64 mask of their 8x8
 *   blocks that have a list (bit x + 8 * y); for each of those u64 mask of its texels that have
 *   one; and for each of these its list;
 * - a list: for each step varint 4 * a + 2 * same + (1 if another step follows), and varint
 *   drop - 1 unless it is the same as that of the last step in the square whose number is this
 *   one's modulo 8. Of the first step a is z less that of the square's list before (0 at first),
 *   folded to 0, -1, 1, -2 ... = 0, 1, 2, 3 ...; of the others z less that of the step before,
 *   less 1.
 *
 * A varint has seven bits a byte, low ones first, the top bit set on all bytes but the last; it is
 * as short as can be.
 *
 * Open, an entry is expanded: lists in the order of the bytes, found through two layers of masks.
 */
#include <stdbool.h>
#include <stdint.h>
#include "umbrage/asset.h"

#define UMB__TRANSMITTANCE_ONE       ((uint32_t)1 << 21) /* all light */
#define UMB__TRANSMITTANCE_LEVEL_MIN 6U                  /* least m */

#define UMB__TRANSMITTANCE_RECENT                                                                  \
    8U /* Number of drops that a square
                                                            remembers */

/* A square of 64x64 texels, or a block of 8x8. */
struct umb__transmittance_group {
    uint64_t mask;  /* Blocks, or texels, that have a list */
    uint32_t first; /* Number of the first of them */
};

struct umb__transmittance_step {
    uint32_t z;    /* First voxel behind the step */
    uint32_t lost; /* Sum of the drops up to here, at most UMB__TRANSMITTANCE_ONE */
};

struct umb__transmittance_map {
    uint32_t level;        /* m, or 0 */
    uint32_t first_square; /* First of its squares: 2^(m-6) rows of 2^(m-6) */
};

/* An entry, expanded. */
struct umb__trans {
    struct umb__transmittance_map *maps;      /* [frustum_count]; NULL: there is no entry */
    struct umb__transmittance_group *squares; /* [square_count] */
    struct umb__transmittance_group *blocks;  /* [block_count] */
    uint32_t *starts;                         /* [list_count + 1] First step of each list */
    struct umb__transmittance_step *steps;    /* [step_count] */
    uint64_t square_count, block_count, list_count, step_count;
};

/*
 * Checks an entry.
 *
 * Fails: E_CORRUPT. Trust: safe on hostile bytes. Cost: linear, no allocation.
 */
UMB_CHECKED enum umb_status umb__transmittance_check(const uint8_t *bytes, uint64_t length,
                                                     const struct umb_frustum_info *frusta,
                                                     uint32_t frustum_count,
                                                     struct umb_error *error);

/*
 * Checks and expands an entry.
 *
 * Out:   trans: finish it; zeroed on failure.
 * Fails: E_CORRUPT, E_NO_MEMORY. Trust: safe on hostile bytes.
 * Cost:  two passes; memory of at most twelve times the entry.
 */
UMB_CHECKED enum umb_status umb__transmittance_load(const uint8_t *bytes, uint64_t length,
                                                    const struct umb_frustum_info *frusta,
                                                    uint32_t frustum_count,
                                                    const struct umb_alloc *alloc,
                                                    struct umb__trans *trans,
                                                    struct umb_error *error);
void umb__transmittance_finish(struct umb__trans *trans, const struct umb_alloc *alloc);

/* Texels x0..x1, y0..y1 of a map in voxels, inclusive and inside the frustum, at depth z. */
struct umb__transmittance_window {
    uint32_t x0, x1, y0, y1, z;
};

/* Sums the loss of all voxels of a window, each at most UMB__TRANSMITTANCE_ONE. In: n: log2 of the
 * frustum's size. */
uint64_t umb__transmittance_lost(const struct umb__trans *trans,
                                 const struct umb__transmittance_map *map, uint32_t n,
                                 const struct umb__transmittance_window *window);

#endif
