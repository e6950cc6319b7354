/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_PARTIAL_SPACE_H
#define UMBRAGE_CORE_PARTIAL_PARTIAL_SPACE_H
/*
 * A view and the cubes of a frustum: which cubes may answer points inside the view, and how large
 * they appear. All errors are towards too many cubes.
 */
#include <stdbool.h>
#include "format/content.h"
#include "umbrage/partial.h"

/* One frustum's voxel space in the world. */
struct umb__space {
    double base[3];    /* World position of X = Y = 0 and Z = 0, or the apex of a perspective
                          frustum */
    double step[3][3]; /* world vector of a voxel along x, y (at W = 1 if perspective) and z */
    double axis[3];    /* Perspective: world vector along the axis for a step of 1 in W */
    double w0, w_step; /* perspective: W = w0 + w_step * Z */
    bool perspective;
    uint32_t log2_size;
    double edges[3]; /* largest edges of a voxel, metres */
    double margin_m; /* Largest distance of a point's look-up from the point, metres */
};

/* A checked view with its planes. */
struct umb__sight {
    const struct umb_partial_view *view;
    double planes[4][4]; /* a camera's sides: inside where dot(n, p) + d >= 0, n of unit length */
};

/* A cube in relation to a view. */
struct umb__seen_cube {
    bool out;       /* nothing in it matters */
    bool whole;     /* True if the whole cube lies in the view */
    double benefit; /* Square of its edge over its distance; of its edge alone without a camera */
    double edge_m, distance_m;
};

/* Fails: E_ARGUMENT, naming the field. */
UMB_CHECKED enum umb_status umb__sight_init(struct umb__sight *sight,
                                            const struct umb_partial_view *view,
                                            struct umb_error *error);

void umb__space_init(struct umb__space *space, const struct umb__content *content, uint32_t frustum,
                     const struct umb_partial_view *view);

/* Returns the longest edge in metres of a cube of voxels whose first is at depth z; in a
 * perspective frustum that of its far side. Space behind the last voxel counts as the last
 * voxel. */
double umb__space_edge(const struct umb__space *space, uint32_t level, uint32_t z);

/* In: x, y, z: the cube's first voxel; level: its edge is 1 << level voxels. */
struct umb__seen_cube umb__sight_cube(const struct umb__sight *sight,
                                      const struct umb__space *space, uint32_t level, uint32_t x,
                                      uint32_t y, uint32_t z);

#endif
