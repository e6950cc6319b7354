/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_TILE_LISTS_H
#define UMBRAGE_SERVER_BAKE_DEPTH_TILE_LISTS_H
/*
 * Lists of the casters that may touch each tile of a map, and each block of two tiles in progress.
 *
 * A tile's list holds the casters that touch the tile, or have a border within about two texels of
 * the tile. So it is also the list of all casters that the tile's result depends on, which keys of
 * cached tiles are made of (tiles/tile_folder.h).
 */
#include "bake/depth/triangle_bins.h"

struct umbb_tile_lists {
    const struct umbb_casters *casters; /* borrowed, with their marks */
    uint32_t tile_log2;                 /* texels a side of a tile, log2 */
    const struct umb_workers *workers;  /* threads to use; NULL: only the caller's */
    size_t max_bytes;                   /* limit of all lists together */
    struct umbb_bins tiles;             /* the map by tile */
    struct umbb_bins blocks[2];         /* a tile by block, one a slot */
};

/* Lists the casters of each tile. lists: its first four fields are set, everything else is zero; to
 * be finished after any result. Fails: E_NO_MEMORY, E_LIMIT (max_bytes). */
UMB_CHECKED enum umb_status umbb_tile_lists_fill(struct umbb_tile_lists *lists,
                                                 struct umb_error *error);

/* Lists the casters of each block of a tile that is being begun, and sets the tile's background.
 * Fails: the errors of umbb_tile_lists_fill. */
UMB_CHECKED enum umb_status umbb_tile_lists_begin(struct umbb_tile_lists *lists, int slot,
                                                  struct umbb_tile *tile, struct umb_error *error);

/* Sets the limit of the lists in bytes. Returns the bytes they take now; 0 if `lists` is NULL. */
size_t umbb_tile_lists_allow(struct umbb_tile_lists *lists, size_t max_bytes);

/* Returns the list of the tile at texel (x0, y0): indices of casters, ascending. The list is NULL
 * only if *count is 0. */
const uint32_t *umbb_tile_lists_of_tile(const struct umbb_tile_lists *lists, int32_t x0, int32_t y0,
                                        size_t *count);

void umbb_tile_lists_finish(struct umbb_tile_lists *lists);

#endif
