/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The voxel into which a point falls, compared with long doubles. Voxels are random bits, so a
 * point in a wrong voxel is noticed with a probability of one half.
 *
 * A place has at most four roundings of doubles: origin less origin, plus the coordinate, times
 * voxels a metre, plus zeros. Relative to an origin near the asset's each is below 2^-53 of what is
 * within two sizes of the frustum, so a place is off by less than 2^-50 sizes. The voxel of a point
 * farther from a border than that must be the exact one; if voxel and coordinates are binary
 * fractions, that of every point.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "make_asset.h"
#include "query/query_parts.h"

enum {
    LOG2 = 7,
    SIZE = 1 << LOG2,
    BATCH = 1000
};

static const uint32_t voxels_log2 = LOG2;

struct fixture {
    struct bytes file;
    struct umb_asset *asset;
    const double *origin; /* the asset's */
    long double per_m;    /* voxels */
    uint64_t judged, ties;
};

static void fixture_make(struct fixture *f, double voxel_m, const double origin[3])
{
    const struct voxels voxels = {random_voxel, &voxels_log2, LOG2, 1};
    memset(f, 0, sizeof *f);
    f->file = make_packed(&voxels, voxel_m, origin);
    f->origin = origin;
    f->per_m = (long double)(1 / voxel_m);
    assert_int_equal(umb_asset_open_bytes(f->file.data, f->file.size, NULL, &f->asset, NULL),
                     UMB_OK);
}

static void fixture_finish(struct fixture *f)
{
    print_message("%llu judged, %llu ties\n", (unsigned long long)f->judged,
                  (unsigned long long)f->ties);
    umb_asset_close(f->asset);
    bytes_finish(&f->file);
}

/* A texel as umbrage/query.h has it. */
static int texel_lit(long double x, long double y, long double z)
{
    if (!(x >= 0 && x < SIZE && y >= 0 && y < SIZE && z >= 0)) {
        return 1;
    }
    return random_voxel(&voxels_log2, 0, (uint32_t)x, (uint32_t)y,
                        z < SIZE ? (uint32_t)z : SIZE - 1);
}

/* Returns the number of lit texels of a point's window, or -1 if a border is nearer than `doubt`
 * voxels. */
static int exact_lit(const struct fixture *f, const struct umb_points *points, size_t i,
                     int32_t taps, long double doubt)
{
    long double v[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        v[axis] = f->per_m * ((long double)points->origin[axis] - (long double)f->origin[axis] +
                              (long double)umb__coordinate(points, i, axis));
        if (fabsl(v[axis] - rintl(v[axis])) < doubt) {
            return -1;
        }
    }
    int lit = 0;
    for (int32_t dy = -(taps / 2); dy <= taps / 2; dy++) {
        for (int32_t dx = -(taps / 2); dx <= taps / 2; dx++) {
            lit += texel_lit(floorl(v[0]) + dx, floorl(v[1]) + dy, floorl(v[2]));
        }
    }
    return lit;
}

static void check_batch(struct fixture *f, const struct umb_points *points, uint32_t taps,
                        long double doubt)
{
    static float values[2][BATCH];
    const struct umb_query_settings settings = {.taps = taps, .bias_mode = UMB_BIAS_NONE};
    struct umb_query query;
    struct umb_answers quickest = {.values = values[0]}, plain = {.values = values[1]};
    assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, points, 0, points->count, &quickest);
    umb__kernel_base((const struct umb__query *)(const void *)query.opaque, points, 0,
                     points->count, &plain);
    assert_memory_equal(values[0], values[1], points->count * sizeof values[0][0]);
    for (size_t i = 0; i < points->count; i++) {
        const int lit = exact_lit(f, points, i, (int32_t)taps, doubt);
        f->ties += lit < 0;
        f->judged += lit >= 0;
        if (lit >= 0 && values[0][i] != (float)lit / (float)(taps * taps)) {
            fail_msg("point %zu, %.20g %.20g %.20g: %g, expected %d of %u", i,
                     umb__coordinate(points, i, 0), umb__coordinate(points, i, 1),
                     umb__coordinate(points, i, 2), (double)values[0][i], lit, taps * taps);
        }
    }
}

/* Points in national coordinates, or relative to an origin nearby; a third within a millionth of a
 * voxel of a border. */
static void points_at_1e7_m_fall_into_their_voxels_of_1_cm(void **state)
{
    (void)state;
    static const double origin[3] = {9999999.37, -9876543.21, 4321.005}, none[3] = {0, 0, 0};
    static const double voxel_m = 0.01;
    static double places[BATCH][3];
    struct fixture f;
    uint64_t seed = round_seed(20140101);
    fixture_make(&f, voxel_m, origin);
    for (int done = 0; done < case_count(1000000); done += BATCH) {
        const int relative = done / BATCH % 2;
        struct umb_points points = {.positions = places, .format = UMB_POINT_F64, .count = BATCH};
        for (int i = 0; i < BATCH * 3; i++) {
            double voxels = (random_unit(&seed) * 1.2 - 0.1) * SIZE;
            if (next_random(&seed) % 3 == 0) {
                voxels = rint(voxels) + (random_unit(&seed) - 0.5) * 1e-6;
            }
            places[i / 3][i % 3] =
                voxels * voxel_m + (relative ? random_unit(&seed) - 0.5 : origin[i % 3]);
        }
        memcpy(points.origin, relative ? origin : none, sizeof points.origin);
        /* 2^-50 sizes; nothing is rounded before the differences of absolute coordinates. */
        check_batch(&f, &points, done / BATCH % 5 == 4 ? 3 : 1, SIZE * 0x1p-50L);
    }
    assert_true(f.ties < f.judged / 100);
    fixture_finish(&f);
}

/* Draws a coordinate that lies on a border, beside one, or rarely anywhere. */
static double special_coordinate(uint64_t *seed, double voxel_m)
{
    static const double fixed[] = {0.0,  -0.0,    DBL_MIN,  -DBL_MIN, 4.9e-324, -4.9e-324,
                                   1e30, DBL_MAX, -DBL_MAX, 1e-300,   -1e-300,  1e18};
    const double border = floor(random_unit(seed) * (SIZE + 5) - 2) * voxel_m;
    switch (next_random(seed) % 6) {
    case 0:
        return border;
    case 1:
        return nextafter(border, INFINITY);
    case 2:
        return nextafter(border, -INFINITY);
    case 3:
        return fixed[next_random(seed) % (sizeof fixed / sizeof fixed[0])];
    case 4:
        return SIZE * voxel_m;
    default:
        return (random_unit(seed) * 1.2 - 0.1) * SIZE * voxel_m;
    }
}

static void borders_belong_to_the_voxel_above_whatever_the_number(void **state)
{
    (void)state;
    static const double origin[3] = {4096, -8, 0.25};
    static const double voxel_m = 0x1p-7;
    static double places[BATCH][3];
    static float narrow[BATCH][3];
    struct fixture f;
    uint64_t seed = round_seed(20140102);
    fixture_make(&f, voxel_m, origin);
    for (int done = 0; done < case_count(1000000); done += BATCH) {
        const int floats = done / BATCH % 2;
        for (int i = 0; i < BATCH * 3; i++) {
            const double place = special_coordinate(&seed, voxel_m);
            places[i / 3][i % 3] = place;
            narrow[i / 3][i % 3] = fabs(place) <= (double)FLT_MAX ? (float)place : FLT_MAX;
        }
        struct umb_points points = {.positions = floats ? (const void *)narrow : places,
                                    .format = floats ? UMB_POINT_F32 : UMB_POINT_F64,
                                    .count = BATCH};
        memcpy(points.origin, origin, sizeof origin);
        check_batch(&f, &points, done / BATCH % 5 == 4 ? 3 : 1, 0);
    }
    assert_true(f.ties == 0);
    fixture_finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_at_1e7_m_fall_into_their_voxels_of_1_cm),
        cmocka_unit_test(borders_belong_to_the_voxel_above_whatever_the_number),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
