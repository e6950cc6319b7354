/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_PARTIAL_SPACE_H
#define UMBRAGE_CORE_PARTIAL_PARTIAL_SPACE_H
/*
 * A view against the cubes of a frustum: which of them may answer points inside it, how large they
 * are seen. Everything errs on the side of too many.
 */
#include <stdbool.h>
#include "format/content.h"
#include "umbrage/partial.h"

/* One frustum's voxel space in the world. */
struct umb__space {
    double base[3];    /* world, where X = Y = 0 and Z = 0, or the apex of a perspective frustum */
    double step[3][3]; /* world vector of a voxel along x, y (at W = 1 if perspective) and z */
    double axis[3];    /* perspective: world vector of one W straight along the axis's row */
    double w0, w_step; /* perspective: W = w0 + w_step * Z */
    bool perspective;
    uint32_t log2_size;
    double edges[3]; /* largest edges of a voxel, metres */
    double margin_m; /* how far from a point its answer may be looked up */
};

/* A checked view with its planes. */
struct umb__sight {
    const struct umb_partial_view *view;
    double planes[4][4]; /* a camera's sides: inside where dot(n, p) + d >= 0, n of unit length */
};

/* A cube as a view sees it. */
struct umb__seen_cube {
    bool out;       /* nothing in it matters */
    bool whole;     /* all of it lies in the view */
    double benefit; /* square of the edge over the distance; of the edge alone without a camera */
    double edge_m, distance_m;
};

/* Fails: E_ARGUMENT, naming the field. */
UMB_CHECKED enum umb_status umb__sight_init(struct umb__sight *sight,
                                            const struct umb_partial_view *view,
                                            struct umb_error *error);

void umb__space_init(struct umb__space *space, const struct umb_content *content, uint32_t frustum,
                     const struct umb_partial_view *view);

/* The longest edge in metres of a cube of voxels whose first is at depth z: of a perspective
 * frustum that of its far side. What lies behind the last voxel counts as there. */
double umb__space_edge(const struct umb__space *space, uint32_t level, uint32_t z);

/* In: x, y, z: the cube's first voxel; level: its edge is 1 << level voxels. */
struct umb__seen_cube umb__sight_cube(const struct umb__sight *sight,
                                      const struct umb__space *space, uint32_t level, uint32_t x,
                                      uint32_t y, uint32_t z);

#endif
