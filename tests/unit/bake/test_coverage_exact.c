/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares the predicate that decides coverage with exact integers. Corners are whole numbers of
 * 2^-10 voxels of at most 24 bits, so that every product below fits an integer, and the double
 * arithmetic has five roundings:
 *
 * - a crossing is off by at most 2^-53 (3 |dx| + |x|) voxels, less than 2^-50 of the greatest
 *   coordinate: a centre farther from both crossings is decided exactly as integers decide;
 * - numerators and area of the gradients are exact, so a depth is off by less than
 *   2^-50 (|gx dx| + |gy dy| + |z| + 1), and a voxel border farther from it than that decides
 * `lit`.
 *
 * What lies nearer is counted as a tie and not checked.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "bake/depth/coverage.h"
#include "make_asset.h"

__extension__ typedef __int128 wide;

enum {
    SIZE = 64,
    GRID = 1024,    /* steps of a voxel */
    FAR = 8000,     /* voxels */
    FIRST_ROW = -4, /* rows and columns that are looked at */
    LAST_ROW = SIZE + 4
};

struct figures {
    uint64_t covered, uncovered, covered_ties, depths, depth_ties;
};

/* A corner in steps of the grid. */
typedef int64_t corner[3];

static int64_t between(uint64_t *state, int64_t low, int64_t high)
{
    return low + (int64_t)(next_random(state) % (uint64_t)(high - low + 1));
}

static void random_corner(uint64_t *state, int kind, corner c)
{
    for (int k = 0; k < 3; k++) {
        switch (kind) {
        case 0: /* centres and borders of texels and voxels */
            c[k] = between(state, -8, 2 * SIZE + 8) * GRID / 2;
            break;
        case 1:
            c[k] = between(state, -FAR * GRID, FAR * GRID);
            break;
        default:
            c[k] = between(state, -4 * GRID, (SIZE + 4) * GRID);
        }
    }
}

/* Draws random triangles; slivers whose third corner lies on the line of the others, a step beside
 * it or at a corner; and edges along the rows and columns. */
static void random_triangle(uint64_t *state, corner v[3])
{
    const int shape = (int)(next_random(state) % 8);
    for (int i = 0; i < 3; i++) {
        random_corner(state, shape < 6 ? shape % 3 : (int)(next_random(state) % 3), v[i]);
    }
    if (shape == 4 || shape == 5) {
        const int64_t part = between(state, 0, 16), side = between(state, -1, 1);
        for (int k = 0; k < 3; k++) {
            v[2][k] = v[0][k] + (v[1][k] - v[0][k]) * part / 16 + (k == 0 ? side : 0);
        }
    } else if (shape == 6) {
        v[1][next_random(state) % 2] = v[0][0];
        v[2][1] = v[0][1];
    } else if (shape == 7) {
        memcpy(v[2], v[next_random(state) % 2], sizeof v[2]);
    }
}

/* Computes where a row of centres crosses an edge: x = num / den, den > 0. */
struct crossing {
    int64_t num, den;
};

static int cross_row(const corner a, const corner b, int64_t py, struct crossing *at)
{
    const int64_t *low = a[1] < b[1] ? a : b, *high = a[1] < b[1] ? b : a;
    if (!(low[1] <= py && py < high[1])) {
        return 0;
    }
    at->den = high[1] - low[1];
    at->num = low[0] * at->den + (py - low[1]) * (high[0] - low[0]);
    return 1;
}

/* Steps from a crossing to px. */
static double steps_from(const struct crossing *at, int64_t px)
{
    return (double)(px * at->den - at->num) / (double)at->den;
}

static double reach_of(corner v[3])
{
    double most = 1.0;
    for (int i = 0; i < 3; i++) {
        most = fmax(most, fmax(fabs((double)v[i][0]), fabs((double)v[i][1])) / GRID);
    }
    return most;
}

static int64_t area_of(corner v[3])
{
    return (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]) - (v[1][1] - v[0][1]) * (v[2][0] - v[0][0]);
}

/* Returns the number of voxels whose centres lie before the plane at a texel's centre; -1 if
 * doubles may decide otherwise. */
static int exact_lit(corner v[3], int64_t px, int64_t py)
{
    int64_t area = area_of(v);
    const int64_t ux = v[1][0] - v[0][0], uy = v[1][1] - v[0][1], uz = v[1][2] - v[0][2];
    const int64_t wx = v[2][0] - v[0][0], wy = v[2][1] - v[0][1], wz = v[2][2] - v[0][2];
    wide nx = (wide)uz * wy - (wide)uy * wz, ny = (wide)ux * wz - (wide)uz * wx;
    if (area == 0) {
        return -1;
    }
    double slack = fabs((double)nx / (double)area * (double)(px - v[0][0])) +
                   fabs((double)ny / (double)area * (double)(py - v[0][1]));
    /* The predicate starts from another corner than this function. The sum over all three corners
     * is slack enough. */
    for (int i = 0; i < 3; i++) {
        slack += fabs((double)nx / (double)area * (double)(px - v[i][0])) +
                 fabs((double)ny / (double)area * (double)(py - v[i][1])) + fabs((double)v[i][2]);
    }
    slack = (slack / GRID + 1.0) * 0x1p-50;
    wide num = (wide)v[0][2] * area + nx * (px - v[0][0]) + ny * (py - v[0][1]);
    if (area < 0) {
        area = -area;
        num = -num;
    }
    const wide voxel = (wide)area * GRID;
    num -= voxel / 2;
    const wide below = num >= 0 ? num / voxel : -((-num + voxel - 1) / voxel);
    const double part = (double)(num - below * voxel) / (double)voxel;
    if (!(fmin(part, 1.0 - part) > slack)) {
        return -1;
    }
    const wide lit = below + 1;
    return lit < 0 ? 0 : lit > SIZE ? SIZE : (int)lit;
}

/* Computes the span of a row as the predicate computes it. */
struct span {
    int32_t first, last;
    int front;
};

static void check_centre(corner v[3], const struct umbb_coverage *c, const struct span *span,
                         int32_t x, int32_t y, const struct crossing at[2], struct figures *f)
{
    const int64_t px = (2 * (int64_t)x + 1) * GRID / 2, py = (2 * (int64_t)y + 1) * GRID / 2;
    const double one = steps_from(&at[0], px), two = steps_from(&at[1], px);
    const double doubt = reach_of(v) * GRID * 0x1p-50;
    const int covered = x >= span->first && x <= span->last;
    if (fabs(one) <= doubt || fabs(two) <= doubt) {
        f->covered_ties++;
        return;
    }
    assert_int_equal(covered, (one > 0) != (two > 0));
    f->covered += (uint64_t)covered;
    f->uncovered += !covered;
    if (covered) {
        assert_int_equal(span->front, area_of(v) < 0);
        const int lit = exact_lit(v, px, py);
        f->depth_ties += lit < 0;
        if (lit >= 0) {
            assert_int_equal(umbb_coverage_lit(c, umbb_coverage_row_z(c, y), x), lit);
            f->depths++;
        }
    }
}

/* Draws centres around both crossings of a row, and some between. */
static void check_row(uint64_t *state, corner v[3], const struct umbb_coverage *c, int32_t y,
                      struct figures *f)
{
    struct crossing at[3];
    struct span span = {.first = 0, .last = -1};
    int count = 0;
    for (int i = 0; i < 3; i++) {
        count += cross_row(v[i], v[(i + 1) % 3], (2 * (int64_t)y + 1) * GRID / 2, &at[count]);
    }
    assert_int_equal(c != NULL && y >= c->row_first && y <= c->row_last, count == 2 && c != NULL);
    if (count == 0) {
        return;
    }
    if (c != NULL) {
        span.front = umbb_coverage_row(c, y, &span.first, &span.last);
    }
    for (int k = 0; k < 9; k++) {
        int64_t x = k < 6 ? at[k % 2].num / at[k % 2].den / GRID + k / 2 - 1
                          : between(state, FIRST_ROW, LAST_ROW);
        x = x < -FAR ? -FAR : x > FAR ? FAR : x;
        check_centre(v, c, &span, (int32_t)x, y, at, f);
    }
}

static void coverage_and_depth_are_those_of_exact_integers(void **state)
{
    (void)state;
    uint64_t seed = round_seed(19730401);
    struct figures f = {0};
    for (int round = 0; round < case_count(4000); round++) {
        corner v[3];
        double corners[3][3];
        struct umbb_coverage coverage;
        random_triangle(&seed, v);
        for (int i = 0; i < 9; i++) {
            corners[i / 3][i % 3] = (double)v[i / 3][i % 3] / GRID;
        }
        const int met = umbb_coverage_prepare((const double(*)[3])corners, SIZE, &coverage);
        for (int32_t y = FIRST_ROW; y <= LAST_ROW; y++) {
            check_row(&seed, v, met ? &coverage : NULL, y, &f);
        }
    }
    print_message("%llu covered, %llu not, %llu ties; %llu depths, %llu ties\n",
                  (unsigned long long)f.covered, (unsigned long long)f.uncovered,
                  (unsigned long long)f.covered_ties, (unsigned long long)f.depths,
                  (unsigned long long)f.depth_ties);
    assert_true(f.covered + f.uncovered > 1000000 && f.depths > 300000);
    assert_true(f.covered_ties > 1000 && f.covered_ties < (f.covered + f.uncovered) / 4);
    assert_true(f.depth_ties < f.depths / 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coverage_and_depth_are_those_of_exact_integers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
