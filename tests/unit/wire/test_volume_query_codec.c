/* SPDX-License-Identifier: Apache-2.0 */
/* Segments, columns and boxes on the wire: they must survive a round trip, and invalid ones must be
 * named. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "wire/volume_queries.h"

enum {
    COUNT = 3
};

static const double records[6 * COUNT] = {1, 2, 3, 4, 5, 6, 7, 8, 9};

static struct umbw_volume_query_request request_of(enum umbw_volume_query volume_query)
{
    return (struct umbw_volume_query_request){.volume_query = volume_query,
                                              .asset = "city",
                                              .light = 300,
                                              .records = records,
                                              .format = UMB_POINT_F64,
                                              .origin = {1e6, 0, -5},
                                              .count = COUNT,
                                              .max_intervals =
                                                  volume_query == UMBW_SEGMENTS ? 70 : 0,
                                              .want_stats = 1};
}

static void requests_pass_unchanged(void **state)
{
    (void)state;
    for (int q = 0; q < UMBW_VOLUME_QUERY_COUNT; q++) {
        const struct umbw_volume_query_request in = request_of((enum umbw_volume_query)q);
        struct umbw_volume_query_request out;
        struct umbw_buffer buffer = {NULL, 0, 0};
        const size_t bytes = (q == UMBW_COLUMNS ? 3U : 6U) * COUNT * sizeof(double);
        assert_int_equal(umbw_encode_volume_query_request(&in, &buffer, NULL), UMB_OK);
        assert_int_equal(
            umbw_decode_volume_query_request(in.volume_query, buffer.bytes + UMBW_PREFIX_BYTES,
                                             buffer.size - UMBW_PREFIX_BYTES, 1000, &out, NULL),
            UMB_OK);
        assert_string_equal(out.asset, "city");
        assert_int_equal(out.light, 300);
        assert_int_equal(out.format, UMB_POINT_F64);
        assert_int_equal(out.count, COUNT);
        assert_int_equal(out.max_intervals, in.max_intervals);
        assert_int_equal(out.want_stats, 1);
        assert_memory_equal(out.origin, in.origin, sizeof in.origin);
        assert_memory_equal(out.records, records, bytes);
        umbw_buffer_finish(&buffer);
    }
}

static void replies_pass_unchanged_and_cut_ones_are_refused(void **state)
{
    (void)state;
    static const uint8_t bytes[4][16 * COUNT] = {{1, 2}, {3, 4}, {5, 6}, {7, 8}};
    for (int q = 0; q < UMBW_VOLUME_QUERY_COUNT; q++) {
        struct umbw_volume_query_reply in = {.volume_query = (enum umbw_volume_query)q,
                                             .asset_id = {9, 8, 7},
                                             .ignores_translucent = q == UMBW_BOXES,
                                             .has_stats = 1,
                                             .nodes = 1U << 20,
                                             .bricks = 5,
                                             .nanoseconds = UINT64_MAX,
                                             .count = COUNT,
                                             .interval_count = 2};
        struct umbw_volume_query_reply out;
        struct umbw_buffer buffer = {NULL, 0, 0};
        struct umb_error error;
        for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
            in.fields[k] = bytes[k];
        }
        assert_int_equal(umbw_encode_volume_query_reply(&in, &buffer, NULL), UMB_OK);
        const uint8_t *message = buffer.bytes + UMBW_PREFIX_BYTES;
        const size_t size = buffer.size - UMBW_PREFIX_BYTES;
        assert_int_equal(
            umbw_decode_volume_query_reply(in.volume_query, message, size, COUNT, &out, &error),
            UMB_OK);
        assert_memory_equal(out.asset_id, in.asset_id, sizeof in.asset_id);
        assert_true(out.nodes == in.nodes && out.bricks == 5 && out.nanoseconds == UINT64_MAX);
        assert_int_equal(out.ignores_translucent, in.ignores_translucent);
        assert_int_equal(out.interval_count, q == UMBW_SEGMENTS ? 2 : 0);
        for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
            const size_t each = umbw_answer_sizes[q][k];
            const size_t count = k == UMBW_FIELD_INTERVALS ? 2 : COUNT;
            if (each > 0) {
                assert_memory_equal(out.fields[k], bytes[k], each * count);
            }
        }
        /* A reply with another number of records than requested must be refused, and so must every
         * prefix of it; each is read from a block of its exact size. */
        assert_int_equal(
            umbw_decode_volume_query_reply(in.volume_query, message, size, COUNT + 1, &out, &error),
            UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "for 4"));
        for (size_t cut = 0; cut < size; cut++) {
            uint8_t *exact = malloc(cut + 1);
            assert_non_null(exact);
            memcpy(exact + 1, message, cut);
            assert_int_equal(umbw_decode_volume_query_reply(in.volume_query, exact + 1, cut, COUNT,
                                                            &out, NULL) == UMB_OK,
                             q == UMBW_SEGMENTS &&
                                 cut == size - 34); /* without intervals it is whole */
            free(exact);
        }
        umbw_buffer_finish(&buffer);
    }
}

static void limits_count_as_points(void **state)
{
    (void)state;
    struct umbw_volume_query_request in = request_of(UMBW_SEGMENTS), out;
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error;
    assert_int_equal(umbw_encode_volume_query_request(&in, &buffer, NULL), UMB_OK);
    const uint8_t *message = buffer.bytes + UMBW_PREFIX_BYTES;
    const size_t size = buffer.size - UMBW_PREFIX_BYTES;
    assert_int_equal(
        umbw_decode_volume_query_request(UMBW_SEGMENTS, message, size, 210, &out, &error), UMB_OK);
    assert_int_equal(
        umbw_decode_volume_query_request(UMBW_SEGMENTS, message, size, 209, &out, &error),
        UMB_E_TOO_LARGE);
    assert_string_equal(error.message,
                        "segments_f64: 3, each counts as 70 points; the limit is 209 points");
    umbw_buffer_finish(&buffer);
    assert_int_equal(umbw_volume_query_points(UMBW_SEGMENTS, 0), 64);
    assert_int_equal(umbw_volume_query_points(UMBW_COLUMNS, 0), 1);
    assert_int_equal(umbw_volume_query_points(UMBW_BOXES, 0), 256);
}

static void requests_that_do_not_fit_are_named(void **state)
{
    (void)state;
    struct umbw_volume_query_request out;
    struct umb_error error;
    /* asset a, field 5 or 6 of that many bytes. */
    uint8_t message[3 + 2 + 24 + 2 + 48] = {0x0a, 1, 'a', 0x2a, 23};
    assert_int_equal(
        umbw_decode_volume_query_request(UMBW_SEGMENTS, message, 5 + 23, 1000, &out, &error),
        UMB_E_ARGUMENT);
    assert_string_equal(error.message, "segments: length is 23 bytes, must be a multiple of 24");
    message[4] = 24;
    message[29] = 0x32;
    message[30] = 48;
    assert_int_equal(
        umbw_decode_volume_query_request(UMBW_BOXES, message, sizeof message, 1000, &out, &error),
        UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "boxes: 24 bytes, and boxes_f64: 48 bytes"));
    assert_int_equal(umbw_decode_volume_query_request(UMBW_COLUMNS, NULL, 0, 1000, &out, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "asset"));
    struct umbw_volume_query_request in = request_of(UMBW_COLUMNS);
    struct umbw_buffer buffer = {NULL, 0, 0};
    in.origin[1] = NAN;
    assert_int_equal(umbw_encode_volume_query_request(&in, &buffer, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "origin"));
    umbw_buffer_finish(&buffer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(requests_pass_unchanged),
        cmocka_unit_test(replies_pass_unchanged_and_cut_ones_are_refused),
        cmocka_unit_test(limits_count_as_points),
        cmocka_unit_test(requests_that_do_not_fit_are_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
