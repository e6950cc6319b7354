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
     * Out:   found: 1 if the cache has the tile; 0 if it must be baked. result: set if found; the
     *        runs of its column are appended to nodes->runs.
     * Fails: the errors of umb__pool_brick, and any failure that ends the bake. The pool must then
     *        be discarded.
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
