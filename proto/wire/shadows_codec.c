/* SPDX-License-Identifier: Apache-2.0 */
/* Describe, List, Limits and Sample of umbrage.v1.Shadows, and the health service. */
#include "base/try.h"
#include "grpc/health/v1/health.pb-c.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"

static const struct umbw_row ASSET_ROWS[] = {
    {1, UMBW_AT(umb_client_asset, name)},
    {2, UMBW_AT(umb_client_asset, id), .flags = UMBW_REQUIRED},
    {3, UMBW_AT(umb_client_asset, packed_bytes)},
    {4, UMBW_AT(umb_client_asset, memory_bytes)},
    {5, UMBW_AT(umb_client_asset, light_count)},
};
UMBW_TABLE(ASSET, umbrage__v1__asset_summary, ASSET_ROWS, "summary.",
           sizeof(struct umb_client_asset));

static const struct umbw_row LIST_ROWS[] = {
    {1, UMBW_AT(umbw_list_reply, assets), UMBW_COUNT(umbw_list_reply, count), .table = &ASSET,
     .most = UMBW_LIST_MAX},
};
UMBW_CODEC(list_reply, struct umbw_list_reply, LIST, umbrage__v1__list_reply, LIST_ROWS,
           sizeof(struct umbw_list_reply), UMBW_BLOCK(umbw_list_reply, assets))

#define LIGHT(member) UMBW_AT(umb_client_light, member)
#define ROW_STRIDE    .stride = sizeof(struct umb_curve_row)

/* Row k of a light's curve: element k of three arrays of the light. */
static const struct umbw_row CURVE_ROWS[] = {
    {1, LIGHT(curve[0].level), ROW_STRIDE},
    {2, LIGHT(curve[0].taps), ROW_STRIDE},
    {3, LIGHT(curve[0].bound_m), ROW_STRIDE},
    {4, LIGHT(curve[0].visibility_error), ROW_STRIDE},
    {5, LIGHT(curve[0].nodes), ROW_STRIDE},
    {6, LIGHT(curve[0].lines), ROW_STRIDE},
    {7, LIGHT(scattered_ns[0]), .stride = sizeof(double)},
    {8, LIGHT(coherent_ns[0]), .stride = sizeof(double)},
};
UMBW_TABLE(CURVE_ROW, umbrage__v1__curve_row, CURVE_ROWS, "lights.curve.", 0);

static const struct umbw_row LIGHT_ROWS[] = {
    {1, LIGHT(info.name)},
    {2, LIGHT(info.kind), .flags = UMBW_CHECKED},
    {3, LIGHT(info.direction)},
    {4, LIGHT(info.position)},
    {5, LIGHT(info.extent)},
    {6, LIGHT(resolution)},
    {7, LIGHT(voxel_m)},
    {8, LIGHT(closed)},
    {9, UMBW_COUNT(umb_client_light, curve_count), .table = &CURVE_ROW, .most = UMB_CURVE_ROWS_MAX},
    {10, LIGHT(info.side), .flags = UMBW_SPARSE},
};
UMBW_TABLE(LIGHT_TABLE, umbrage__v1__light, LIGHT_ROWS, "lights.", sizeof(struct umb_client_light));

#define DESCRIPTION(member) UMBW_AT(umb_client_description, member)

static const struct umbw_row DESCRIPTION_ROWS[] = {
    {1, DESCRIPTION(asset), .flags = UMBW_REQUIRED, .table = &ASSET},
    {2, DESCRIPTION(lights), UMBW_COUNT(umb_client_description, light_count), .table = &LIGHT_TABLE,
     .most = UMB_LIGHTS_MAX},
    {3, DESCRIPTION(origin)},
    {4, DESCRIPTION(bounds.min)},
    {5, DESCRIPTION(bounds.max)},
    {6, DESCRIPTION(plan), .flags = UMBW_FILLED},
    {7, DESCRIPTION(settings), .flags = UMBW_FILLED},
    {8, DESCRIPTION(scene_hash), .flags = UMBW_REQUIRED},
};
UMBW_TABLE(DESCRIPTION_TABLE, umbrage__v1__describe_reply, DESCRIPTION_ROWS, "",
           sizeof(struct umb_client_description));

enum umb_status umbw_decode_describe_reply(const uint8_t *message, size_t size,
                                           struct umb_client_description **out,
                                           struct umb_error *error)
{
    void *made;
    const enum umb_status status = umbw_decode_new(&DESCRIPTION_TABLE, message, size, &made, error);
    *out = made;
    return status;
}

enum umb_status umbw_encode_describe_reply(const struct umb_client_description *in,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    return umbw_encode(&DESCRIPTION_TABLE, in, buffer, error);
}

static const struct umbw_row DESCRIBE_ROWS[] = {
    {1, UMBW_AT(umbw_describe_request, asset), .flags = UMBW_REQUIRED | UMBW_CHECKED},
    {2, UMBW_AT(umbw_describe_request, want_curves)},
};
UMBW_CODEC(describe_request, struct umbw_describe_request, DESCRIBE, umbrage__v1__describe_request,
           DESCRIBE_ROWS, sizeof(struct umbw_describe_request))

static const struct umbw_row LIMITS_ROWS[] = {
    {1, UMBW_AT(umbw_limits, client.max_points)},
    {2, UMBW_AT(umbw_limits, client.max_message_bytes)},
    {3, UMBW_AT(umbw_limits, client.max_targets)},
    {4, UMBW_AT(umbw_limits, client.max_taps)},
    {5, UMBW_AT(umbw_limits, max_streams)},
    {6, UMBW_AT(umbw_limits, queue)},
    {7, UMBW_AT(umbw_limits, encodings), UMBW_COUNT(umbw_limits, encoding_count),
     .flags = UMBW_SENT},
    {8, UMBW_AT(umbw_limits, client.version)},
    {9, UMBW_AT(umbw_limits, max_bundle_bytes)},
    {10, UMBW_AT(umbw_limits, max_bundle_files)},
    {11, UMBW_AT(umbw_limits, max_owner_jobs)},
    {12, UMBW_AT(umbw_limits, client.max_segments)},
    {13, UMBW_AT(umbw_limits, client.max_columns)},
    {14, UMBW_AT(umbw_limits, client.max_boxes)},
    {15, UMBW_AT(umbw_limits, client.max_box_steps)},
};
UMBW_CODEC(limits_reply, struct umbw_limits, LIMITS, umbrage__v1__limits_reply, LIMITS_ROWS,
           sizeof(struct umbw_limits))

static const struct umbw_row SAMPLE_REQUEST_ROWS[] = {
    {1, UMBW_AT(umbw_sample_request, asset), .flags = UMBW_REQUIRED | UMBW_CHECKED},
    {2, UMBW_AT(umbw_sample_request, settings.light)},
    {3, UMBW_AT(umbw_sample_request, settings.count)},
    {4, UMBW_AT(umbw_sample_request, settings.seed)},
    {5, UMBW_AT(umbw_sample_request, settings.scattered), .most = 1},
};
UMBW_TABLE(SAMPLE_REQUEST, umbrage__v1__sample_request, SAMPLE_REQUEST_ROWS, "",
           sizeof(struct umbw_sample_request));

static enum umb_status check_sample(const struct umbw_sample_request *request,
                                    struct umb_error *error)
{
    const uint32_t count = request->settings.count;
    return count >= 1 && count <= UMB_SAMPLE_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "count: %u, must be 1 to %u", count,
                          UMB_SAMPLE_MAX);
}

enum umb_status umbw_decode_sample_request(const uint8_t *message, size_t size,
                                           struct umbw_sample_request *out, struct umb_error *error)
{
    UMB__TRY(umbw_decode(&SAMPLE_REQUEST, message, size, out, error));
    return check_sample(out, error);
}

enum umb_status umbw_encode_sample_request(const struct umbw_sample_request *in,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    UMB__TRY(check_sample(in, error));
    return umbw_encode(&SAMPLE_REQUEST, in, buffer, error);
}

static const struct umbw_row SAMPLE_REPLY_ROWS[] = {
    {1, UMBW_AT(umbw_sample_reply, sample.asset_id), .flags = UMBW_REQUIRED},
    {2, UMBW_AT(umbw_sample_reply, sample.origin), .flags = UMBW_FINITE | UMBW_SPARSE},
    {3, UMBW_AT(umbw_sample_reply, points.at), UMBW_COUNT(umbw_sample_reply, points.size)},
    {4, UMBW_AT(umbw_sample_reply, sample.note)},
};
UMBW_TABLE(SAMPLE_REPLY, umbrage__v1__sample_reply, SAMPLE_REPLY_ROWS, "",
           sizeof(struct umbw_sample_reply));

enum umb_status umbw_decode_sample_reply(const uint8_t *message, size_t size,
                                         struct umbw_sample_reply *out, struct umb_error *error)
{
    UMB__TRY(umbw_decode(&SAMPLE_REPLY, message, size, out, error));
    out->sample.count = out->points.size / UMBW_SAMPLE_POINT_BYTES;
    return out->points.size % UMBW_SAMPLE_POINT_BYTES == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "points_f64: length is %zu bytes, must be a multiple of %zu",
                          out->points.size, UMBW_SAMPLE_POINT_BYTES);
}

enum umb_status umbw_encode_sample_reply(const struct umbw_sample_reply *in,
                                         struct umbw_buffer *buffer, struct umb_error *error)
{
    struct umbw_sample_reply copy = *in;
    copy.points.size = in->sample.count * UMBW_SAMPLE_POINT_BYTES;
    return umbw_encode(&SAMPLE_REPLY, &copy, buffer, error);
}

static const struct umbw_row SERVICE_ROWS[] = {{1, .size = 256, .flags = UMBW_CHECKED}};
UMBW_CODEC(health_request, char, SERVICE, grpc__health__v1__health_check_request, SERVICE_ROWS, 256)

static const struct umbw_row SERVING_ROWS[] = {{1, .size = sizeof(int)}};
UMBW_CODEC(health_reply, int, SERVING, grpc__health__v1__health_check_response, SERVING_ROWS,
           sizeof(int))

enum umb_status umbw_encode_empty(struct umbw_buffer *buffer, struct umb_error *error)
{
    return umbw_buffer_begin_message(buffer, 0, 0, error);
}
