/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_SLICE_COUNT_H
#define UMBRAGE_CORE_QUERY_SLICE_COUNT_H
/*
 * Windows of any width in one slice of depth. Uniform cubes are counted whole, so the cost grows
 * with the shadow's edges inside the window and not with its area. It serves penumbras and
 * footprints; the kernels are faster for windows of a fixed few texels.
 */
#include "query/query_parts.h"

/* Texels x0 <= x <= x1, y0 <= y <= y1; empty where x0 > x1 or y0 > y1. */
struct umb__texels {
    int64_t x0, x1, y0, y1;
};

/* One slice of a frustum. */
struct umb__slice {
    const struct umb__tree *tree;
    struct umb_query_stats *stats; /* Numbers of nodes and bricks read, which calls increase */
    int64_t z; /* Depth of the slice in voxels; below 0 all is lit; beyond the frustum it counts as
                  the last voxel */
};

/* A box of real width in texels, around the middle of a texel. */
struct umb__real_box {
    int64_t x, y;
    double width, height; /* Size in texels, at least 1 */
};

/* Returns whether a texel of the rectangle has state `lit`. Texels beyond the frustum are lit. The
 * search stops at the first such texel. */
bool umb__slice_has(const struct umb__slice *slice, struct umb__texels texels, bool lit);

/*
 * Returns the lit share of a box, 0..1. Partly covered texels count by their covered part, so the
 * share is continuous in width and height. A box of odd size is a plain n x m box. Texels beyond
 * the frustum are lit.
 */
double umb__slice_share(const struct umb__slice *slice, const struct umb__real_box *box);

/* Stores a share in an answer format. Bytes and bits are computed from the share rounded to a
 * float, because stages pass floats on and the result must not depend on which stages ran. */
void umb__store_share(void *values, enum umb_answer_format format, size_t i, double share);

#endif
