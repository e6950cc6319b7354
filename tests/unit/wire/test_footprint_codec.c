/* SPDX-License-Identifier: Apache-2.0 */
/* Footprints on the wire: they must survive a round trip, and invalid ones must be named. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "wire/messages.h"

enum {
    POINTS = 3
};

static const float positions[POINTS][3] = {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}};
static const float sides[POINTS] = {0, 0.5F, 8};

static struct umbw_query_request request_of(enum umb_filter filter)
{
    return (struct umbw_query_request){
        .asset = "a",
        .settings = {.taps = 1, .filter = filter},
        .points = {.positions = positions, .count = POINTS},
    };
}

/* Sends a request through both directions; `out` points into `buffer`. */
static enum umb_status pass(const struct umbw_query_request *in, struct umbw_buffer *buffer,
                            struct umbw_query_request *out, struct umb_error *error)
{
    enum umb_status status = umbw_encode_query_request(in, buffer, error);
    return status == UMB_OK
               ? umbw_decode_query_request(buffer->bytes + UMBW_PREFIX_BYTES,
                                           buffer->size - UMBW_PREFIX_BYTES, 100, out, error)
               : status;
}

static void footprints_pass_unchanged(void **state)
{
    (void)state;
    struct umbw_query_request in = request_of(UMB_FILTER_FOOTPRINT), out;
    struct umbw_buffer own = {NULL, 0, 0}, same = {NULL, 0, 0}, pixel = {NULL, 0, 0};
    struct umb_error error;
    in.points.footprints = sides;
    assert_int_equal(pass(&in, &own, &out, &error), UMB_OK);
    assert_memory_equal(out.points.footprints, sides, sizeof sides);
    umbw_buffer_finish(&own);
    in.points.footprints = NULL;
    in.settings.footprint_m = 2.5;
    assert_int_equal(pass(&in, &same, &out, &error), UMB_OK);
    assert_true(out.settings.footprint_m == 2.5 && out.points.footprints == NULL);
    umbw_buffer_finish(&same);
    in.settings.footprint_m = 0;
    in.settings.pixel_rad = 0.001;
    memcpy(in.settings.eye, (double[3]){1e6, -2, 3}, sizeof in.settings.eye);
    assert_int_equal(pass(&in, &pixel, &out, &error), UMB_OK);
    assert_true(out.settings.pixel_rad == 0.001);
    assert_memory_equal(out.settings.eye, in.settings.eye, sizeof out.settings.eye);
    umbw_buffer_finish(&pixel);
}

static void a_picture_has_pixels_of_its_own(void **state)
{
    (void)state;
    static const float depth[POINTS] = {1, 2, 3};
    struct umbw_query_request in = request_of(UMB_FILTER_FOOTPRINT), out;
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error;
    in.has_picture = 1;
    in.points.positions = NULL;
    in.picture = (struct umb_picture){.camera.eye = {3, 2, 1},
                                      .camera.forward = {0, 1, 0},
                                      .camera.up = {0, 0, 1},
                                      .camera.fov_y = 1,
                                      .width = POINTS,
                                      .height = 1,
                                      .depth = (const void *)depth};
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_OK);
    assert_true(out.settings.eye[0] == 3 && out.settings.eye[2] == 1);
    assert_true(out.settings.pixel_rad == 1); /* 2 tan(1/2) is 1.09 */
    umbw_buffer_finish(&buffer);
    in.settings.footprint_m = 4;
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_OK);
    assert_true(out.settings.pixel_rad == 0 && out.settings.footprint_m == 4);
    umbw_buffer_finish(&buffer);
}

static void footprints_that_do_not_fit_are_named(void **state)
{
    (void)state;
    struct umbw_query_request in = request_of(UMB_FILTER_BOX), out;
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error;
    in.points.footprints = sides;
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "footprints: belongs to the filter 3"));
    in.points.footprints = NULL;
    in.settings.footprint_m = NAN;
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "footprint_m: belongs to"));
    /* From a foreign client: asset a, two points, filter 3, five bytes of footprints. */
    uint8_t message[3 + 2 + 24 + 3 + 8] = {0x0a, 1, 'a', 0x62, 24};
    memcpy(message + 29, (uint8_t[]){0xf0, 0x01, 3, 0x82, 0x02, 5}, 6);
    assert_int_equal(umbw_decode_query_request(message, sizeof message, 100, &out, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "footprints: length is 5 bytes, must be 0 or 8 for 2"));
    /* An eye of two numbers. */
    uint8_t eye[3 + 3 + 3 + 16] = {0x0a, 1, 'a', 0xf0, 0x01, 3, 0x92, 0x02, 16};
    assert_int_equal(umbw_decode_query_request(eye, sizeof eye, 100, &out, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "eye: "));
    umbw_buffer_finish(&buffer);
}

static void a_footprint_filter_without_footprints_is_refused(void **state)
{
    (void)state;
    struct umbw_query_request in = request_of(UMB_FILTER_FOOTPRINT), out;
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error;
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "filter: 3 (FOOTPRINT) without one"));
    /* From a foreign client: asset a, two points, filter 3. */
    uint8_t message[3 + 2 + 24 + 3] = {0x0a, 1, 'a', 0x62, 24};
    memcpy(message + 29, (uint8_t[]){0xf0, 0x01, 3}, 3);
    assert_int_equal(umbw_decode_query_request(message, sizeof message, 100, &out, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "filter: 3 (FOOTPRINT) without one"));
    /* Without points there is nothing to have one. */
    in.points.count = 0;
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_OK);
    umbw_buffer_finish(&buffer);
}

static void an_eye_needs_pixels(void **state)
{
    (void)state;
    struct umbw_query_request in = request_of(UMB_FILTER_FOOTPRINT), out;
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error;
    in.settings.footprint_m = 2;
    in.settings.eye[2] = 5;
    assert_int_equal(pass(&in, &buffer, &out, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "eye: without pixel_rad"));
    uint8_t eye[3 + 3 + 3 + 24] = {0x0a, 1, 'a', 0xf0, 0x01, 3, 0x92, 0x02, 24};
    assert_int_equal(umbw_decode_query_request(eye, sizeof eye, 100, &out, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "eye: without pixel_rad"));
    umbw_buffer_finish(&buffer);
}

static void translucent_casters_may_be_left_out(void **state)
{
    (void)state;
    struct umbw_query_request in = request_of(UMB_FILTER_BOX), out;
    struct umb_error error;
    for (int only = 0; only < 2; only++) {
        struct umbw_buffer buffer = {NULL, 0, 0};
        in.settings.opaque_only = only;
        assert_int_equal(pass(&in, &buffer, &out, &error), UMB_OK);
        assert_int_equal(out.settings.opaque_only, only);
        umbw_buffer_finish(&buffer);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(footprints_pass_unchanged),
        cmocka_unit_test(a_picture_has_pixels_of_its_own),
        cmocka_unit_test(footprints_that_do_not_fit_are_named),
        cmocka_unit_test(a_footprint_filter_without_footprints_is_refused),
        cmocka_unit_test(an_eye_needs_pixels),
        cmocka_unit_test(translucent_casters_may_be_left_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
