/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_PARTIAL_SPACE_H
#define UMBRAGE_CORE_PARTIAL_PARTIAL_SPACE_H
/*
 * A view and the cubes of a frustum: which cubes may answer points inside the view, and how large
 * they appear. Rounding may add cubes, but never leaves one out.
 */
#include <stdbool.h>
#include "format/content.h"
#include "umbrage/partial.h"

/* One frustum's voxel space in the world. */
struct umb__space {
    double base[3];    /* World position of voxel coordinates (0, 0, 0), or the apex of a
                          perspective frustum */
    double step[3][3]; /* World vectors of a voxel along x, y (where W = 1 if perspective) and z */
    bool is_perspective;
    struct umb__perspective perspective; /* Zero of a frustum that is not */
    uint32_t log2_size;
    double edges[3]; /* Largest edges of a voxel along x, y, z, metres */
    double margin_m; /* Largest distance of a point's look-up from the point, metres */
};

/* A checked view with its planes. */
struct umb__sight {
    const struct umb_partial_view *view;
    double planes[4]
                 [4]; /* Sides of the camera's view, each a unit normal n and a distance d: a point
                         p is inside where dot(n, p) + d >= 0 */
};

/* A cube in relation to a view. */
struct umb__seen_cube {
    bool out;       /* True if no point in the view needs the cube */
    bool whole;     /* True if the whole cube lies in the view */
    double benefit; /* Square of edge over distance; without a camera, square of the edge */
    double edge_m, distance_m; /* Longest edge, and distance from the eye, metres */
};

/* Checks a view and computes its planes. Fails: E_ARGUMENT, naming the field. */
UMB_CHECKED enum umb_status umb__sight_init(struct umb__sight *sight,
                                            const struct umb_partial_view *view,
                                            struct umb_error *error);

/* Fills in the space of a frustum. In: view: its taps and bias_m widen the margin. */
void umb__space_init(struct umb__space *space, const struct umb__content *content, uint32_t frustum,
                     const struct umb_partial_view *view);

/* Returns the longest edge in metres of a cube of voxels whose first voxel is at depth z. In a
 * perspective frustum it is an edge of the cube's far side. Space behind the last voxel counts as
 * the last voxel. */
double umb__space_edge(const struct umb__space *space, uint32_t level, uint32_t z);

/* Returns whether a cube of 1 << level voxels a side may matter to the view, and its apparent size.
 * In: x, y, z: first voxel of the cube. */
struct umb__seen_cube umb__sight_cube(const struct umb__sight *sight,
                                      const struct umb__space *space, uint32_t level, uint32_t x,
                                      uint32_t y, uint32_t z);

#endif
