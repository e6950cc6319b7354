/* SPDX-License-Identifier: Apache-2.0 */
/* The tent and Gaussian filters, compared with plain sums of weights; and footprints in metres. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "volume_fixture.h"

enum {
    POINTS = 1500
};

/* Computes the answer as the header defines it, texel by texel. In: v: voxel space. */
static uint32_t plain_tent(const struct volume_fixture *f, const double v[3], int32_t taps)
{
    int32_t half = taps / 2, m = half + 1;
    uint32_t sum = 0;
    for (int32_t j = -half; j <= half; j++) {
        for (int32_t i = -half; i <= half; i++) {
            int32_t weight = (m - abs(i)) * (m - abs(j));
            int lit = fixture_voxel(f, (int64_t)floor(v[0]) + i, (int64_t)floor(v[1]) + j,
                                    (int64_t)floor(v[2]));
            sum += lit ? (uint32_t)weight : 0;
        }
    }
    return sum;
}

static void tents_weigh_the_texels_that_plain_loops_weigh(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 61;
    volume_fixture_open(&f, fixture_noise, 7, 0, 0);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        struct umb_query_settings settings = {
            .taps = taps, .bias_mode = UMB_BIAS_NONE, .filter = UMB_FILTER_TENT};
        struct umb_query query, byte_query;
        uint32_t m = (taps + 1) / 2, total = m * m * m * m;
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
        settings.format = UMB_ANSWER_U8;
        assert_int_equal(umb_query_prepare(f.asset, &settings, &byte_query, NULL), UMB_OK);
        for (size_t i = 0; i < POINTS; i++) {
            double v[3], p[3];
            float value = 0;
            uint8_t byte = 0;
            for (unsigned k = 0; k < 3; k++) {
                v[k] = (random_unit(&seed) * 1.2 - 0.1) * f.size;
            }
            fixture_world(&f, v, p);
            fixture_voxel_of(&f, p, v);
            struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
            struct umb_answers answers = {.values = &value}, bytes = {.values = &byte};
            memcpy(points.origin, fixture_origin, sizeof fixture_origin);
            umb_query_run(&query, &points, 0, 1, &answers);
            umb_query_run(&byte_query, &points, 0, 1, &bytes);
            uint32_t want = plain_tent(&f, v, (int32_t)taps);
            assert_true(value == (float)want / (float)total);
            assert_int_equal(byte, (2 * 255 * want + total) / (2 * total));
        }
    }
    volume_fixture_close(&f);
}

/* Returns the weight of the header's Gaussian for a texel at a distance on one axis. */
static long double bell(int32_t distance, int32_t taps)
{
    const long double sigma = taps / 6.0L;
    return expl(-distance * distance / (2 * sigma * sigma));
}

/* Returns the answer of the unbounded Gaussian, texel by texel. `reach` texels hold all but 1e-10
 * of its weight. */
static long double plain_gaussian(const struct volume_fixture *f, const double v[3], int32_t taps)
{
    const int32_t reach = 2 * taps;
    long double sum = 0, total = 0;
    for (int32_t j = -reach; j <= reach; j++) {
        for (int32_t i = -reach; i <= reach; i++) {
            const long double weight = bell(i, taps) * bell(j, taps);
            total += weight;
            sum += fixture_voxel(f, (int64_t)floor(v[0]) + i, (int64_t)floor(v[1]) + j,
                                 (int64_t)floor(v[2]))
                       ? weight
                       : 0;
        }
    }
    return sum / total;
}

/* Checks the header's bound on windows of noise, inside the frustum and across its edge. */
static void gaussians_are_near_the_unbounded_one(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 63;
    long double worst = 0;
    volume_fixture_open(&f, fixture_noise, 7, 0, 0);
    for (int32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        struct umb_query_settings settings = {
            .taps = (uint32_t)taps, .bias_mode = UMB_BIAS_NONE, .filter = UMB_FILTER_GAUSSIAN};
        struct umb_query query, byte_query;
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
        settings.format = UMB_ANSWER_U8;
        assert_int_equal(umb_query_prepare(f.asset, &settings, &byte_query, NULL), UMB_OK);
        for (size_t i = 0; i < POINTS / 4; i++) {
            double v[3], p[3];
            float value = 0;
            uint8_t byte = 0;
            for (unsigned k = 0; k < 3; k++) {
                v[k] = (random_unit(&seed) * 1.2 - 0.1) * f.size;
            }
            fixture_world(&f, v, p);
            fixture_voxel_of(&f, p, v);
            struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
            struct umb_answers answers = {.values = &value}, bytes = {.values = &byte};
            memcpy(points.origin, fixture_origin, sizeof fixture_origin);
            umb_query_run(&query, &points, 0, 1, &answers);
            umb_query_run(&byte_query, &points, 0, 1, &bytes);
            const long double away = fabsl((long double)value - plain_gaussian(&f, v, taps));
            worst = away > worst ? away : worst;
            assert_true(away <= 0.006L);
            assert_true(ldexp((double)value, 22) == floor(ldexp((double)value, 22)));
            assert_int_equal(byte, (int)floor(255 * (double)value + 0.5));
        }
    }
    assert_true(worst > 0); /* it is not the unbounded one itself */
    volume_fixture_close(&f);
}

static int lit_from_40_on(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    (void)y;
    (void)z;
    return x >= 40;
}

/* Beside an edge the answers are sums of the weights of a row: they must rise, and be symmetric. */
static void gaussians_rise_evenly_across_an_edge(void **state)
{
    (void)state;
    struct volume_fixture f;
    volume_fixture_open(&f, lit_from_40_on, 7, 0, 0);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        const struct umb_query_settings settings = {
            .taps = taps, .bias_mode = UMB_BIAS_NONE, .filter = UMB_FILTER_GAUSSIAN};
        struct umb_query query;
        float before = 0, share[64];
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
        for (int x = 20; x < 60; x++) {
            const double v[3] = {x + 0.5, 64.5, 64.5};
            double p[3];
            fixture_world(&f, v, p);
            struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
            struct umb_answers answers = {.values = &share[x]};
            memcpy(points.origin, fixture_origin, sizeof fixture_origin);
            umb_query_run(&query, &points, 0, 1, &answers);
            assert_true(share[x] >= before);
            before = share[x];
        }
        assert_true(share[20] == 0 && share[59] == 1);
        for (int d = 0; d < 19; d++) {
            assert_true(share[40 + d] + share[39 - d] == 1);
        }
    }
    volume_fixture_close(&f);
}

static void a_tent_of_one_texel_is_a_box_of_one_texel(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 62;
    static double positions[POINTS][3];
    static float normals[POINTS][3], box[POINTS], tent[POINTS];
    volume_fixture_open(&f, fixture_noise, 6, 1, 0);
    for (size_t i = 0; i < POINTS; i++) {
        for (unsigned k = 0; k < 3; k++) {
            positions[i][k] = random_unit(&seed) * 40 - 20;
            normals[i][k] = (float)(random_unit(&seed) - 0.5);
        }
    }
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .normals = normals, .count = POINTS};
    struct umb_query_settings settings = {.taps = 1};
    struct umb_query query;
    struct umb_answers a = {.values = box}, b = {.values = tent};
    memcpy(points.origin, fixture_origin, sizeof fixture_origin);
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, &points, 0, POINTS, &a);
    settings.filter = UMB_FILTER_TENT;
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, &points, 0, POINTS, &b);
    assert_memory_equal(box, tent, sizeof box);
    assert_int_equal(a.stats.points, b.stats.points);
    assert_int_equal(a.stats.outside, b.stats.outside);
    assert_int_equal(a.stats.before, b.stats.before);
    assert_int_equal(a.stats.behind, b.stats.behind);
    assert_int_equal(a.stats.facing_away, b.stats.facing_away);
    volume_fixture_close(&f);
}

static void footprints_take_the_nearest_odd_number_of_texels(void **state)
{
    (void)state;
    /* In texels of 0.25 m. */
    static const struct {
        double texels;
        uint32_t taps;
    } cases[] = {{0.01, 1}, {1.9, 1}, {2.1, 3}, {3.9, 3}, {4.1, 5}, {9, 9}, {17.9, 17}, {18, 17}};
    struct volume_fixture f;
    struct umb_error error;
    struct umb_query query;
    volume_fixture_open(&f, fixture_noise, 6, 0, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umb_query_settings settings = {.footprint_m = cases[i].texels * 0.25};
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, &error), UMB_OK);
        assert_int_equal(umb_query_taps(&query), cases[i].taps);
    }
    struct umb_query_settings wide = {.footprint_m = 4.6}, both = {.taps = 3, .footprint_m = 1};
    struct umb_query_settings below = {.footprint_m = -1}, nan = {.footprint_m = NAN};
    struct umb_query_settings other = {.filter = (enum umb_filter)UMB_FILTERS};
    assert_int_equal(umb_query_prepare(f.asset, &wide, &query, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "footprint_m: 4.6, must be above 0 and at most 4.5"));
    assert_int_equal(umb_query_prepare(f.asset, &both, &query, &error), UMB_E_ARGUMENT);
    assert_int_equal(umb_query_prepare(f.asset, &below, &query, &error), UMB_E_ARGUMENT);
    assert_int_equal(umb_query_prepare(f.asset, &nan, &query, &error), UMB_E_ARGUMENT);
    assert_int_equal(umb_query_prepare(f.asset, &other, &query, &error), UMB_E_ARGUMENT);
    volume_fixture_close(&f);
}

static void the_table_of_filters_has_their_names_in_order(void **state)
{
    (void)state;
    char names[128] = "";
    size_t length = 0;
    for (int i = 0; i < UMB_FILTERS; i++) {
        const struct umb_filter_info *info = umb_filter_get_info((enum umb_filter)i);
        assert_ptr_equal(umb_filter_name((enum umb_filter)i), info->name);
        length += (size_t)snprintf(names + length, sizeof names - length, "%s%s", i > 0 ? "|" : "",
                                   info->name);
        assert_true(info->is_window || !info->has_curve);
    }
    assert_string_equal(names, UMB_FILTER_NAMES);
    assert_string_equal(umb_filter_get_info((enum umb_filter)UMB_FILTERS)->name, "unknown");
    assert_string_equal(umb_filter_name((enum umb_filter) - 1), "unknown");
    assert_false(umb_filter_get_info((enum umb_filter)UMB_FILTERS)->is_window);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tents_weigh_the_texels_that_plain_loops_weigh),
        cmocka_unit_test(gaussians_are_near_the_unbounded_one),
        cmocka_unit_test(gaussians_rise_evenly_across_an_edge),
        cmocka_unit_test(a_tent_of_one_texel_is_a_box_of_one_texel),
        cmocka_unit_test(footprints_take_the_nearest_odd_number_of_texels),
        cmocka_unit_test(the_table_of_filters_has_their_names_in_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
