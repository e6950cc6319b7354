/* SPDX-License-Identifier: Apache-2.0 */
/* Requests with a picture, packed answers, and the mark of the answers that the client has. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "wire/messages.h"

static const float depths[6] = {1, 2, 3, 4, 5, 6};

static struct umbw_query_request request_of(void)
{
    struct umbw_query_request request = {.asset = "city",
                                         .settings = {.taps = 3},
                                         .has_picture = 1,
                                         .pack = 1,
                                         .base_mark = 0xfedcba9876543210U};
    request.points.count = 6;
    request.picture = (struct umb_picture){.camera.eye = {1, 2, 3},
                                           .camera.forward = {0, 0, 1},
                                           .camera.up = {0, 1, 0},
                                           .camera.fov_y = 0.5,
                                           .width = 3,
                                           .height = 2,
                                           .depth = depths};
    return request;
}

static enum umb_status there_and_back(const struct umbw_query_request *in, size_t max_points,
                                      struct umbw_query_request *out, struct umbw_buffer *buffer,
                                      struct umb_error *error)
{
    *buffer = (struct umbw_buffer){0};
    enum umb_status status = umbw_encode_query_request(in, buffer, error);
    return status == UMB_OK
               ? umbw_decode_query_request(buffer->bytes + UMBW_PREFIX_BYTES,
                                           buffer->size - UMBW_PREFIX_BYTES, max_points, out, error)
               : status;
}

static void picture_and_packing_survive_the_wire(void **state)
{
    (void)state;
    const struct umbw_query_request in = request_of();
    struct umbw_query_request out;
    struct umbw_buffer buffer;
    struct umb_error error = {0};
    if (there_and_back(&in, 6, &out, &buffer, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(out.has_picture, 1);
    assert_int_equal(out.pack, 1);
    assert_true(out.base_mark == in.base_mark);
    assert_int_equal(out.points.count, 6);
    assert_memory_equal(out.points.positions, depths, sizeof depths);
    assert_memory_equal(out.picture.camera.eye, in.picture.camera.eye, 3 * sizeof(double));
    assert_memory_equal(out.picture.camera.forward, in.picture.camera.forward, 3 * sizeof(double));
    assert_memory_equal(out.picture.camera.up, in.picture.camera.up, 3 * sizeof(double));
    assert_int_equal(out.picture.width, 3);
    assert_int_equal(out.picture.height, 2);
    umbw_buffer_finish(&buffer);
}

static void expect_refused(const struct umbw_query_request *in, size_t max_points,
                           enum umb_status wanted, const char *words)
{
    struct umbw_query_request out;
    struct umbw_buffer buffer;
    struct umb_error error = {0};
    const enum umb_status status = there_and_back(in, max_points, &out, &buffer, &error);
    umbw_buffer_finish(&buffer);
    if (status != wanted || !strstr(error.message, words)) {
        fail_msg("%s: %s, wanted '%s'", umb_status_name(status), error.message, words);
    }
}

static void pictures_that_do_not_fit_are_refused_by_field(void **state)
{
    (void)state;
    struct umbw_query_request in = request_of();
    expect_refused(&in, 5, UMB_E_TOO_LARGE, "depth");
    in.picture.width = 4;
    expect_refused(&in, 100, UMB_E_ARGUMENT, "depth: 6 numbers for 4 x 2 pixels");
    in = request_of();
    in.picture.camera.fov_y = 4;
    expect_refused(&in, 100, UMB_E_ARGUMENT, "fov_y");
    in = request_of();
    in.points.origin[1] = 5;
    expect_refused(&in, 100, UMB_E_ARGUMENT, "origin");
}

/* Every prefix and every flipped byte of a message must be refused or decode to something
 * consistent. */
static void spoilt_messages_do_no_harm(void **state)
{
    (void)state;
    const struct umbw_query_request in = request_of();
    struct umbw_query_request out;
    struct umbw_buffer buffer;
    struct umb_error error;
    assert_int_equal(there_and_back(&in, 6, &out, &buffer, &error), UMB_OK);
    const size_t size = buffer.size - UMBW_PREFIX_BYTES;
    uint8_t *exact = malloc(size);
    for (size_t at = 0; at < size * 8; at++) {
        memcpy(exact, buffer.bytes + UMBW_PREFIX_BYTES, size);
        exact[at / 8] ^= (uint8_t)(1U << (at % 8));
        if (umbw_decode_query_request(exact, size, 6, &out, &error) == UMB_OK && out.has_picture) {
            assert_int_equal(out.points.count, (size_t)out.picture.width * out.picture.height);
        }
    }
    for (size_t cut = 0; cut < size; cut++) {
        uint8_t *part = malloc(cut ? cut : 1);
        memcpy(part, buffer.bytes + UMBW_PREFIX_BYTES, cut);
        (void)!umbw_decode_query_request(part, cut, 6, &out, &error);
        free(part);
    }
    free(exact);
    umbw_buffer_finish(&buffer);
}

static void the_packing_of_a_reply_survives_the_wire(void **state)
{
    (void)state;
    for (int packing = 0; packing < 3; packing++) {
        const uint8_t answers[4] = {9, 8, 7, 6};
        const struct umbw_query_reply in = {.visibility_bytes = sizeof answers,
                                            .packing = (enum umbw_packing)packing};
        struct umbw_query_reply out;
        struct umb_error error;
        uint8_t bytes[256];
        const size_t head = umbw_write_query_reply_head(&in, bytes);
        assert_true(head <= umbw_query_reply_room(&in));
        memcpy(bytes + head, answers, sizeof answers);
        assert_int_equal(umbw_decode_query_reply(bytes + UMBW_PREFIX_BYTES,
                                                 head + sizeof answers - UMBW_PREFIX_BYTES, &out,
                                                 &error),
                         UMB_OK);
        assert_int_equal(out.packing, packing);
        assert_memory_equal(out.visibility, answers, sizeof answers);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(picture_and_packing_survive_the_wire),
        cmocka_unit_test(pictures_that_do_not_fit_are_refused_by_field),
        cmocka_unit_test(spoilt_messages_do_no_harm),
        cmocka_unit_test(the_packing_of_a_reply_survives_the_wire),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
