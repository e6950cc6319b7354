/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_POLYGON_CLIP_H
#define UMBRAGE_SERVER_BAKE_IMPORT_POLYGON_CLIP_H
/*
 * Polygons into triangles without adding or dropping a corner.
 *
 * Every polygon of n corners gives exactly n - 2 triangles, whatever its shape (self-crossing,
 * repeated corners, no area), in the polygon's own winding. A simple polygon is covered exactly
 * once, unless it was cut roughly (see `rough`), which takes thousands of corners and a deliberate
 * shape. Corners in a straight line keep their place on an edge, so neighbours that share such a
 * corner still meet edge to edge.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBB_POLYGON_CORNERS_MAX 65536U

/* Working memory, reused from polygon to polygon. Zero it before first use. */
struct umbb_polygon {
    double (*points)[3]; /* [capacity], filled by the caller; owns the arrays below, too */
    double (*flat)[2];
    uint32_t *previous, *next;
    uint32_t *queue; /* ring buffer of corners that may be ears */
    uint8_t *flags;
    uint32_t *cells;     /* grid over the polygon: the first corner in each cell */
    uint32_t *cell_next; /* next corner in the same cell */
    uint32_t side;       /* number of cells along each axis */
    double low[2], extent[2];
    size_t queue_first, queue_count;
    uint64_t budget;    /* number of tests of a cell or a corner left for this polygon */
    uint64_t overdrawn; /* number of tests beyond the allowances, all polygons so far */
    uint32_t rough;     /* number of polygons so far that ran out of budget and end as a fan */
    uint32_t (*triangles)[3]; /* [capacity] corner numbers, the result */
    size_t capacity;
};

/* Makes room for `corners` corners. Fails: E_LIMIT (UMBB_POLYGON_CORNERS_MAX), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_polygon_reserve(struct umbb_polygon *polygon, size_t corners,
                                                 struct umb_error *error);

/*
 * Fills polygon->triangles with count - 2 triangles.
 *
 * In:    polygon->points: double[count][3], finite, count >= 3 and within the room reserved.
 * Cost:  about O(n) for usual polygons. At worst 128 n tests, and one pool of 2^26 for all polygons
 *        together (a second or so): no file can make its faces cost more than that. Allocates
 *        nothing.
 * Source: G. H. Meisters, Polygons have ears, Amer. Math. Monthly 82 (1975); D. Eberly,
 * Triangulation by Ear Clipping (2002): only the neighbours of a cut ear can change; normal of a
 * polygon that need not be flat: M. E. Newell, in Sutherland et al. 1974 (ACM Comp. Surveys 6/1).
 */
void umbb_polygon_triangulate(struct umbb_polygon *polygon, uint32_t count);

void umbb_polygon_finish(struct umbb_polygon *polygon);

#endif
