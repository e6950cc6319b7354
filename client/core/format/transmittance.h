/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_TRANSMITTANCE_H
#define UMBRAGE_CORE_FORMAT_TRANSMITTANCE_H
/*
 * The transmittance of translucent casters: how much light is left along each texel's ray (deep
 * shadow maps).
 *
 * The map of a frustum of 2^n voxels a side has 2^m texels a side. A texel's list has steps (z,
 * drop) with ascending z. A voxel at depth z' gets 1 minus the drops of all steps with z <= z'.
 * Drops are in units of 2^-21. A texel without a list gets all light. The entry TRNS of the
 * canonical block holds the maps of all frusta (docs/reference/umb-format.md, section 3): squares
 * of 64x64 texels with masks of the blocks and texels that have a list. An open asset has the entry
 * expanded: lists in the order of the bytes, found through two layers of masks.
 */
#include <stdbool.h>
#include <stdint.h>
#include "umbrage/asset.h"

#define UMB__TRANSMITTANCE_ONE       ((uint32_t)1 << 21) /* Units of all light */
#define UMB__TRANSMITTANCE_LEVEL_MIN 6U                  /* Least m */
#define UMB__TRANSMITTANCE_RECENT    8U                  /* Drops that a square remembers */

/* A square of 64x64 texels, or a block of 8x8. */
struct umb__transmittance_group {
    uint64_t mask; /* Blocks, or texels, that have a list */
    /* Number of the first block with a list (of a square), or of the first list (of a block) */
    uint32_t first;
};

struct umb__transmittance_step {
    uint32_t z;    /* First voxel behind the step */
    uint32_t lost; /* Sum of the drops up to this step, at most UMB__TRANSMITTANCE_ONE */
};

struct umb__transmittance_map {
    uint32_t level; /* Level m of the map; 0: no map */
    /* Index of the map's first square; it has 2^(m-6) rows of 2^(m-6) squares */
    uint32_t first_square;
};

/* The transmittance of all frusta, expanded. */
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

/* Returns the light lost by all voxels of a window, at most UMB__TRANSMITTANCE_ONE for each voxel.
 * In: n: binary logarithm of the frustum's voxels a side. */
uint64_t umb__transmittance_lost(const struct umb__trans *trans,
                                 const struct umb__transmittance_map *map, uint32_t n,
                                 const struct umb__transmittance_window *window);

/* Returns whether no texel of a window has a list. The depth is not read. Windows of many blocks
 * may give false without a list. */
bool umb__transmittance_is_clear(const struct umb__trans *trans,
                                 const struct umb__transmittance_map *map, uint32_t n,
                                 const struct umb__transmittance_window *window);

/*
 * Writing: squares of 64x64 texels, in the order of the entry.
 *
 *     umb__transmittance_square(&bytes, lists, max_bytes, &error);   each square, row by row
 *
 * Several threads may write squares, each to an array of its own; then umb__transmittance_append
 * puts the arrays one behind the other. No square depends on another.
 */
#define UMB__TRANSMITTANCE_SIDE 64U /* Texels a side of a square */

/* A step as it is written. */
struct umb__transmittance_drop {
    uint32_t z;
    uint32_t drop; /* Light taken, in units of 2^-21, 1 and up */
};

/* The list of one texel, z ascending; none if count is 0. */
struct umb__transmittance_list {
    const struct umb__transmittance_drop *steps;
    uint32_t count;
};

/* A growing array of bytes. Start zeroed. */
struct umb__transmittance_bytes {
    const struct umb_alloc *alloc;
    uint8_t *data; /* Bytes; free them with umb__transmittance_bytes_finish */
    size_t count, capacity;
};
void umb__transmittance_bytes_finish(struct umb__transmittance_bytes *bytes);

/*
 * Appends a square.
 *
 * In:    lists: [64 * 64], row by row.
 * Fails: E_NO_MEMORY, E_LIMIT (more than max_bytes then). After a failure only finish `bytes`.
 */
UMB_CHECKED enum umb_status umb__transmittance_square(struct umb__transmittance_bytes *bytes,
                                                      const struct umb__transmittance_list *lists,
                                                      size_t max_bytes, struct umb_error *error);

/*
 * Appends bytes unchanged: the levels of all frusta, or squares written elsewhere.
 *
 * Fails: as umb__transmittance_square.
 */
UMB_CHECKED enum umb_status umb__transmittance_append(struct umb__transmittance_bytes *bytes,
                                                      const void *data, size_t count,
                                                      size_t max_bytes, struct umb_error *error);

#endif
