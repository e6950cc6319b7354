/* SPDX-License-Identifier: Apache-2.0 */
/* Describe, List and health messages: round trips, limits, sweeps over prefixes and flips. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include "grpc/health/v1/health.pb-c.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/bakes.h"
#include "wire/codec.h"
#include "wire_samples.h"

static uint8_t *take_message(struct umbw_buffer *buffer, size_t *size)
{
    assert_true(buffer->size >= UMBW_PREFIX_BYTES);
    *size = buffer->size - UMBW_PREFIX_BYTES;
    uint8_t *message = malloc(*size == 0 ? 1 : *size);
    assert_non_null(message);
    memcpy(message, buffer->bytes + UMBW_PREFIX_BYTES, *size);
    umbw_buffer_finish(buffer);
    return message;
}

static char plan_text[] = "effect=closed state=on reason=\"\xc3\xa9\"\n";
static char settings_text[] = "resolution=1024\n";

static uint8_t *sample_description(size_t *size)
{
    struct umb_client_light lights[3];
    struct umbw_buffer buffer = {NULL, 0, 0};
    for (unsigned i = 0; i < 3; i++) {
        sample_light(i, &lights[i]);
        lights[i].curve_count = i == 2 ? UMB_CURVE_ROWS_MAX : i;
        for (size_t row = 0; row < lights[i].curve_count; row++) {
            const double number = (double)row + i;
            lights[i].curve[row] =
                (struct umb_curve_row){i, 3, number, number / 64, number + 2, number + 3, {0}};
            lights[i].scattered_ns[row] = number + 4;
            lights[i].coherent_ns[row] = i == 1 ? 0 : number + 5;
        }
    }
    struct umb_client_description reply = {
        .asset = sample_summary(3),
        .light_count = 3,
        .lights = lights,
        .origin = {1, 2, 3},
        .bounds = {{-1, -2, -3}, {4, 5, 6}},
        .plan = plan_text,
        .settings = settings_text,
    };
    memset(reply.scene_hash, 0x5a, sizeof reply.scene_hash);
    assert_int_equal(umbw_encode_describe_reply(&reply, &buffer, NULL), UMB_OK);
    return take_message(&buffer, size);
}

static void description_round_trip_keeps_every_field(void **state)
{
    struct umb_client_description *out;
    struct umb_client_light light;
    size_t size;
    (void)state;
    uint8_t *message = sample_description(&size);
    assert_int_equal(umbw_decode_describe_reply(message, size, &out, NULL), UMB_OK);
    struct umb_client_asset summary = sample_summary(3);
    assert_string_equal(out->asset.name, summary.name);
    assert_memory_equal(out->asset.id, summary.id, sizeof summary.id);
    assert_true(out->asset.memory_bytes == 1ULL << 35);
    assert_int_equal(out->light_count, 3);
    for (unsigned i = 0; i < 3; i++) {
        sample_light(i, &light);
        assert_string_equal(out->lights[i].info.name, light.info.name);
        assert_int_equal(out->lights[i].info.kind, light.info.kind);
        assert_memory_equal(out->lights[i].info.direction, light.info.direction, 24);
        assert_memory_equal(out->lights[i].info.position, light.info.position, 24);
        assert_memory_equal(out->lights[i].voxel_m, light.voxel_m, 24);
        assert_true(out->lights[i].info.extent == light.info.extent);
        assert_memory_equal(out->lights[i].info.side, light.info.side, sizeof light.info.side);
        assert_true(out->lights[i].resolution == light.resolution);
        assert_int_equal(out->lights[i].closed, light.closed);
        const struct umb_client_light *curve = &out->lights[i];
        assert_int_equal(curve->curve_count, i == 2 ? UMB_CURVE_ROWS_MAX : (int)i);
        for (size_t row = 0; row < curve->curve_count; row++) {
            const double number = (double)row + i;
            const struct umb_curve_row *r = &curve->curve[row];
            assert_true(r->level == i && r->taps == 3 && r->bound_m == number &&
                        r->visibility_error == number / 64 && r->nodes == number + 2 &&
                        r->lines == number + 3);
            assert_true(curve->scattered_ns[row] == number + 4);
            assert_true(curve->coherent_ns[row] == (i == 1 ? 0 : number + 5));
        }
    }
    assert_true(out->origin[2] == 3 && out->bounds.min[1] == -2 && out->bounds.max[0] == 4);
    assert_string_equal(out->plan, plan_text);
    assert_string_equal(out->settings, settings_text);
    assert_int_equal(out->scene_hash[31], 0x5a);
    free(out);
    free(message);
}

static void expect_bad_description(const Umbrage__V1__DescribeReply *other,
                                   enum umb_status expected, const char *word)
{
    struct umb_client_description *out;
    struct umb_error error = {.status = UMB_OK};
    size_t size = umbrage__v1__describe_reply__get_packed_size(other);
    uint8_t *message = malloc(size + 1);
    assert_non_null(message);
    (void)umbrage__v1__describe_reply__pack(other, message);
    assert_int_equal(umbw_decode_describe_reply(message, size, &out, &error), expected);
    print_message("%s\n", error.message);
    assert_non_null(strstr(error.message, word));
    assert_null(out);
    free(message);
}

static void broken_descriptions_are_named_and_leave_nothing(void **state)
{
    uint8_t id[32] = {0};
    char name[] = "a";
    char long_name[70];
    double two[2] = {1, 2};
    Umbrage__V1__DescribeReply other = UMBRAGE__V1__DESCRIBE_REPLY__INIT;
    Umbrage__V1__AssetSummary summary = UMBRAGE__V1__ASSET_SUMMARY__INIT;
    Umbrage__V1__Light light = UMBRAGE__V1__LIGHT__INIT;
    Umbrage__V1__Light *lights[] = {&light};
    (void)state;
    memset(long_name, 'a', sizeof long_name - 1);
    long_name[sizeof long_name - 1] = '\0';
    expect_bad_description(&other, UMB_E_ARGUMENT, "summary: is missing");
    other.summary = &summary;
    summary.name = name;
    summary.id.data = id;
    summary.id.len = 31;
    expect_bad_description(&other, UMB_E_ARGUMENT, "summary.id: length is 31");
    summary.id.len = 32;
    expect_bad_description(&other, UMB_E_ARGUMENT, "scene_hash");
    other.scene_hash.data = id;
    other.scene_hash.len = 32;
    other.lights = lights;
    other.n_lights = 1;
    light.kind = (Umbrage__V1__LightKind)5;
    expect_bad_description(&other, UMB_E_ARGUMENT, "lights.kind: 5");
    light.kind = (Umbrage__V1__LightKind)0;
    light.name = long_name;
    expect_bad_description(&other, UMB_E_ARGUMENT, "lights.name: 69 bytes");
    light.name = name;
    light.direction = two;
    light.n_direction = 2;
    expect_bad_description(&other, UMB_E_ARGUMENT, "lights.direction: has 2");
}

/* 2 bytes a light on the wire become hundreds in memory: the count must be checked before. */
static void too_many_lights_are_refused_before_they_cost_memory(void **state)
{
    size_t size = 2 * (UMB_LIGHTS_MAX + 1);
    uint8_t *message = malloc(size);
    struct umb_client_description *out;
    struct umb_error error = {.status = UMB_OK};
    (void)state;
    assert_non_null(message);
    for (size_t i = 0; i < size; i += 2) {
        message[i] = 0x12;
        message[i + 1] = 0;
    }
    assert_int_equal(umbw_decode_describe_reply(message, size, &out, &error), UMB_E_TOO_LARGE);
    assert_non_null(strstr(error.message, "4097"));
    free(message);
}

static void nested_unknown_fields_meet_a_limit(void **state)
{
    /* One light whose sub-fields are 2-byte unknown fields. */
    size_t count = 3 << 20;
    uint8_t *message = malloc(36 + count + 5);
    struct umb_client_description *out;
    (void)state;
    assert_non_null(message);
    /* A summary with an id. */
    memset(message, 0, 36);
    memcpy(message, "\x0a\x22\x12\x20", 4);
    uint8_t *light = message + 36;
    light[0] = 0x12;
    light[1] = (uint8_t)(count | 0x80);
    light[2] = (uint8_t)(count >> 7 | 0x80);
    light[3] = (uint8_t)(count >> 14 | 0x80);
    light[4] = (uint8_t)(count >> 21);
    for (size_t i = 0; i < count; i += 2) {
        light[5 + i] = 0x78; /* field 15 */
        light[6 + i] = 0;
    }
    struct umb_error error = {.status = UMB_OK};
    enum umb_status status = umbw_decode_describe_reply(message, 36 + count + 5, &out, &error);
    print_message("%s\n", error.message);
    assert_int_equal(status, UMB_E_TOO_LARGE); /* trying again would not help */
    free(message);
}

/* One asset, its count of lights again and again: two bytes each. */
static void fields_of_parts_meet_a_limit(void **state)
{
    (void)state;
    for (size_t over = 0; over <= 1; over++) {
        const size_t count = 2 * (UMBW_NESTED_MAX + over);
        uint8_t *message = calloc(1, 5 + count);
        struct umbw_list_reply out;
        struct umb_error error = {.status = UMB_OK};
        assert_non_null(message);
        message[0] = 0x0a;
        for (unsigned i = 0; i < 4; i++) {
            message[1 + i] = (uint8_t)((count >> (7 * i) & 127) | (i < 3 ? 128 : 0));
        }
        for (size_t i = 0; i < count; i += 2) {
            message[5 + i] = 5 << 3;
        }
        enum umb_status status = umbw_decode_list_reply(message, 5 + count, &out, &error);
        assert_int_equal(status, over ? UMB_E_TOO_LARGE : UMB_E_ARGUMENT); /* else without an id */
        assert_non_null(strstr(error.message, over ? "its parts have" : "summary.id"));
        free(message);
    }
}

/* A manifest counts like a message, in one piece or in many. Its field `priority` is repeated. */
static void fields_of_a_manifest_meet_a_limit(void **state)
{
    (void)state;
    for (size_t over = 0; over <= 1; over++) {
        const size_t count = 2 * (UMBW_FIELDS_MAX / 2 + over); /* in the second piece */
        const size_t piece = 4, first = UMBW_FIELDS_MAX / 2 * piece;
        uint8_t *message = calloc(1, first + 4 + count);
        struct umbw_submit_request out;
        struct umb_error error = {.status = UMB_OK};
        assert_non_null(message);
        for (size_t i = 0; i < first; i += piece) {
            memcpy(message + i, (const uint8_t[]){0x0a, 2, 4 << 3, 1}, piece);
        }
        uint8_t *second = message + first;
        second[0] = 0x0a;
        for (unsigned i = 0; i < 3; i++) {
            second[1 + i] = (uint8_t)((count >> (7 * i) & 127) | (i < 2 ? 128 : 0));
        }
        for (size_t i = 0; i < count; i += 2) {
            second[4 + i] = 4 << 3;
        }
        enum umb_status status =
            umbw_decode_submit_request(message, first + 4 + count, &out, &error);
        assert_int_equal(status, over ? UMB_E_ARGUMENT : UMB_OK);
        umbw_manifest_finish(&out.manifest);
        free(message);
    }
}

static void touch_description(const uint8_t *message, size_t size)
{
    struct umb_client_description *out;
    if (umbw_decode_describe_reply(message, size, &out, NULL) == UMB_OK) {
        assert_true(strlen(out->plan) < size && strlen(out->settings) < size);
        free(out);
    }
}

static void touch_list(const uint8_t *message, size_t size)
{
    struct umbw_list_reply out;
    if (umbw_decode_list_reply(message, size, &out, NULL) == UMB_OK) {
        for (size_t i = 0; i < out.count; i++) {
            assert_true(strlen(out.assets[i].name) <= UMBW_ASSET_NAME_MAX);
        }
        free(out.assets);
    }
}

static void touch_small(const uint8_t *message, size_t size)
{
    char text[UMBW_ASSET_NAME_MAX + 1];
    struct umbw_describe_request request;
    int serving;
    if (umbw_decode_describe_request(message, size, &request, NULL) == UMB_OK) {
        assert_true(strlen(request.asset) > 0);
    }
    if (umbw_decode_health_request(message, size, text, NULL) == UMB_OK) {
        assert_true(strlen(text) <= 255);
    }
    enum umb_status status = umbw_decode_health_reply(message, size, &serving, NULL);
    assert_true(status == UMB_OK || serving == 0);
}

static void sweep(const uint8_t *message, size_t size, void (*touch)(const uint8_t *, size_t))
{
    for (size_t length = 0; length <= size; length++) {
        uint8_t *copy = malloc(length == 0 ? 1 : length);
        assert_non_null(copy);
        memcpy(copy, message, length);
        touch(copy, length);
        free(copy);
    }
    for (size_t at = 0; at < size; at++) {
        for (unsigned bit = 0; bit < 9; bit++) {
            uint8_t *copy = malloc(size);
            assert_non_null(copy);
            memcpy(copy, message, size);
            copy[at] ^= (uint8_t)(bit < 8 ? 1U << bit : 0xffU);
            touch(copy, size);
            free(copy);
        }
    }
}

static void description_decoder_survives_prefixes_and_flips(void **state)
{
    size_t size;
    (void)state;
    uint8_t *message = sample_description(&size);
    sweep(message, size, touch_description);
    free(message);
}

static uint8_t *sample_list(size_t count, size_t *size)
{
    struct umb_client_asset assets[8];
    struct umbw_buffer buffer = {NULL, 0, 0};
    for (unsigned i = 0; i < 8; i++) {
        assets[i] = sample_summary(i);
    }
    struct umbw_list_reply reply = {.count = count, .assets = assets};
    assert_int_equal(umbw_encode_list_reply(&reply, &buffer, NULL), UMB_OK);
    return take_message(&buffer, size);
}

static void list_round_trip_keeps_order(void **state)
{
    (void)state;
    for (size_t count = 0; count <= 8; count += 4) {
        struct umbw_list_reply out;
        size_t size;
        uint8_t *message = sample_list(count, &size);
        assert_int_equal(umbw_decode_list_reply(message, size, &out, NULL), UMB_OK);
        assert_int_equal(out.count, count);
        for (unsigned i = 0; i < count; i++) {
            struct umb_client_asset expected = sample_summary(i);
            assert_string_equal(out.assets[i].name, expected.name);
            assert_true(out.assets[i].packed_bytes == expected.packed_bytes);
        }
        free(out.assets);
        free(message);
    }
}

static void list_decoder_survives_prefixes_and_flips(void **state)
{
    size_t size;
    (void)state;
    uint8_t *message = sample_list(3, &size);
    sweep(message, size, touch_list);
    free(message);
}

static void list_request_is_an_empty_message(void **state)
{
    static const uint8_t expected[5];
    struct umbw_buffer buffer = {NULL, 0, 0};
    (void)state;
    assert_int_equal(umbw_encode_empty(&buffer, NULL), UMB_OK);
    assert_int_equal(buffer.size, 5);
    assert_memory_equal(buffer.bytes, expected, 5);
    umbw_buffer_finish(&buffer);
}

static void small_messages_round_trip(void **state)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    char text[256];
    struct umbw_describe_request request = {.asset = "stadt"}, back;
    int serving = 2;
    size_t size;
    (void)state;
    assert_int_equal(umbw_encode_describe_request(&request, &buffer, NULL), UMB_OK);
    uint8_t *message = take_message(&buffer, &size);
    assert_int_equal(umbw_decode_describe_request(message, size, &back, NULL), UMB_OK);
    assert_int_equal(back.want_curves, 0);
    free(message);
    request = (struct umbw_describe_request){.asset = "stadt \xc3\xbc", .want_curves = 1};
    assert_int_equal(umbw_encode_describe_request(&request, &buffer, NULL), UMB_OK);
    message = take_message(&buffer, &size);
    assert_int_equal(umbw_decode_describe_request(message, size, &back, NULL), UMB_OK);
    assert_int_equal(back.want_curves, 1);
    assert_string_equal(back.asset, "stadt \xc3\xbc");
    sweep(message, size, touch_small);
    free(message);
    assert_int_equal(umbw_encode_health_request("umbrage.v1.Shadows", &buffer, NULL), UMB_OK);
    message = take_message(&buffer, &size);
    assert_int_equal(umbw_decode_health_request(message, size, text, NULL), UMB_OK);
    assert_string_equal(text, "umbrage.v1.Shadows");
    free(message);
    assert_int_equal(umbw_encode_health_reply(&serving, &buffer, NULL), UMB_OK);
    message = take_message(&buffer, &size);
    serving = 0;
    assert_int_equal(umbw_decode_health_reply(message, size, &serving, NULL), UMB_OK);
    assert_int_equal(serving, 2);
    free(message);
    /* An empty body means the server as a whole. */
    assert_int_equal(umbw_decode_health_request(NULL, 0, text, NULL), UMB_OK);
    assert_string_equal(text, "");
    request.asset[0] = '\0';
    assert_int_equal(umbw_encode_describe_request(&request, &buffer, NULL), UMB_E_ARGUMENT);
    umbw_buffer_finish(&buffer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(description_round_trip_keeps_every_field),
        cmocka_unit_test(broken_descriptions_are_named_and_leave_nothing),
        cmocka_unit_test(too_many_lights_are_refused_before_they_cost_memory),
        cmocka_unit_test(nested_unknown_fields_meet_a_limit),
        cmocka_unit_test(fields_of_parts_meet_a_limit),
        cmocka_unit_test(fields_of_a_manifest_meet_a_limit),
        cmocka_unit_test(description_decoder_survives_prefixes_and_flips),
        cmocka_unit_test(list_round_trip_keeps_order),
        cmocka_unit_test(list_decoder_survives_prefixes_and_flips),
        cmocka_unit_test(list_request_is_an_empty_message),
        cmocka_unit_test(small_messages_round_trip),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
