/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_H
/*
 * Depth paths: two ways from casters to the texels of tiles. Both give the same integers, because
 * coverage.h and depth_perspective.h decide every texel.
 *
 * Raster: scan conversion. Embree: one ray a texel, slower by an order of magnitude. Embree only
 * proposes candidates: every triangle is a user primitive with a padded box.
 *
 *     umbb_depth_raster_create(&casters, &options, &depth, &error);
 *     for every tile: depth.begin(depth.state, slot, &tile, &error);
 *                     depth.block(...) for every block, from any thread
 *     depth.destroy(depth.state);
 */
#include "bake/depth/proven_squares.h"
#include "bake/depth/tile_lists.h"

struct umbb_depth_options {
    uint32_t tile_log2; /* texels a side of a tile, log2 */
    unsigned threads;   /* number of threads that call block at once, 1.. */
    int plain;          /* 1: never use vector kernels (tests) */
    enum umbb_prove prove;
    size_t max_bytes; /* limit of the lists of triangles, bytes; 0 = no limit */
};

/* A depth path. One object serves one bake. */
struct umbb_depth {
    void *state;
    /* Lists of the triangles of each tile, part of `state`. NULL: the path has no lists (Embree).
     * Then tiles cannot be cached, and the path's memory is part of the plan (memory_plan.h). */
    struct umbb_tile_lists *lists;
    /* Prepares the path for a tile whose place and size are set, and proves squares of it where
     * possible. slot: 0 or 1, because two tiles may be in progress. */
    enum umb_status (*begin)(void *state, int slot, struct umbb_tile *tile,
                             struct umb_error *error);
    /* Fills texels and level 3 of the pyramid of block (bx, by), counted in blocks of UMBB_BLOCK
     * texels a side (or the whole tile if that is smaller). Threads: any, a block each. */
    void (*block)(void *state, int slot, unsigned thread, struct umbb_tile *tile, int32_t bx,
                  int32_t by);
    void (*destroy)(void *state);
};

/*
 * Creates a path.
 *
 * In:    casters: borrowed until the path is destroyed; their marks are not read.
 * Out:   depth: its destroy frees all.
 * Fails: E_NO_MEMORY, E_LIMIT (max_bytes), E_INTERNAL (with Embree's message).
 */
typedef enum umb_status umbb_depth_create_fn(const struct umbb_casters *casters,
                                             const struct umbb_depth_options *options,
                                             struct umbb_depth *depth, struct umb_error *error);

UMB_CHECKED umbb_depth_create_fn umbb_depth_raster_create;
UMB_CHECKED umbb_depth_create_fn umbb_depth_embree_create;

#endif
