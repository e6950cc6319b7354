/* SPDX-License-Identifier: Apache-2.0 */
/* Describe, List, Limits and Sample of umbrage.v1.Shadows, and the health service. */
#include "grpc/health/v1/health.pb-c.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"

UMBW_TABLE(ASSET, umbrage__v1__asset_summary, "summary.", sizeof(struct umb_client_asset),
           {1, UMBW_AT(umb_client_asset, name)},
           {2, UMBW_AT(umb_client_asset, id), .flags = UMBW_REQUIRED},
           {3, UMBW_AT(umb_client_asset, packed_bytes)},
           {4, UMBW_AT(umb_client_asset, memory_bytes)},
           {5, UMBW_AT(umb_client_asset, light_count)});

UMBW_TABLE(LIST, umbrage__v1__list_reply, "", sizeof(struct umbw_list_reply),
           {1, UMBW_AT(umbw_list_reply, assets), UMBW_COUNT(umbw_list_reply, count),
            .flags = UMBW_FILLED, .table = &ASSET, .most = UMBW_LIST_MAX});
UMBW_CODEC(list_reply, struct umbw_list_reply, LIST)

#define LIGHT(member) UMBW_AT(umb_client_light, member)
#define ROW_STRIDE    .stride = sizeof(struct umb_curve_row)

/* Row k of a light's curve: element k of three arrays of the light. */
UMBW_TABLE(CURVE_ROW, umbrage__v1__curve_row, "lights.curve.", 0,
           {1, LIGHT(curve[0].level), ROW_STRIDE}, {2, LIGHT(curve[0].taps), ROW_STRIDE},
           {3, LIGHT(curve[0].bound_m), ROW_STRIDE},
           {4, LIGHT(curve[0].visibility_error), ROW_STRIDE},
           {5, LIGHT(curve[0].nodes), ROW_STRIDE}, {6, LIGHT(curve[0].lines), ROW_STRIDE},
           {7, LIGHT(scattered_ns[0]), .stride = sizeof(double)},
           {8, LIGHT(coherent_ns[0]), .stride = sizeof(double)});

UMBW_TABLE(LIGHT_TABLE, umbrage__v1__light, "lights.", sizeof(struct umb_client_light),
           {1, LIGHT(info.name)}, {2, LIGHT(info.kind), .flags = UMBW_CHECKED},
           {3, LIGHT(info.direction)}, {4, LIGHT(info.position)}, {5, LIGHT(info.extent)},
           {6, LIGHT(resolution)}, {7, LIGHT(voxel_m)}, {8, LIGHT(closed)},
           {9, UMBW_COUNT(umb_client_light, curve_count), .table = &CURVE_ROW,
            .most = UMB_CURVE_ROWS_MAX},
           {10, LIGHT(info.side), .flags = UMBW_SPARSE});

#define DESCRIPTION(member) UMBW_AT(umb_client_description, member)

UMBW_TABLE(DESCRIPTION_TABLE, umbrage__v1__describe_reply, "",
           sizeof(struct umb_client_description),
           {1, DESCRIPTION(asset), .flags = UMBW_REQUIRED, .table = &ASSET},
           {2, DESCRIPTION(lights), UMBW_COUNT(umb_client_description, light_count),
            .table = &LIGHT_TABLE, .most = UMB_LIGHTS_MAX},
           {3, DESCRIPTION(origin)}, {4, DESCRIPTION(bounds.min)}, {5, DESCRIPTION(bounds.max)},
           {6, DESCRIPTION(plan), .flags = UMBW_FILLED},
           {7, DESCRIPTION(settings), .flags = UMBW_FILLED},
           {8, DESCRIPTION(scene_hash), .flags = UMBW_REQUIRED});
UMBW_ENCODER(describe_reply, struct umb_client_description, DESCRIPTION_TABLE)

enum umb_status umbw_decode_describe_reply(const uint8_t *message, size_t size,
                                           struct umb_client_description **out,
                                           struct umb_error *error)
{
    void *made;
    const enum umb_status status = umbw_decode_new(&DESCRIPTION_TABLE, message, size, &made, error);
    *out = made;
    return status;
}

UMBW_TABLE(DESCRIBE, umbrage__v1__describe_request, "", sizeof(struct umbw_describe_request),
           {1, UMBW_AT(umbw_describe_request, asset), .flags = UMBW_REQUIRED | UMBW_CHECKED},
           {2, UMBW_AT(umbw_describe_request, want_curves)});
UMBW_CODEC(describe_request, struct umbw_describe_request, DESCRIBE)

#define LIMITS(member) UMBW_AT(umbw_limits, member)

UMBW_TABLE(LIMITS_TABLE, umbrage__v1__limits_reply, "", sizeof(struct umbw_limits),
           {1, LIMITS(client.max_points)}, {2, LIMITS(client.max_message_bytes)},
           {3, LIMITS(client.max_targets)}, {4, LIMITS(client.max_taps)}, {5, LIMITS(max_streams)},
           {6, LIMITS(queue)},
           {7, LIMITS(encodings), UMBW_COUNT(umbw_limits, encoding_count), .flags = UMBW_SENT},
           {8, LIMITS(client.version)}, {9, LIMITS(max_bundle_bytes)},
           {10, LIMITS(max_bundle_files)}, {11, LIMITS(max_owner_jobs)},
           {12, LIMITS(client.max_segments)}, {13, LIMITS(client.max_columns)},
           {14, LIMITS(client.max_boxes)}, {15, LIMITS(client.max_box_steps)});
UMBW_CODEC(limits_reply, struct umbw_limits, LIMITS_TABLE)

#define SAMPLE(member) UMBW_AT(umbw_sample_request, member)

UMBW_TABLE(SAMPLE_REQUEST, umbrage__v1__sample_request, "", sizeof(struct umbw_sample_request),
           {1, SAMPLE(asset), .flags = UMBW_REQUIRED | UMBW_CHECKED}, {2, SAMPLE(settings.light)},
           {3, SAMPLE(settings.count), .flags = UMBW_REQUIRED, .most = UMB_SAMPLE_MAX},
           {4, SAMPLE(settings.seed)}, {5, SAMPLE(settings.scattered), .most = 1});
UMBW_CODEC(sample_request, struct umbw_sample_request, SAMPLE_REQUEST)

UMBW_TABLE(SAMPLE_REPLY, umbrage__v1__sample_reply, "", sizeof(struct umbw_sample_reply),
           {1, UMBW_AT(umbw_sample_reply, sample.asset_id), .flags = UMBW_REQUIRED},
           {2, UMBW_AT(umbw_sample_reply, sample.origin), .flags = UMBW_FINITE | UMBW_SPARSE},
           {3, UMBW_AT(umbw_sample_reply, points), UMBW_COUNT(umbw_sample_reply, sample.count),
            .stride = UMBW_SAMPLE_POINT_BYTES},
           {4, UMBW_AT(umbw_sample_reply, sample.note)});
UMBW_CODEC(sample_reply, struct umbw_sample_reply, SAMPLE_REPLY)

UMBW_TABLE(SERVICE, grpc__health__v1__health_check_request, "", 256,
           {1, .size = 256, .flags = UMBW_CHECKED});
UMBW_CODEC(health_request, char, SERVICE)

UMBW_TABLE(SERVING, grpc__health__v1__health_check_response, "", sizeof(int),
           {1, .size = sizeof(int)});
UMBW_CODEC(health_reply, int, SERVING)

enum umb_status umbw_encode_empty(struct umbw_buffer *buffer, struct umb_error *error)
{
    return umbw_buffer_begin_message(buffer, 0, 0, error);
}
