/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_CURVE_CURVE_MEASURE_H
#define UMBRAGE_CORE_CURVE_CURVE_MEASURE_H
/*
 * Measures the accuracy curve of an asset during its bake: queries the octree at points on the
 * scene's surfaces, with every setting of the curve.
 *
 * The sums depend on content, octree and points only, so they are equal on every machine and for
 * all query kernels.
 */
#include "format/content.h"
#include "umbrage/curve.h"

/* Most rows of one light: nine filters, and levels 3, 5, ... 13. */
#define UMB__CURVE_TAPS_COUNT 9U

/*
 * Measures the rows of one light.
 *
 * In:    content: lights, frusta and origin are read. octree: canonical, a root for each frustum.
 *        points: on surfaces, with normals towards the light; at most UMB__CURVE_POINTS_MAX,
 *        finite. Points whose normal faces away do not count. workers: helpers, which share the
 *        settings; NULL: the calling thread does everything.
 * Out:   records: [UMB_CURVE_ROWS_MAX], ascending. count: number of records, 0 if no point counts.
 * Fails: E_NO_MEMORY, E_NOT_FOUND (light).
 * Cost:  about 20 us a point at 16384 voxels a side.
 */
UMB_CHECKED enum umb_status umb__curve_measure(const struct umb__content *content,
                                               const struct umb__octree *octree, uint32_t light,
                                               const struct umb_points *points,
                                               const struct umb_workers *workers,
                                               struct umb__curve_record records[UMB_CURVE_ROWS_MAX],
                                               uint32_t *count, struct umb_error *error);

/* A window of the octree, and what reading it costs. */
struct umb__octree_window {
    const struct umb__octree *octree;
    uint32_t root;  /* Number of the root, a frustum's */
    uint32_t level; /* Level at which the look-up of a single voxel stops; 0: at the voxel */
    int32_t x0, x1, y0, y1; /* First and last texel, inside the frustum */
    int32_t z;
    uint64_t nodes; /* Added to: number of distinct mixed nodes above bricks */
    uint64_t lines; /* Added to: number of lines, see docs/reference/umb-format.md, CURV */
};

/* Returns the number of lit texels of a window. For a single voxel whose look-up stops at a level
 * it returns the state of the cell at that level in halves: 0 is shadowed, 1 is mixed, 2 is lit.
 * The counts depend on the voxels only, not on the layout or tuning of queries, so they may be part
 * of a file's identity. Cost: one visit for each node that the window touches. */
uint32_t umb__octree_window_count(struct umb__octree_window *window);

#endif
