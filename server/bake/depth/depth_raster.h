/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_RASTER_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_RASTER_H
/*
 * Depth by scan conversion: the fast path for opaque triangles.
 *
 * Life: create bins the casters by tile, once. begin bins a tile's casters by block. block draws
 * them into three layers of integers (nearest front and back face of closed parts, nearest other
 * face) and decides lit and end; with AVX-512 cell by cell, without layers (depth_cells.h). A
 * minimum of integers does not depend on the order of drawing.
 */
#include "bake/depth/tile.h"

/* Size of the map's parts, and number of threads that call block at once. */
struct umbb_depth_options {
    uint32_t tile_log2;
    unsigned threads; /* 1.. */
    int plain;        /* 1: never use vector kernels (tests) */
    enum umbb_prove prove;
    size_t max_bytes; /* limit of the path's lists of triangles; 0 = no limit */
};

/*
 * Creates the path.
 *
 * In:    casters: borrowed until destroyed.
 * Out:   depth: its destroy frees all.
 * Fails: E_NO_MEMORY, E_LIMIT (max_bytes).
 */
UMB_CHECKED enum umb_status umbb_depth_raster_create(const struct umbb_casters *casters,
                                                     const struct umbb_depth_options *options,
                                                     struct umbb_depth *depth,
                                                     struct umb_error *error);

#endif
