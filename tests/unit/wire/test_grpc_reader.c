/* SPDX-License-Identifier: Apache-2.0 */
/* The reader of length-prefixed messages, fed in every way. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "grpc/grpc.h"

struct log {
    unsigned count;
    size_t total;
    uint8_t bytes[64];
    int compressed;
    enum umb_status answer;
};

static enum umb_status note(void *user, const uint8_t *message, size_t size, int compressed)
{
    struct log *log = user;
    assert_true(log->total + size <= sizeof log->bytes);
    memcpy(log->bytes + log->total, message, size);
    log->total += size;
    log->count++;
    log->compressed += compressed;
    return log->answer;
}

/* Three messages: "hello", an empty one, "ab" with the compressed flag. */
static const uint8_t STREAM[] = {0, 0, 0, 0, 5, 'h', 'e', 'l', 'l', 'o', 0,
                                 0, 0, 0, 0, 1, 0,   0,   0,   2,   'a', 'b'};

static void expect_whole_stream(const struct umbw_reader *reader, const struct log *log)
{
    assert_int_equal(log->count, 3);
    assert_int_equal(log->total, 7);
    assert_memory_equal(log->bytes, "helloab", 7);
    assert_int_equal(log->compressed, 1);
    assert_int_equal(umbw_reader_at_boundary(reader), 1);
}

/* Feeds a piece from an exact-size block, so that a read beyond it is seen by ASan. */
static enum umb_status feed_piece(struct umbw_reader *reader, const uint8_t *bytes, size_t count,
                                  struct log *log)
{
    uint8_t *copy = malloc(count == 0 ? 1 : count);
    assert_non_null(copy);
    memcpy(copy, bytes, count);
    enum umb_status status = umbw_reader_feed(reader, copy, count, note, log, NULL);
    free(copy);
    return status;
}

static void reader_takes_a_stream_byte_by_byte(void **state)
{
    struct umbw_reader reader;
    struct log log = {.answer = UMB_OK};
    (void)state;
    umbw_reader_init(&reader, 5);
    for (size_t i = 0; i < sizeof STREAM; i++) {
        assert_int_equal(feed_piece(&reader, STREAM + i, 1, &log), UMB_OK);
        bool boundary = i + 1 == 10 || i + 1 == 15 || i + 1 == sizeof STREAM;
        assert_int_equal(umbw_reader_at_boundary(&reader), boundary);
    }
    expect_whole_stream(&reader, &log);
    umbw_reader_finish(&reader);
}

static void reader_takes_a_stream_split_at_any_two_points(void **state)
{
    (void)state;
    for (size_t first = 0; first <= sizeof STREAM; first++) {
        for (size_t second = first; second <= sizeof STREAM; second++) {
            struct umbw_reader reader;
            struct log log = {.answer = UMB_OK};
            umbw_reader_init(&reader, 5);
            assert_int_equal(feed_piece(&reader, STREAM, first, &log), UMB_OK);
            assert_int_equal(feed_piece(&reader, STREAM + first, second - first, &log), UMB_OK);
            assert_int_equal(feed_piece(&reader, STREAM + second, sizeof STREAM - second, &log),
                             UMB_OK);
            expect_whole_stream(&reader, &log);
            umbw_reader_finish(&reader);
        }
    }
}

static void reader_rejects_message_over_limit_on_its_prefix(void **state)
{
    struct umbw_reader reader;
    struct log log = {.answer = UMB_OK};
    struct umb_error error = {.status = UMB_OK};
    static const uint8_t prefix[] = {0, 0, 0, 4, 1}; /* 1025 bytes */
    (void)state;
    umbw_reader_init(&reader, 1024);
    assert_int_equal(umbw_reader_feed(&reader, prefix, sizeof prefix, note, &log, &error),
                     UMB_E_TOO_LARGE);
    assert_non_null(strstr(error.message, "1025"));
    assert_non_null(strstr(error.message, "1024"));
    assert_null(reader.message);
    assert_int_equal(log.count, 0);
    umbw_reader_finish(&reader);
}

static void reader_accepts_message_at_the_limit(void **state)
{
    struct umbw_reader reader;
    struct log log = {.answer = UMB_OK};
    static const uint8_t bytes[] = {0, 0, 0, 0, 3, 'x', 'y', 'z'};
    (void)state;
    umbw_reader_init(&reader, 3);
    assert_int_equal(feed_piece(&reader, bytes, sizeof bytes, &log), UMB_OK);
    assert_int_equal(log.total, 3);
    umbw_reader_finish(&reader);
}

static void reader_rejects_unknown_flags(void **state)
{
    (void)state;
    for (unsigned flag = 2; flag < 256; flag++) {
        struct umbw_reader reader;
        struct log log = {.answer = UMB_OK};
        const uint8_t prefix[] = {(uint8_t)flag, 0, 0, 0, 0};
        umbw_reader_init(&reader, 1024);
        assert_int_equal(feed_piece(&reader, prefix, sizeof prefix, &log), UMB_E_PROTOCOL);
        assert_int_equal(log.count, 0);
        umbw_reader_finish(&reader);
    }
}

static void reader_allocates_no_more_than_twice_what_came(void **state)
{
    struct umbw_reader reader;
    struct log log = {.answer = UMB_OK};
    static const uint8_t prefix[] = {0, 0xff, 0xff, 0xff, 0xff};
    static const uint8_t block[5000];
    (void)state;
    umbw_reader_init(&reader, UINT32_MAX);
    assert_int_equal(feed_piece(&reader, prefix, sizeof prefix, &log), UMB_OK);
    assert_int_equal(reader.capacity, 0);
    assert_int_equal(feed_piece(&reader, block, 10, &log), UMB_OK);
    assert_true(reader.capacity <= 4096);
    assert_int_equal(feed_piece(&reader, block, sizeof block, &log), UMB_OK);
    assert_true(reader.capacity <= 2 * 5010);
    assert_int_equal(umbw_reader_at_boundary(&reader), 0);
    umbw_reader_finish(&reader);
}

static void reader_gives_room_for_its_message_and_takes_it_from_there(void **state)
{
    enum {
        SIZE = 3000000,
        FIRST = 20000
    };
    static uint8_t expected[SIZE];
    static struct {
        uint8_t *message;
        size_t size;
    } got;
    (void)state;
    for (size_t i = 0; i < SIZE; i++) {
        expected[i] = (uint8_t)(i * 7 + i / 251);
    }
    const uint8_t prefix[] = {0, SIZE >> 24, SIZE >> 16 & 255, SIZE >> 8 & 255, SIZE & 255};
    struct umbw_reader reader;
    uint8_t *place;
    struct log log = {.answer = UMB_OK};
    umbw_reader_init(&reader, SIZE);
    assert_int_equal(umbw_reader_room(&reader, SIZE, &place), 0);
    assert_int_equal(feed_piece(&reader, prefix, sizeof prefix, &log), UMB_OK);
    assert_int_equal(umbw_reader_room(&reader, SIZE, &place), 0);
    assert_int_equal(feed_piece(&reader, expected, FIRST, &log), UMB_OK);
    size_t at = FIRST;
    while (at < SIZE) {
        size_t room = umbw_reader_room(&reader, 700001, &place);
        assert_true(room > 0 && room <= 700001 && room <= SIZE - at);
        assert_true(reader.capacity <= 2 * at + (1 << 20));
        memcpy(place, expected + at, room);
        at += room;
        if (at < SIZE) {
            assert_int_equal(umbw_reader_feed(&reader, place, room, note, &log, NULL), UMB_OK);
        } else {
            got.message = reader.message;
            got.size = reader.message_size;
        }
    }
    assert_int_equal(got.size, SIZE);
    assert_memory_equal(got.message, expected, SIZE);
    umbw_reader_finish(&reader);
}

static void reader_stops_when_the_callback_says_so(void **state)
{
    struct umbw_reader reader;
    struct log log = {.answer = UMB_E_BUSY};
    (void)state;
    umbw_reader_init(&reader, 1024);
    assert_int_equal(umbw_reader_feed(&reader, STREAM, sizeof STREAM, note, &log, NULL),
                     UMB_E_BUSY);
    assert_int_equal(log.count, 1);
    umbw_reader_finish(&reader);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reader_takes_a_stream_byte_by_byte),
        cmocka_unit_test(reader_takes_a_stream_split_at_any_two_points),
        cmocka_unit_test(reader_rejects_message_over_limit_on_its_prefix),
        cmocka_unit_test(reader_accepts_message_at_the_limit),
        cmocka_unit_test(reader_rejects_unknown_flags),
        cmocka_unit_test(reader_allocates_no_more_than_twice_what_came),
        cmocka_unit_test(reader_gives_room_for_its_message_and_takes_it_from_there),
        cmocka_unit_test(reader_stops_when_the_callback_says_so),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
