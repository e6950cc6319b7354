/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_COVERAGE_LANES_H
#define UMBRAGE_SERVER_BAKE_DEPTH_COVERAGE_LANES_H
/*
 * umbb_coverage_prepare for LANES triangles at a time: its operations in the same order, without
 * fused multiply-add, so the bits are the same. Corners are loaded and coverages stored as rows of
 * numbers of one triangle. In between they are transposed, so that a register holds one number of
 * LANES triangles.
 *
 * coverage_avx2.c and coverage_avx512.c include this file once each, after defining LANES; the
 * types lanes (doubles), mask and ints (32 bits); the macros LOAD, SAVE, ALL_OF, LEAST, MOST, LESS,
 * EQUAL, BOTH, EITHER, DIFFER, SELECT and KEPT; the functions transpose, first_centre, minus_one,
 * choose, ones and pairs; and PREPARE, the name of the result.
 */

/* A coverage is sixteen numbers, the last two of which are pairs of integers. */
_Static_assert(sizeof(struct umbb_coverage) == 16 * sizeof(double), "whole rows");

/* One corner of each triangle. */
struct corner {
    lanes x, y, z;
};

/* Orders two corners canonically; returns the lanes in which they were swapped. */
static inline mask order(struct corner *a, struct corner *b)
{
    const mask x = EITHER(LESS(b->x, a->x), BOTH(EQUAL(a->x, b->x), LESS(b->z, a->z)));
    const mask later = EITHER(LESS(b->y, a->y), BOTH(EQUAL(a->y, b->y), x));
    const struct corner first = *a;
    a->x = SELECT(later, b->x, a->x);
    a->y = SELECT(later, b->y, a->y);
    a->z = SELECT(later, b->z, a->z);
    b->x = SELECT(later, first.x, b->x);
    b->y = SELECT(later, first.y, b->y);
    b->z = SELECT(later, first.z, b->z);
    return later;
}

static inline lanes edge_slope(const struct corner *a, const struct corner *b)
{
    return KEPT(LESS(a->y, b->y), (b->x - a->x) / (b->y - a->y));
}

/* Lanes that are finite: for other values v - v is not 0. */
static inline mask are_finite(lanes v)
{
    return EQUAL(v - v, ALL_OF(0.0));
}

static inline lanes clamp(lanes v, lanes high)
{
    return LEAST(MOST(v, ALL_OF(0.0)), high);
}

/* Computes the coverages. numbers: receives the fields of struct umbb_coverage in their order. */
static inline void prepare_lanes(struct corner v[3], lanes size, lanes numbers[16])
{
    mask odd = order(&v[0], &v[1]);
    odd = DIFFER(odd, order(&v[1], &v[2]));
    odd = DIFFER(odd, order(&v[0], &v[1]));
    const ints first = first_centre(v[0].y);
    const lanes ux = v[1].x - v[0].x, wx = v[2].x - v[0].x;
    const lanes uy = v[1].y - v[0].y, wy = v[2].y - v[0].y;
    const lanes uz = v[1].z - v[0].z, wz = v[2].z - v[0].z;
    const lanes area = ux * wy - uy * wx;
    const lanes gx = (uz * wy - uy * wz) / area, gy = (ux * wz - uz * wx) / area;
    const mask finite = BOTH(are_finite(gx), are_finite(gy));
    /* No rows: all corners have the same x. */
    const mask thin = BOTH(EQUAL(v[0].x, v[1].x), EQUAL(v[1].x, v[2].x));
    const ints last = minus_one(choose(thin, first, first_centre(v[2].y)));
    for (size_t i = 0; i < 3; i++) {
        numbers[i] = v[i].x;
        numbers[3 + i] = v[i].y;
    }
    numbers[6] = edge_slope(&v[0], &v[1]);
    numbers[7] = edge_slope(&v[1], &v[2]);
    numbers[8] = edge_slope(&v[0], &v[2]);
    numbers[9] = v[0].z;
    numbers[10] = KEPT(finite, gx);
    numbers[11] = KEPT(finite, gy);
    numbers[12] = clamp(LEAST(LEAST(v[0].z, v[1].z), v[2].z), size);
    numbers[13] = clamp(MOST(MOST(v[0].z, v[1].z), v[2].z), size);
    numbers[14] = pairs(first, last);
    numbers[15] = pairs(ones(odd), ones(DIFFER(LESS(area, ALL_OF(0.0)), odd)));
}

/* Loads the corners of the triangles: eight numbers of each triangle as a row, the ninth apart. */
static inline void corners_load(const double (*corners)[3][3], const uint32_t *triangles,
                                size_t count, struct corner v[3])
{
    lanes n[8];
    double ninth[LANES];
    for (size_t i = 0; i < LANES; i++) {
        const double *from = corners[triangles[i < count ? i : 0]][0];
        for (size_t row = 0; row < 8; row += LANES) {
            n[row + i] = LOAD(from + row);
        }
        ninth[i] = from[8];
    }
    for (size_t row = 0; row < 8; row += LANES) {
        transpose(n + row);
    }
    v[0] = (struct corner){n[0], n[1], n[2]};
    v[1] = (struct corner){n[3], n[4], n[5]};
    v[2] = (struct corner){n[6], n[7], LOAD(ninth)};
}

void PREPARE(const double (*corners)[3][3], const uint32_t *triangles, size_t count, int32_t size,
             struct umbb_coverage *coverages)
{
    for (size_t from = 0; from < count; from += LANES) {
        const size_t left = count - from < LANES ? count - from : LANES;
        struct corner v[3];
        lanes numbers[16];
        corners_load(corners, triangles + from, left, v);
        prepare_lanes(v, ALL_OF((double)size), numbers);
        for (size_t row = 0; row < 16; row += LANES) {
            transpose(numbers + row);
            for (size_t i = 0; i < left; i++) {
                SAVE((double *)(void *)&coverages[from + i] + row, numbers[row + i]);
            }
        }
    }
}

#endif
