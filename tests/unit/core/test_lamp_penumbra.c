/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares penumbras of lamps with the share of the light's points that a receiver sees, computed
 * in world space: a plate hangs between a light of six faces and a floor. Also tests coarse
 * look-ups and windows in metres on the same assets.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "lamp_fixture.h"

enum {
    POINTS = 500,
    SIDE = 64 /* points of the light on each axis, of the truth */
};

/* A plate and a floor, both across `normal`, at distances from the light. The plate is a square
 * around the foot of the light's perpendicular, moved by `shift` along a[0]. */
struct stage {
    double normal[3], a[2][3];
    double plate, half, shift, floor;
};

static double dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static struct stage stage_of(double x, double y, double z, double shift)
{
    struct stage s = {.plate = 2, .half = 0.5, .shift = shift, .floor = 4};
    const double length = sqrt(x * x + y * y + z * z);
    const double n[3] = {x / length, y / length, z / length};
    memcpy(s.normal, n, sizeof n);
    const double flat = sqrt(n[0] * n[0] + n[1] * n[1]);
    s.a[0][0] = -n[1] / flat;
    s.a[0][1] = n[0] / flat;
    s.a[1][0] = n[1] * 0 - n[2] * s.a[0][1];
    s.a[1][1] = n[2] * s.a[0][0];
    s.a[1][2] = n[0] * s.a[0][1] - n[1] * s.a[0][0];
    return s;
}

/* Returns true if the segment between two places, relative to the light, passes through the
 * plate. */
static int passes_plate(const struct stage *s, const double from[3], const double to[3])
{
    const double h0 = dot3(s->normal, from), h1 = dot3(s->normal, to);
    double p[3];
    if ((h0 < s->plate) == (h1 < s->plate)) {
        return 0;
    }
    const double t = (s->plate - h0) / (h1 - h0);
    for (int k = 0; k < 3; k++) {
        p[k] = from[k] + t * (to[k] - from[k]);
    }
    return fabs(dot3(s->a[0], p) - s->shift) < s->half && fabs(dot3(s->a[1], p)) < s->half;
}

static int before_stage(const void *user, uint32_t face, uint32_t x, uint32_t y, uint32_t z)
{
    const struct stage *s = user;
    static const double middle[3] = {0, 0, 0};
    const double w = near_w + (z + 0.5) / SIZE * (far_w - near_w);
    const double u = ((x + 0.5) / SIZE * 2 - 1) * tangent * w;
    const double v = ((y + 0.5) / SIZE * 2 - 1) * tangent * w;
    double axes[3][3], p[3];
    face_axes(face, axes);
    for (int k = 0; k < 3; k++) {
        p[k] = u * axes[0][k] + v * axes[1][k] + w * axes[2][k];
    }
    return dot3(s->normal, p) < s->floor && !passes_plate(s, middle, p);
}

/* Computes the half axes of the light as a receiver at p, relative to the light, sees it. */
static void light_axes(const struct umb_light_info *light, const double p[3], double half[2][3])
{
    double n[3];
    const double radius = light->extent / 2, length = sqrt(dot3(p, p));
    const double side = sqrt(dot3(light->side, light->side));
    for (int k = 0; k < 3; k++) {
        n[k] = light->kind == UMB_LIGHT_POINT ? p[k] / length : light->direction[k];
    }
    const int least = fabs(n[0]) < 0.6 ? 0 : 1;
    double axis[3] = {least == 0, least == 1, 0};
    for (int k = 0; k < 3; k++) {
        half[0][k] = side > 0
                         ? light->side[k] / 2
                         : radius * (axis[k] - n[least] * n[k]) / sqrt(1 - n[least] * n[least]);
    }
    const double scale = radius / sqrt(dot3(half[0], half[0]));
    half[1][0] = scale * (n[1] * half[0][2] - n[2] * half[0][1]);
    half[1][1] = scale * (n[2] * half[0][0] - n[0] * half[0][2]);
    half[1][2] = scale * (n[0] * half[0][1] - n[1] * half[0][0]);
}

/* Returns the share of the light that a receiver at p, relative to the light, sees. */
static double truth(const struct stage *s, const struct umb_light_info *light, const double p[3])
{
    double half[2][3], all = 0, seen = 0;
    light_axes(light, p, half);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double a = 2 * (i % SIDE + 0.5) / SIDE - 1, b = 2 * (i / SIDE + 0.5) / SIDE - 1;
        double at[3];
        if (light->kind != UMB_LIGHT_RECTANGLE && a * a + b * b > 1) {
            continue;
        }
        for (int k = 0; k < 3; k++) {
            at[k] = a * half[0][k] + b * half[1][k];
        }
        all++;
        seen += !passes_plate(s, p, at);
    }
    return seen / all;
}

static double storage[POINTS][3];
static float normals[POINTS][3], values[POINTS];

/* Points on the floor around the plate's shadow, with the floor's normal. */
static struct umb_points floor_points(const struct stage *s, uint64_t *seed)
{
    struct umb_points points = {
        .positions = storage, .format = UMB_POINT_F64, .normals = normals, .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    for (size_t i = 0; i < POINTS; i++) {
        const double x = s->shift * 2 + (random_unit(seed) * 2 - 1) * 2.5;
        const double y = (random_unit(seed) * 2 - 1) * 2.5;
        for (int k = 0; k < 3; k++) {
            storage[i][k] =
                eye[k] - origin[k] + s->floor * s->normal[k] + x * s->a[0][k] + y * s->a[1][k];
            normals[i][k] = (float)-s->normal[k];
        }
    }
    return points;
}

static struct umb_query prepared(const struct umb_asset *asset,
                                 const struct umb_query_settings *settings)
{
    struct umb_query query;
    struct umb_error error = {0};
    if (umb_query_prepare(asset, settings, &query, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return query;
}

static void run(const struct umb_asset *asset, const struct umb_query_settings *settings,
                const struct umb_points *points, float *answers_of)
{
    const struct umb_query query = prepared(asset, settings);
    struct umb_answers answers = {.values = answers_of};
    umb_query_run(&query, points, 0, points->count, &answers);
    assert_int_equal(answers.stats.points, points->count);
}

static struct umb_asset *open_stage(const struct stage *s, const struct umb_light_info *light)
{
    const struct lamp_model model = {before_stage, s, light};
    struct umb_error error = {0};
    struct umb_asset *asset = try_lamp(&model, &error);
    if (asset == NULL) {
        fail_msg("%s", error.message);
    }
    return asset;
}

/* A rectangle or disc that looks along the stage's normal, its side along the plate's diagonal. */
static struct umb_light_info area_light(const struct stage *s, enum umb_light_kind kind,
                                        double first, double second)
{
    struct umb_light_info light = {.kind = kind, .extent = second};
    for (int k = 0; k < 3 && kind != UMB_LIGHT_POINT; k++) {
        light.direction[k] = s->normal[k];
        light.side[k] = first * sqrt(0.5) * (s->a[0][k] + s->a[1][k]);
    }
    return light;
}

/*
 * The plate's shadow lies in one face, across an edge, and around a corner of the cube. Faces have
 * 128 texels a side, of 0.07 m on the floor, and half a texel may shift an edge. A penumbra is 0.3
 * to 1.2 m wide, so that is 0.03 to 0.12 of the light; the strip of 0.02 m has hard edges at its
 * ends. In a square of points of which a quarter is penumbra the mean error is then at most 0.015.
 */
static void penumbras_are_the_share_of_the_light_that_is_seen(void **state)
{
    static const double towards[3][3] = {{0.1, 0.05, 1}, {1, 0.9, 0.1}, {1, 1.05, 0.95}};
    static const struct {
        enum umb_light_kind kind;
        double first, second;
    } lights[] = {{UMB_LIGHT_POINT, 0, 0.5},
                  {UMB_LIGHT_DISC, 0, 0.7},
                  {UMB_LIGHT_RECTANGLE, 0.8, 0.3},
                  {UMB_LIGHT_RECTANGLE, 1.2, 0.02}};
    uint64_t seed = 91;
    (void)state;
    const size_t step = (size_t)short_count(1, 4); /* every kind of light in the short form, too */
    for (size_t n = 0; n < 12; n += step) {
        const double *to = towards[n % 3];
        const struct stage s = stage_of(to[0], to[1], to[2], n % 2 ? 0.4 : 0);
        const struct umb_light_info light =
            area_light(&s, lights[n / 3].kind, lights[n / 3].first, lights[n / 3].second);
        struct umb_asset *asset = open_stage(&s, &light);
        const struct umb_points points = floor_points(&s, &seed);
        double sum = 0, worst = 0;
        size_t half = 0;
        run(asset, &(struct umb_query_settings){.filter = UMB_FILTER_PENUMBRA}, &points, values);
        for (size_t i = 0; i < POINTS; i++) {
            double p[3];
            for (int k = 0; k < 3; k++) {
                p[k] = storage[i][k] - (eye[k] - origin[k]);
            }
            const double want = truth(&s, &light, p), off = fabs((double)values[i] - want);
            sum += off;
            worst = fmax(worst, off);
            half += want > 0.05 && want < 0.95;
        }
        print_message("%zu: mean %.4f, worst %.3f, %zu half\n", n, sum / POINTS, worst, half);
        assert_true(half > POINTS / 20);
        assert_true(sum / POINTS <= 0.015);
        assert_true(worst <= 0.3);
        umb_asset_close(asset);
    }
}

/* Random planes across faces, as in test_perspective.c, under every kind of light. */
static void a_plane_never_shadows_itself_in_penumbras_and_coarse_look_ups(void **state)
{
    uint64_t seed = 92;
    (void)state;
    for (int n = 0; n < short_count(6, 3); n++) {
        struct stage s = stage_of(random_unit(&seed) - 0.5, random_unit(&seed) - 0.5,
                                  random_unit(&seed) - 0.5, 0);
        s.half = 0;
        const enum umb_light_kind kinds[] = {UMB_LIGHT_POINT, UMB_LIGHT_DISC, UMB_LIGHT_RECTANGLE};
        const struct umb_light_info light = area_light(&s, kinds[n % 3], n % 3 == 2 ? 0.6 : 0, 0.4);
        struct umb_asset *asset = open_stage(&s, &light);
        for (int normal = 1; normal >= 0; normal--) {
            struct umb_points points = floor_points(&s, &seed);
            points.normals = normal ? normals : NULL;
            struct umb_query_settings settings = {.filter = UMB_FILTER_PENUMBRA};
            run(asset, &settings, &points, values);
            for (size_t i = 0; i < POINTS; i++) {
                if (values[i] != 1.0F) {
                    fail_msg("plane %d, point %zu: %g", n, i, (double)values[i]);
                }
            }
            settings = (struct umb_query_settings){.level = 3};
            run(asset, &settings, &points, values);
            for (size_t i = 0; i < POINTS && normal; i++) {
                if (values[i] != 1.0F) {
                    fail_msg("plane %d, level 3, point %zu: %g", n, i, (double)values[i]);
                }
            }
        }
        umb_asset_close(asset);
    }
}

static void an_area_light_shines_to_one_side_for_every_filter(void **state)
{
    static const struct umb_query_settings all[] = {
        {.taps = 1},
        {.taps = 9},
        {.level = 3},
        {.footprint_m = 0.3},
        {.filter = UMB_FILTER_PENUMBRA},
        {.filter = UMB_FILTER_FOOTPRINT, .footprint_m = 0.5}};
    const struct stage s = stage_of(0.2, 0.3, 1, 0);
    const struct umb_light_info light = area_light(&s, UMB_LIGHT_DISC, 0, 0.4);
    struct umb_asset *asset = open_stage(&s, &light);
    uint64_t seed = 93;
    struct umb_points points = {.positions = storage, .format = UMB_POINT_F64, .count = POINTS};
    (void)state;
    memcpy(points.origin, origin, sizeof origin);
    for (size_t i = 0; i < POINTS; i++) {
        for (int k = 0; k < 3; k++) {
            storage[i][k] = eye[k] - origin[k] + (random_unit(&seed) - 0.5) * 3;
        }
    }
    for (size_t n = 0; n < sizeof all / sizeof all[0]; n++) {
        struct umb_query_settings settings = all[n];
        settings.bias_mode = UMB_BIAS_NONE;
        const struct umb_query query = prepared(asset, &settings);
        struct umb_answers answers = {.values = values};
        umb_query_run(&query, &points, 0, POINTS, &answers);
        uint64_t behind = 0;
        for (size_t i = 0; i < POINTS; i++) {
            double p[3];
            for (int k = 0; k < 3; k++) {
                p[k] = storage[i][k] - (eye[k] - origin[k]);
            }
            const double height = dot3(p, light.direction);
            behind += height <= 0;
            /* Well before the plate all is lit; a footprint may reach behind the light. */
            if (height <= 0 ? values[i] != 0 : n < 5 && height < 1 && values[i] != 1) {
                fail_msg("settings %zu, point %zu at %g: %g", n, i, height, (double)values[i]);
            }
        }
        assert_true(n == 5 || answers.stats.facing_away == behind);
    }
    umb_asset_close(asset);
}

/* If a cell answers 0 or 1 it is uniform, so the voxel in it must give the same answer. */
static void coarse_look_ups_agree_with_the_voxels(void **state)
{
    const struct stage s = stage_of(1, 0.9, 0.1, 0.4);
    struct umb_asset *asset = open_stage(&s, NULL);
    static float fine[POINTS];
    size_t sure = 0, mixed = 0;
    uint64_t seed = 94;
    struct umb_points points = {.positions = storage, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_query_settings settings = {.level = 3, .bias_mode = UMB_BIAS_NONE};
    (void)state;
    memcpy(points.origin, origin, sizeof origin);
    for (size_t i = 0; i < POINTS; i++) {
        for (int k = 0; k < 3; k++) {
            storage[i][k] =
                eye[k] - origin[k] + 4 * s.normal[k] + (random_unit(&seed) * 2 - 1) * 2.5;
        }
    }
    run(asset, &settings, &points, values);
    settings.level = 0;
    run(asset, &settings, &points, fine);
    for (size_t i = 0; i < POINTS; i++) {
        assert_true(values[i] == 0.5F || values[i] == fine[i]);
        sure += values[i] != 0.5F;
        mixed += values[i] == 0.5F;
    }
    assert_true(sure > POINTS / 10 && mixed > POINTS / 10);
    umb_asset_close(asset);
}

/* A width in metres must become the odd number of texels at the point that is nearest to it. */
static void widths_in_metres_are_windows_of_the_texels_there(void **state)
{
    const struct stage s = stage_of(0.1, 0.05, 1, 0);
    struct umb_asset *asset = open_stage(&s, NULL);
    static float windows[9][POINTS];
    const double texel = 2 * tangent / SIZE;
    uint64_t seed = 95;
    const struct umb_points points = floor_points(&s, &seed);
    size_t widths[9] = {0};
    (void)state;
    for (uint32_t n = 0; n < 9; n++) {
        run(asset, &(struct umb_query_settings){.taps = 2 * n + 1}, &points, windows[n]);
    }
    run(asset, &(struct umb_query_settings){.footprint_m = 0.45}, &points, values);
    for (size_t i = 0; i < POINTS; i++) {
        double w = 0;
        for (int k = 0; k < 3; k++) {
            w = fmax(w, fabs(storage[i][k] - (eye[k] - origin[k])));
        }
        const size_t n = (size_t)fmin(0.45 / (texel * w) / 2, 8);
        assert_true(values[i] == windows[n][i]);
        widths[n]++;
    }
    assert_true(widths[3] > 0 && widths[2] > 0);
    umb_asset_close(asset);
}

static void formats_and_splits_tell_the_same(void **state)
{
    static float parts[POINTS];
    static uint8_t bytes[POINTS];
    const struct stage s = stage_of(1, 0.9, 0.1, 0.4);
    const struct umb_light_info light = area_light(&s, UMB_LIGHT_DISC, 0, 0.7);
    struct umb_asset *asset = open_stage(&s, &light);
    uint64_t seed = 96;
    const struct umb_points points = floor_points(&s, &seed);
    struct umb_query_settings settings = {.filter = UMB_FILTER_PENUMBRA};
    struct umb_query query = prepared(asset, &settings);
    struct umb_answers floats = {.values = values}, split = {.values = parts};
    struct umb_answers u8 = {.values = bytes};
    (void)state;
    umb_query_run(&query, &points, 0, POINTS, &floats);
    umb_query_run(&query, &points, 0, 17, &split);
    umb_query_run(&query, &points, 17, POINTS - 17, &split);
    assert_memory_equal(values, parts, sizeof values);
    assert_memory_equal(&floats.stats, &split.stats, sizeof floats.stats);
    settings.format = UMB_ANSWER_U8;
    query = prepared(asset, &settings);
    umb_query_run(&query, &points, 0, POINTS, &u8);
    for (size_t i = 0; i < POINTS; i++) {
        struct umb_explanation e;
        query = prepared(asset, &(struct umb_query_settings){.filter = UMB_FILTER_PENUMBRA});
        umb_query_explain(&query, &points, i, &e);
        assert_true(fabs(bytes[i] - 255.0 * (double)values[i]) <= 0.501);
        assert_true((float)e.answer == values[i]);
    }
    umb_asset_close(asset);
}

/* Points at the light, far beyond doubles' resolution, and not finite: any answer from 0 to 1. */
static void numbers_that_overflow_do_no_harm(void **state)
{
    static const double far[] = {0,      1e-310,           1e-30,       1e15, -3e18, 1e300,
                                 -1e306, (double)INFINITY, (double)NAN, 5};
    const struct stage s = stage_of(1, 0.9, 0.1, 0.4);
    const struct umb_light_info light = area_light(&s, UMB_LIGHT_RECTANGLE, 1e6, 1e-9);
    struct umb_asset *asset = open_stage(&s, &light);
    uint64_t seed = 97;
    struct umb_points points = {
        .positions = storage, .format = UMB_POINT_F64, .normals = normals, .count = POINTS};
    (void)state;
    memcpy(points.origin, eye, sizeof eye);
    for (size_t i = 0; i < POINTS; i++) {
        for (int k = 0; k < 3; k++) {
            storage[i][k] = far[next_random(&seed) % 10] * (random_unit(&seed) * 2 - 1);
            normals[i][k] = (float)(far[next_random(&seed) % 10] * random_unit(&seed));
        }
    }
    run(asset, &(struct umb_query_settings){.filter = UMB_FILTER_PENUMBRA}, &points, values);
    for (size_t i = 0; i < POINTS; i++) {
        assert_true(values[i] >= 0 && values[i] <= 1);
    }
    umb_asset_close(asset);
}

static void extents_out_of_range_are_refused_by_name(void **state)
{
    static const struct {
        struct umb_light_info light;
        struct umb_query_settings settings;
        const char *message;
    } cases[] = {
        {{.kind = UMB_LIGHT_POINT}, {0}, "light 0 (point) is 0 m across"},
        {{.kind = UMB_LIGHT_POINT, .extent = 1e300}, {0}, "1e+300 m across"},
        {{.kind = UMB_LIGHT_POINT, .extent = 1}, {.light_extent = 0.1}, "light_extent: 0.1 rad"},
        {{.kind = UMB_LIGHT_POINT, .extent = -1}, {0}, "extent -1 must be finite"},
        {{.kind = UMB_LIGHT_POINT, .extent = (double)NAN}, {0}, "extent nan must be finite"},
        {{.kind = UMB_LIGHT_POINT, .extent = 1, .side = {1}}, {0}, "lights[0].side: (1, 0, 0)"},
        {{.kind = UMB_LIGHT_DISC, .extent = 1}, {0}, "direction: (0, 0, 0)"},
        {{.kind = UMB_LIGHT_RECTANGLE, .extent = 1, .direction = {0, 0, 1}},
         {0},
         "light 0 (rectangle) is 0 m across"},
        {{.kind = UMB_LIGHT_RECTANGLE, .extent = 1, .direction = {0, 0, 1}, .side = {1e9}},
         {0},
         "1e+09 m across"},
        {{.kind = UMB_LIGHT_RECTANGLE, .extent = 1, .direction = {0, 0, 1}, .side = {1, 0, 0.1}},
         {0},
         "across the direction of a rectangle"},
        {{.kind = UMB_LIGHT_RECTANGLE, .extent = 1, .direction = {0, 0, 1}, .side = {1e200}},
         {0},
         "side: (1e+200"},
        {{.kind = (enum umb_light_kind)5, .extent = 1}, {0}, "kind: 5, this reader knows 0 to 4"},
    };
    const struct stage s = stage_of(0.1, 0.05, 1, 0);
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct lamp_model model = {before_stage, &s, &cases[i].light};
        struct umb_error error = {0};
        struct umb_asset *asset = try_lamp(&model, &error);
        struct umb_query_settings settings = cases[i].settings;
        struct umb_query query;
        settings.filter = UMB_FILTER_PENUMBRA;
        assert_true(asset == NULL || umb_query_prepare(asset, &settings, &query, &error) != UMB_OK);
        if (strstr(error.message, cases[i].message) == NULL) {
            fail_msg("case %zu: %s", i, error.message);
        }
        umb_asset_close(asset);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(penumbras_are_the_share_of_the_light_that_is_seen),
        cmocka_unit_test(a_plane_never_shadows_itself_in_penumbras_and_coarse_look_ups),
        cmocka_unit_test(an_area_light_shines_to_one_side_for_every_filter),
        cmocka_unit_test(coarse_look_ups_agree_with_the_voxels),
        cmocka_unit_test(widths_in_metres_are_windows_of_the_texels_there),
        cmocka_unit_test(formats_and_splits_tell_the_same),
        cmocka_unit_test(numbers_that_overflow_do_no_harm),
        cmocka_unit_test(extents_out_of_range_are_refused_by_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
