/* SPDX-License-Identifier: Apache-2.0 */
/* Reflection on hostile requests, inflating within limits, and the codecs of targets and limits. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <zlib.h>
#include "wire/bakes.h"
#include "grpc/reflection/v1/reflection.pb-c.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"
#include "grpc/grpc.h"
#include "wire/messages.h"
#include "wire_samples.h"

/* A gzip stream of `size` zeros; returns its length. */
static size_t gzip_zeros(size_t size, uint8_t *out, size_t capacity)
{
    z_stream stream;
    memset(&stream, 0, sizeof stream);
    assert_int_equal(deflateInit2(&stream, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
    uint8_t *zeros = calloc(size, 1);
    assert_non_null(zeros);
    stream.next_in = zeros;
    stream.avail_in = (uInt)size;
    stream.next_out = out;
    stream.avail_out = (uInt)capacity;
    assert_int_equal(deflate(&stream, Z_FINISH), Z_STREAM_END);
    size_t length = capacity - stream.avail_out;
    deflateEnd(&stream);
    free(zeros);
    return length;
}

static void gunzip_takes_up_to_its_limit_and_not_one_byte_more(void **state)
{
    (void)state;
    static uint8_t packed[65536];
    const size_t limits[] = {1, 4095, 4096, 4097, 100000, UMBW_GUNZIP_MAX};
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        uint8_t *out;
        size_t size;
        struct umb_error error;
        size_t length = gzip_zeros(limits[i], packed, sizeof packed);
        assert_int_equal(umbw_gunzip(packed, length, limits[i], &out, &size, &error), UMB_OK);
        assert_int_equal(size, limits[i]);
        free(out);
        length = gzip_zeros(limits[i] + 1, packed, sizeof packed);
        assert_int_equal(umbw_gunzip(packed, length, limits[i], &out, &size, &error),
                         UMB_E_TOO_LARGE);
        assert_null(out);
    }
}

/* A field of bytes: tag, length in five bytes; returns the head's length. */
static size_t put_head(uint8_t *at, uint32_t number, size_t size)
{
    at[0] = (uint8_t)(number << 3 | UMBW_WIRE_BYTES);
    for (int i = 0; i < 5; i++) {
        at[1 + i] = (uint8_t)((size >> (7 * i) & 127) | (i < 4 ? 128 : 0));
    }
    return 6;
}

/* Makes `count` fields of number 15, which none of our messages has, two bytes each. */
static size_t put_unknown(uint8_t *at, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        at[2 * i] = 15 << 3;
        at[2 * i + 1] = 0;
    }
    return 2 * count;
}

/* In sub-messages too. */
static void unknown_fields_of_parts_meet_a_limit(void **state)
{
    (void)state;
    const size_t text = (size_t)4 << 20;
    uint8_t *message = malloc(text + 3 * UMBW_FIELDS_MAX);
    assert_non_null(message);
    for (size_t over = 0; over <= 1; over++) {
        struct umbw_submit_request request;
        struct umb_error error = {0};
        const size_t unknown = UMBW_FIELDS_MAX + over;
        size_t size = put_head(message, 1, 6 + text + 6 + 2 * unknown); /* the manifest */
        size += put_head(message + size, 1, text);                      /* its scene */
        memset(message + size, 'a', text);
        size += text;
        size += put_head(message + size, 2, 2 * unknown); /* a file */
        size += put_unknown(message + size, unknown);
        enum umb_status status = umbw_decode_submit_request(message, size, &request, &error);
        assert_int_equal(status == UMB_E_TOO_LARGE, over);
        assert_true(!over || strstr(error.message, "unknown fields") != NULL);
        umbw_manifest_finish(&request.manifest);
    }
    free(message);
}

static void gunzip_refuses_every_prefix_and_trailing_bytes(void **state)
{
    (void)state;
    uint8_t packed[4096];
    size_t length = gzip_zeros(5000, packed, sizeof packed);
    for (size_t cut = 0; cut <= length; cut++) {
        uint8_t *exact = malloc(cut > 0 ? cut : 1);
        uint8_t *out;
        size_t size;
        assert_non_null(exact);
        memcpy(exact, packed, cut);
        enum umb_status status = umbw_gunzip(exact, cut, 100000, &out, &size, NULL);
        /* The last bytes of a prefix are read as the size, which may be over the limit. */
        assert_true(cut == length ? status == UMB_OK
                                  : status == UMB_E_ARGUMENT || status == UMB_E_TOO_LARGE);
        assert_true((out != NULL) == (status == UMB_OK));
        free(out);
        free(exact);
    }
    uint8_t *out;
    size_t size;
    packed[length] = 0;
    assert_int_equal(umbw_gunzip(packed, length + 1, 100000, &out, &size, NULL), UMB_E_ARGUMENT);
}

static void gunzip_refuses_streams_that_lie_about_their_size(void **state)
{
    (void)state;
    static uint8_t packed[65536];
    const size_t length = gzip_zeros(UMBW_GUNZIP_MAX, packed, sizeof packed);
    const uint32_t lies[] = {0,        1,         4096, UMBW_GUNZIP_MAX - 1, UMBW_GUNZIP_MAX + 1,
                             1u << 31, UINT32_MAX};
    for (size_t i = 0; i < sizeof lies / sizeof lies[0]; i++) {
        uint8_t *out;
        size_t size;
        for (int k = 0; k < 4; k++) {
            packed[length - 4 + (size_t)k] = (uint8_t)(lies[i] >> 8 * k);
        }
        assert_int_equal(umbw_gunzip(packed, length, SIZE_MAX, &out, &size, NULL),
                         lies[i] > UMBW_GUNZIP_MAX ? UMB_E_TOO_LARGE : UMB_E_ARGUMENT);
        assert_null(out);
    }
}

static void reflection_answers_or_refuses_every_flipped_request(void **state)
{
    (void)state;
    const uint8_t request[] = "\x22\x1eumbrage.v1.Shadows.QueryStream"; /* field 4 */
    struct umb_error error;
    for (size_t size = 0; size < sizeof request; size++) {
        for (unsigned bit = 0; bit < 8 * size; bit++) {
            uint8_t *exact = malloc(size);
            struct umbw_buffer buffer = {0};
            assert_non_null(exact);
            memcpy(exact, request, size);
            exact[bit / 8] ^= (uint8_t)(1U << bit % 8);
            enum umb_status status = umbw_reflection_answer(exact, size, &buffer, &error);
            assert_true(status == UMB_OK || status == UMB_E_ARGUMENT);
            umbw_buffer_finish(&buffer);
            free(exact);
        }
    }
}

/* Appends a target to a message; returns the new size. */
static size_t put_target(uint8_t *message, size_t size, const char *asset, uint8_t light)
{
    size_t length = strlen(asset);
    message[size++] = 0x4a; /* field 9 */
    message[size++] = (uint8_t)(length + 4);
    message[size++] = 0x0a;
    message[size++] = (uint8_t)length;
    memcpy(message + size, asset, length);
    size += length;
    message[size++] = 0x10;
    message[size++] = light;
    return size;
}

static void targets_come_in_order_and_end(void **state)
{
    (void)state;
    uint8_t message[256];
    const float point[3] = {1, 2, 3};
    size_t size = put_target(message, 0, "one", 1);
    message[size++] = 0x62; /* points between the targets */
    message[size++] = sizeof point;
    memcpy(message + size, point, sizeof point);
    size = put_target(message, size + sizeof point, "two", 2);
    struct umbw_query_request request;
    struct umbw_query_target target;
    struct umb_error error;
    assert_int_equal(umbw_decode_query_request(message, size, 10, &request, &error), UMB_OK);
    assert_int_equal(request.target_count, 2);
    assert_int_equal(umbw_query_target_next(&request, &target, &error), UMB_OK);
    assert_string_equal(target.asset, "one");
    assert_int_equal(target.light, 1);
    assert_int_equal(umbw_query_target_next(&request, &target, &error), UMB_OK);
    assert_string_equal(target.asset, "two");
    assert_int_equal(target.light, 2);
    assert_int_equal(umbw_query_target_next(&request, &target, &error), UMB_E_ARGUMENT);
    /* one point of two targets is two answers */
    assert_int_equal(umbw_decode_query_request(message, size, 1, &request, &error),
                     UMB_E_TOO_LARGE);
    assert_non_null(strstr(error.message, "2 targets"));
}

static void reply_head_is_exactly_as_long_as_its_room_without_stats(void **state)
{
    (void)state;
    const size_t sizes[] = {0, 1, 127, 128, 16383, 16384, 1 << 21, UINT32_MAX / 2};
    uint8_t ids[UMBW_TARGETS_MAX * UMB_ID_BYTES] = {0};
    uint8_t head[4096];
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        for (size_t count = 0; count <= UMBW_TARGETS_MAX; count += 16) {
            struct umbw_query_reply reply = sample_reply(NULL, sizes[i]);
            reply.asset_ids = ids;
            reply.asset_id_count = count;
            reply.voxel_m = 0.125;
            assert_true(umbw_write_query_reply_head(&reply, head) <= umbw_query_reply_room(&reply));
            reply.has_stats = 0;
            assert_int_equal(umbw_write_query_reply_head(&reply, head),
                             umbw_query_reply_room(&reply));
        }
    }
}

static void limits_survive_their_codec(void **state)
{
    (void)state;
    static const char *const encodings[] = {"identity", "gzip"};
    struct umbw_limits in = {.client = {.max_points = 1ULL << 40,
                                        .max_message_bytes = 7,
                                        .max_targets = 64,
                                        .max_taps = 17,
                                        .version = "1.2.3"},
                             .max_streams = 256,
                             .queue = 9,
                             .encodings = encodings,
                             .encoding_count = 2};
    struct umbw_limits out;
    struct umbw_buffer buffer = {0};
    assert_int_equal(umbw_encode_limits_reply(&in, &buffer, NULL), UMB_OK);
    assert_int_equal(umbw_decode_limits_reply(buffer.bytes + UMBW_PREFIX_BYTES,
                                              buffer.size - UMBW_PREFIX_BYTES, &out, NULL),
                     UMB_OK);
    in.encodings = NULL; /* not read */
    in.encoding_count = 0;
    assert_memory_equal(&in, &out, sizeof in);
    umbw_buffer_finish(&buffer);
}

/* The file of a symbol, an unknown symbol, a type, the list of services, and a request for nothing:
 * each gets its kind of answer, as another decoder reads it. */
static void reflection_answers_each_question(void **state)
{
    (void)state;
    static const struct {
        const char *question;
        size_t size;
        int answer; /* number of the response's field */
    } rows[] = {{"\x22\x12umbrage.v1.Shadows", 20, 4},
                {"\x22\x01x", 3, 7},
                {"\x32\x12umbrage.v1.Shadows", 20, 5},
                {"\x3a\x00", 2, 6},
                {"", 0, 7}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct umbw_buffer buffer = {0};
        assert_int_equal(
            umbw_reflection_answer((const uint8_t *)rows[i].question, rows[i].size, &buffer, NULL),
            UMB_OK);
        Grpc__Reflection__V1__ServerReflectionResponse *answer =
            grpc__reflection__v1__server_reflection_response__unpack(
                NULL, buffer.size - UMBW_PREFIX_BYTES, buffer.bytes + UMBW_PREFIX_BYTES);
        assert_non_null(answer);
        assert_int_equal(answer->message_response_case, rows[i].answer);
        if (rows[i].answer == 4) {
            assert_int_equal(answer->file_descriptor_response->n_file_descriptor_proto, 1);
            assert_memory_equal(answer->file_descriptor_response->file_descriptor_proto->data + 2,
                                "umbrage/v1/shadows.proto", 24); /* its first field */
        } else if (rows[i].answer == 6) {
            assert_true(answer->list_services_response->n_service >= 5);
        }
        grpc__reflection__v1__server_reflection_response__free_unpacked(answer, NULL);
        umbw_buffer_finish(&buffer);
    }
}

struct pair {
    char asset[8];
    uint32_t light;
};

static void a_table_that_does_not_fit_its_message_fails_at_its_first_use(void **state)
{
    (void)state;
    UMBW_TABLE(FEW, umbrage__v1__target, "", sizeof(struct pair), {1, UMBW_AT(pair, asset)});
    UMBW_TABLE(SWAPPED, umbrage__v1__target, "", sizeof(struct pair), {2, UMBW_AT(pair, light)},
               {1, UMBW_AT(pair, asset)});
    const struct umbw_table *tables[] = {&FEW, &SWAPPED};
    static const char *const reasons[] = {"umbrage.v1.Target: has 2 fields, its table has 1 rows",
                                          "asset: row 2 of the table stands here"};
    for (size_t i = 0; i < 4; i++) { /* the second use too */
        struct pair pair = {"a", 1};
        struct umb_error error = {0};
        struct umbw_buffer buffer = {0};
        assert_int_equal(umbw_encode(tables[i % 2], &pair, &buffer, &error), UMB_E_INTERNAL);
        assert_string_equal(error.message, reasons[i % 2]);
        error.message[0] = '\0';
        assert_int_equal(umbw_decode(tables[i % 2], (const uint8_t *)"", 0, &pair, &error),
                         UMB_E_INTERNAL);
        assert_string_equal(error.message, reasons[i % 2]);
        assert_null(buffer.bytes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(unknown_fields_of_parts_meet_a_limit),
        cmocka_unit_test(a_table_that_does_not_fit_its_message_fails_at_its_first_use),
        cmocka_unit_test(gunzip_takes_up_to_its_limit_and_not_one_byte_more),
        cmocka_unit_test(gunzip_refuses_every_prefix_and_trailing_bytes),
        cmocka_unit_test(gunzip_refuses_streams_that_lie_about_their_size),
        cmocka_unit_test(reflection_answers_or_refuses_every_flipped_request),
        cmocka_unit_test(reflection_answers_each_question),
        cmocka_unit_test(targets_come_in_order_and_end),
        cmocka_unit_test(reply_head_is_exactly_as_long_as_its_room_without_stats),
        cmocka_unit_test(limits_survive_their_codec),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
