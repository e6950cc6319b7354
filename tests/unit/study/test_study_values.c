/* SPDX-License-Identifier: Apache-2.0 */
/* The study's tone curve and traced reference. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "study/picture_light.h"
#include "study/picture_text.h"
#include "study/study_scene.h"
#include "study/study_math.h"
#include "study/traced_shadow.h"

static void near_check(const char *what, double have, double want, double tolerance)
{
    if (!(fabs(have - want) <= tolerance)) {
        fail_msg("%s: have %.17g, want %.17g", what, have, want);
    }
}

static void tone_curve_rises_and_stays_in_range(void **state)
{
    (void)state;
    double last = -1.0;
    for (double x = 0.0; x < 8.0; x += 0.01) {
        const double y = umbt_shoulder(x);
        assert_true(y > last && y >= 0.0 && y < 1.0 && y <= x + 1e-15);
        last = y;
    }
    assert_int_equal(umbt_srgb8(0.0), 0);
    assert_int_equal(umbt_srgb8(1.0), 255);
    assert_int_equal(umbt_srgb8(2.0), 255);
    assert_int_equal(umbt_srgb8(-1.0), 0);
    assert_int_equal(umbt_srgb8(0.2140411), 127); /* the middle code, IEC 61966-2-1 */
    const struct umbt_rgb surface = umbt_surface_color(3);
    const struct umbt_rgb lit = umbt_shade(surface, 1.0, 0.8, 1.0);
    const struct umbt_rgb shadowed = umbt_shade(surface, 0.0, 0.8, 1.0);
    const struct umbt_rgb away = umbt_shade(surface, 1.0, -0.8, 1.0);
    for (int k = 0; k < 3; k++) {
        assert_true(lit.c[k] > 2.0 * shadowed.c[k]);
        near_check("facing away", away.c[k], shadowed.c[k], 0.0);
    }
}

/* Over a square of the pattern, the mean of the codes is the value itself. */
static void dithered_values_keep_their_mean(void **state)
{
    (void)state;
    for (double x = 0.05; x < 0.95; x += 0.01) {
        double sum = 0.0;
        const double encoded = 255.0 * (1.055 * pow(x, 1.0 / 2.4) - 0.055);
        for (uint32_t i = 0; i < 64; i++) {
            sum += umbt_srgb8_dithered(x, umbt_dither(8 + i % 8, 16 + i / 8));
        }
        near_check("mean of the codes", sum / 64.0, encoded, 1.0 / 64.0);
    }
    assert_int_equal(umbt_srgb8_dithered(1.0, 0.999), 255);
    assert_int_equal(umbt_srgb8_dithered(0.0, 0.999), 0);
}

/* Counts white pixels, and checks that all others are a quarter of what they were. */
static size_t white_count(const struct umbt_picture *picture, uint32_t width, uint32_t height)
{
    size_t white = 0;
    for (uint32_t y = 0; y < picture->height; y++) {
        for (uint32_t x = 0; x < picture->width; x++) {
            const uint8_t *pixel = &picture->pixels[3 * ((size_t)y * picture->width + x)];
            const int inside = x >= 3 && y >= 4 && x < 3 + width && y < 4 + height;
            assert_true(pixel[0] == (inside ? 25 : 100) || (inside && pixel[0] == 255));
            white += pixel[0] == 255;
        }
    }
    return white;
}

static void labels_are_text_on_a_strip(void **state)
{
    (void)state;
    struct umbt_picture picture;
    size_t white[3];
    static const char *const texts[] = {"-", "I", "W|"};
    for (int i = 0; i < 3; i++) {
        const uint32_t width = umbt_label_width(texts[i], 2), height = 2 * UMBT_LABEL_HEIGHT;
        assert_int_equal(umbt_picture_init(&picture, 40, 40, NULL), UMB_OK);
        memset(picture.pixels, 100, (size_t)3 * 40 * 40);
        umbt_label_draw(&picture, 3, 4, 2, texts[i]);
        white[i] = white_count(&picture, width, height);
        umbt_label_draw(&picture, 30, 35, 8, texts[i]); /* cut off at the border */
        umbt_label_draw(&picture, 400, 400, 8, texts[i]);
        umbt_label_draw(&picture, 0, 0, 1, "");
        umbt_picture_finish(&picture);
    }
    assert_int_equal(white[0], 4 * 3); /* three font pixels */
    assert_int_equal(white[1], 4 * 11);
    assert_true(white[2] > white[1]);
    assert_int_equal(umbt_label_width("abc", 1), 3 * 6 - 1 + 4);
}

static void lamps_fall_off_with_the_square_of_the_distance(void **state)
{
    (void)state;
    const struct umb_light_info lamp = {
        .kind = UMB_LIGHT_SPOT, .direction = {0, 0, -1}, .position = {0, 0, 10}};
    struct umbt_picture_light light = {.lamp = &lamp, .reference_m = 5.0};
    static const double up[3] = {0, 0, 1}, below[3] = {0, 0, 0}, beside[3] = {10, 0, 0};
    double share;
    near_check("cosine below", umbt_picture_light_at(&light, below, up, &share), 1.0, 1e-12);
    near_check("share at twice the reference", share, 0.25, 1e-5);
    near_check("cosine beside", umbt_picture_light_at(&light, beside, up, &share), sqrt(0.5), 1e-9);
    near_check("share beside", share, 0.125, 1e-5);
    light.cone[0] = cos(0.2); /* beside is at 45 degrees: outside */
    light.cone[1] = cos(0.7);
    (void)umbt_picture_light_at(&light, beside, up, &share);
    near_check("share outside of the cone", share, 0.0, 0.0);
    (void)umbt_picture_light_at(&light, below, up, &share);
    near_check("share inside of the cone", share, 0.25, 1e-5);
}

/* A frustum of half-metre voxels that looks straight down. */
static void frustum_make(struct umb_frustum_info *frustum)
{
    memset(frustum, 0, sizeof *frustum);
    frustum->log2_size = 6;
    frustum->world_to_voxel[0][0] = 2.0;
    frustum->world_to_voxel[1][1] = -2.0;
    frustum->world_to_voxel[2][2] = -2.0;
    frustum->world_to_voxel[3][3] = 1.0;
    for (int k = 0; k < 3; k++) {
        frustum->world_to_voxel[k][3] = 32.0;
        frustum->voxel_step[k][k] = 1.0 / frustum->world_to_voxel[k][k];
    }
}

static void bias_follows_the_documented_formula(void **state)
{
    (void)state;
    struct umb_frustum_info frustum;
    struct umb_query_settings settings = {.taps = 1};
    frustum_make(&frustum);
    const double up[3] = {0.0, 0.0, 1.0}, slanted[3] = {0.6, 0.0, 0.8};
    near_check("one tap, facing", umbt_truth_bias(&settings, &frustum, up), 0.25, 1e-15);
    near_check("one tap, slanted", umbt_truth_bias(&settings, &frustum, slanted), 0.35, 1e-15);
    settings.taps = 9;
    near_check("nine taps", umbt_truth_bias(&settings, &frustum, slanted), 0.25 * (9.0 * 0.6 + 0.8),
               1e-15);
    settings.bias_mode = UMB_BIAS_VOXELS;
    settings.bias = 3.0;
    near_check("voxels", umbt_truth_bias(&settings, &frustum, slanted), 1.5, 1e-15);
    settings.bias_mode = UMB_BIAS_METRES;
    near_check("metres", umbt_truth_bias(&settings, &frustum, slanted), 3.0, 0.0);
    settings.bias_mode = UMB_BIAS_NONE;
    near_check("none", umbt_truth_bias(&settings, &frustum, slanted), 0.0, 0.0);
}

/* Under a sun overhead the move is along the light, by at most 1.5 texels with one tap; the rest is
 * along the normal. Before a lamp all of it is along the normal. */
static void lifts_follow_the_documented_formula(void **state)
{
    (void)state;
    static const double origin[3] = {0.0, 0.0, 0.0};
    const double gentle[3] = {0.6, 0.0, 0.8}, steep[3] = {0.96, 0.0, 0.28};
    const struct umb_light_info lamp = {.kind = UMB_LIGHT_POINT};
    struct umbt_truth truth = {.settings = {.taps = 1}, .to_light = {0.0, 0.0, 1.0}};
    struct umb_frustum_info frustum;
    double moved[3];
    frustum_make(&frustum);
    umbt_truth_move(&truth, &frustum, origin, gentle, moved);
    near_check("gentle, across", moved[0], 0.0, 1e-15);
    near_check("gentle, lift", moved[2], 0.35 / 0.8, 1e-15);
    umbt_truth_move(&truth, &frustum, origin, steep, moved);
    const double rest = 0.25 * (0.96 + 0.28) - 0.75 * 0.28;
    near_check("steep, across", moved[0], 0.96 * rest, 1e-15);
    near_check("steep, lift", moved[2], 0.75 + 0.28 * rest, 1e-15);
    truth.lamp = &lamp;
    umbt_truth_move(&truth, &frustum, origin, gentle, moved);
    near_check("lamp, across", moved[0], 0.6 * 0.35, 1e-15);
    near_check("lamp, along", moved[2], 0.8 * 0.35, 1e-15);
}

/* A floor at z = 0 and, 2 m above it, a roof over x < 0. */
static const double house[4][3][3] = {
    {{-9.0, -9.0, 0.0}, {9.0, -9.0, 0.0}, {9.0, 9.0, 0.0}},
    {{-9.0, -9.0, 0.0}, {9.0, 9.0, 0.0}, {-9.0, 9.0, 0.0}},
    {{-9.0, -9.0, 2.0}, {0.0, -9.0, 2.0}, {0.0, 9.0, 2.0}},
    {{-9.0, -9.0, 2.0}, {0.0, 9.0, 2.0}, {-9.0, 9.0, 2.0}},
};

static void window_counts_the_texels_beyond_the_edge(void **state)
{
    (void)state;
    struct umbr_rays *rays = NULL;
    struct umb_error error;
    assert_int_equal(umbr_rays_build(house, 4, NULL, &rays, &error), UMB_OK);
    struct umbt_truth truth = {.rays = rays,
                               .kind = UMBT_TRUTH_TEXELS,
                               .settings = {.taps = 3},
                               .samples = 30,
                               .to_light = {0.0, 0.0, 1.0},
                               .diagonal_m = 26.0};
    frustum_make(&truth.frustum);
    const double up[3] = {0.0, 0.0, 1.0}, down[3] = {0.0, 0.0, -1.0};
    const double under[3] = {-5.0, 1.0, 0.0}, open[3] = {5.0, 1.0, 0.0}, edge[3] = {0.1, 1.1, 0.0};
    near_check("under the roof", (double)umbt_truth_visibility(&truth, under, up), 0.0, 0.0);
    near_check("in the open", (double)umbt_truth_visibility(&truth, open, up), 1.0, 0.0);
    near_check("facing away", (double)umbt_truth_visibility(&truth, open, down), 0.0, 0.0);
    /* Texels [-0.5,0) [0,0.5) [0.5,1): one of three columns has its centre under the roof. */
    near_check("at the edge", (double)umbt_truth_visibility(&truth, edge, up), 2.0 / 3.0, 1e-6);
    /* The area around x = 0.1 is 1.5 m wide: 0.85 of it beyond the edge; 30 columns resolve 1/30.
     */
    truth.kind = UMBT_TRUTH_AREA;
    near_check("area", (double)umbt_truth_visibility(&truth, edge, up), 0.85 / 1.5, 1.0 / 30.0);
    truth.kind = UMBT_TRUTH_SURFACE;
    near_check("surface", (double)umbt_truth_visibility(&truth, edge, up), 1.0, 0.0);
    near_check("surface, under", (double)umbt_truth_visibility(&truth, under, up), 0.0, 0.0);
    umbr_rays_destroy(rays);
}

/* A cube of 6 m, wound outwards: bit k of a corner's number is the side along axis k. */
static void cube_make(double corners[12][3][3])
{
    static const int faces[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6},
                                     {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7},
                                     {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    for (int t = 0; t < 12; t++) {
        for (int c = 0; c < 3; c++) {
            for (int k = 0; k < 3; k++) {
                corners[t][c][k] = ((faces[t][c] >> k) & 1) ? 3.0 : -3.0;
            }
        }
    }
}

static void window_knows_when_it_reaches_into_a_closed_solid(void **state)
{
    (void)state;
    struct umbr_rays *rays = NULL;
    struct umb_error error;
    double cube[12][3][3];
    uint8_t closed[12];
    cube_make(cube);
    memset(closed, 1, sizeof closed);
    assert_int_equal(umbr_rays_build((const double(*)[3][3])cube, 12, NULL, &rays, &error), UMB_OK);
    struct umbt_truth truth = {.rays = rays,
                               .settings = {.taps = 3, .bias_mode = UMB_BIAS_NONE},
                               .to_light = {0.0, 0.0, 1.0},
                               .diagonal_m = 11.0,
                               .closed = closed};
    frustum_make(&truth.frustum);
    const double up[3] = {0.0, 0.0, 1.0};
    const double inside[3] = {0.1, 0.2, 0.3}, above[3] = {0.1, 0.2, 3.1};
    /* Texels are 0.5 m: around x = 3.1 the nearest centre is 3.25 or, one to the left, 2.75. */
    const double beside[3] = {3.1, 0.2, 0.3}, apart[3] = {3.6, 0.2, 0.3};
    assert_int_equal(umbt_truth_is_undefined(&truth, inside, up), 1);
    assert_int_equal(umbt_truth_is_undefined(&truth, above, up), 0);
    assert_int_equal(umbt_truth_is_undefined(&truth, beside, up), 1);
    assert_int_equal(umbt_truth_is_undefined(&truth, apart, up), 0);
    truth.settings.taps = 1;
    assert_int_equal(umbt_truth_is_undefined(&truth, beside, up), 0);
    truth.closed = NULL;
    assert_int_equal(umbt_truth_is_undefined(&truth, inside, up), 0);
    umbr_rays_destroy(rays);
}

static void plans_are_read_line_by_line(void **state)
{
    (void)state;
    static const char plan[] =
        "effect=closed state=on reason=\"all\" cost=\"a layer\"\n"
        "effect=cut-out state=off reason=\"switched off\" cost=\"none\"\n"
        "effect=transmittance state=off reason=\"the first 'effect=cut-out state=on '\"\n";
    assert_int_equal(umbt_plan_has(plan, "closed"), 1);
    assert_int_equal(umbt_plan_has(plan, "cut-out"), 0);
    assert_int_equal(umbt_plan_has("effect=cut-out state=on reason=\"\"", "cut-out"), 1);
    assert_int_equal(umbt_plan_has("effect=a state=off\neffect=cut-out state=on x", "cut-out"), 1);
    assert_int_equal(umbt_plan_has("", "cut-out"), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tone_curve_rises_and_stays_in_range),
        cmocka_unit_test(dithered_values_keep_their_mean),
        cmocka_unit_test(labels_are_text_on_a_strip),
        cmocka_unit_test(lamps_fall_off_with_the_square_of_the_distance),
        cmocka_unit_test(bias_follows_the_documented_formula),
        cmocka_unit_test(lifts_follow_the_documented_formula),
        cmocka_unit_test(window_counts_the_texels_beyond_the_edge),
        cmocka_unit_test(plans_are_read_line_by_line),
        cmocka_unit_test(window_knows_when_it_reaches_into_a_closed_solid),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
