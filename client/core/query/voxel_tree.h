/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_VOXEL_TREE_H
#define UMBRAGE_CORE_QUERY_VOXEL_TREE_H
/*
 * Reads one frustum of the mapped layout by voxels: finds a voxel, and the cube around it that has
 * one state. Volume queries and explanations use this; the kernels for points have their own
 * descent. The layout is in format/view.h.
 */
#include <stdbool.h>
#include <stdint.h>
#include "format/view.h"
#include "umbrage/volume.h"

struct umb__tree {
    const uint32_t *grid; /* Cells of the frustum */
    const uint64_t *nodes;
    const uint64_t (*bricks)[8];
    uint32_t log2_size; /* The frustum has 1 << log2_size voxels a side */
    uint32_t grid_log2; /* The grid has 1 << grid_log2 cells a side */
};

/* The place of a voxel in the tree: the largest aligned uniform cube around the voxel, or its
 * brick. */
struct umb__place {
    const uint64_t *brick; /* [8], a depth slice each; NULL: the cube is all lit or all shadowed */
    uint32_t level;        /* Level of the cube, which is 1 << level voxels wide; 3 for a brick */
    bool lit;              /* State of the cube, if brick is NULL */
};

/* Content of a cell, or of a wide node's child: a uniform state, or the number of a node or
 * brick. */
struct umb__link {
    bool mixed, lit;
    uint32_t number; /* If mixed: word of a wide node, or number of a brick */
};

static inline int32_t umb__min(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

static inline int32_t umb__max(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

/* A rectangle of texels x0 <= x <= x1, y0 <= y <= y1; empty where x0 > x1 or y0 > y1. */
struct umb__rectangle {
    int32_t x0, x1, y0, y1;
};

/* Returns the bits of an 8x8 slice's texels in the rectangle. In: x, y: the slice's first texel. */
static inline uint64_t umb__slice_mask(int32_t x, int32_t y, const struct umb__rectangle *in)
{
    const int32_t left = umb__max(in->x0 - x, 0), right = umb__min(in->x1 - x, 7);
    const int32_t top = umb__max(in->y0 - y, 0), bottom = umb__min(in->y1 - y, 7);
    if (left > right || top > bottom) {
        return 0;
    }
    const uint64_t row = (0xffU >> (7 - right)) & (0xffU << left);
    return row * UINT64_C(0x0101010101010101) & UINT64_MAX << (8 * top) &
           UINT64_MAX >> (8 * (7 - bottom));
}

/* Returns the level of the grid's cells. */
static inline uint32_t umb__tree_cell_level(const struct umb__tree *tree)
{
    return tree->log2_size - tree->grid_log2;
}

/* Reads cell (x, y, z) of the grid, in cells. */
static inline struct umb__link umb__tree_cell(const struct umb__tree *tree, uint32_t x, uint32_t y,
                                              uint32_t z)
{
    uint32_t g = tree->grid_log2;
    uint32_t value = tree->grid[(size_t)x + ((size_t)y << g) + ((size_t)z << (2 * g))];
    if (value < UMB__CELL_FIRST) {
        return (struct umb__link){false, value == UMB__CELL_LIT, 0};
    }
    return (struct umb__link){true, false, value - UMB__CELL_FIRST};
}

/* Reads a child of the wide node at word `number`. In: child: x + 4 * y + 16 * z, 0..63. */
static inline struct umb__link umb__tree_child(const struct umb__tree *tree, uint32_t number,
                                               unsigned child)
{
    const uint64_t *node = tree->nodes + number;
    if (!(node[0] >> child & 1)) {
        return (struct umb__link){false, node[1] >> child & 1, 0};
    }
    return (struct umb__link){true, false, umb__wide_child(node, child)};
}

/* Returns the child of a node of level `level + 2` that holds voxel (x, y, z). */
static inline unsigned umb__child_at(uint32_t level, uint32_t x, uint32_t y, uint32_t z)
{
    return (x >> level & 3) | (y >> level & 3) << 2 | (z >> level & 3) << 4;
}

/* Finds the cube or brick of a voxel inside the frustum. The descent ends: levels fall by two down
 * to bricks. */
static inline struct umb__place umb__tree_locate(const struct umb__tree *tree, uint32_t x,
                                                 uint32_t y, uint32_t z,
                                                 struct umb_volume_stats *stats)
{
    uint32_t level = umb__tree_cell_level(tree);
    struct umb__link link = umb__tree_cell(tree, x >> level, y >> level, z >> level);
    stats->nodes++;
    while (link.mixed && level > UMB_LEVEL_BRICK) {
        level -= 2;
        link = umb__tree_child(tree, link.number, umb__child_at(level, x, y, z));
        stats->nodes++;
    }
    stats->bricks += link.mixed;
    return (struct umb__place){link.mixed ? tree->bricks[link.number] : NULL, level, link.lit};
}

/* Returns the state of a voxel in its brick. */
static inline bool umb__brick_voxel(const uint64_t brick[8], uint32_t x, uint32_t y, uint32_t z)
{
    return brick[z & 7] >> ((x & 7) + 8 * (y & 7)) & 1;
}

/* Returns the first shadowed slice of a column in a brick, from slice z on; 8 if there is none. */
static inline uint32_t umb__brick_depth(const uint64_t brick[8], uint32_t x, uint32_t y, uint32_t z)
{
    while (z < 8 && umb__brick_voxel(brick, x, y, z)) {
        z++;
    }
    return z;
}

#endif
