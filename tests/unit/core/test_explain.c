/* SPDX-License-Identifier: Apache-2.0 */
/* Explanations, compared with the answers that they explain and with single look-ups. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "volume_fixture.h"

enum {
    POINTS = 1500
};

static void windows_hold_the_texels_that_answers_count(void **state)
{
    (void)state;
    struct volume_fixture f;
    uint64_t seed = 51;
    volume_fixture_open(&f, fixture_noise, 7, 1, 0);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 8) {
        struct umb_query_settings settings = {.taps = taps};
        struct umb_query query;
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
        for (size_t i = 0; i < POINTS; i++) {
            double v[3], p[3];
            float normal[3], value = 0;
            struct umb_explanation e;
            for (unsigned k = 0; k < 3; k++) {
                v[k] = (random_unit(&seed) * 1.4 - 0.2) * f.size;
                normal[k] = (float)(random_unit(&seed) - 0.5);
            }
            fixture_world(&f, v, p);
            struct umb_points points = {.positions = p,
                                        .format = UMB_POINT_F64,
                                        .normals = i % 3 ? normal : NULL,
                                        .count = 1};
            struct umb_answers answers = {.values = &value};
            memcpy(points.origin, fixture_origin, sizeof fixture_origin);
            umb_query_run(&query, &points, 0, 1, &answers);
            umb_query_explain(&query, &points, 0, &e);
            uint32_t lit = 0;
            for (uint32_t j = 0; j < taps; j++) {
                lit += (uint32_t)__builtin_popcount(e.rows[j]);
                assert_int_equal(e.rows[j] >> taps, 0);
            }
            assert_int_equal(lit, e.lit_taps);
            assert_true((float)lit / (float)(taps * taps) == value);
            assert_int_equal(e.has_normal, i % 3 != 0);
            assert_int_equal(e.facing_away, e.has_normal && e.cosine <= 0);
            if (e.step_count > 0) {
                uint32_t centre = e.rows[taps / 2] >> (taps / 2) & 1;
                assert_int_equal(e.steps[e.step_count - 1].state, centre);
                assert_int_equal(e.window[0] + taps / 2, e.cell[0]);
                assert_int_equal(fixture_voxel(&f, e.cell[0], e.cell[1], e.cell[2]), centre);
            }
        }
    }
    volume_fixture_close(&f);
}

static void points_far_beyond_everything_are_explained_as_lit(void **state)
{
    (void)state;
    struct volume_fixture f;
    static const double far[4][3] = {{1e300, 0, 0}, {-1e18, 1e18, 5}, {3e9, 3e9, 3e9}, {NAN, 1, 2}};
    volume_fixture_open(&f, fixture_noise, 6, 1, 0);
    struct umb_query_settings settings = {.taps = 5, .bias_mode = UMB_BIAS_NONE};
    struct umb_query query;
    struct umb_points points = {.positions = far, .format = UMB_POINT_F64, .count = 4};
    assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
    for (size_t i = 0; i < 4; i++) {
        struct umb_explanation e;
        umb_query_explain(&query, &points, i, &e);
        assert_int_equal(e.lit_taps, 25);
        assert_int_equal(e.rows[4], 31);
        assert_int_equal(e.step_count, 0);
        assert_int_equal(e.bias_mode, UMB_BIAS_NONE);
    }
    volume_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(windows_hold_the_texels_that_answers_count),
        cmocka_unit_test(points_far_beyond_everything_are_explained_as_lit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
