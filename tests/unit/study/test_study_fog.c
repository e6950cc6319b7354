/* SPDX-License-Identifier: Apache-2.0 */
/* Light shafts, compared with sums over single points along the view ray. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "make_asset.h"
#include "study/study_picture.h"

enum {
    STEPS = 20000
};

static int stripes(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return (x + y + z) % 2 == 0;
}

static void fog_equals_a_sum_over_points(void **state)
{
    (void)state;
    const double origin[3] = {500, -3, 7}, density = 0.2;
    struct voxels voxels = {stripes, NULL, 7, 1};
    struct bytes file = make_packed(&voxels, 0.125, origin);
    struct umb_asset *asset;
    struct umbt_fog fog;
    struct umb_query query;
    struct umb_query_settings settings = {.bias_mode = UMB_BIAS_NONE};
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    assert_int_equal(umbt_fog_make(asset, 0, density, &fog, NULL), UMB_OK);
    uint64_t seed = 41;
    for (int trial = 0; trial < 10; trial++) {
        double eye[3], end[3], way[3], length = 0, sum = 0, through, lit;
        for (int k = 0; k < 3; k++) {
            eye[k] = origin[k] + random_unit(&seed) * 18 - 1;
            end[k] = origin[k] + random_unit(&seed) * 18 - 1;
            way[k] = end[k] - eye[k];
            length += way[k] * way[k];
        }
        length = sqrt(length);
        for (int i = 0; i < STEPS; i++) {
            double t = (i + 0.5) / STEPS, p[3];
            float value = 0;
            for (int k = 0; k < 3; k++) {
                p[k] = eye[k] + t * way[k];
            }
            struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
            struct umb_answers answers = {.values = &value};
            umb_query_run(&query, &points, 0, 1, &answers);
            sum += (double)value * density * length / STEPS * exp(-density * length * t);
        }
        umbt_fog_look(&fog, eye, end, &through, &lit);
        /* Each of some 400 boundaries may be off by half a step of the sum. */
        assert_true(fabs(lit - sum) < 400 * 0.5 * density * length / STEPS);
        assert_true(fabs(through - exp(-density * length)) < 1e-12);
        assert_true(lit + through <= 1 + 1e-12);
    }
    umb_asset_close(asset);
    bytes_finish(&file);
}

static void rays_of_more_intervals_than_fit_are_halved(void **state)
{
    (void)state;
    const double origin[3] = {0, 0, 0};
    struct voxels voxels = {stripes, NULL, 8, 1};
    struct bytes file = make_packed(&voxels, 1, origin);
    struct umb_asset *asset;
    struct umbt_fog thick, parts;
    struct umb_segment_answer answer;
    struct umb_segment_answers answers = {.segments = &answer};
    const double ends[6] = {-50, 0.5, 0.25, 300, 255.5, 255.25};
    struct umb_segments segments = {.ends = ends, .format = UMB_POINT_F64, .count = 1};
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    assert_int_equal(umbt_fog_make(asset, 0, 1e-7, &thick, NULL), UMB_OK);
    parts = thick;
    umb_volume_segments(&parts.volume, &segments, 0, 1, &answers);
    double through, lit;
    umbt_fog_look(&thick, ends, ends + 3, &through, &lit);
    /* In such a thin fog the light is proportional to the lit length. */
    assert_true(answer.interval_count > 256);
    assert_true(fabs(lit / (1e-7 * answer.lit_m) - 1) < 1e-4);
    umb_asset_close(asset);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fog_equals_a_sum_over_points),
        cmocka_unit_test(rays_of_more_intervals_than_fit_are_halved),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
