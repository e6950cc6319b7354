/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_CACHED_TILES_H
#define UMBRAGE_SERVER_BAKE_BUILD_CACHED_TILES_H
/*
 * A cache of tiles' results between bakes, as two functions. The tile loop asks the cache for each
 * tile before drawing the tile, and gives the cache each tile that was built.
 *
 * A tile's result is what the levels above the tile and the pool need: the greatest lit, the least
 * end, the column, and the nodes that the column's runs refer to.
 * Threads: both functions are called by the owner of the loop only.
 */
#include "bake/build/columns.h"

struct umbb_tile_result {
    int32_t max_lit, min_end; /* extremes of the tile's texels, or bounds (proven_squares.h) */
    struct umbb_column column;
};

/* Place of a tile: its first texel, and its number in the frustum, row by row. */
struct umbb_tile_place {
    int32_t x0, y0;
    uint32_t number;
};

/* Pool and runs that hold a tile's nodes or receive them. */
struct umbb_tile_nodes {
    struct umb__pool *pool; /* nodes of the column's runs */
    struct umbb_runs *runs; /* the column's runs, after any others */
    size_t max_bytes;       /* limit of the working memory in addition to the pool */
};

struct umbb_cached_tiles {
    void *user;
    /*
     * Finds a tile's result and adds its nodes to the pool.
     *
     * Out:   found: 0 if the tile must be baked; result and runs are unchanged then. Else result:
     *        its column's runs are the last of the runs.
     * Fails: as umb__pool_brick; any failure that ends the bake. Discard the pool then.
     */
    enum umb_status (*find)(void *user, const struct umbb_tile_place *place,
                            const struct umbb_tile_nodes *nodes, struct umbb_tile_result *result,
                            int *found, struct umb_error *error);
    /* Stores a copy of a result. Fails: only if the bake must end for it. */
    enum umb_status (*keep)(void *user, const struct umbb_tile_place *place,
                            const struct umbb_tile_nodes *nodes,
                            const struct umbb_tile_result *result, struct umb_error *error);
};

#endif
