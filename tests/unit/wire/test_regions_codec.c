/* SPDX-License-Identifier: Apache-2.0 */
/* RegionRequest and RegionReply: round trips, limits, sweeps over prefixes and flips. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "wire/regions.h"

static struct umbw_region_request sample(size_t count)
{
    struct umbw_region_request request = {.asset = "city", .count = count};
    for (size_t i = 0; i < count; i++) {
        request.ranges[i] = (struct umb_range){(uint64_t)i << 40, i + 1};
    }
    return request;
}

static void requests_and_replies_come_back_as_they_went(void **state)
{
    (void)state;
    struct umb_error error;
    for (size_t count = 1; count <= UMBW_RANGES_MAX; count += 127) {
        struct umbw_region_request request = sample(count), back;
        struct umbw_buffer buffer = {NULL, 0, 0};
        assert_int_equal(umbw_encode_region_request(&request, &buffer, &error), UMB_OK);
        assert_int_equal(umbw_decode_region_request(buffer.bytes + UMBW_PREFIX_BYTES,
                                                    buffer.size - UMBW_PREFIX_BYTES, &back, &error),
                         UMB_OK);
        assert_memory_equal(&request, &back, sizeof back);
        umbw_buffer_finish(&buffer);
    }
    const uint8_t data[3] = {1, 2, 3};
    struct umbw_region_reply reply = {.file_bytes = UINT64_MAX, .data = data, .data_size = 3}, back;
    struct umbw_buffer buffer = {NULL, 0, 0};
    memset(reply.asset_id, 7, sizeof reply.asset_id);
    assert_int_equal(umbw_encode_region_reply(&reply, &buffer, &error), UMB_OK);
    assert_int_equal(umbw_decode_region_reply(buffer.bytes + UMBW_PREFIX_BYTES,
                                              buffer.size - UMBW_PREFIX_BYTES, &back, &error),
                     UMB_OK);
    assert_memory_equal(back.asset_id, reply.asset_id, sizeof back.asset_id);
    assert_true(back.file_bytes == UINT64_MAX && back.data_size == 3);
    assert_memory_equal(back.data, data, 3);
    umbw_buffer_finish(&buffer);
}

static void whatever_comes_stays_within_the_limits(void **state)
{
    (void)state;
    struct umbw_region_request request = sample(5), back;
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error;
    assert_int_equal(umbw_encode_region_request(&request, &buffer, &error), UMB_OK);
    const size_t size = buffer.size - UMBW_PREFIX_BYTES;
    for (size_t length = 0; length <= size; length++) {
        for (size_t bit = 0; bit < 8 * length; bit++) {
            uint8_t *exact = malloc(length ? length : 1);
            memcpy(exact, buffer.bytes + UMBW_PREFIX_BYTES, length);
            exact[bit / 8] ^= (uint8_t)(1 << bit % 8);
            if (umbw_decode_region_request(exact, length, &back, &error) == UMB_OK) {
                uint64_t total = 0;
                assert_true(back.count >= 1 && back.count <= UMBW_RANGES_MAX);
                for (size_t i = 0; i < back.count; i++) {
                    total += back.ranges[i].length;
                    assert_true(back.ranges[i].offset <= INT64_MAX);
                }
                assert_true(total <= UMBW_REGION_BYTES_MAX);
            }
            free(exact);
        }
    }
    umbw_buffer_finish(&buffer);
}

/* A packed field as long as the message must be read only up to the limit. */
static void long_lists_are_read_up_to_the_limit(void **state)
{
    (void)state;
    enum {
        ELEMENTS = 1000
    };
    uint8_t message[8 + ELEMENTS] = {0x0a, 1, 'a', 0x12, (ELEMENTS & 0x7f) | 0x80, ELEMENTS >> 7};
    struct umbw_region_request request;
    struct umb_error error = {0};
    memset(message + 6, 0xff, ELEMENTS); /* after the limit: no varint */
    memset(message + 6, 1, UMBW_RANGES_MAX + 1);
    assert_int_equal(umbw_decode_region_request(message, 6 + ELEMENTS, &request, &error),
                     UMB_E_ARGUMENT);
    assert_string_equal(error.message, "offsets: 129 are over the limit of 128");
}

/* The pieces of a view are limited together: no single piece is too long. */
static void pieces_of_a_view_are_limited_together(void **state)
{
    (void)state;
    enum {
        PIECES = 9,
        PIECE = 132
    }; /* bytes of a piece with its tag and length */
    uint8_t message[3 + PIECES * PIECE] = {0x0a, 1, 'a'};
    struct umbw_derive_request request;
    struct umb_error error = {0};
    for (size_t i = 0; i < PIECES; i++) { /* each holds an unknown field */
        static const uint8_t head[] = {0x42, 129, 1, 0xfa, 0x07, 126};
        memcpy(message + 3 + i * PIECE, head, sizeof head);
    }
    assert_int_equal(umbw_decode_derive_request(message, sizeof message, &request, &error),
                     UMB_E_ARGUMENT);
    assert_string_equal(error.message, "view: 1161 bytes, at most 1024");
}

static struct umbw_derive_request derive_sample(int cascades)
{
    struct umbw_derive_request request = {
        .asset = "city",
        .settings = {.light = 3,
                     .width = 16384,
                     .height = 1,
                     .rect = {-1.5, 0, 1e6, 7},
                     .map = {.technique = UMB_MAP_EVSM,
                             .format = UMB_MAP_F16,
                             .access = UMB_MAP_MIPS,
                             .blur = 63,
                             .exponent = 5.5,
                             .negative_exponent = 0.25,
                             .depth_plane = 1,
                             .moment_bias = 0.5}},
    };
    if (cascades) {
        request.settings.cascades = (struct umb_cascade_settings){
            .count = 8, .weight = 0.7, .fit = UMB_CASCADE_LISPSM, .blend = 0.25};
        request.settings.contrast = 1.5;
        request.settings.match_contrast = 1;
        request.view = (struct umb__map_view){.eye = {1, 2, 3},
                                              .right = {1, 0, 0},
                                              .up = {0, 1, 0},
                                              .forward = {0, 0, 1},
                                              .tan_x = 0.5,
                                              .tan_y = 0.25,
                                              .near_m = 1,
                                              .far_m = 2};
    }
    return request;
}

static void requests_for_maps_come_back_as_they_went(void **state)
{
    (void)state;
    struct umb_error error;
    for (int cascades = 0; cascades < 2; cascades++) {
        struct umbw_derive_request request = derive_sample(cascades), back;
        struct umbw_buffer buffer = {NULL, 0, 0};
        assert_int_equal(umbw_encode_derive_request(&request, &buffer, &error), UMB_OK);
        const uint8_t *message = buffer.bytes + UMBW_PREFIX_BYTES;
        const size_t size = buffer.size - UMBW_PREFIX_BYTES;
        assert_int_equal(umbw_decode_derive_request(message, size, &back, &error), UMB_OK);
        assert_memory_equal(&request, &back, sizeof back);
        for (size_t length = 0; length < size; length++) { /* cut, and turned */
            uint8_t *copy = malloc(size);
            memcpy(copy, message, size);
            (void)!umbw_decode_derive_request(copy, length, &back, &error);
            copy[length] ^= 0x41;
            (void)!umbw_decode_derive_request(copy, size, &back, &error);
            free(copy);
        }
        umbw_buffer_finish(&buffer);
    }
    struct umbw_derive_request request = derive_sample(0);
    struct umbw_buffer buffer = {NULL, 0, 0};
    request.settings.map.technique = UMB_MAP_CONVOLUTION;
    assert_int_equal(umbw_encode_derive_request(&request, &buffer, &error), UMB_E_UNSUPPORTED);
    umbw_buffer_finish(&buffer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(requests_and_replies_come_back_as_they_went),
        cmocka_unit_test(requests_for_maps_come_back_as_they_went),
        cmocka_unit_test(long_lists_are_read_up_to_the_limit),
        cmocka_unit_test(pieces_of_a_view_are_limited_together),
        cmocka_unit_test(whatever_comes_stays_within_the_limits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
