/* SPDX-License-Identifier: Apache-2.0 */
/* The filter of early resets: however the bytes are divided, it must drop those frames and no
 * others. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "daemon/transport/h2_filter.h"

struct text {
    uint8_t bytes[4096];
    size_t size;
};

static void add_frame(struct text *text, uint8_t type, uint32_t stream, size_t length)
{
    uint8_t *p = text->bytes + text->size;
    assert_true(text->size + 9 + length <= sizeof text->bytes);
    p[0] = (uint8_t)(length >> 16);
    p[1] = (uint8_t)(length >> 8);
    p[2] = (uint8_t)length;
    p[3] = type;
    p[4] = 0;
    p[5] = (uint8_t)(stream >> 24);
    p[6] = (uint8_t)(stream >> 16);
    p[7] = (uint8_t)(stream >> 8);
    p[8] = (uint8_t)stream;
    memset(p + 9, 0xab, length);
    text->size += 9 + length;
}

static void add_preface(struct text *text)
{
    memcpy(text->bytes + text->size, "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 24);
    text->size += 24;
}

static int keep(void *user, const uint8_t *bytes, size_t count)
{
    struct text *out = user;
    assert_true(count > 0);
    assert_true(out->size + count <= sizeof out->bytes);
    memcpy(out->bytes + out->size, bytes, count);
    out->size += count;
    return 0;
}

/* Two resets of unopened streams among frames that must stay; `expected` is without them. */
static void make_mixed(struct text *in, struct text *expected)
{
    static const struct {
        uint8_t type;
        uint32_t stream;
        size_t length;
        int dropped;
    } frames[] = {
        {4, 0, 0, 0},  {3, 1, 4, 1},  {1, 1, 20, 0}, {0, 1, 300, 0}, {3, 1, 4, 0},
        {3, 7, 4, 1},  {1, 7, 5, 0},  {3, 9, 5, 0},  {6, 0, 8, 0},   {3, 8, 4, 0},
        {99, 0, 3, 0}, {1, 11, 1, 0}, {3, 11, 4, 0}, {0, 11, 0, 0},
    };
    add_preface(in);
    add_preface(expected);
    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++) {
        add_frame(in, frames[i].type, frames[i].stream, frames[i].length);
        if (!frames[i].dropped) {
            add_frame(expected, frames[i].type, frames[i].stream, frames[i].length);
        }
    }
}

static void filter_drops_early_resets_however_the_bytes_are_cut(void **state)
{
    struct text in = {.size = 0};
    struct text expected = {.size = 0};
    (void)state;
    make_mixed(&in, &expected);
    for (size_t piece = 1; piece <= in.size; piece++) {
        struct umbd_h2_filter filter;
        struct text out = {.size = 0};
        umbd_h2_filter_init(&filter);
        for (size_t at = 0; at < in.size; at += piece) {
            size_t count = in.size - at < piece ? in.size - at : piece;
            assert_int_equal(umbd_h2_filter_feed(&filter, in.bytes + at, count, keep, &out), 0);
        }
        assert_int_equal(out.size, expected.size);
        assert_memory_equal(out.bytes, expected.bytes, expected.size);
        assert_int_equal(filter.odd, 3); /* two resets and the unknown type */
        assert_true(umbd_h2_filter_was_reset(&filter, 1));
        assert_false(umbd_h2_filter_was_reset(&filter, 1));
        assert_true(umbd_h2_filter_was_reset(&filter, 7));
        assert_false(umbd_h2_filter_was_reset(&filter, 11));
    }
}

static void filter_forgets_the_oldest_of_too_many(void **state)
{
    struct umbd_h2_filter filter;
    struct text out = {.size = 0};
    (void)state;
    umbd_h2_filter_init(&filter);
    struct text preface = {.size = 0};
    add_preface(&preface);
    umbd_h2_filter_feed(&filter, preface.bytes, preface.size, keep, &out);
    for (uint32_t i = 0; i <= UMBD_EARLY_RESETS; i++) {
        struct text reset = {.size = 0};
        add_frame(&reset, 3, 2 * i + 1, 4);
        assert_int_equal(umbd_h2_filter_feed(&filter, reset.bytes, reset.size, keep, &out), 0);
    }
    assert_int_equal(out.size, 24);
    assert_false(umbd_h2_filter_was_reset(&filter, 1));
    assert_true(umbd_h2_filter_was_reset(&filter, 3));
    assert_true(umbd_h2_filter_was_reset(&filter, 2 * UMBD_EARLY_RESETS + 1));
}

static void filter_says_once_of_a_stream_that_was_reset_twice(void **state)
{
    struct umbd_h2_filter filter;
    struct text in = {.size = 0}, out = {.size = 0};
    (void)state;
    add_preface(&in);
    add_frame(&in, 3, 5, 4);
    add_frame(&in, 3, 5, 4);
    umbd_h2_filter_init(&filter);
    assert_int_equal(umbd_h2_filter_feed(&filter, in.bytes, in.size, keep, &out), 0);
    assert_true(umbd_h2_filter_was_reset(&filter, 5));
    assert_false(umbd_h2_filter_was_reset(&filter, 5));
}

static int refuse(void *user, const uint8_t *bytes, size_t count)
{
    (void)bytes;
    *(size_t *)user += count;
    return -7;
}

static void filter_says_what_is_left_of_a_data_frame_and_nothing_else(void **state)
{
    struct umbd_h2_filter filter;
    struct text in = {.size = 0}, out = {.size = 0};
    uint32_t stream;
    (void)state;
    add_preface(&in);
    add_frame(&in, 1, 1, 20);
    size_t data = in.size;
    add_frame(&in, 0, 1, 300);
    size_t padded = in.size;
    add_frame(&in, 0, 3, 50);
    in.bytes[padded + 4] = 8; /* PADDED */
    add_frame(&in, 4, 0, 6);
    umbd_h2_filter_init(&filter);
    for (size_t i = 0; i < in.size; i++) {
        uint32_t left = umbd_h2_filter_data_left(&filter, &stream);
        if (i >= data + 9 && i < padded) {
            assert_int_equal(left, padded - i);
            assert_int_equal(stream, 1);
        } else {
            assert_int_equal(left, 0);
        }
        assert_int_equal(umbd_h2_filter_feed(&filter, in.bytes + i, 1, keep, &out), 0);
    }
}

static void filter_stops_when_told(void **state)
{
    struct umbd_h2_filter filter;
    struct text in = {.size = 0};
    struct text expected = {.size = 0};
    size_t seen = 0;
    (void)state;
    make_mixed(&in, &expected);
    umbd_h2_filter_init(&filter);
    assert_int_equal(umbd_h2_filter_feed(&filter, in.bytes, in.size, refuse, &seen), -7);
    assert_int_equal(seen, 24 + 9); /* up to the first dropped frame */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(filter_drops_early_resets_however_the_bytes_are_cut),
        cmocka_unit_test(filter_forgets_the_oldest_of_too_many),
        cmocka_unit_test(filter_says_once_of_a_stream_that_was_reset_twice),
        cmocka_unit_test(filter_says_what_is_left_of_a_data_frame_and_nothing_else),
        cmocka_unit_test(filter_stops_when_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
