/* SPDX-License-Identifier: Apache-2.0 */
/* Splits, frusta of slices, snapping, warps, and the seam with its remedy. */
#include "maps_fixture.h"
#include "maps/map_receiver.h"
#include "maps/map_view.h"
#include "base/vec.h"
#include "umbrage/cascades.h"

static const struct umb_box scene = {{-60, -50, 0}, {70, 40, 25}};

static struct umb_camera camera_of(uint64_t *seed)
{
    struct umb_camera camera = {.up = {0, 0, 1},
                                .fov_y = 0.4 + 0.5 * random_unit(seed),
                                .aspect = 1 + random_unit(seed),
                                .near_m = 0.1 + random_unit(seed),
                                .far_m = 60.0 + 100.0 * random_unit(seed)};
    for (int k = 0; k < 3; k++) {
        camera.eye[k] = (random_unit(seed) - 0.5) * 40.0;
        camera.forward[k] = random_unit(seed) - 0.5;
    }
    camera.eye[2] = 3.0 + 10.0 * random_unit(seed);
    camera.forward[2] *= 0.5;
    return camera;
}

static struct umb_cascade_settings settings_of(enum umb_cascade_fit fit)
{
    struct umb_cascade_settings settings = {.count = 4, .weight = 0.7, .fit = fit};
    for (int i = 0; i < 4; i++) {
        settings.resolution[i] = 512U << (i % 2);
    }
    return settings;
}

static void splits_mix_logarithmic_and_uniform_ones(void **state)
{
    (void)state;
    double splits[UMB_CASCADES_MAX + 1];
    umb_cascades_split(1.0, 1000.0, 3, 1.0, splits);
    assert_true(fabs(splits[1] - 10.0) < 1e-12 && fabs(splits[2] - 100.0) < 1e-12);
    umb_cascades_split(1.0, 1000.0, 3, 0.0, splits);
    assert_true(fabs(splits[1] - 334.0) < 1e-12 && fabs(splits[2] - 667.0) < 1e-12);
    umb_cascades_split(1.0, 1000.0, 3, 0.25, splits);
    assert_true(fabs(splits[1] - (0.25 * 10.0 + 0.75 * 334.0)) < 1e-12);
    assert_true(splits[0] == 1.0 && splits[3] == 1000.0);
    uint64_t seed = 2006;
    for (int i = 0; i < case_count(100000); i++) {
        const double near = exp((random_unit(&seed) - 0.5) * 20.0);
        const double far = near * (1.0 + exp((random_unit(&seed) - 0.5) * 20.0));
        umb_cascades_split(near, far, 8, random_unit(&seed), splits);
        for (int k = 0; k < 8; k++) {
            assert_true(splits[k] <= splits[k + 1] * (1.0 + 1e-15));
        }
    }
}

/* What a camera sees of the scene must lie on the map of its slice, for every fit; casters before
 * it must too, in depth. */
static void every_visible_point_of_the_scene_lies_on_its_map(void **state)
{
    (void)state;
    uint64_t seed = 2013;
    int seen = 0, warped = 0;
    for (int round = 0; round < case_count(600000) / 200; round++) {
        const struct umb_camera camera = camera_of(&seed);
        const struct umb_cascade_settings settings = settings_of((enum umb_cascade_fit)(round % 3));
        struct umb__map_view view;
        struct umb_cascade_plan plan;
        double to_light[3] = {random_unit(&seed) - 0.5, random_unit(&seed) - 0.5,
                              0.05 + random_unit(&seed)};
        assert_int_equal(umb_cascades_plan(&camera, to_light, &scene, &settings, &plan, NULL),
                         UMB_OK);
        assert_true(umb__unit(to_light));
        assert_int_equal(umb__map_view_make(&camera, &view, NULL), UMB_OK);
        for (int i = 0; i < 200; i++) {
            const double z = camera.near_m + (camera.far_m - camera.near_m) * random_unit(&seed);
            const double x = (2.0 * random_unit(&seed) - 1.0) * z * view.tan_x;
            const double y = (2.0 * random_unit(&seed) - 1.0) * z * view.tan_y;
            double world[3];
            int inside = 1, slice = 0;
            for (int k = 0; k < 3; k++) {
                world[k] = view.eye[k] + x * view.right[k] + y * view.up[k] + z * view.forward[k];
                inside &= world[k] >= scene.min[k] && world[k] <= scene.max[k];
            }
            if (!inside) {
                continue;
            }
            while (z > plan.splits[slice + 1]) {
                slice++;
            }
            struct umb__map_point at;
            const struct umb_map_frustum *f = &plan.frusta[slice];
            assert_true(umb__frustum_map(f, world, &at));
            if (!(at.at[0] >= 0.5 && at.at[0] <= f->width - 0.5 && at.at[1] >= 0.5 &&
                  at.at[1] <= f->height - 0.5 && at.at[2] > 0.0 && at.at[2] < 1.0)) {
                fail_msg("fit %d slice %d: %g %g of %u, depth %g", round % 3, slice, at.at[0],
                         at.at[1], f->width, at.at[2]);
            }
            seen++;
            warped += plan.warped[slice];
        }
    }
    print_message("%d points, %d on warped maps\n", seen, warped);
    assert_true(seen > 50000 && warped > 10000);
}

/* The texel of a world point must keep its place in the grid while the camera moves and turns: it
 * may move by whole texels only. */
static void snapped_texels_stay_where_they_are_in_the_world(void **state)
{
    (void)state;
    uint64_t seed = 99;
    const double to_light[3] = {0.3, -0.5, 0.9}, world[3] = {5.0, 7.0, 1.0};
    struct umb_camera camera = camera_of(&seed);
    const struct umb_cascade_settings settings = settings_of(UMB_CASCADE_SLICE);
    struct umb_cascade_plan first, next;
    assert_int_equal(umb_cascades_plan(&camera, to_light, &scene, &settings, &first, NULL), UMB_OK);
    for (int round = 0; round < case_count(2000); round++) {
        struct umb_camera moved = camera_of(&seed); /* turned, and somewhere else */
        moved.fov_y = camera.fov_y;
        moved.aspect = camera.aspect;
        moved.near_m = camera.near_m;
        moved.far_m = camera.far_m;
        assert_int_equal(umb_cascades_plan(&moved, to_light, &scene, &settings, &next, NULL),
                         UMB_OK);
        for (int i = 0; i < 4; i++) {
            struct umb__map_point a, b;
            assert_true(umb__frustum_map(&first.frusta[i], world, &a));
            assert_true(umb__frustum_map(&next.frusta[i], world, &b));
            for (int k = 0; k < 2; k++) {
                const double shift = b.at[k] - a.at[k];
                assert_true(fabs(shift - nearbyint(shift)) < 1e-6);
            }
        }
    }
}

/* Metres of a texel across the view, at the near and the far end of the first slice. */
static void texel_ratio(enum umb_cascade_fit fit, double *near_m, double *ratio)
{
    const struct umb_camera camera = {.eye = {0, 0, 1.7},
                                      .forward = {0, 1, 0},
                                      .up = {0, 0, 1},
                                      .fov_y = 0.58, /* tangents of 0.3 and 0.5 */
                                      .aspect = 5.0 / 3.0,
                                      .near_m = 1.0,
                                      .far_m = 100.0};
    const struct umb_box ground = {{-200, -200, 0}, {200, 200, 10}};
    const double to_light[3] = {0, 0, 1};
    struct umb_cascade_settings settings = settings_of(fit);
    struct umb_cascade_plan plan;
    settings.count = 1;
    assert_int_equal(umb_cascades_plan(&camera, to_light, &ground, &settings, &plan, NULL), UMB_OK);
    double texel[2];
    for (int end = 0; end < 2; end++) {
        const double world[3] = {0, end == 0 ? 2.0 : 98.0, 0};
        struct umb__map_point at;
        assert_true(umb__frustum_map(&plan.frusta[0], world, &at));
        texel[end] = 1.0 / umb__length(at.gradient[0]);
    }
    *near_m = texel[0];
    *ratio = texel[1] / texel[0];
}

static void lispsm_gives_the_near_ground_finer_texels(void **state)
{
    (void)state;
    double plain, warped, ratio;
    texel_ratio(UMB_CASCADE_SCENE, &plain, &ratio);
    assert_true(fabs(ratio - 1.0) < 1e-9);
    texel_ratio(UMB_CASCADE_LISPSM, &warped, &ratio);
    print_message("texel near the eye: %.4f m plain, %.4f m warped; far/near %.2f\n", plain, warped,
                  ratio);
    /* n = 1 + sqrt(100) = 11 before a slice of 99: q runs from 11 to 110. */
    assert_true(ratio > 8.0 && ratio < 10.5);
    assert_true(warped < 0.2 * plain);
}

/* A strip of shadow, 6 fine texels wide, on two maps whose texels differ by 4: the coarse filter
 * is four times as wide, so its shadow is fainter where the layers meet. */
static void the_seam_of_two_layers_is_fainter_and_a_contrast_matches_it(void **state)
{
    enum {
        FINE = 256,
        COARSE = 64,
        POINTS = 61
    };
    static float fine[FINE][FINE], coarse[COARSE][COARSE], scratch[2 * POINTS];
    (void)state;
    for (int y = 0; y < FINE; y++) {
        for (int x = 0; x < FINE; x++) {
            fine[y][x] = x >= 125 && x < 131 ? 0.3F : 0.6F;
        }
    }
    for (int y = 0; y < COARSE; y++) {
        for (int x = 0; x < COARSE; x++) {
            coarse[y][x] = fine[4 * y + 2][4 * x + 2];
        }
    }
    const struct umb_map_frustum fine_frustum = plain_frustum(FINE, FINE);
    struct umb_map_frustum coarse_frustum = plain_frustum(COARSE, COARSE);
    coarse_frustum.world_to_map[0][0] = 0.25;
    coarse_frustum.world_to_map[1][1] = 0.25;
    const struct umb_map_settings settings = {.technique = UMB_MAP_VSM, .blur = 9};
    struct umb_map *a = map_of(&fine_frustum, &fine[0][0], &settings);
    struct umb_map *b = map_of(&coarse_frustum, &coarse[0][0], &settings);
    static double world[POINTS][3];
    for (int i = 0; i < POINTS; i++) {
        world[i][0] = 125.0 + 6.0 * i / POINTS; /* under the strip */
        world[i][1] = 128.0;
        world[i][2] = 60.0;
    }
    const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_cascade_seam seam = {.fine = a, .coarse = b};
    assert_int_equal(umb_cascades_match(&seam, &points, scratch, NULL), UMB_OK);
    print_message("seam: %.3f with C = 1, %.3f with C = %.2f\n", seam.difference, seam.after,
                  seam.contrast);
    assert_true(seam.difference > 0.3);
    assert_true(seam.after < 0.5 * seam.difference);
    assert_true(seam.contrast > 4.0 && seam.contrast < 20.0);
    umb_map_destroy(a);
    umb_map_destroy(b);
}

/* Two maps that answer 0 and 1, so that an answer shows which map gave it; blending must be
 * continuous. */
static void points_ask_their_slice_and_fade_into_the_next(void **state)
{
    (void)state;
    const float dark = 0.0F, light = 1.0F;
    const struct umb_map_frustum frustum = plain_frustum(1, 1);
    const struct umb_map_settings settings = {0};
    struct umb_map *maps[2] = {map_of(&frustum, &dark, &settings),
                               map_of(&frustum, &light, &settings)};
    struct umb_map_query queries[2];
    for (int i = 0; i < 2; i++) {
        queries[i] = query_of(maps[i], &(struct umb_map_filter){.width = 1});
    }
    struct umb_cascade_plan plan = {.count = 2, .splits = {1, 10, 50}, .blend = 0.2};
    plan.forward[2] = 1.0; /* looks along z, which is depth in hundredths */
    for (double z = 0.5; z < 60.0; z += 0.1) {
        const double world[3] = {0.5, 0.5, z};
        const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = 1};
        float value = -1.0F;
        umb_cascades_run(&plan, queries, &points, 0, 1, &value);
        const double expected = fmin(fmax((z - 8.2) / 1.8, 0.0), 1.0);
        assert_true(fabs((double)value - expected) < 1e-6);
    }
    umb_map_destroy(maps[0]);
    umb_map_destroy(maps[1]);
}

static void plans_of_strangers_are_refused_by_name(void **state)
{
    (void)state;
    uint64_t seed = 5;
    const struct umb_camera good = camera_of(&seed);
    const struct umb_cascade_settings settings = settings_of(UMB_CASCADE_SLICE);
    const double to_light[3] = {0, 0, 1}, nothing[3] = {0, 0, 0};
    struct umb_cascade_plan plan;
    struct umb_error error;
    struct umb_camera bad = good;
    bad.near_m = 0.0;
    assert_int_equal(umb_cascades_plan(&bad, to_light, &scene, &settings, &plan, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "near 0"));
    bad = good;
    bad.up[0] = NAN;
    assert_int_equal(umb_cascades_plan(&bad, to_light, &scene, &settings, &plan, &error),
                     UMB_E_ARGUMENT);
    struct umb__map_view view; /* a request brings one as it likes */
    assert_int_equal(umb__map_view_make(&good, &view, NULL), UMB_OK);
    view.right[0] = NAN;
    assert_int_equal(umb__cascades_plan(&view, to_light, &scene, &settings, &plan, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "orthonormal"));
    bad = good;
    bad.fov_y = 3.2;
    assert_int_equal(umb_cascades_plan(&bad, to_light, &scene, &settings, &plan, &error),
                     UMB_E_ARGUMENT);
    assert_int_equal(umb_cascades_plan(&good, nothing, &scene, &settings, &plan, &error),
                     UMB_E_ARGUMENT);
    struct umb_cascade_settings wrong = settings;
    wrong.count = 9;
    assert_int_equal(umb_cascades_plan(&good, to_light, &scene, &wrong, &plan, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "settings.count is 9"));
    wrong = settings;
    wrong.resolution[2] = 3;
    assert_int_equal(umb_cascades_plan(&good, to_light, &scene, &wrong, &plan, &error),
                     UMB_E_ARGUMENT);
    const struct umb_box empty = {{1, 0, 0}, {0, 1, 1}};
    assert_int_equal(umb_cascades_plan(&good, to_light, &empty, &settings, &plan, &error),
                     UMB_E_ARGUMENT);
}

/* These must be refused: otherwise extents would be 0 or infinite, and they are divisors. */
static void cameras_beyond_what_doubles_can_tell_are_refused(void **state)
{
    (void)state;
    uint64_t seed = 6;
    const struct umb_camera good = camera_of(&seed);
    const double to_light[3] = {0, 0, 1};
    struct umb_cascade_plan plan;
    struct umb_error error;
    for (int fit = UMB_CASCADE_SLICE; fit <= UMB_CASCADE_LISPSM; fit++) {
        const struct umb_cascade_settings settings = settings_of((enum umb_cascade_fit)fit);
        const double eyes[] = {1e20, -1e20, 1e29, 1e31, 1e308};
        for (size_t i = 0; i < sizeof eyes / sizeof eyes[0]; i++) {
            struct umb_camera far_away = good;
            far_away.eye[0] = eyes[i];
            assert_int_equal(
                umb_cascades_plan(&far_away, to_light, &scene, &settings, &plan, &error),
                UMB_E_ARGUMENT);
            assert_non_null(strstr(error.message, "eye"));
        }
        struct umb_camera odd = good;
        odd.far_m = 1e300;
        assert_int_equal(umb_cascades_plan(&odd, to_light, &scene, &settings, &plan, &error),
                         UMB_E_ARGUMENT);
        odd = good;
        odd.near_m = 1e-300;
        assert_int_equal(umb_cascades_plan(&odd, to_light, &scene, &settings, &plan, &error),
                         UMB_E_ARGUMENT);
        odd = good;
        odd.aspect = 1e-300;
        assert_int_equal(umb_cascades_plan(&odd, to_light, &scene, &settings, &plan, &error),
                         UMB_E_ARGUMENT);
        odd = good;
        odd.eye[0] = 1e7; /* far, but within reach */
        assert_int_equal(umb_cascades_plan(&odd, to_light, &scene, &settings, &plan, &error),
                         UMB_OK);
        for (uint32_t slice = 0; slice < plan.count; slice++) {
            for (int i = 0; i < 16; i++) {
                assert_true(isfinite(plan.frusta[slice].world_to_map[i / 4][i % 4]));
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splits_mix_logarithmic_and_uniform_ones),
        cmocka_unit_test(every_visible_point_of_the_scene_lies_on_its_map),
        cmocka_unit_test(snapped_texels_stay_where_they_are_in_the_world),
        cmocka_unit_test(lispsm_gives_the_near_ground_finer_texels),
        cmocka_unit_test(the_seam_of_two_layers_is_fainter_and_a_contrast_matches_it),
        cmocka_unit_test(points_ask_their_slice_and_fade_into_the_next),
        cmocka_unit_test(plans_of_strangers_are_refused_by_name),
        cmocka_unit_test(cameras_beyond_what_doubles_can_tell_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
