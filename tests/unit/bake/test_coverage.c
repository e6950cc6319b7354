/* SPDX-License-Identifier: Apache-2.0 */
/* The predicate that decides coverage must be watertight, independent of the order of corners, and
 * right where geometry leaves no doubt. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "bake/depth/coverage.h"

#define SIZE 64

static uint64_t random_state;

/* splitmix64 */
static uint64_t random_bits(void)
{
    uint64_t z = (random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

static double random_unit(void)
{
    return (double)(random_bits() >> 11) * 0x1p-53;
}

static void seed(uint64_t value)
{
    random_state = value;
    print_message("seed %llu\n", (unsigned long long)value);
}

/* Draws a coordinate that often lies exactly on a texel's centre or border. */
static double random_coordinate(void)
{
    const double value = 1.0 + random_unit() * (SIZE - 2);
    switch (random_bits() % 4) {
    case 0:
        return floor(value) + 0.5;
    case 1:
        return floor(value);
    default:
        return value;
    }
}

static void count_cover(double v[3][3], int counts[SIZE][SIZE])
{
    struct umbb_coverage c;
    if (!umbb_coverage_prepare((const double(*)[3])v, SIZE, &c)) {
        return;
    }
    for (int32_t y = c.row_first; y <= c.row_last; y++) {
        int32_t first, last;
        umbb_coverage_row(&c, y, &first, &last);
        for (int32_t x = first; x <= last; x++) {
            counts[y][x]++;
        }
    }
}

/* Draws a fan around a centre with a convex outline. Every centre strictly inside must be
 * covered. */
static void fans_leave_no_centre_uncovered(void **state)
{
    (void)state;
    seed(20260101);
    for (int round = 0; round < 400; round++) {
        static int counts[SIZE][SIZE];
        memset(counts, 0, sizeof counts);
        const int n = 3 + (int)(random_bits() % 12);
        double centre[3] = {SIZE / 2.0, SIZE / 2.0, 10.0}, rim[16][3];
        if (random_bits() & 1) {
            centre[0] += 0.5;
            centre[1] += 0.5;
        }
        for (int i = 0; i < n; i++) {
            const double a = 6.283185307179586 * i / n;
            rim[i][0] = 32.0 + 29.0 * cos(a);
            rim[i][1] = 32.0 + 29.0 * sin(a);
            rim[i][2] = random_unit() * SIZE;
        }
        for (int i = 0; i < n; i++) {
            double v[3][3];
            const int turn = (int)(random_bits() % 3); /* any corner first, either winding */
            const double *corner[3] = {centre, rim[i], rim[(i + 1) % n]};
            for (int k = 0; k < 3; k++) {
                memcpy(v[k], corner[(k + turn) % 3], sizeof v[k]);
            }
            count_cover(v, counts);
        }
        for (int y = 0; y < SIZE; y++) {
            for (int x = 0; x < SIZE; x++) {
                double inside = 1e9; /* distance to the nearest rim line */
                for (int i = 0; i < n; i++) {
                    const double *p = rim[i], *q = rim[(i + 1) % n];
                    const double dx = q[0] - p[0], dy = q[1] - p[1];
                    const double d =
                        (dx * (y + 0.5 - p[1]) - dy * (x + 0.5 - p[0])) / hypot(dx, dy);
                    inside = fmin(inside, d);
                }
                if (inside > 1e-9) { /* 1e-9: rounding of the test's own outline */
                    assert_true(counts[y][x] > 0);
                } else if (inside < -1e-9) {
                    assert_int_equal(counts[y][x], 0);
                }
            }
        }
    }
}

/* Cuts a square along random vertices, which lie on texel centres in about half of the cases. */
static void triangulated_squares_are_watertight(void **state)
{
    (void)state;
    seed(7);
    for (int round = 0; round < 2000; round++) {
        static int counts[SIZE][SIZE];
        memset(counts, 0, sizeof counts);
        double p[3] = {random_coordinate(), random_coordinate(), random_coordinate()};
        double corner[4][3] = {{1, 1, 5}, {63, 1, 9}, {63, 63, 2}, {1, 63, 60}};
        for (int i = 0; i < 4; i++) {
            double v[3][3];
            memcpy(v[0], corner[i], sizeof v[0]);
            memcpy(v[1], corner[(i + 1) % 4], sizeof v[1]);
            memcpy(v[2], p, sizeof v[2]);
            count_cover(v, counts);
        }
        for (int y = 1; y < 63; y++) {
            for (int x = 1; x < 63; x++) {
                assert_true(counts[y][x] > 0);
            }
        }
        assert_int_equal(counts[0][10], 0);
        assert_int_equal(counts[63][10], 0);
    }
}

static void answers_do_not_depend_on_corner_order(void **state)
{
    (void)state;
    seed(11);
    static const int order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1},
                                    {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    for (int round = 0; round < 2000; round++) {
        double v[3][3];
        for (int i = 0; i < 9; i++) {
            v[i / 3][i % 3] = random_coordinate();
        }
        struct umbb_coverage first;
        memset(&first, 0, sizeof first);
        const int covers = umbb_coverage_prepare((const double(*)[3])v, SIZE, &first);
        for (int k = 1; k < 6; k++) {
            double w[3][3];
            for (int i = 0; i < 3; i++) {
                memcpy(w[i], v[order[k][i]], sizeof w[i]);
            }
            struct umbb_coverage other;
            memset(&other, 0, sizeof other);
            assert_int_equal(umbb_coverage_prepare((const double(*)[3])w, SIZE, &other), covers);
            if (covers) {
                assert_int_equal(other.odd, k < 3 ? first.odd : !first.odd);
                assert_int_equal(other.facing, k < 3 ? first.facing : !first.facing);
                other.odd = first.odd;
                other.facing = first.facing;
                assert_memory_equal(&other, &first, sizeof first);
            }
        }
    }
}

static void winding_tells_front_from_back(void **state)
{
    (void)state;
    /* Normal (0, 0, -1): against the light, which travels along +z. */
    const double facing[3][3] = {{1, 1, 5}, {1, 20, 5}, {20, 1, 5}};
    const double away[3][3] = {{1, 1, 5}, {20, 1, 5}, {1, 20, 5}};
    struct umbb_coverage c;
    int32_t first, last;
    assert_true(umbb_coverage_prepare(facing, SIZE, &c));
    assert_true(umbb_coverage_row(&c, 5, &first, &last));
    assert_true(umbb_coverage_prepare(away, SIZE, &c));
    assert_false(umbb_coverage_row(&c, 5, &first, &last));
}

static void edge_on_and_degenerate_triangles_cover_nothing(void **state)
{
    (void)state;
    const double wall[3][3] = {{5.5, 1, 1}, {5.5, 9, 1}, {5.5, 9, 30}};
    const double line[3][3] = {{1, 1, 1}, {2, 2, 2}, {3, 3, 3}};
    const double point[3][3] = {{4.5, 4.5, 1}, {4.5, 4.5, 1}, {4.5, 4.5, 1}};
    const double(*all[3])[3] = {wall, line, point};
    for (int i = 0; i < 3; i++) {
        static int counts[SIZE][SIZE];
        double v[3][3];
        memset(counts, 0, sizeof counts);
        memcpy(v, all[i], sizeof v);
        count_cover(v, counts);
        for (int k = 0; k < SIZE * SIZE; k++) {
            assert_int_equal(counts[k / SIZE][k % SIZE], 0);
        }
    }
}

/* Tetrahedra squashed to lines along the light that run through texel centres, up to a few units in
 * the last place: the computed sign of their area means nothing. */
static void flat_solid(double v[4][3])
{
    const double step[2] = {1.0 + (double)(random_bits() % 5), 1.0 + (double)(random_bits() % 5)};
    const double from[2] = {(double)(random_bits() % 20) + 0.5, (double)(random_bits() % 20) + 0.5};
    for (int i = 0; i < 4; i++) {
        const double t = 8.0 * random_unit();
        v[i][0] = from[0] + t * step[0];
        v[i][1] = from[1] + t * step[1];
        v[i][2] = 1.0 + 60.0 * random_unit();
        if (random_bits() & 1) {
            v[i][0] = nextafter(v[i][0], random_bits() & 1 ? 100.0 : -100.0);
        }
        if (random_bits() % 4 == 0) {
            v[i][0] += 1e-13 * (random_unit() - 0.5);
        }
    }
}

static void a_column_that_enters_a_sliver_of_a_solid_leaves_it(void **state)
{
    (void)state;
    static const int face[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    uint64_t columns = 0;
    seed(13);
    for (int round = 0; round < 3000; round++) {
        static int faces[2][SIZE][SIZE];
        double v[4][3];
        memset(faces, 0, sizeof faces);
        flat_solid(v);
        const int turned = (int)(random_bits() & 1); /* either winding: the count is symmetric */
        for (int i = 0; i < 4; i++) {
            struct umbb_coverage c;
            double w[3][3];
            for (int k = 0; k < 3; k++) {
                memcpy(w[k], v[face[i][turned ? 2 - k : k]], sizeof w[k]);
            }
            if (!umbb_coverage_prepare((const double(*)[3])w, SIZE, &c)) {
                continue;
            }
            for (int32_t y = c.row_first; y <= c.row_last; y++) {
                int32_t first, last;
                const int front = umbb_coverage_row(&c, y, &first, &last);
                for (int32_t x = first; x <= last; x++) {
                    faces[front][y][x]++;
                }
            }
        }
        for (int k = 0; k < SIZE * SIZE; k++) {
            const int backs = faces[0][k / SIZE][k % SIZE], fronts = faces[1][k / SIZE][k % SIZE];
            assert_int_equal(fronts > 0, backs > 0);
            columns += fronts > 0;
        }
    }
    assert_true(columns > 1000); /* the slivers did meet centres */
}

static void depth_counts_voxel_centres_before_the_surface(void **state)
{
    (void)state;
    static const struct {
        double z;
        int32_t lit;
    } cases[] = {{0.0, 0},   {0.5, 0},   {0.50001, 1}, {1.0, 1},  {1.5, 1},  {1.6, 2},
                 {63.5, 63}, {63.6, 64}, {64.0, 64},   {-3.0, 0}, {99.0, 64}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const double z = cases[i].z;
        const double v[3][3] = {{1, 1, z}, {1, 20, z}, {20, 1, z}};
        struct umbb_coverage c;
        assert_true(umbb_coverage_prepare(v, SIZE, &c));
        assert_int_equal(umbb_coverage_lit(&c, umbb_coverage_row_z(&c, 3), 3), cases[i].lit);
    }
}

static void depth_follows_the_plane_and_stays_within_the_corners(void **state)
{
    (void)state;
    seed(3);
    for (int round = 0; round < 5000; round++) {
        double v[3][3];
        for (int i = 0; i < 9; i++) {
            v[i / 3][i % 3] = random_coordinate();
        }
        struct umbb_coverage c;
        if (!umbb_coverage_prepare((const double(*)[3])v, SIZE, &c)) {
            continue;
        }
        const double area =
            (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]) - (v[1][1] - v[0][1]) * (v[2][0] - v[0][0]);
        for (int32_t y = c.row_first; y <= c.row_last; y++) {
            int32_t first, last;
            umbb_coverage_row(&c, y, &first, &last);
            for (int32_t x = first; x <= last; x++) {
                const int32_t lit = umbb_coverage_lit(&c, umbb_coverage_row_z(&c, y), x);
                assert_true(lit >= (int32_t)ceil(c.z_min - 0.5) &&
                            lit <= (int32_t)ceil(c.z_max - 0.5));
                if (fabs(area) < 1.0) {
                    continue; /* slivers: the test's own barycentrics lose too much */
                }
                double z = 0.0;
                for (int i = 0; i < 3; i++) {
                    const double *p = v[(i + 1) % 3], *q = v[(i + 2) % 3];
                    const double w = (p[0] - (x + 0.5)) * (q[1] - (y + 0.5)) -
                                     (p[1] - (y + 0.5)) * (q[0] - (x + 0.5));
                    z += w / area * v[i][2];
                }
                const double t = z - 0.5;
                if (fabs(t - rint(t)) > 1e-6) { /* 1e-6: rounding of both ways to compute z */
                    const double expected = ceil(fmin(fmax(z, 0.0), SIZE) - 0.5);
                    assert_int_equal(lit, (int32_t)expected);
                }
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fans_leave_no_centre_uncovered),
        cmocka_unit_test(triangulated_squares_are_watertight),
        cmocka_unit_test(answers_do_not_depend_on_corner_order),
        cmocka_unit_test(winding_tells_front_from_back),
        cmocka_unit_test(edge_on_and_degenerate_triangles_cover_nothing),
        cmocka_unit_test(depth_counts_voxel_centres_before_the_surface),
        cmocka_unit_test(depth_follows_the_plane_and_stays_within_the_corners),
        cmocka_unit_test(a_column_that_enters_a_sliver_of_a_solid_leaves_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
