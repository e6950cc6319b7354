/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_SLICE_COUNT_H
#define UMBRAGE_CORE_QUERY_SLICE_COUNT_H
/*
 * Windows of any width in one slice of depth: uniform cubes are taken whole, so that the cost grows
 * with the shadow's edges inside the window and not with its area. For penumbras and footprints;
 * the kernels answer windows of a fixed few texels faster.
 */
#include "query/query_parts.h"
#include "query/voxel_tree.h"

/* Texels x0 <= x <= x1, y0 <= y <= y1; empty where x0 > x1 or y0 > y1. */
struct umb__texels {
    int64_t x0, x1, y0, y1;
};

/* One slice of a frustum. */
struct umb__slice {
    const struct umb__tree *tree;
    struct umb_query_stats *stats; /* nodes and bricks are added to */
    int64_t z;                     /* before 0: all lit; behind the last: the last */
};

/* A box as wide as real numbers, in texels, around the middle of a texel. */
struct umb__real_box {
    int64_t x, y;
    double width, height; /* 1 and up */
};

/* Returns whether a texel of the rectangle has the state; beyond the frustum all are lit. Stops at
 * the first. */
bool umb__slice_has(const struct umb__slice *slice, struct umb__texels texels, bool lit);

/*
 * Returns the lit share of a box, 0..1: texels that it covers in part count by that part.
 * Continuous in width and height; for odd ones the plain n x m box. Beyond the frustum all is lit.
 */
double umb__slice_share(const struct umb__slice *slice, const struct umb__real_box *box);

static inline struct umb__tree umb__tree_of(const struct umb__query *q)
{
    return (struct umb__tree){.grid = q->grid,
                              .nodes = q->nodes,
                              .bricks = q->bricks,
                              .log2_size = q->log2_size,
                              .grid_log2 = q->grid_log2};
}

/* Stores a share as umb_answer_format says. Bytes and bits are those of the float that it rounds
 * to: stages behind one another hand on floats, and which of them ran must not show. */
void umb__store_share(void *values, enum umb_answer_format format, size_t i, double share);

#endif
