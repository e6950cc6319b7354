/* SPDX-License-Identifier: Apache-2.0 */
/* Queries, compared with the plainest possible counting and with each other. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "query/query_parts.h"

enum {
    LOG2 = 8,
    SIZE = 1 << LOG2,
    POINTS = 4000
};

static const double voxel_m = 0.25;
static const double origin[3] = {1000000.5, -5, 12};

/* Rolling hills with a floating slab: lit, shadowed and mixed nodes at all levels. */
static int hilly(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    uint32_t height = 150 + (x * 7 + y * 3) % 23 + (x / 32 * 5 + y / 32 * 11) % 40;
    if (x > 60 && x < 200 && y > 100 && y < 131) {
        height = 77;
    }
    return z < height;
}

struct fixture {
    struct bytes file;
    struct umb_asset *asset;
    double (*points)[3];
    float (*normals)[3];
};

static double storage_points[POINTS][3];
static float storage_normals[POINTS][3];

static int set_up(void **state)
{
    static struct fixture f;
    struct voxels voxels = {hilly, NULL, LOG2, 1};
    uint64_t seed = 20140704;
    print_message("seed %llu\n", (unsigned long long)seed);
    f.file = make_packed(&voxels, voxel_m, origin);
    assert_int_equal(umb_asset_open_bytes(f.file.data, f.file.size, NULL, &f.asset, NULL), UMB_OK);
    for (size_t i = 0; i < POINTS; i++) {
        for (size_t k = 0; k < 3; k++) {
            /* A tenth beyond each side, so that borders are met often. */
            storage_points[i][k] = (random_unit(&seed) * 1.2 - 0.1) * SIZE * voxel_m;
            storage_normals[i][k] = (float)(random_unit(&seed) * 2 - 1);
        }
    }
    f.points = storage_points;
    f.normals = storage_normals;
    *state = &f;
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *f = *state;
    umb_asset_close(f->asset);
    bytes_finish(&f->file);
    return 0;
}

static struct umb_points batch_of(const struct fixture *f, int with_normals)
{
    struct umb_points points = {.positions = f->points,
                                .format = UMB_POINT_F64,
                                .normals = with_normals ? f->normals : NULL,
                                .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    return points;
}

static void run(const struct fixture *f, const struct umb_query_settings *settings,
                const struct umb_points *points, void *values, struct umb_query_stats *stats)
{
    struct umb_query query;
    struct umb_answers answers = {.values = values};
    struct umb_error error;
    assert_int_equal(umb_query_prepare(f->asset, settings, &query, &error), UMB_OK);
    umb_query_run(&query, points, 0, points->count, &answers);
    if (stats) {
        *stats = answers.stats;
    }
}

/* Computes one texel as the header defines it. */
static int plain_texel(int64_t x, int64_t y, double z)
{
    if (x < 0 || x >= SIZE || y < 0 || y >= SIZE || z < 0) {
        return 1;
    }
    uint32_t voxel = z >= SIZE ? SIZE - 1 : (uint32_t)z;
    return hilly(NULL, 0, (uint32_t)x, (uint32_t)y, voxel);
}

static void windows_count_the_texels_that_plain_loops_count(void **state)
{
    const struct fixture *f = *state;
    static float values[POINTS];
    struct umb_points points = batch_of(f, 0);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        struct umb_query_settings settings = {.taps = taps, .bias_mode = UMB_BIAS_NONE};
        run(f, &settings, &points, values, NULL);
        int64_t half = taps / 2;
        for (size_t i = 0; i < POINTS; i++) {
            const double *p = f->points[i];
            int lit = 0;
            for (int64_t dy = -half; dy <= half; dy++) {
                for (int64_t dx = -half; dx <= half; dx++) {
                    lit += plain_texel((int64_t)floor(p[0] / voxel_m) + dx,
                                       (int64_t)floor(p[1] / voxel_m) + dy, p[2] / voxel_m);
                }
            }
            assert_true(values[i] == (float)lit / (float)(taps * taps));
        }
    }
}

static void all_kernels_give_the_same_bits(void **state)
{
    const struct fixture *f = *state;
    static float base[POINTS], fast[POINTS];
    struct umb_points points = batch_of(f, 1);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 4) {
        struct umb_query_settings settings = {.taps = taps};
        struct umb_query query;
        struct umb_answers a = {.values = base}, b = {.values = fast};
        assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
        umb__kernel_base((const struct umb__query *)(const void *)query.opaque, &points, 0, POINTS,
                         &a);
        umb_query_run(&query, &points, 0, POINTS, &b);
        assert_memory_equal(base, fast, sizeof base);
        assert_memory_equal(&a.stats, &b.stats, sizeof a.stats);
    }
}

static void any_split_of_a_batch_gives_the_same_answers(void **state)
{
    const struct fixture *f = *state;
    static float whole[POINTS], parts[POINTS];
    static const size_t steps[] = {1, 7, 64, 1000};
    struct umb_points points = batch_of(f, 1);
    struct umb_query_settings settings = {.taps = 9};
    struct umb_query query;
    assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
    struct umb_answers answers = {.values = whole};
    umb_query_run(&query, &points, 0, POINTS, &answers);
    for (size_t s = 0; s < sizeof steps / sizeof steps[0]; s++) {
        struct umb_answers part = {.values = parts};
        memset(parts, 0xff, sizeof parts);
        for (size_t i = 0; i < POINTS; i += steps[s]) {
            size_t left = POINTS - i < steps[s] ? POINTS - i : steps[s];
            umb_query_run(&query, &points, i, left, &part);
        }
        assert_memory_equal(whole, parts, sizeof whole);
        /* The number of reads depends on how a batch is split; these members come after the
         * others. */
        assert_memory_equal(&answers.stats, &part.stats, offsetof(struct umb_query_stats, nodes));
    }
}

static void unaligned_float_points_are_read_as_they_are(void **state)
{
    const struct fixture *f = *state;
    static uint8_t raw[12 * POINTS + 1];
    static double as_double[POINTS][3];
    static float from_float[POINTS], from_double[POINTS];
    for (size_t i = 0; i < 3 * POINTS; i++) {
        float value = (float)f->points[i / 3][i % 3];
        memcpy(raw + 1 + 4 * i, &value, sizeof value);
        as_double[i / 3][i % 3] = (double)value;
    }
    struct umb_points points = batch_of(f, 1);
    struct umb_query_settings settings = {.taps = 5};
    points.positions = raw + 1;
    points.format = UMB_POINT_F32;
    run(f, &settings, &points, from_float, NULL);
    points.positions = as_double;
    points.format = UMB_POINT_F64;
    run(f, &settings, &points, from_double, NULL);
    assert_memory_equal(from_float, from_double, sizeof from_float);
}

static void formats_are_roundings_of_one_count(void **state)
{
    const struct fixture *f = *state;
    static float floats[POINTS];
    static uint8_t bytes[POINTS], bits[(POINTS + 7) / 8];
    struct umb_points points = batch_of(f, 1);
    struct umb_query_settings settings = {.taps = 7};
    run(f, &settings, &points, floats, NULL);
    settings.format = UMB_ANSWER_U8;
    run(f, &settings, &points, bytes, NULL);
    settings.format = UMB_ANSWER_BIT;
    run(f, &settings, &points, bits, NULL);
    for (size_t i = 0; i < POINTS; i++) {
        int count = (int)lroundf(floats[i] * 49);
        assert_int_equal(bytes[i], (255 * count * 2 + 49) / 98);
        assert_int_equal(bits[i / 8] >> (i % 8) & 1, count * 2 >= 49);
    }
}

static void bits_behind_the_last_answer_are_zero(void **state)
{
    const struct fixture *f = *state;
    uint8_t whole[(POINTS + 7) / 8 + 2], parts[sizeof whole];
    struct umb_points points = batch_of(f, 1);
    struct umb_query_settings settings = {.taps = 3, .format = UMB_ANSWER_BIT};
    struct umb_query query;
    assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
    for (size_t count = 1; count < 40; count++) {
        size_t bytes = umb_answer_bytes(UMB_ANSWER_BIT, count);
        struct umb_answers answers = {.values = whole}, part = {.values = parts};
        /* Bits that were in the output before must not appear in answers: they might be another
         * caller's. */
        memset(whole, 0xff, sizeof whole);
        memset(parts, 0xff, sizeof parts);
        umb_query_run(&query, &points, 0, count, &answers);
        assert_int_equal(bytes, (count + 7) / 8);
        if (count % 8 != 0) {
            assert_int_equal(whole[bytes - 1] >> (count % 8), 0);
        }
        assert_int_equal(whole[bytes], 0xff);
        /* In order and on one thread, runs may begin anywhere. */
        for (size_t i = 0; i < count; i += 3) {
            umb_query_run(&query, &points, i, count - i < 3 ? count - i : 3, &part);
        }
        assert_memory_equal(whole, parts, bytes);
    }
}

static void stats_count_points_outside_before_and_behind(void **state)
{
    const struct fixture *f = *state;
    const double s = SIZE * voxel_m;
    const double four[6][3] = {{-1, 1, 1},       {1, s + 0.01, 1}, {1, 1, -0.5},
                               {1, 1, s + 3000}, {1, 1, 1},        {1, 1, -0.0}};
    float values[6];
    struct umb_points points = {.positions = four, .format = UMB_POINT_F64, .count = 6};
    struct umb_query_settings settings = {.bias_mode = UMB_BIAS_NONE};
    struct umb_query_stats stats;
    memcpy(points.origin, origin, sizeof origin);
    run(f, &settings, &points, values, &stats);
    assert_int_equal(stats.points, 6);
    assert_int_equal(stats.outside, 2);
    assert_int_equal(stats.before, 1);
    assert_int_equal(stats.behind, 1);
    const float expected[6] = {1, 1, 1, 0, 1, 1};
    assert_memory_equal(values, expected, sizeof expected);
}

static void receivers_facing_away_are_shadowed_by_their_normal(void **state)
{
    const struct fixture *f = *state;
    const float normals[4][3] = {{0, 0, 1}, {1, 0, 0}, {0, 0, -1}, {0, 0, 0}};
    const double lit_points[4][3] = {{1, 1, 1}, {1, 1, 1}, {1, 1, 1}, {1, 1, 1}};
    const float expected[4] = {0, 0, 1, 1};
    float values[4];
    struct umb_points points = {
        .positions = lit_points, .format = UMB_POINT_F64, .normals = normals, .count = 4};
    struct umb_query_settings settings = {.taps = 3};
    struct umb_query_stats stats;
    memcpy(points.origin, origin, sizeof origin);
    run(f, &settings, &points, values, &stats);
    assert_memory_equal(values, expected, sizeof expected);
    assert_int_equal(stats.facing_away, 2);
}

/* Lit before the plane a x + b y + z = c, sampled at voxel centres as in a bake. */
struct plane {
    double a, b, c;
};

static int before_plane(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const struct plane *p = user;
    (void)frustum;
    double depth = p->c - p->a * (x + 0.5) - p->b * (y + 0.5);
    return z + 0.5 < depth;
}

static void automatic_bias_leaves_no_acne_on_planes(void **state)
{
    (void)state;
    uint64_t seed = 7;
    for (int trial = 0; trial < 24; trial++) {
        struct plane plane = {(random_unit(&seed) - 0.5) * 5, (random_unit(&seed) - 0.5) * 5, 64};
        plane.c += 64 * (plane.a + plane.b) - 32 + random_unit(&seed);
        if (trial == 0) {
            plane = (struct plane){0, 0, 64.5}; /* exactly on voxel centres */
        }
        struct voxels voxels = {before_plane, &plane, 7, 1};
        struct bytes file = make_packed(&voxels, 0.125, origin);
        struct umb_asset *asset;
        assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
        for (uint32_t taps = 1; taps <= 17; taps += 4) {
            struct umb_query_settings settings = {.taps = taps};
            struct umb_query query;
            assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
            for (int k = 0; k < 500; k++) {
                double x = 20 + random_unit(&seed) * 88, y = 20 + random_unit(&seed) * 88;
                double z = plane.c - plane.a * x - plane.b * y;
                double p[3] = {x * 0.125, y * 0.125, z * 0.125};
                float n[3] = {(float)-plane.a, (float)-plane.b, -1}, value = 0;
                if (z < 1 || z > 127) {
                    continue;
                }
                struct umb_points points = {
                    .positions = p, .format = UMB_POINT_F64, .normals = n, .count = 1};
                struct umb_answers answers = {.values = &value};
                memcpy(points.origin, origin, sizeof origin);
                umb_query_run(&query, &points, 0, 1, &answers);
                assert_true(value == 1.0F);
            }
        }
        umb_asset_close(asset);
        bytes_finish(&file);
    }
}

static void bad_settings_name_field_value_and_limit(void **state)
{
    const struct fixture *f = *state;
    struct umb_query query;
    struct umb_error error;
    struct umb_query_settings even = {.taps = 4}, wide = {.taps = 19}, light = {.light = 1};
    struct umb_query_settings bias = {.bias_mode = UMB_BIAS_METRES, .bias = -1};
    assert_int_equal(umb_query_prepare(f->asset, &even, &query, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "taps: 4"));
    assert_int_equal(umb_query_prepare(f->asset, &wide, &query, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "17"));
    assert_int_equal(umb_query_prepare(f->asset, &light, &query, &error), UMB_E_NOT_FOUND);
    assert_int_equal(umb_query_prepare(f->asset, &bias, &query, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "bias: -1"));
    bias.bias = NAN;
    assert_int_equal(umb_query_prepare(f->asset, &bias, &query, &error), UMB_E_ARGUMENT);
}

static void points_that_are_not_finite_are_named_and_do_no_harm(void **state)
{
    const struct fixture *f = *state;
    float bad[3][3] = {{1, 2, 3}, {1, NAN, 3}, {INFINITY, 2, -INFINITY}};
    float values[3];
    struct umb_points points = {.positions = bad, .count = 3};
    struct umb_error error;
    assert_int_equal(umb_points_check(&points, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "points[1].y: nan"));
    struct umb_query_settings settings = {.taps = 17};
    run(f, &settings, &points, values, NULL);
    points.origin[2] = INFINITY;
    assert_int_equal(umb_points_check(&points, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "origin.z"));
}

static void one_bad_number_is_found_wherever_it_lies(void **state)
{
    enum {
        COUNT = 75
    }; /* two blocks and a rest */
    static const double bads[] = {NAN, -NAN, INFINITY, -INFINITY};
    (void)state;
    for (int wide = 0; wide < 2; wide++) {
        /* Blocks of exact size, at an odd address, surrounded by the largest finite numbers. */
        size_t word = wide ? sizeof(double) : sizeof(float);
        uint8_t *bytes = malloc(3 * COUNT * word + 1);
        assert_non_null(bytes);
        struct umb_points points = {
            .positions = bytes + 1, .format = wide ? UMB_POINT_F64 : UMB_POINT_F32, .count = COUNT};
        for (size_t at = 0; at <= 3 * COUNT; at++) {
            for (size_t i = 0; i < 3 * COUNT; i++) {
                double number = i == at ? bads[at % 4] : i % 2 == 0 ? -DBL_MAX : DBL_MIN / 4;
                float narrow = i == at ? (float)number : i % 2 == 0 ? FLT_MAX : FLT_MIN / 4;
                memcpy(bytes + 1 + i * word, wide ? (void *)&number : (void *)&narrow, word);
            }
            struct umb_error error = {0};
            char place[32];
            snprintf(place, sizeof place, "points[%zu].%c:", at / 3, "xyz"[at % 3]);
            enum umb_status status = umb_points_check(&points, &error);
            assert_int_equal(status, at < 3 * COUNT ? UMB_E_ARGUMENT : UMB_OK);
            assert_true(at == 3 * COUNT || strstr(error.message, place) != NULL);
        }
        free(bytes);
    }
}

static void explanation_agrees_with_the_answer(void **state)
{
    const struct fixture *f = *state;
    static float values[POINTS];
    struct umb_points points = batch_of(f, 1);
    struct umb_query_settings settings = {.taps = 1};
    struct umb_query query;
    run(f, &settings, &points, values, NULL);
    assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
    for (size_t i = 0; i < POINTS; i++) {
        struct umb_explanation e;
        umb_query_explain(&query, &points, i, &e);
        assert_true((float)e.lit_taps == values[i]);
        if (e.step_count > 0) {
            assert_int_equal(e.steps[e.step_count - 1].state, e.lit_taps);
            assert_true(e.bias_m > 0);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(windows_count_the_texels_that_plain_loops_count),
        cmocka_unit_test(all_kernels_give_the_same_bits),
        cmocka_unit_test(any_split_of_a_batch_gives_the_same_answers),
        cmocka_unit_test(unaligned_float_points_are_read_as_they_are),
        cmocka_unit_test(formats_are_roundings_of_one_count),
        cmocka_unit_test(bits_behind_the_last_answer_are_zero),
        cmocka_unit_test(stats_count_points_outside_before_and_behind),
        cmocka_unit_test(receivers_facing_away_are_shadowed_by_their_normal),
        cmocka_unit_test(automatic_bias_leaves_no_acne_on_planes),
        cmocka_unit_test(bad_settings_name_field_value_and_limit),
        cmocka_unit_test(points_that_are_not_finite_are_named_and_do_no_harm),
        cmocka_unit_test(one_bad_number_is_found_wherever_it_lies),
        cmocka_unit_test(explanation_agrees_with_the_answer),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
