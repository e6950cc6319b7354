/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_CACHED_TILES_H
#define UMBRAGE_SERVER_BAKE_BUILD_CACHED_TILES_H
/*
 * A cache of tiles' results between bakes, as two functions. The tile loop asks for each tile
 * before it draws it, and hands over what it has built.
 *
 * A tile's result is all that the levels above the tile and the pool need of it: the greatest lit,
 * the least end, the column and the nodes that its runs lead to.
 * Threads: both functions are called by the owner of the loop only.
 */
#include "bake/build/columns.h"

struct umbb_tile_result {
    int32_t max_lit, min_end; /* of all its texels, or bounds of them (proven_squares.h) */
    struct umbb_column column;
};

/* Which tile is meant: its first texel, and its number in the frustum, row by row. */
struct umbb_tile_place {
    int32_t x0, y0;
    uint32_t number;
};

struct umbb_cached_tiles {
    void *user;
    /*
     * Finds a tile's result and adds its nodes to the pool.
     *
     * In:    max_bytes: working memory that it may take beside the pool.
     * Out:   found: 0 if the tile is to be baked; result and runs are left alone then. Else
     *        result: its column's runs are the last of `runs`.
     * Fails: as umb_pool_brick; whatever else ends the bake. The pool is to be given up then.
     */
    enum umb_status (*find)(void *user, const struct umbb_tile_place *place, size_t max_bytes,
                            struct umb_pool *pool, struct umbb_runs *runs,
                            struct umbb_tile_result *result, int *found, struct umb_error *error);
    /* Takes a copy of a result. Fails: only where the bake is to end for it. */
    enum umb_status (*keep)(void *user, const struct umbb_tile_place *place, size_t max_bytes,
                            const struct umb_pool *pool, const struct umbb_runs *runs,
                            const struct umbb_tile_result *result, struct umb_error *error);
};

#endif
