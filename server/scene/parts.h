/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_PARTS_H
#define UMBRAGE_SERVER_SCENE_PARTS_H
/*
 * Connected parts of a triangle soup and whether each is a closed solid.
 *
 * Corners are welded by exact position (bit equality after -0 becomes 0). Two triangles are
 * connected if they share a welded edge. A part is closed if every edge is used by exactly two
 * triangles, once in each direction (edge-manifold and consistently oriented). Degenerate
 * triangles (two equal corners, or zero area in doubles) belong to no part.
 *
 * Orientation: outward solids have positive signed volume. A closed part of negative volume is
 * turned around (`flipped`) unless its box lies inside the box of a closed part of positive volume:
 * then it is taken for a cavity and left alone. The search for such a box is limited
 * (parts_nest.h). A part that is left alone wrongly costs bytes, never a wrong shadow.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/geom.h"
#include "umbrage/status.h"

struct umbs_part {
    size_t triangle_count;
    size_t boundary_edges;     /* number of edges of one triangle */
    size_t nonmanifold_edges;  /* number of edges of three or more triangles */
    size_t inconsistent_edges; /* number of edges that two triangles use in the same direction */
    double volume;             /* signed volume in cubic metres */
    struct umb_box box;
    double hole[3];       /* midpoint of the first bad edge, if the part is not closed */
    size_t cut_triangles; /* number of triangles with holes (umbs_cuts_open_parts) */
    /* Number of triangles that let light through (umbs_cuts_open_parts). */
    size_t translucent_triangles;
    int closed;
    int flipped;
};

struct umbs_parts {
    size_t part_count;
    struct umbs_part *parts; /* [part_count] parts, in the order of their first triangles */
    uint32_t *part_of;       /* [count] part of each triangle; UINT32_MAX: degenerate */
    uint8_t *closed;         /* [count] 1: the triangle is in a closed part */
    size_t degenerate_count; /* number of degenerate triangles */
    size_t closed_triangles; /* number of triangles in closed parts */
    /* Number of triangles with the same three corners as an earlier one, in any order. */
    size_t duplicate_triangles;
};

/*
 * Finds the parts.
 *
 * In:    corners: double[count][3][3], world space; borrowed during the call.
 * Out:   parts: finish with umbs_parts_finish.
 * Fails: E_NO_MEMORY, E_TOO_LARGE (above 1431655764 triangles); parts is then zeroed.
 * Cost:  O(count) with hashing; while it runs about 100 bytes a triangle of a mesh, up to 190 of a
 *        soup in which every triangle is a part of its own.
 */
UMB_CHECKED enum umb_status umbs_parts_find(const double (*corners)[3][3], size_t count,
                                            struct umbs_parts *parts, struct umb_error *error);
void umbs_parts_finish(struct umbs_parts *parts);

/* Turns one triangle around: its other side becomes its front. */
void umbs_triangle_turn(double corners[3][3]);

/*
 * Turns the triangles of flipped parts around, so that all closed parts wind outward (cavities
 * inward). Ray tracing, and any test of front against back, needs this once after umbs_parts_find.
 *
 * In: corners: double[count][3][3] that parts was found from; changed in place.
 */
void umbs_parts_orient(const struct umbs_parts *parts, double (*corners)[3][3], size_t count);

/* Writes why a part is not closed, in words: "12 boundary edges, 1 edge of three or more triangles
 * (first at 1.5 2 0)", or "closed". The text is cut at size - 1 bytes. */
void umbs_part_reason(const struct umbs_part *part, char *text, size_t size);

#endif
