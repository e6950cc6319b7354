/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_CURVE_OCTREE_WINDOW_H
#define UMBRAGE_CORE_CURVE_OCTREE_WINDOW_H
/*
 * Counts windows in the octree, and their reads. The counts depend on the voxels only, not on the
 * layout or tuning of queries, so they may be part of a file's identity.
 *
 * Cost: one visit for each node that the window touches.
 */
#include "format/octree.h"

struct umb__octree_window {
    const struct umb__octree *octree;
    uint32_t root;          /* whose voxels */
    uint32_t level;         /* 0, or the level at which the look-up of a single voxel stops */
    int32_t x0, x1, y0, y1; /* inclusive, inside the frustum */
    int32_t z;
    uint64_t nodes; /* Added to: number of distinct mixed nodes above bricks */
    uint64_t lines; /* Added to: number of lines, see docs/reference/umb-format.md, CURV */
};

/* Returns the lit texels of the window; of a single voxel with a level the lit halves of its cell:
 * 0, 1 or 2. */
uint32_t umb__octree_window_count(struct umb__octree_window *window);

#endif
