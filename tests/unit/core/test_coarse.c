/* SPDX-License-Identifier: Apache-2.0 */
/* Look-ups that stop at cells, and the bound that is stated for every look-up. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "format/asset_parts.h"
#include "make_asset.h"
#include "query/query_parts.h"
#include "umbrage/curve.h"

enum {
    POINTS = 5003
};

static const double voxel_m = 0.25;
static const double origin[3] = {700000.5, -5, 12};

/* Balls of shadow, whose boundary is known everywhere. */
static const double balls[3][4] = {{20, 30, 25, 13}, {44, 20, 40, 9.3}, {70, 70, 64, 31}};

static double distance_to(const double p[3], unsigned ball)
{
    double square = 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        square += (p[axis] - balls[ball][axis]) * (p[axis] - balls[ball][axis]);
    }
    return sqrt(square) - balls[ball][3];
}

/* Returns 1 if a place in voxel space is lit. Out: *boundary: distance to the nearest ball's
 * surface, in voxels. */
static int truth(const double p[3], double *boundary)
{
    int lit = 1;
    *boundary = INFINITY;
    for (unsigned ball = 0; ball < 3; ball++) {
        double d = distance_to(p, ball);
        lit &= d >= 0;
        *boundary = fmin(*boundary, fabs(d));
    }
    return lit;
}

static int ball_voxel(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    double ignored;
    (void)user;
    (void)frustum;
    return truth((double[3]){x + 0.5, y + 0.5, z + 0.5}, &ignored);
}

struct fixture {
    struct voxels voxels;
    struct bytes packed;
    struct umb_asset *asset;
};

static void fixture_open(struct fixture *f, uint32_t log2_size)
{
    f->voxels = (struct voxels){ball_voxel, NULL, log2_size, 1};
    f->packed = make_packed(&f->voxels, voxel_m, origin);
    assert_int_equal(umb_asset_open_bytes(f->packed.data, f->packed.size, NULL, &f->asset, NULL),
                     UMB_OK);
}

static void fixture_close(struct fixture *f)
{
    umb_asset_close(f->asset);
    bytes_finish(&f->packed);
}

static double positions[POINTS][3];
static float normals[POINTS][3];

static struct umb_points draw_points(uint32_t size, uint64_t *seed)
{
    for (size_t i = 0; i < POINTS; i++) {
        for (size_t k = 0; k < 3; k++) {
            positions[i][k] = (random_unit(seed) * 1.1 - 0.05) * size * voxel_m;
            normals[i][k] = (float)(random_unit(seed) * 2 - 1.2 * (k == 2));
        }
        if (i % 5 == 0) {
            memset(normals[i], 0, sizeof normals[i]);
        }
    }
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .normals = normals, .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    return points;
}

/* Returns the answer of a cell from its voxels: 0, 1, or one half. */
static float cell_answer(const struct fixture *f, const struct umb__window *w, uint32_t level)
{
    if (w->all_lit) {
        return 1;
    }
    const uint32_t cell = 1U << level;
    const uint32_t x0 = (uint32_t)w->x0 & ~(cell - 1), y0 = (uint32_t)w->y0 & ~(cell - 1);
    const uint32_t z0 = (uint32_t)w->z & ~(cell - 1);
    const int first = ball_voxel(f->voxels.user, 0, x0, y0, z0);
    for (uint32_t i = 0; i < cell * cell * cell; i++) {
        if (ball_voxel(NULL, 0, x0 + i % cell, y0 + i / cell % cell, z0 + i / cell / cell) !=
            first) {
            return 0.5F;
        }
    }
    return (float)first;
}

static void coarse_answers_are_those_of_whole_cells(void **state)
{
    (void)state;
    uint64_t seed = 5;
    for (uint32_t log2_size = 6; log2_size <= 7; log2_size++) {
        struct fixture f;
        fixture_open(&f, log2_size);
        struct umb_points points = draw_points(1U << log2_size, &seed);
        struct umb_query_settings settings = {.level = 3};
        struct umb_query query;
        struct umb__query q;
        float values[POINTS];
        struct umb_answers answers = {.values = values};
        size_t halves = 0;
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
        umb_query_run(&query, &points, 0, POINTS, &answers);
        assert_int_equal(answers.stats.bricks, 0);
        memcpy(&q, query.opaque, sizeof q);
        for (size_t i = 0; i < POINTS; i++) {
            struct umb_query_stats stats = {0};
            double v[3];
            float expected = 0;
            if (umb__voxel_at(&q, &points, i, v)) {
                struct umb__window window = umb__window_at(&q, v, &stats);
                expected = cell_answer(&f, &window, settings.level);
            }
            assert_float_equal(values[i], expected, 0);
            halves += expected == 0.5F;
        }
        assert_true(halves > 20);
        fixture_close(&f);
    }
}

static void coarse_kernels_agree_bit_by_bit(void **state)
{
    (void)state;
#if defined(__x86_64__)
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("bmi2")) {
        skip();
    }
    struct fixture f;
    uint64_t seed = 9;
    fixture_open(&f, 7);
    struct umb_points points = draw_points(128, &seed);
    struct umb_query_settings settings = {.level = 3};
    struct umb_query query;
    struct umb__query q;
    static float base[POINTS], avx2[POINTS];
    struct umb_answers a = {.values = base}, b = {.values = avx2};
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    memcpy(&q, query.opaque, sizeof q);
    umb__kernel_coarse(&q, &points, 0, POINTS, &a);
    umb__kernel_coarse_avx2(&q, &points, 0, 1000, &b);
    umb__kernel_coarse_avx2(&q, &points, 1000, POINTS - 1000, &b);
    assert_memory_equal(base, avx2, sizeof base);
    assert_memory_equal(&a.stats, &b.stats, sizeof a.stats);
    fixture_close(&f);
#endif
}

static void no_answer_is_farther_from_a_boundary_than_its_bound(void **state)
{
    (void)state;
    static const struct umb_query_settings cases[] = {
        {.taps = 1},
        {.taps = 3},
        {.taps = 9},
        {.taps = 17},
        {.level = 3},
        {.taps = 5, .bias_mode = UMB_BIAS_NONE},
        {.taps = 1, .bias_mode = UMB_BIAS_METRES, .bias = 2},
        {.taps = 1, .bias_mode = UMB_BIAS_VOXELS, .bias = 3},
        {.level = 3, .bias_mode = UMB_BIAS_NONE},
    };
    uint64_t seed = 3;
    struct fixture f;
    fixture_open(&f, 7);
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        struct umb_points points = draw_points(128, &seed);
        struct umb_query query;
        float values[POINTS];
        struct umb_answers answers = {.values = values};
        const double bound_m = umb_query_bound_m(f.asset, &cases[c]);
        double worst_m = 0;
        assert_int_equal(umb_query_prepare(f.asset, &cases[c], &query, NULL), UMB_OK);
        umb_query_run(&query, &points, 0, POINTS, &answers);
        for (size_t i = 0; i < POINTS; i++) {
            double boundary, v[3];
            int inside = 1;
            for (unsigned axis = 0; axis < 3; axis++) {
                v[axis] = positions[i][axis] / voxel_m;
                inside &= v[axis] >= 24 && v[axis] < 128 - 24; /* no window is cut */
            }
            int lit = truth(v, &boundary);
            int away = (double)normals[i][2] >= 0 && i % 5 != 0; /* shadowed by its normal */
            if (inside && !away && values[i] != (float)lit) {
                worst_m = fmax(worst_m, boundary * voxel_m);
            }
        }
        assert_true(worst_m <= bound_m);
        assert_true(worst_m > 0.25 * bound_m); /* and says something */
    }
    fixture_close(&f);
}

static void levels_that_a_layout_need_not_have_are_refused(void **state)
{
    (void)state;
    static const struct umb_query_settings bad[] = {{.level = 2},
                                                    {.level = 4},
                                                    {.level = 5},
                                                    {.level = 3, .taps = 3},
                                                    {.level = 3, .footprint_m = 1},
                                                    {.level = 3, .filter = UMB_FILTER_TENT}};
    struct fixture f;
    struct umb_query query;
    struct umb_error error;
    fixture_open(&f, 7);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(umb_query_prepare(f.asset, &bad[i], &query, &error), UMB_E_ARGUMENT);
        assert_memory_equal(error.message, "level: ", 7);
    }
    assert_int_equal(umb_level_max(6), 3);
    assert_int_equal(umb_level_max(10), 3);
    assert_int_equal(umb_level_max(11), 5);
    assert_int_equal(umb_level_max(14), 7);
    assert_int_equal(umb_level_max(20), 13);
    fixture_close(&f);
}

static void coarse_explanations_stop_at_their_level(void **state)
{
    (void)state;
    struct fixture f;
    uint64_t seed = 21;
    fixture_open(&f, 7);
    struct umb_points points = draw_points(128, &seed);
    struct umb_query_settings settings = {.level = 3};
    struct umb_query query;
    float values[POINTS];
    struct umb_answers answers = {.values = values};
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, &points, 0, POINTS, &answers);
    for (size_t i = 0; i < 500; i++) {
        struct umb_explanation e;
        umb_query_explain(&query, &points, i, &e);
        assert_float_equal((float)e.answer, values[i], 0);
        assert_int_equal(e.level, 3);
        if (!e.facing_away) {
            assert_float_equal(e.voxel_size_m, 8 * voxel_m, 1e-9);
        }
        if (e.step_count > 0) {
            assert_true(e.steps[e.step_count - 1].level >= 3);
            assert_int_equal(e.steps[e.step_count - 1].state == 2, values[i] == 0.5F);
        }
    }
    fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coarse_answers_are_those_of_whole_cells),
        cmocka_unit_test(coarse_kernels_agree_bit_by_bit),
        cmocka_unit_test(no_answer_is_farther_from_a_boundary_than_its_bound),
        cmocka_unit_test(levels_that_a_layout_need_not_have_are_refused),
        cmocka_unit_test(coarse_explanations_stop_at_their_level),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
