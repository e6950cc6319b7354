/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_COVERAGE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_COVERAGE_H
/*
 * The predicate: which texel centres a triangle covers, and at which depth. All depth paths use
 * this one definition, so no two of them can disagree.
 *
 * Voxel space, doubles. Texel (x, y) has its centre at (x + 0.5, y + 0.5). The corners are put into
 * canonical order (by y, then x, then z), so that the answer does not depend on the winding or on
 * the corner that the file starts with.
 *
 * Coverage: the row of centres py meets edge (a, b), a.y < b.y, iff a.y <= py < b.y; it crosses
 * there at a.x + (py - a.y) * ((b.x - a.x) / (b.y - a.y)), clamped to a.x .. b.x. A row meets
 * exactly two edges of a triangle or none. The covered centres are those between the two crossings,
 * both included. If the two crossings are the same number nothing is covered: a corner only touches
 * the row, or a sliver has no width left. Watertight: two triangles that share an edge compute the
 * same crossing from the same two corners, and a centre on it belongs to both.
 *
 * Facing is decided row by row, by the order of the two crossings. Consider spans that include one
 * crossing and not the other. A closed and consistently oriented surface then has exactly as many
 * front as back spans over each centre, because each edge's crossing ends what it begins. The
 * rounding of a sliver's area plays no part. So no column enters a solid without leaving it, and
 * `end` never runs on to the background through a missing back face.
 *
 * Depth: z = (a.z + gy * (py - a.y)) + gx * (px - a.x) from the canonical first corner a, with
 * gradients computed once a triangle, clamped to the triangle's least and greatest z. It is never
 * incremental: no tile, clip rectangle or thread changes a bit. `lit` of a fragment is the number
 * of voxels of the column whose centre z + 0.5 lies before it: ceil(z - 0.5), in 0..size.
 *
 * A triangle of zero projected area covers nothing, unless rounding keeps its crossings apart. The
 * spans of its neighbours then end at the same crossings.
 */
#include <stddef.h>
#include <stdint.h>

/* Limit of a corner's coordinate in magnitude (voxels); it must also be finite. */
#define UMBB_COORDINATE_MAX 1073741824.0

/* A triangle prepared by umbb_coverage_prepare. */
struct umbb_coverage {
    double x[3], y[3]; /* corners in canonical order */
    double slope[3];   /* dx/dy of the edges 0-1, 1-2 and 0-2; 0 where the edge has no height */
    double anchor_z;   /* depth of corner 0 */
    double gradient_x, gradient_y;
    double z_min, z_max;         /* range of depth, clamped to 0..size */
    int32_t row_first, row_last; /* rows of centres that it meets: none if row_first > row_last */
    int32_t odd;                 /* 1 if canonical order reversed the original winding */
    /* 1 if the triangle seems to face the light by the sign of its area, which rounding can
     * reverse. umbb_coverage_row decides this for each row. */
    int32_t facing;
};

/* The vector forms write sixteen numbers, the last two of which are pairs of integers. */
_Static_assert(sizeof(struct umbb_coverage) == 16 * sizeof(double) &&
                   offsetof(struct umbb_coverage, slope) == 6 * sizeof(double) &&
                   offsetof(struct umbb_coverage, anchor_z) == 9 * sizeof(double) &&
                   offsetof(struct umbb_coverage, z_min) == 12 * sizeof(double) &&
                   offsetof(struct umbb_coverage, row_first) == 14 * sizeof(double) &&
                   offsetof(struct umbb_coverage, odd) == 15 * sizeof(double) &&
                   offsetof(struct umbb_coverage, facing) == 15 * sizeof(double) + sizeof(int32_t),
               "the numbers of a coverage lie as vectors write them");

/*
 * Prepares a triangle.
 *
 * In:    corners: double[3][3], voxel space, original winding. size: voxels of the column.
 * Out:   coverage: set if 1 is returned. 0: the triangle covers no texel centre.
 * Cost:  four divisions, no allocation.
 */
int umbb_coverage_prepare(const double corners[3][3], int32_t size, struct umbb_coverage *coverage);

/* Computes x where a row of centres enters (low) and leaves (high) a triangle, counted from the
 * centre of texel 0. low may equal high. Returns the same as umbb_coverage_row. */
static inline int umbb_coverage_crossings(const struct umbb_coverage *coverage, int32_t row,
                                          double *low, double *high)
{
    const double py = (double)row + 0.5;
    /* The crossed edges: the long edge 0-2, and a short one that the height of corner 1 selects. */
    const int upper = py >= coverage->y[1];
    const int from = upper ? 1 : 0;
    const int to = upper ? 2 : 1;
    const double xa = coverage->x[from], xb = coverage->x[to];
    double one = xa + (py - coverage->y[from]) * coverage->slope[upper];
    const double one_min = xa < xb ? xa : xb, one_max = xa < xb ? xb : xa;
    one = one > one_min ? one : one_min; /* NaN becomes one_min too */
    one = one < one_max ? one : one_max;
    const double xc = coverage->x[0], xd = coverage->x[2];
    double two = xc + (py - coverage->y[0]) * coverage->slope[2];
    const double two_min = xc < xd ? xc : xd, two_max = xc < xd ? xd : xc;
    two = two > two_min ? two : two_min;
    two = two < two_max ? two : two_max;
    *low = (one < two ? one : two) - 0.5;
    *high = (one > two ? one : two) - 0.5;
    /* Light travels along +z and voxel space is right handed. So corners in canonical order make a
     * front face if corner 1 lies on the side of small x. */
    return (one < two) != coverage->odd;
}

/*
 * Finds the texels that a row covers: x_first .. x_last, empty if x_first > x_last.
 *
 * In:  row: row_first <= row <= row_last.
 * Out: returns 1 if the triangle, by its original winding, faces the light in this row, else 0.
 */
static inline int umbb_coverage_row(const struct umbb_coverage *coverage, int32_t row,
                                    int32_t *x_first, int32_t *x_last)
{
    double low, high;
    const int front = umbb_coverage_crossings(coverage, row, &low, &high);
    /* Ceiling and floor by truncation: |low| is far below 2^31 (UMBB_COORDINATE_MAX). */
    int32_t first = (int32_t)low;
    first += (double)first < low;
    int32_t last = (int32_t)high;
    last -= (double)last > high;
    *x_first = first;
    *x_last = low < high ? last : first - 1;
    return front;
}

/* Finds the rows among y0 .. y0 + n - 1 that a triangle meets: none if *first > *last. */
static inline void umbb_coverage_rows_within(const struct umbb_coverage *coverage, int32_t y0,
                                             int32_t n, int32_t *first, int32_t *last)
{
    const int32_t bottom = y0 + n - 1;
    *first = coverage->row_first > y0 ? coverage->row_first : y0;
    *last = coverage->row_last < bottom ? coverage->row_last : bottom;
}

/* Does umbb_coverage_row, clipped to texels x0 .. x0 + n - 1. span: first and last covered
 * texel. */
static inline int umbb_coverage_row_within(const struct umbb_coverage *coverage, int32_t row,
                                           int32_t x0, int32_t n, int32_t span[2])
{
    const int32_t right = x0 + n - 1;
    const int front = umbb_coverage_row(coverage, row, &span[0], &span[1]);
    span[0] = span[0] > x0 ? span[0] : x0;
    span[1] = span[1] < right ? span[1] : right;
    return front;
}

/* Does umbb_coverage_row, but leaves out centres on the second crossing, for callers that count
 * fragments. A centre on the edge of two adjacent triangles then belongs to only one of them. */
static inline void umbb_coverage_row_once(const struct umbb_coverage *coverage, int32_t row,
                                          int32_t *x_first, int32_t *x_last)
{
    double low, high;
    (void)umbb_coverage_crossings(coverage, row, &low, &high);
    int32_t first = (int32_t)low;
    first += (double)first < low;
    int32_t last = (int32_t)high;
    last -= (double)last >= high;
    *x_first = first;
    *x_last = low < high ? last : first - 1;
}

/* Returns the number of voxels whose centre lies before depth z, which is within int32_t. */
static inline int32_t umbb_coverage_round(double z)
{
    const double t = z - 0.5;
    const int32_t lit = (int32_t)t;
    return lit + ((double)lit < t);
}

/* Returns the depth of the row at the anchor's x, which is the same for all texels of the row. */
static inline double umbb_coverage_row_z(const struct umbb_coverage *coverage, int32_t row)
{
    return coverage->anchor_z + coverage->gradient_y * (((double)row + 0.5) - coverage->y[0]);
}

/* Returns the number of voxels of column x whose centre lies before the triangle, 0..size. */
static inline int32_t umbb_coverage_lit(const struct umbb_coverage *coverage, double row_z,
                                        int32_t x)
{
    double z = row_z + coverage->gradient_x * (((double)x + 0.5) - coverage->x[0]);
    z = z > coverage->z_min ? z : coverage->z_min; /* NaN becomes z_min too */
    z = z < coverage->z_max ? z : coverage->z_max;
    return umbb_coverage_round(z);
}

#endif
