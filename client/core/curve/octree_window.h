/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_CURVE_OCTREE_WINDOW_H
#define UMBRAGE_CORE_CURVE_OCTREE_WINDOW_H
/*
 * Windows counted in the exchange form, and what they read: counts that depend on the voxels alone,
 * not on how queries are laid out or tuned, so that they may stand in a file's identity.
 *
 * Cost: one visit for each node that the window touches.
 */
#include "format/octree.h"

struct umb__octree_window {
    const struct umb_octree *octree;
    uint32_t root;          /* whose voxels */
    uint32_t level;         /* 0, or where the look-up of a single voxel stops */
    int32_t x0, x1, y0, y1; /* inclusive, inside the frustum */
    int32_t z;
    uint64_t nodes; /* added to: distinct mixed nodes above bricks */
    uint64_t lines; /* added to: docs/reference/umb-format.md, CURV */
};

/* Lit texels of the window; of a single voxel with a level the halves of its cell: 0, 1 or 2. */
uint32_t umb__octree_window_count(struct umb__octree_window *window);

#endif
