/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_TILE_LOOP_H
#define UMBRAGE_SERVER_BAKE_BUILD_TILE_LOOP_H
/*
 * The core of a bake: from tiles of depth to the merged octree.
 *
 * The threads build the nodes of a tile and draw the depth of the next one, and the owner gathers
 * the nodes (tile_squares.h): two tiles are in memory at a time. The levels above the tiles are
 * built at the end from each tile's column. Equal casters give equal octrees up to numbering, for
 * every tile size and number of threads.
 */
#include "bake/build/columns.h"
#include "bake/build/static_rule.h"
#include "bake/depth/depth.h"
#include "format/occluder_depth_build.h"

/* Figures of a bake, for the summary. */
struct umbb_bake_figures {
    uint64_t texels; /* texels that were processed: without tiles that the tile cache had */
    uint64_t tiles;
    uint64_t tiles_found; /* tiles that the tile cache had */
    double seconds_depth; /* time of waiting for depth, without building */
    double seconds_build;
    size_t octree_bytes; /* size at the end, tables included */
};

/*
 * A cache of tiles' results between bakes, as two functions. The tile loop asks the cache for each
 * tile before drawing the tile, and gives the cache each tile that was built.
 *
 * A tile's result is what the levels above the tile and the pool need: the greatest lit, the least
 * end, the column, and the nodes that the column's runs refer to.
 * Threads: both functions are called by the owner of the loop only.
 */
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

struct umbb_bake_options {
    uint32_t log2_size; /* size of the frustum */
    uint32_t tile_log2; /* 6 .. log2_size */
    unsigned threads;   /* 1.. */
    int closed_rule;
    size_t octree_max_bytes;
    /* Limit in bytes of three things together: the octree, the columns kept for the levels above
     * the tiles, and the depth path's lists of triangles; 0 = no limit. */
    size_t shared_max_bytes;
    /* First tile to bake, and the tile after the last one. If only_end is above only_first, the
     * other tiles are left out; the pool is empty after the bake, and there is no root. */
    uint32_t only_first, only_end;
    const struct umbb_cached_tiles *cached_tiles; /* may be NULL; borrowed */
    /* [2] Memory of tiles, zeroed before the first of several frusta and kept from one to the next,
     * because fresh pages cost time. The caller finishes both. NULL: memory for this bake alone. */
    struct umbb_tile *tiles;
    /* Receives the first occluders; NULL: they are not kept. With an occluder depth map no square
     * is proven from bounds, and a tile cache keeps first occluders too. */
    struct umb__occluder_depth *occluder_depth;
    /* The static rule after umbb_static_init; NULL: receivers may be anywhere. Under the static
     * rule there is no tile cache, no occluder depth map, no square proven from bounds, and no
     * choice of tiles; the depth path draws each tile twice. */
    struct umbb_static *rule;
    int (*cancelled)(void); /* may be NULL; from any thread */
    /* Progress callback, called by the owner; may be NULL. tiles: number of finished tiles.
     * tiles_found: how many of these the tile cache had; texels_done leaves them out. */
    void (*progress)(void *user, uint64_t texels_done, uint64_t tiles, uint64_t tiles_found);
    void *progress_user;
};

/*
 * Bakes one frustum into a pool that several frusta may share. Equal nodes exist once.
 *
 * In:    depth: created for the same casters, tile size and threads. pool: holds the nodes of
 *        frusta baked before; its limit is replaced by the options'.
 * Out:   root: the frustum's root, of level log2_size. figures: may be NULL.
 * Fails: E_NO_MEMORY, E_LIMIT (either limit), E_CANCELLED, and the errors of the tile cache. The
 *        pool then holds more nodes than its roots reach: discard it.
 */
UMB_CHECKED enum umb_status umbb_bake_into(const struct umbb_depth *depth,
                                           const struct umbb_bake_options *options,
                                           struct umb__pool *pool, uint32_t *root,
                                           struct umbb_bake_figures *figures,
                                           struct umb_error *error);

/* Bytes of all tiles that a bake has in memory. */
size_t umbb_bake_tile_bytes(uint32_t log2_size, uint32_t tile_log2, int closed_rule);

#endif
