/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The bytes of every message that a client or a server sends, with all fields set and with few.
 * They were made by protobuf-c's own encoder, and must not change. tests/interop/test_wire.py
 * compares with Python's protobuf.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "wire/bakes.h"
#include "wire/messages.h"
#include "wire/regions.h"
#include "wire/versions.h"
#include "wire/volume_queries.h"
#include "wire_samples.h"
#include "golden_bytes.h"

static const float few_points[6] = {1, 2.5F, -3, 4, 5, 6};
static const double wide_points[3] = {1e7, -0.25, 3};

/* Compares a message with the golden bytes of its name, in hexadecimal digits. */
static void expect(const char *name, enum umb_status status, struct umbw_buffer *buffer)
{
    char text[2 * GOLDEN_BYTES_MAX + 1];
    assert_int_equal(status, UMB_OK);
    assert_true(buffer->size <= GOLDEN_BYTES_MAX);
    for (size_t i = 0; i < buffer->size; i++) {
        (void)snprintf(text + 2 * i, 3, "%02x", (unsigned)buffer->bytes[i]);
    }
    text[2 * buffer->size] = '\0';
    umbw_buffer_finish(buffer);
    for (size_t i = 0; i < sizeof golden_bytes / sizeof golden_bytes[0]; i++) {
        if (strcmp(golden_bytes[i].name, name) == 0) {
            assert_string_equal(text, golden_bytes[i].digits);
            return;
        }
    }
    fail_msg("no golden bytes: {\"%s\", \"%s\"},", name, text);
}

static void queries_keep_their_bytes(void **state)
{
    (void)state;
    struct umbw_buffer b = {0};
    struct umbw_query_request few = {.asset = "a", .points = {.positions = few_points, .count = 2}};
    expect("query few", umbw_encode_query_request(&few, &b, NULL), &b);
    struct umbw_query_request all = sample_request(NULL, few_points, 1);
    all.points.positions = wide_points;
    all.points.format = UMB_POINT_F64;
    all.points.footprints = few_points;
    all.settings.opaque_only = 1;
    all.settings.filter = UMB_FILTER_FOOTPRINT;
    all.settings.light_extent = 0.5;
    all.settings.footprint_m = 2;
    all.settings.pixel_rad = 0.001;
    all.settings.eye[1] = 7;
    all.pack = 1;
    all.base_mark = 0xfedcba9876543210U;
    expect("query all", umbw_encode_query_request(&all, &b, NULL), &b);
    few.dial = (struct umb_dial){.max_error_m = 1, .max_visibility = 0.5, .budget_ns = 40};
    few.settings.bias_mode = UMB_BIAS_NONE;
    few.points.origin[2] = -1;
    expect("query dial", umbw_encode_query_request(&few, &b, NULL), &b);
    struct umbw_query_request picture = {.asset = "a", .has_picture = 1, .points.count = 6};
    picture.settings.format = UMB_ANSWER_U8;
    picture.picture = (struct umb_picture){
        .camera = {.eye = {1, 0, 3}, .forward = {0, 0, 1}, .up = {0, 1, 0}, .fov_y = 0.5},
        .width = 3,
        .height = 2,
        .depth = few_points};
    expect("query picture", umbw_encode_query_request(&picture, &b, NULL), &b);
}

static void replies_keep_their_bytes(void **state)
{
    (void)state;
    struct umbw_buffer b = {0};
    struct umbw_query_reply reply = sample_reply(NULL, 300);
    uint8_t ids[2 * UMB_ID_BYTES] = {9, 8, 7};
    reply.voxel_m = 0.125;
    reply.level = 5;
    reply.taps = 3;
    reply.bound_m = 1.5;
    reply.visibility_error = 0.25;
    reply.lines = 2.5;
    reply.expected_ns = 40;
    reply.packing = UMBW_PACKING_CHANGES;
    expect("reply all", encode_head(&reply, &b), &b);
    reply.asset_ids = ids;
    reply.asset_id_count = 2;
    expect("reply targets", encode_head(&reply, &b), &b);
    memset(&reply, 0, sizeof reply);
    expect("reply few", encode_head(&reply, &b), &b);
    reply.has_stats = 1;
    expect("reply no counts", encode_head(&reply, &b), &b);
}

static void assets_keep_their_bytes(void **state)
{
    (void)state;
    struct umbw_buffer b = {0};
    struct umb_client_asset assets[2] = {sample_summary(3), {.light_count = 0}};
    const struct umbw_list_reply list = {.count = 2, .assets = assets};
    expect("list", umbw_encode_list_reply(&list, &b, NULL), &b);
    struct umb_client_light lights[2];
    char plan[] = "effect=closed state=on\n", settings[] = "resolution=64\n";
    sample_light(1, &lights[0]);
    sample_light(2, &lights[1]);
    lights[1].curve_count = 2;
    lights[1].curve[1] = (struct umb_curve_row){3, 5, 0.5, 0.25, 7, 8, {0}};
    lights[1].scattered_ns[0] = 9;
    lights[1].coherent_ns[1] = 10;
    struct umb_client_description description = {.asset = sample_summary(2),
                                                 .light_count = 2,
                                                 .lights = lights,
                                                 .origin = {1, 2, 3},
                                                 .bounds = {{-1, -2, -3}, {4, 0, 6}},
                                                 .plan = plan,
                                                 .settings = settings,
                                                 .scene_hash = {1, 2, 3}};
    expect("description", umbw_encode_describe_reply(&description, &b, NULL), &b);
    memset(&description, 0, sizeof description);
    expect("description few", umbw_encode_describe_reply(&description, &b, NULL), &b);
    const struct umbw_describe_request request = {.asset = "stadt \xc3\xbc", .want_curves = 1};
    expect("describe", umbw_encode_describe_request(&request, &b, NULL), &b);
    static const char *const encodings[] = {"identity", "gzip"};
    const struct umbw_limits limits = {.client = {.max_points = 1001,
                                                  .max_message_bytes = (uint64_t)1002 << 32,
                                                  .max_targets = 1003,
                                                  .max_taps = 1004,
                                                  .version = "1.2.3-fake",
                                                  .max_segments = 1010,
                                                  .max_columns = 1011,
                                                  .max_boxes = 1012,
                                                  .max_box_steps = (uint64_t)1013 << 32},
                                       .max_streams = 1005,
                                       .queue = 1006,
                                       .encodings = encodings,
                                       .encoding_count = 2,
                                       .max_bundle_bytes = 1007,
                                       .max_bundle_files = 1008,
                                       .max_owner_jobs = 1009};
    expect("limits", umbw_encode_limits_reply(&limits, &b, NULL), &b);
    const int serving = 2;
    expect("health", umbw_encode_health_reply(&serving, &b, NULL), &b);
    expect("check", umbw_encode_health_request("umbrage.v1.Shadows", &b, NULL), &b);
    expect("empty", umbw_encode_empty(&b, NULL), &b);
}

static void jobs_keep_their_bytes(void **state)
{
    (void)state;
    struct umbw_buffer b = {0};
    struct umbw_bundle_file files[2] = {{.path = "a/b.gltf", .size = 1ULL << 40, .sha256 = {1, 2}},
                                        {.path = "", .size = 0}};
    struct umb_job_setting settings[2] = {{"resolution", "64"}, {"sun", ""}};
    struct umbw_submit_request submit = {.has_manifest = 1,
                                         .manifest = {.scene = "a/b.gltf",
                                                      .files = files,
                                                      .file_count = 2,
                                                      .settings = settings,
                                                      .setting_count = 2,
                                                      .priority = -10}};
    expect("manifest", umbw_encode_submit_request(&submit, &b, NULL), &b);
    submit = (struct umbw_submit_request){.data = (const uint8_t *)"\1\2\3", .data_size = 3};
    expect("data", umbw_encode_submit_request(&submit, &b, NULL), &b);
    const struct umb_job_submitted submitted = {.job = "0123", .existing = 1};
    expect("submitted", umbw_encode_submit_reply(&submitted, &b, NULL), &b);
    struct umb_job_status jobs[2] = {{.job = "0123",
                                      .owner = "me",
                                      .cause = "c\xc3\xa9",
                                      .phase = "bake",
                                      .unit = "texel",
                                      .state = UMB_JOB_POISON,
                                      .failure = UMB_JOB_CANCELLED,
                                      .priority = -3,
                                      .has_asset = 1,
                                      .asset = {7},
                                      .epoch = 4,
                                      .bundle_bytes = 5,
                                      .done = 6,
                                      .total = 1ULL << 50,
                                      .submitted_ms = 8,
                                      .started_ms = 9,
                                      .ended_ms = 10,
                                      .not_before_ms = 11,
                                      .left_ms = -1,
                                      .rate = 0.5,
                                      .tiles_done = 12,
                                      .tiles_total = 13,
                                      .tiles_found = 14,
                                      .plan = "p\n",
                                      .notices = "n\n"},
                                     {.left_ms = -1}};
    const struct umbw_job_list list = {.jobs = jobs, .count = 2};
    expect("status", umbw_encode_job_status(&jobs[0], &b, NULL), &b);
    expect("status few", umbw_encode_job_status(&jobs[1], &b, NULL), &b);
    expect("jobs", umbw_encode_job_list(&list, &b, NULL), &b);
    const uint32_t limit = 500;
    expect("list jobs", umbw_encode_list_jobs_request(&limit, &b, NULL), &b);
    expect("watch", umbw_encode_job_request("0123", &b, NULL), &b);
    expect("delete", umbw_encode_delete_request("4567", &b, NULL), &b);
    const struct umbw_fetch_request fetch = {.asset = "4567", .offset = 1ULL << 33};
    expect("fetch", umbw_encode_fetch_request(&fetch, &b, NULL), &b);
    const struct umbw_fetch_reply piece = {
        .size = 1ULL << 34, .offset = 5, .data = (const uint8_t *)"\4\5", .data_size = 2};
    expect("piece", umbw_encode_fetch_reply(&piece, &b, NULL), &b);
}

static void regions_keep_their_bytes(void **state)
{
    (void)state;
    struct umbw_buffer b = {0};
    const struct umbw_region_request region = {
        .asset = "city", .count = 2, .ranges = {{0, 32768}, {1ULL << 40, 5}}};
    expect("region", umbw_encode_region_request(&region, &b, NULL), &b);
    const struct umbw_region_reply reply = {
        .asset_id = {7}, .file_bytes = UINT64_MAX, .data = (const uint8_t *)"\6\7", .data_size = 2};
    expect("range", umbw_encode_region_reply(&reply, &b, NULL), &b);
    const struct umbw_version_request version = {.asset = "city"};
    expect("version", umbw_encode_version_request(&version, &b, NULL), &b);
    struct umbw_derive_request derive = {
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
    expect("derive", umbw_encode_derive_request(&derive, &b, NULL), &b);
    derive = (struct umbw_derive_request){
        .asset = "city",
        .settings.cascades = {.count = 8, .weight = 0.75, .fit = UMB_CASCADE_LISPSM},
        .view = {.eye = {1, 2, 3},
                 .right = {1, 0, 0},
                 .up = {0, 1, 0},
                 .forward = {0, 0, 1},
                 .tan_x = 0.5,
                 .tan_y = 0.25,
                 .near_m = 1,
                 .far_m = 2}};
    expect("derive view", umbw_encode_derive_request(&derive, &b, NULL), &b);
}

static void samples_keep_their_bytes(void **state)
{
    (void)state;
    struct umbw_buffer b = {0};
    struct umbw_sample_request request = {.asset = "city", .settings.count = 1};
    expect("sample few", umbw_encode_sample_request(&request, &b, NULL), &b);
    request.settings = (struct umb_sample_settings){
        .light = 300, .count = 65536, .seed = UINT64_MAX, .scattered = 0.25};
    expect("sample", umbw_encode_sample_request(&request, &b, NULL), &b);
    struct umbw_sample_reply reply = {.sample.asset_id = {7, 8}};
    expect("sampled none", umbw_encode_sample_reply(&reply, &b, NULL), &b);
    reply.sample.count = 1;
    reply.sample.origin[1] = -2.5;
    (void)snprintf(reply.sample.note, sizeof reply.sample.note, "1 of 2");
    reply.points = (const uint8_t *)wide_points;
    expect("sampled", umbw_encode_sample_reply(&reply, &b, NULL), &b);
}

static void volume_queries_keep_their_bytes(void **state)
{
    (void)state;
    static const uint8_t answers[64] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
    static const double records[6] = {1, 2, 3, 4, 5, 6};
    for (int q = 0; q < UMBW_VOLUME_QUERY_COUNT; q++) {
        struct umbw_buffer b = {0};
        char name[48];
        struct umbw_volume_query_request request = {.volume_query = (enum umbw_volume_query)q,
                                                    .asset = "city",
                                                    .light = 300,
                                                    .records = records,
                                                    .format = UMB_POINT_F64,
                                                    .origin = {1e6, 0, -5},
                                                    .count = 1,
                                                    .max_intervals = q == UMBW_SEGMENTS ? 70 : 0,
                                                    .want_stats = 1};
        struct umbw_volume_query_reply reply = {
            .volume_query = (enum umbw_volume_query)q,
            .asset_id = {9, 8, 7},
            .ignores_translucent = 1,
            .has_stats = 1,
            .nodes = 1U << 20,
            .bricks = 5,
            .nanoseconds = UINT64_MAX,
            .count = 1,
            .interval_count = q == UMBW_SEGMENTS ? 2 : 0,
            .fields = {answers, answers + 1, answers + 2, answers + 3}};
        (void)snprintf(name, sizeof name, "volume %d", q);
        expect(name, umbw_encode_volume_query_request(&request, &b, NULL), &b);
        request.format = UMB_POINT_F32;
        request.origin[0] = request.origin[2] = 0;
        (void)snprintf(name, sizeof name, "volume few %d", q);
        expect(name, umbw_encode_volume_query_request(&request, &b, NULL), &b);
        (void)snprintf(name, sizeof name, "volume reply %d", q);
        expect(name, umbw_encode_volume_query_reply(&reply, &b, NULL), &b);
        reply.nodes = reply.bricks = reply.nanoseconds = 0;
        (void)snprintf(name, sizeof name, "volume reply no counts %d", q);
        expect(name, umbw_encode_volume_query_reply(&reply, &b, NULL), &b);
    }
}

/* Checks answers without a descriptor, since descriptors change with the .proto files. */
static void reflection_keeps_its_bytes(void **state)
{
    (void)state;
    static const char *const requests[] = {"\x0a\x01h\x1a\x01x", "\x22\x01y",
                                           "\x2a\x02\x10\x05",   "\x32\x12umbrage.v1.Picture",
                                           "\x3a\x00",           "\x0a\x01h"};
    static const size_t sizes[] = {6, 3, 4, 20, 2, 3};
    for (size_t i = 0; i < 6; i++) {
        struct umbw_buffer b = {0};
        char name[48];
        (void)snprintf(name, sizeof name, "reflection %zu", i);
        expect(name, umbw_reflection_answer((const uint8_t *)requests[i], sizes[i], &b, NULL), &b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(queries_keep_their_bytes),
        cmocka_unit_test(replies_keep_their_bytes),
        cmocka_unit_test(assets_keep_their_bytes),
        cmocka_unit_test(jobs_keep_their_bytes),
        cmocka_unit_test(regions_keep_their_bytes),
        cmocka_unit_test(samples_keep_their_bytes),
        cmocka_unit_test(volume_queries_keep_their_bytes),
        cmocka_unit_test(reflection_keeps_its_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
