/* SPDX-License-Identifier: Apache-2.0 */
/* Pixels to points, and packed answers. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/picture.h"

enum {
    WIDTH = 7,
    HEIGHT = 5,
    PIXELS = WIDTH * HEIGHT
};

static float depths[PIXELS];

static struct umb_picture picture_of(void)
{
    return (struct umb_picture){.camera.eye = {1e6, -3, 2},
                                .camera.forward = {3, 0, 4},
                                .camera.up = {0, 2, 0},
                                .camera.fov_y = 1.0,
                                .width = WIDTH,
                                .height = HEIGHT,
                                .depth = depths};
}

static void points_project_back_to_the_centres_of_their_pixels(void **state)
{
    (void)state;
    const struct umb_picture picture = picture_of();
    struct umb_error error;
    float points[3 * PIXELS];
    for (size_t i = 0; i < PIXELS; i++) {
        depths[i] = 0.25F * (float)(i + 1);
    }
    assert_int_equal(umb_picture_check(&picture, &error), UMB_OK);
    umb_picture_points(&picture, 0, PIXELS, points);
    /* The frame by hand: forward (0.6, 0, 0.8), right = forward x up = (-0.8, 0, 0.6). */
    const double tall = tan(0.5), wide = tall * WIDTH / HEIGHT;
    for (size_t i = 0; i < PIXELS; i++) {
        const float *p = points + 3 * i;
        const double depth = 0.6 * (double)p[0] + 0.8 * (double)p[2];
        const double x = (-0.8 * (double)p[0] + 0.6 * (double)p[2]) / (depth * wide);
        const double y = (double)p[1] / (depth * tall);
        assert_true(fabs(depth - (double)depths[i]) < 1e-5);
        assert_true(fabs((x + 1) / 2 * WIDTH - ((double)(i % WIDTH) + 0.5)) < 1e-5);
        assert_true(fabs((1 - y) / 2 * HEIGHT - ((double)(i / WIDTH) + 0.5)) < 1e-5);
    }
    float part[3 * 4]; /* any interval gives the same bits */
    umb_picture_points(&picture, 11, 4, part);
    assert_memory_equal(part, points + 33, sizeof part);
}

static void pixels_with_nothing_in_them_are_lit_and_no_others(void **state)
{
    (void)state;
    const float nothing[] = {0, -1, NAN, INFINITY, -INFINITY, 2e9F};
    const struct umb_picture picture = picture_of();
    float points[3 * PIXELS], wide[PIXELS] = {0};
    uint8_t bytes[PIXELS] = {0}, bits[(PIXELS + 7) / 8] = {0};
    for (size_t i = 0; i < PIXELS; i++) {
        depths[i] = i % 4 == 1 ? nothing[i / 4 % 6] : 3;
    }
    umb_picture_points(&picture, 0, PIXELS, points);
    umb_picture_fill(&picture, 0, PIXELS, UMB_ANSWER_F32, wide);
    umb_picture_fill(&picture, 0, PIXELS, UMB_ANSWER_U8, bytes);
    umb_picture_fill(&picture, 0, 16, UMB_ANSWER_BIT, bits);
    umb_picture_fill(&picture, 16, PIXELS - 16, UMB_ANSWER_BIT, bits);
    for (size_t i = 0; i < PIXELS; i++) {
        const int lit = i % 4 == 1;
        assert_int_equal(wide[i] > 0, lit);
        assert_int_equal(bytes[i], lit ? 255 : 0);
        assert_int_equal(bits[i / 8] >> (i % 8) & 1, lit);
        assert_true(isfinite(points[3 * i]) && (points[3 * i] == 0) == lit);
    }
}

static void pictures_that_span_nothing_are_refused(void **state)
{
    (void)state;
    struct umb_error error;
    const struct umb_picture good = picture_of();
    struct umb_picture bad[8];
    for (size_t i = 0; i < 8; i++) {
        bad[i] = good;
    }
    bad[0].width = 0;
    bad[1].height = 0;
    bad[2].camera.fov_y = 0;
    bad[3].camera.fov_y = NAN;
    bad[4].camera.fov_y = 3.2;
    bad[5].camera.eye[1] = INFINITY;
    memcpy(bad[6].camera.up, good.camera.forward, sizeof good.camera.forward);
    memset(bad[7].camera.forward, 0, sizeof bad[7].camera.forward);
    for (size_t i = 0; i < 8; i++) {
        assert_int_equal(umb_picture_check(&bad[i], &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "picture"));
    }
}

/* Rounding leaves something of the product of parallel vectors. */
static void an_up_along_forward_is_refused_whatever_its_direction(void **state)
{
    (void)state;
    struct umb_error error;
    uint64_t seed = 8;
    for (size_t i = 0; i < 1000; i++) {
        struct umb_picture picture = picture_of();
        const double length = ldexp(random_unit(&seed) * 4 - 2, (int)(i % 40) - 20);
        for (unsigned k = 0; k < 3; k++) {
            picture.camera.forward[k] = random_unit(&seed) * 2 - 1;
            picture.camera.up[k] = picture.camera.forward[k] * length;
        }
        assert_int_equal(umb_picture_check(&picture, &error), UMB_E_ARGUMENT);
        picture.camera.up[i % 3] += 1e-3 * length;
        assert_int_equal(umb_picture_check(&picture, &error), UMB_OK);
    }
}

enum {
    FRAME = 20000
};

static uint8_t before[FRAME], after[FRAME], out[FRAME], scratch[FRAME];

static void a_packed_frame_comes_back_and_changes_are_small(void **state)
{
    (void)state;
    struct umb_error error;
    uint64_t seed = 3;
    const size_t room = umb_picture_room(FRAME);
    uint8_t *packed = malloc(room);
    size_t whole, changes;
    for (size_t i = 0; i < FRAME; i++) {
        before[i] = (uint8_t)next_random(&seed);
    }
    memcpy(after, before, FRAME);
    after[77] ^= 1;
    after[FRAME - 1] ^= 128;
    assert_int_not_equal(umb_picture_mark(before, FRAME), umb_picture_mark(after, FRAME));
    assert_int_equal(umb_picture_pack(after, NULL, FRAME, NULL, packed, &whole, &error), UMB_OK);
    assert_true(whole <= room);
    assert_int_equal(umb_picture_unpack(packed, whole, NULL, out, FRAME, &error), UMB_OK);
    assert_memory_equal(out, after, FRAME);
    assert_int_equal(umb_picture_pack(after, before, FRAME, scratch, packed, &changes, &error),
                     UMB_OK);
    assert_true(changes < 100 && whole > FRAME / 2);
    assert_int_equal(umb_picture_unpack(packed, changes, before, out, FRAME, &error), UMB_OK);
    assert_memory_equal(out, after, FRAME);
    for (size_t size = 0; size < changes; size++) { /* cut short */
        uint8_t *exact = malloc(size ? size : 1);
        memcpy(exact, packed, size);
        assert_int_equal(umb_picture_unpack(exact, size, before, out, FRAME, &error),
                         UMB_E_CORRUPT);
        free(exact);
    }
    /* Of another length. */
    assert_int_equal(umb_picture_unpack(packed, changes, NULL, out, FRAME - 1, &error),
                     UMB_E_CORRUPT);
    assert_int_equal(umb_picture_pack(after, NULL, 100, NULL, packed, &whole, &error), UMB_OK);
    assert_int_equal(umb_picture_unpack(packed, whole, NULL, out, 101, &error), UMB_E_CORRUPT);
    assert_int_equal(umb_picture_pack(after, NULL, 0, NULL, packed, &whole, &error), UMB_OK);
    assert_int_equal(umb_picture_unpack(packed, whole, NULL, out, 0, &error), UMB_OK);
    free(packed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_project_back_to_the_centres_of_their_pixels),
        cmocka_unit_test(pixels_with_nothing_in_them_are_lit_and_no_others),
        cmocka_unit_test(pictures_that_span_nothing_are_refused),
        cmocka_unit_test(an_up_along_forward_is_refused_whatever_its_direction),
        cmocka_unit_test(a_packed_frame_comes_back_and_changes_are_small),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
