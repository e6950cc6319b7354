/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Geometry that touches a spot's near plane, its sides or the light itself. The polygon that
 * clipping leaves of a triangle must hold the part of the triangle that lies in the pyramid, and
 * nothing else. Points of a triangle are made by long double weights; coordinates are within 4 of
 * 0, a corner made by a cut is off by less than 1e-14 where the pyramid's sides are met at all
 * steeply, and the margin of 1e-9 leaves room for edges that run almost within a side.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "bake/analysis/eye_clip.h"
#include "make_asset.h"

static const struct umbb_pyramid pyramid = {.low = {-1, -0.5}, .high = {1, 0.5}, .near = 0.25};
static const double margin = 1e-9; /* metres */

/* Corners anywhere around the light; on the near plane or a unit in the last place beside it, on a
 * side, at the light. */
static void random_corner(uint64_t *seed, double corner[3])
{
    for (int k = 0; k < 3; k++) {
        corner[k] = 4 * random_unit(seed) - 1.5;
    }
    switch (next_random(seed) % 8) {
    case 0:
        corner[2] = pyramid.near;
        break;
    case 1:
        corner[2] = nextafter(pyramid.near, next_random(seed) & 1 ? 1.0 : 0.0);
        break;
    case 2:
        corner[0] = (next_random(seed) & 1 ? pyramid.low[0] : pyramid.high[0]) * corner[2];
        break;
    case 3:
        corner[1] = (next_random(seed) & 1 ? pyramid.low[1] : pyramid.high[1]) * corner[2];
        break;
    case 4:
        memset(corner, 0, 3 * sizeof corner[0]);
        break;
    default:
        break;
    }
}

/* Estimates how far inside the pyramid a point lies; negative outside. */
static long double inside(const long double p[3])
{
    long double least = p[2] - (long double)pyramid.near;
    for (int k = 0; k < 2; k++) {
        least = fminl(least, p[k] - (long double)pyramid.low[k] * p[2]);
        least = fminl(least, (long double)pyramid.high[k] * p[2] - p[k]);
    }
    return least;
}

static void normal_of(double v[3][3], long double n[3])
{
    for (int k = 0; k < 3; k++) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        n[k] = ((long double)v[1][a] - (long double)v[0][a]) *
                   ((long double)v[2][b] - (long double)v[0][b]) -
               ((long double)v[1][b] - (long double)v[0][b]) *
                   ((long double)v[2][a] - (long double)v[0][a]);
    }
}

/* Estimates how far inside a convex polygon a point of its plane lies, seen along the axis nearest
 * to the plane's normal. In: sign: direction in which the polygon runs round, seen along that
 * axis. */
static long double depth_in(const struct umbb_polygon *polygon, const long double p[3], int axis,
                            long double sign)
{
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    long double least = INFINITY;
    for (size_t i = 0; i < polygon->count; i++) {
        const double *from = polygon->corners[i], *to = polygon->corners[(i + 1) % polygon->count];
        const long double da = (long double)to[a] - (long double)from[a];
        const long double db = (long double)to[b] - (long double)from[b];
        const long double length = hypotl(da, db);
        if (length > 0) {
            least = fminl(
                least,
                sign * (da * (p[b] - (long double)from[b]) - db * (p[a] - (long double)from[a])) /
                    length);
        }
    }
    return isinf(least) ? -1 : least; /* a triangle that only touches: a point, with no inside */
}

static void what_a_light_sees_of_a_triangle_is_what_is_left_of_it(void **state)
{
    (void)state;
    uint64_t seed = round_seed(19740117);
    int seen = 0, unseen = 0;
    for (int round = 0; round < case_count(1000000); round++) {
        double v[3][3];
        struct umbb_polygon left;
        long double n[3], p[3], sum = 0, weight[3];
        for (int i = 0; i < 3; i++) {
            random_corner(&seed, v[i]);
            weight[i] = (long double)random_unit(&seed) + 1e-3L;
            sum += weight[i];
        }
        normal_of(v, n);
        int axis = fabsl(n[0]) > fabsl(n[1]) ? 0 : 1;
        axis = fabsl(n[2]) > fabsl(n[axis]) ? 2 : axis;
        umbb_eye_clip(&pyramid, (const double(*)[3])v, &left);
        for (int k = 0; k < 3; k++) {
            p[k] = ((long double)v[0][k] * weight[0] + (long double)v[1][k] * weight[1] +
                    (long double)v[2][k] * weight[2]) /
                   sum;
        }
        if (fabsl(n[axis]) < 1e-3L) { /* hardly a triangle: nothing to be inside of */
            continue;
        }
        const long double depth = depth_in(&left, p, axis, n[axis] > 0 ? 1 : -1);
        if (inside(p) > (long double)margin) {
            assert_true(depth > -(long double)margin);
            seen++;
        } else if (inside(p) < -(long double)margin) {
            assert_true(depth < (long double)margin);
            unseen++;
        }
    }
    print_message("%d points seen, %d not\n", seen, unseen);
    assert_true(seen > case_count(1000000) / 20 && unseen > case_count(1000000) / 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_a_light_sees_of_a_triangle_is_what_is_left_of_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
