/* SPDX-License-Identifier: Apache-2.0 */
/*
 * QueryRequest and QueryReply: our codecs are compared with protobuf-c's own pack and unpack. Also
 * tested: field checks, and sweeps over every prefix and every flipped byte from exact-size blocks
 * (for ASan).
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "umbrage/v1/shadows.pb-c.h"
#include "wire_samples.h"

#define POINTS 7

static float positions[3 * POINTS];
static float normals[3 * POINTS];

static int fill_points(void **state)
{
    (void)state;
    for (int i = 0; i < 3 * POINTS; i++) {
        positions[i] = (float)i * 1.5F - 3;
        normals[i] = (float)(i % 5) - 2;
    }
    return 0;
}

/* The message behind the prefix, in an exact-size block. */
static uint8_t *take_message(struct umbw_buffer *buffer, size_t *size)
{
    assert_true(buffer->size >= UMBW_PREFIX_BYTES);
    const uint8_t *p = buffer->bytes;
    assert_int_equal(p[0], 0);
    *size = (size_t)p[1] << 24 | (size_t)p[2] << 16 | (size_t)p[3] << 8 | p[4];
    assert_int_equal(*size, buffer->size - UMBW_PREFIX_BYTES);
    uint8_t *message = malloc(*size == 0 ? 1 : *size);
    assert_non_null(message);
    memcpy(message, p + UMBW_PREFIX_BYTES, *size);
    umbw_buffer_finish(buffer);
    return message;
}

static uint8_t *encode_request(const struct umbw_query_request *request, size_t *size)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error = {.status = UMB_OK};
    enum umb_status status = umbw_encode_query_request(request, &buffer, &error);
    if (status != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return take_message(&buffer, size);
}

static void request_round_trip_keeps_every_field(void **state)
{
    struct umbw_query_request in = sample_request(positions, normals, POINTS);
    struct umbw_query_request out;
    size_t size;
    (void)state;
    uint8_t *message = encode_request(&in, &size);
    assert_int_equal(umbw_decode_query_request(message, size, POINTS, &out, NULL), UMB_OK);
    assert_string_equal(out.asset, in.asset);
    assert_int_equal(out.settings.light, 3);
    assert_int_equal(out.settings.taps, 9);
    assert_int_equal(out.settings.bias_mode, UMB_BIAS_METRES);
    assert_true(out.settings.bias == 0.25);
    assert_int_equal(out.settings.format, UMB_ANSWER_BIT);
    assert_memory_equal(out.points.origin, in.points.origin, sizeof in.points.origin);
    assert_int_equal(out.points.count, POINTS);
    assert_int_equal(out.points.format, UMB_POINT_F32);
    assert_memory_equal(out.points.positions, positions, sizeof positions);
    assert_memory_equal(out.points.normals, normals, sizeof normals);
    assert_int_equal(out.want_stats, 1);
    /* Points are read in place: both pointers lie inside the message. */
    assert_true((const uint8_t *)out.points.positions > message);
    assert_true((const uint8_t *)out.points.positions + sizeof positions <= message + size);
    assert_true((const uint8_t *)out.points.normals > message);
    free(message);
}

static void dials_and_levels_keep_their_numbers_and_exclude_taps(void **state)
{
    static const struct {
        struct umb_dial dial;
        uint32_t taps, level, expected_taps;
        enum umb_status status;
    } cases[] = {
        {{0}, 0, 5, 1, UMB_OK},
        {{.max_error_m = 0.5}, 0, 0, 0, UMB_OK},
        {{.max_error_m = 2, .max_visibility = 0.25}, 0, 0, 0, UMB_OK},
        {{.budget_ns = 40, .max_error_m = 2}, 0, 0, 0, UMB_OK},
        {{.budget_ns = 40}, 3, 0, 0, UMB_E_ARGUMENT},
        {{.budget_ns = -40}, 0, 0, 0, UMB_E_ARGUMENT},
        {{.max_visibility = 0.25}, 3, 0, 0, UMB_E_ARGUMENT},
        {{.max_error_m = 1}, 0, 3, 0, UMB_E_ARGUMENT},
        {{.max_error_m = -1}, 0, 0, 0, UMB_E_ARGUMENT},
        {{.max_visibility = (double)NAN}, 0, 0, 0, UMB_E_ARGUMENT},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbw_query_request in = sample_request(positions, normals, POINTS);
        struct umbw_query_request out;
        struct umbw_buffer buffer = {NULL, 0, 0};
        struct umb_error error;
        in.dial = cases[i].dial;
        in.settings.taps = cases[i].taps;
        in.settings.level = cases[i].level;
        assert_int_equal(umbw_encode_query_request(&in, &buffer, &error), cases[i].status);
        if (cases[i].status != UMB_OK) {
            assert_memory_equal(error.message, cases[i].dial.budget_ns != 0 ? "budg" : "max_", 4);
            umbw_buffer_finish(&buffer);
            continue;
        }
        size_t size;
        uint8_t *message = take_message(&buffer, &size);
        assert_int_equal(umbw_decode_query_request(message, size, POINTS, &out, NULL), UMB_OK);
        assert_int_equal(out.settings.taps, cases[i].expected_taps);
        assert_int_equal(out.settings.level, cases[i].level);
        assert_true(out.dial.max_error_m == cases[i].dial.max_error_m);
        assert_true(out.dial.max_visibility == cases[i].dial.max_visibility);
        assert_true(out.dial.budget_ns == cases[i].dial.budget_ns);
        Umbrage__V1__QueryRequest *other = umbrage__v1__query_request__unpack(NULL, size, message);
        assert_non_null(other);
        assert_int_equal(other->level, cases[i].level);
        assert_true(other->max_error_m == cases[i].dial.max_error_m);
        umbrage__v1__query_request__free_unpacked(other, NULL);
        free(message);
    }
}

static void filters_keep_their_numbers_and_unknown_ones_are_refused(void **state)
{
    static const struct {
        int filter;
        double light_extent;
        const char *message; /* NULL: taken */
    } cases[] = {
        {UMB_FILTER_TENT, 0, NULL},
        {UMB_FILTER_PENUMBRA, 0.25, NULL},
        {UMB_FILTER_GAUSSIAN, 0, NULL},
        {5, 0, "filter: 5 is not one of"},
        {UMB_FILTER_PENUMBRA, 1.5, "light_extent: 1.5 is not within 0..1"},
        {UMB_FILTER_PENUMBRA, (double)NAN, "light_extent: nan"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbw_query_request in = sample_request(positions, normals, POINTS), out;
        struct umbw_buffer buffer = {NULL, 0, 0};
        struct umb_error error;
        in.settings.filter = (enum umb_filter)cases[i].filter;
        in.settings.light_extent = cases[i].light_extent;
        enum umb_status status = umbw_encode_query_request(&in, &buffer, &error);
        umbw_buffer_finish(&buffer);
        assert_int_equal(status, cases[i].message ? UMB_E_ARGUMENT : UMB_OK);
        /* A message from a foreign client: field 30 as a number, field 31 as a double. */
        uint8_t message[13] = {0xf0, 0x01, (uint8_t)cases[i].filter, 0xf9, 0x01};
        memcpy(message + 5, &cases[i].light_extent, sizeof(double));
        uint8_t named[16] = {0x0a, 1, 'a'};
        memcpy(named + 3, message, sizeof message);
        status = umbw_decode_query_request(named, sizeof named, POINTS, &out, &error);
        if (cases[i].message) {
            assert_int_equal(status, UMB_E_ARGUMENT);
            assert_non_null(strstr(error.message, cases[i].message));
        } else {
            assert_int_equal(status, UMB_OK);
            assert_int_equal(out.settings.filter, cases[i].filter);
            assert_true(out.settings.light_extent == cases[i].light_extent);
        }
    }
}

static void request_reads_in_protobuf_c_as_the_proto_file_says(void **state)
{
    struct umbw_query_request in = sample_request(positions, normals, POINTS);
    size_t size;
    (void)state;
    uint8_t *message = encode_request(&in, &size);
    Umbrage__V1__QueryRequest *other = umbrage__v1__query_request__unpack(NULL, size, message);
    assert_non_null(other);
    assert_string_equal(other->asset, "city");
    assert_int_equal(other->light, 3);
    assert_int_equal(other->taps, 9);
    assert_int_equal(other->bias_mode, 2);
    assert_int_equal(other->format, 2);
    assert_int_equal(other->n_origin, 3);
    assert_int_equal(other->points.len, sizeof positions);
    assert_int_equal(other->normals.len, sizeof normals);
    assert_int_equal(other->points_f64.len, 0);
    assert_true(other->want_stats);
    umbrage__v1__query_request__free_unpacked(other, NULL);
    free(message);
}

static void answer_formats_map_to_the_wire_numbers(void **state)
{
    static const struct {
        enum umb_answer_format ours;
        Umbrage__V1__AnswerFormat wire;
    } pairs[] = {{UMB_ANSWER_U8, 0}, {UMB_ANSWER_F32, 1}, {UMB_ANSWER_BIT, 2}};
    (void)state;
    for (size_t i = 0; i < 3; i++) {
        struct umbw_query_request in = sample_request(positions, NULL, 1);
        struct umbw_query_request out;
        size_t size;
        in.settings.format = pairs[i].ours;
        uint8_t *message = encode_request(&in, &size);
        Umbrage__V1__QueryRequest *other = umbrage__v1__query_request__unpack(NULL, size, message);
        assert_non_null(other);
        assert_int_equal(other->format, pairs[i].wire);
        umbrage__v1__query_request__free_unpacked(other, NULL);
        assert_int_equal(umbw_decode_query_request(message, size, 1, &out, NULL), UMB_OK);
        assert_int_equal(out.settings.format, pairs[i].ours);
        free(message);
    }
}

/* Packs a request with protobuf-c alone; the block is exact. */
static uint8_t *pack_other(const Umbrage__V1__QueryRequest *other, size_t *size)
{
    *size = umbrage__v1__query_request__get_packed_size(other);
    uint8_t *message = malloc(*size == 0 ? 1 : *size);
    assert_non_null(message);
    (void)umbrage__v1__query_request__pack(other, message);
    return message;
}

static char city[] = "city";

static Umbrage__V1__QueryRequest other_request(void)
{
    Umbrage__V1__QueryRequest other = UMBRAGE__V1__QUERY_REQUEST__INIT;
    other.asset = city;
    other.points.data = (uint8_t *)positions;
    other.points.len = sizeof positions;
    return other;
}

static void expect_refused(const Umbrage__V1__QueryRequest *other, size_t max_points,
                           enum umb_status expected, const char *word)
{
    struct umbw_query_request request;
    struct umb_error error = {.status = UMB_OK};
    size_t size;
    uint8_t *message = pack_other(other, &size);
    assert_int_equal(umbw_decode_query_request(message, size, max_points, &request, &error),
                     expected);
    print_message("%s\n", error.message);
    assert_non_null(strstr(error.message, word));
    free(message);
}

static void defaults_are_one_tap_u8_and_automatic_bias(void **state)
{
    Umbrage__V1__QueryRequest other = other_request();
    struct umbw_query_request request;
    size_t size;
    (void)state;
    uint8_t *message = pack_other(&other, &size);
    assert_int_equal(umbw_decode_query_request(message, size, 100, &request, NULL), UMB_OK);
    assert_int_equal(request.settings.taps, 1);
    assert_int_equal(request.settings.format, UMB_ANSWER_U8);
    assert_int_equal(request.settings.bias_mode, UMB_BIAS_AUTO);
    assert_true(request.points.origin[0] == 0);
    assert_null(request.points.normals);
    assert_int_equal(request.want_stats, 0);
    free(message);
}

static void bad_fields_are_named(void **state)
{
    double two[2] = {1, 2};
    double infinite[3] = {0, (double)INFINITY, 0};
    char empty[] = "";
    char malformed[] = "caf\xe9";
    char long_name[300];
    (void)state;
    memset(long_name, 'a', sizeof long_name - 1);
    long_name[sizeof long_name - 1] = '\0';
    Umbrage__V1__QueryRequest other = other_request();
    other.taps = 4;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "taps: 4");
    other.taps = 19;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "taps: 19");
    other = other_request();
    other.bias = -1;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "bias: -1");
    other.bias = 1000001;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "bias: ");
    other.bias = (double)NAN;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "bias: ");
    other = other_request();
    other.bias_mode = (Umbrage__V1__BiasMode)4;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "bias_mode: 4");
    other.bias_mode = (Umbrage__V1__BiasMode)-1;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "bias_mode: -1");
    other = other_request();
    other.format = (Umbrage__V1__AnswerFormat)3;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "format: 3");
    other = other_request();
    other.origin = two;
    other.n_origin = 2;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "origin: has 2");
    other.origin = infinite;
    other.n_origin = 3;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "origin: number 1");
    other = other_request();
    other.asset = empty;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "asset: is empty");
    other.asset = malformed;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "asset: not UTF-8");
    other.asset = long_name;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "asset: 299 bytes");
}

static void point_lengths_that_do_not_fit_are_named(void **state)
{
    (void)state;
    Umbrage__V1__QueryRequest other = other_request();
    other.points.len = sizeof positions - 1;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "points: length is 83 bytes");
    other = other_request();
    expect_refused(&other, POINTS - 1, UMB_E_TOO_LARGE, "points: 7 is over the limit of 6 points");
    other.points_f64.data = (uint8_t *)positions;
    other.points_f64.len = 24;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "points_f64");
    other.points.len = 0;
    other.points_f64.len = 25;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "points_f64: length is 25 bytes");
    other.points_f64.len = 48;
    expect_refused(&other, 1, UMB_E_TOO_LARGE, "points_f64: 2 is over the limit of 1 points");
    other = other_request();
    other.normals.data = (uint8_t *)normals;
    other.normals.len = sizeof normals - 12;
    expect_refused(&other, 100, UMB_E_ARGUMENT, "normals: length is 72 bytes, must be 0 or 84");
}

static void double_points_are_taken_in_place(void **state)
{
    double wide[6] = {1e7, -2.5, 0.125, 3, 4, 5};
    Umbrage__V1__QueryRequest other = other_request();
    struct umbw_query_request request;
    size_t size;
    (void)state;
    other.points.len = 0;
    other.points_f64.data = (uint8_t *)wide;
    other.points_f64.len = sizeof wide;
    uint8_t *message = pack_other(&other, &size);
    assert_int_equal(umbw_decode_query_request(message, size, 2, &request, NULL), UMB_OK);
    assert_int_equal(request.points.format, UMB_POINT_F64);
    assert_int_equal(request.points.count, 2);
    assert_memory_equal(request.points.positions, wide, sizeof wide);
    free(message);
}

/* asset "a", then fields as given. */
static enum umb_status decode_with(const uint8_t *tail, size_t tail_size,
                                   struct umbw_query_request *request, struct umb_error *error)
{
    static uint8_t message[512]; /* lives as long as the request's pointers */
    static const uint8_t head[] = {0x0a, 1, 'a'};
    memcpy(message, head, sizeof head);
    memcpy(message + sizeof head, tail, tail_size);
    return umbw_decode_query_request(message, sizeof head + tail_size, 100, request, error);
}

static void duplicate_fields_take_the_last_one(void **state)
{
    static const uint8_t tail[] = {
        0x0a, 1,  'b',                                       /* asset "b" */
        0x62, 12, 1,   2, 3, 4, 5, 6, 7, 8, 9, 10, 11,   12, /* points */
        0x18, 3,                                             /* taps 3 */
        0x62, 12, 12,  2, 3, 4, 5, 6, 7, 8, 9, 10, 11,   99, /* points again */
        0x18, 5,                                             /* taps 5 */
        0x6a, 24, 0,   0, 0, 0, 0, 0, 0, 0, 0, 0,  0,    0,
        0,    0,  0,   0, 0, 0, 0, 0, 0, 0, 0, 0,  0x6a, 0, /* points_f64, taken back */
    };
    struct umbw_query_request request;
    (void)state;
    assert_int_equal(decode_with(tail, sizeof tail, &request, NULL), UMB_OK);
    assert_string_equal(request.asset, "b");
    assert_int_equal(request.settings.taps, 5);
    assert_int_equal(request.points.count, 1);
    assert_int_equal(((const uint8_t *)request.points.positions)[11], 99);
}

static void unknown_fields_are_skipped(void **state)
{
    static const uint8_t tail[] = {
        0xa0, 0x06, 0xff, 0x01,                   /* field 100, varint */
        0xa2, 0x06, 3,    1,    2, 3,             /* field 100, bytes */
        0xa5, 0x06, 1,    2,    3, 4,             /* field 100, 32 bits */
        0xa1, 0x06, 1,    2,    3, 4, 5, 6, 7, 8, /* field 100, 64 bits */
        0x18, 7,                                  /* taps */
    };
    struct umbw_query_request request;
    (void)state;
    assert_int_equal(decode_with(tail, sizeof tail, &request, NULL), UMB_OK);
    assert_int_equal(request.settings.taps, 7);
    assert_int_equal(request.points.count, 0);
}

static void origin_may_come_unpacked(void **state)
{
    uint8_t tail[27];
    struct umbw_query_request request;
    (void)state;
    for (size_t i = 0; i < 3; i++) {
        double value = (double)i + 0.5;
        tail[9 * i] = 0x39; /* field 7, 64 bits */
        memcpy(tail + 9 * i + 1, &value, 8);
    }
    assert_int_equal(decode_with(tail, sizeof tail, &request, NULL), UMB_OK);
    assert_true(request.points.origin[2] == 2.5);
}

static void wrong_wire_types_are_named(void **state)
{
    static const struct {
        uint8_t bytes[12];
        size_t size;
        const char *word;
    } bad[] = {
        {{0x60, 1}, 2, "points: wire type is 0, must be 2"},
        {{0x5d, 1, 2, 3, 4}, 5, "normals: wire type is 5"},
        {{0x1a, 1, 1}, 3, "taps: wire type is 2, must be 0"},
        {{0x28, 1}, 2, "bias: wire type is 0, must be 1"},
        {{0x38, 1}, 2, "origin: wire type is 0"},
        {{0x1b, 1}, 2, "field 3"},                             /* a group */
        {{0x00, 1}, 2, "tag"},                                 /* field number 0 */
        {{0x62, 0xff, 0xff, 0xff, 0xff, 0x0f}, 6, "field 12"}, /* longer than the message */
        {{0x18, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f}, 11, "field 3"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct umbw_query_request request;
        struct umb_error error = {.status = UMB_OK};
        assert_int_equal(decode_with(bad[i].bytes, bad[i].size, &request, &error), UMB_E_ARGUMENT);
        print_message("%s\n", error.message);
        assert_non_null(strstr(error.message, bad[i].word));
    }
}

static void repeated_small_fields_meet_a_limit(void **state)
{
    size_t size = 3 + 2 * 65536;
    uint8_t *message = malloc(size);
    struct umbw_query_request request;
    struct umb_error error = {.status = UMB_OK};
    (void)state;
    assert_non_null(message);
    memcpy(message,
           "\x0a\x01"
           "a",
           3);
    for (size_t i = 3; i < size; i += 2) {
        message[i] = 0x18;
        message[i + 1] = 1;
    }
    message[size - 3] = 5; /* of two that are within the limit the last one counts */
    assert_int_equal(umbw_decode_query_request(message, size - 2, 1, &request, &error), UMB_OK);
    assert_int_equal(request.settings.taps, 5);
    assert_int_equal(umbw_decode_query_request(message, size, 1, &request, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "65536"));
    free(message);
}

static void encoder_refuses_what_the_decoder_would(void **state)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_error error = {.status = UMB_OK};
    (void)state;
    struct umbw_query_request request = sample_request(positions, NULL, POINTS);
    request.settings.taps = 2;
    assert_int_equal(umbw_encode_query_request(&request, &buffer, &error), UMB_E_ARGUMENT);
    request = sample_request(positions, NULL, POINTS);
    request.settings.format = (enum umb_answer_format)9;
    assert_int_equal(umbw_encode_query_request(&request, &buffer, &error), UMB_E_ARGUMENT);
    request = sample_request(NULL, NULL, POINTS);
    assert_int_equal(umbw_encode_query_request(&request, &buffer, &error), UMB_E_ARGUMENT);
    request = sample_request(positions, NULL, SIZE_MAX / 2);
    assert_int_equal(umbw_encode_query_request(&request, &buffer, &error), UMB_E_TOO_LARGE);
    request = sample_request(positions, NULL, POINTS);
    memset(request.asset, 'a', sizeof request.asset); /* no NUL */
    assert_int_equal(umbw_encode_query_request(&request, &buffer, &error), UMB_E_ARGUMENT);
    assert_null(buffer.bytes);
}

/* Every request that decodes must describe memory inside its message; ASan checks the reads. */
static void touch_request(const uint8_t *message, size_t size)
{
    struct umbw_query_request request;
    struct umb_error error = {.status = UMB_OK};
    if (umbw_decode_query_request(message, size, 1000, &request, &error) != UMB_OK) {
        assert_true(error.status != UMB_OK && error.message[0] != '\0');
        return;
    }
    uint32_t sum = 0;
    size_t scalar = request.points.format == UMB_POINT_F64 ? 8 : 4;
    for (size_t i = 0; i < request.points.count * 3 * scalar; i++) {
        sum += ((const uint8_t *)request.points.positions)[i];
    }
    for (size_t i = 0; request.points.normals != NULL && i < request.points.count * 12; i++) {
        sum += ((const uint8_t *)request.points.normals)[i];
    }
    assert_true(request.settings.taps % 2 == 1 && request.settings.taps <= UMB_TAPS_MAX);
    assert_true(strlen(request.asset) <= UMBW_ASSET_NAME_MAX);
    assert_true(sum < UINT32_MAX);
}

/* Runs a decoder on every prefix and every flipped byte, each from its own exact-size block. */
static void sweep(const uint8_t *message, size_t size,
                  void (*touch)(const uint8_t *message, size_t size))
{
    for (size_t length = 0; length <= size; length++) {
        uint8_t *copy = malloc(length == 0 ? 1 : length);
        assert_non_null(copy);
        memcpy(copy, message, length);
        touch(copy, length);
        free(copy);
    }
    for (size_t at = 0; at < size; at++) {
        for (unsigned flip = 1; flip < 256; flip = flip < 8 ? flip + 1 : flip * 2 - 1) {
            uint8_t *copy = malloc(size);
            assert_non_null(copy);
            memcpy(copy, message, size);
            copy[at] ^= (uint8_t)flip;
            touch(copy, size);
            free(copy);
        }
    }
}

static void request_decoder_survives_prefixes_and_flips(void **state)
{
    struct umbw_query_request in = sample_request(positions, normals, POINTS);
    size_t size;
    (void)state;
    uint8_t *message = encode_request(&in, &size);
    sweep(message, size, touch_request);
    free(message);
}

static uint8_t *encode_reply(const struct umbw_query_reply *reply, size_t *size)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    assert_int_equal(encode_head(reply, &buffer), UMB_OK);
    const uint8_t *p = buffer.bytes;
    *size = (size_t)p[1] << 24 | (size_t)p[2] << 16 | (size_t)p[3] << 8 | p[4];
    size_t head = buffer.size - UMBW_PREFIX_BYTES;
    assert_int_equal(*size, head + reply->visibility_bytes);
    uint8_t *message = malloc(*size);
    assert_non_null(message);
    memcpy(message, p + UMBW_PREFIX_BYTES, head);
    if (reply->visibility_bytes > 0) {
        memcpy(message + head, reply->visibility, reply->visibility_bytes);
    }
    umbw_buffer_finish(&buffer);
    return message;
}

static void reply_round_trip_keeps_every_field(void **state)
{
    uint8_t visibility[300];
    (void)state;
    memset(visibility, 0xa5, sizeof visibility);
    for (size_t bytes = 0; bytes <= sizeof visibility; bytes += 100) {
        struct umbw_query_reply in = sample_reply(visibility, bytes);
        struct umbw_query_reply out;
        in.level = 7;
        in.taps = UINT32_MAX; /* the widest: the room must do */
        in.bound_m = 0.125;
        in.visibility_error = 0.5;
        in.lines = 2.5;
        size_t size;
        uint8_t *message = encode_reply(&in, &size);
        assert_int_equal(umbw_decode_query_reply(message, size, &out, NULL), UMB_OK);
        assert_int_equal(out.visibility_bytes, bytes);
        assert_memory_equal(out.asset_id, in.asset_id, UMB_ID_BYTES);
        assert_memory_equal(&out.stats, &in.stats, sizeof in.stats);
        assert_true(out.nanoseconds == in.nanoseconds && out.has_stats == 1);
        assert_true(out.level == 7 && out.taps == UINT32_MAX && out.bound_m == 0.125);
        assert_true(out.visibility_error == 0.5 && out.lines == 2.5);
        assert_true(size + UMBW_PREFIX_BYTES <= umbw_query_reply_room(&in) + bytes);
        Umbrage__V1__QueryReply *other = umbrage__v1__query_reply__unpack(NULL, size, message);
        assert_non_null(other);
        assert_int_equal(other->visibility.len, bytes);
        assert_non_null(other->stats);
        assert_true(other->stats->nodes == 1ULL << 40);
        assert_true(other->stats->level == 7 && other->stats->bound_m == 0.125);
        umbrage__v1__query_reply__free_unpacked(other, NULL);
        free(message);
    }
}

static void reply_without_a_whole_id_is_refused(void **state)
{
    static const uint8_t message[] = {0x12, 3, 1, 2, 3};
    struct umbw_query_reply reply;
    struct umb_error error = {.status = UMB_OK};
    (void)state;
    assert_int_equal(umbw_decode_query_reply(message, sizeof message, &reply, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "asset_id: length is 3 bytes"));
}

static void touch_reply(const uint8_t *message, size_t size)
{
    struct umbw_query_reply reply;
    uint32_t sum = 0;
    if (umbw_decode_query_reply(message, size, &reply, NULL) == UMB_OK) {
        for (size_t i = 0; i < reply.visibility_bytes; i++) {
            sum += reply.visibility[i];
        }
    }
    assert_true(sum < UINT32_MAX);
}

static void reply_decoder_survives_prefixes_and_flips(void **state)
{
    static const uint8_t visibility[20] = {1, 2, 3};
    struct umbw_query_reply in = sample_reply(visibility, sizeof visibility);
    size_t size;
    (void)state;
    uint8_t *message = encode_reply(&in, &size);
    sweep(message, size, touch_reply);
    free(message);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(request_round_trip_keeps_every_field),
        cmocka_unit_test(request_reads_in_protobuf_c_as_the_proto_file_says),
        cmocka_unit_test(answer_formats_map_to_the_wire_numbers),
        cmocka_unit_test(defaults_are_one_tap_u8_and_automatic_bias),
        cmocka_unit_test(bad_fields_are_named),
        cmocka_unit_test(point_lengths_that_do_not_fit_are_named),
        cmocka_unit_test(double_points_are_taken_in_place),
        cmocka_unit_test(duplicate_fields_take_the_last_one),
        cmocka_unit_test(unknown_fields_are_skipped),
        cmocka_unit_test(origin_may_come_unpacked),
        cmocka_unit_test(wrong_wire_types_are_named),
        cmocka_unit_test(repeated_small_fields_meet_a_limit),
        cmocka_unit_test(encoder_refuses_what_the_decoder_would),
        cmocka_unit_test(request_decoder_survives_prefixes_and_flips),
        cmocka_unit_test(filters_keep_their_numbers_and_unknown_ones_are_refused),
        cmocka_unit_test(dials_and_levels_keep_their_numbers_and_exclude_taps),
        cmocka_unit_test(reply_round_trip_keeps_every_field),
        cmocka_unit_test(reply_without_a_whole_id_is_refused),
        cmocka_unit_test(reply_decoder_survives_prefixes_and_flips),
    };
    return cmocka_run_group_tests(tests, fill_points, NULL);
}
