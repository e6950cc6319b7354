/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage.v1.DescribeRequest and DescribeReply. */
#include "wire/asset_codec.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "base/utf8.h"

enum umb_status umbw_decode_describe_request(const uint8_t *message, size_t size,
                                             char asset[UMBW_ASSET_NAME_MAX + 1], int *want_curves,
                                             struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "want_curves"},
    };
    struct umbw_field_found found[2];
    asset[0] = '\0';
    *want_curves = 0;
    UMB__TRY(umbw_proto_scan(message, size, fields, 2, found, NULL, error));
    *want_curves = found[1].number != 0;
    return umbw_asset_copy(found[0].bytes, found[0].size, asset, error);
}

enum umb_status umbw_encode_describe_request(const char *asset, int want_curves,
                                             struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__DescribeRequest message = UMBRAGE__V1__DESCRIBE_REQUEST__INIT;
    char copy[UMBW_ASSET_NAME_MAX + 1];
    UMB__TRY(umbw_asset_copy((const uint8_t *)asset, strlen(asset), copy, error));
    message.asset = copy;
    message.want_curves = want_curves != 0;
    return umbw_message_append(&message.base, buffer, error);
}

void umbw_describe_reply_finish(struct umbw_describe_reply *reply)
{
    free(reply->lights);
    free(reply->plan);
    free(reply->settings);
    memset(reply, 0, sizeof *reply);
}

static enum umb_status take_curve(const Umbrage__V1__Light *message, struct umbw_curve *curve,
                                  struct umb_error *error)
{
    if (message->n_curve > UMB_CURVE_ROWS_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "lights.curve: %zu rows are over the limit of %d",
                        message->n_curve, UMB_CURVE_ROWS_MAX);
    }
    curve->count = message->n_curve;
    for (size_t i = 0; i < curve->count; i++) {
        const Umbrage__V1__CurveRow *row = message->curve[i];
        curve->rows[i] = (struct umb_curve_row){
            .level = row->level,
            .taps = row->taps,
            .bound_m = row->bound_m,
            .visibility_error = row->visibility_error,
            .nodes = row->nodes,
            .lines = row->lines,
        };
        curve->scattered_ns[i] = row->scattered_ns;
        curve->coherent_ns[i] = row->coherent_ns;
    }
    return UMB_OK;
}

static enum umb_status take_light(const Umbrage__V1__Light *message, struct umbw_light *light,
                                  struct umb_error *error)
{
    enum umb_status status =
        umbw_text_copy("lights.name", (const uint8_t *)message->name, strlen(message->name),
                       UMB_NAME_SIZE - 1, light->info.name, error);
    int kind = (int)message->kind;
    if (status == UMB_OK && (kind < UMB_LIGHT_DIRECTIONAL || kind > UMB_LIGHT_POINT)) {
        status = umb_fail(error, UMB_E_ARGUMENT, "lights.kind: %d is unknown", kind);
    }
    if (status == UMB_OK) {
        status = umbw_vector_copy("lights.direction", message->direction, message->n_direction,
                                  light->info.direction, error);
    }
    if (status == UMB_OK) {
        status = umbw_vector_copy("lights.position", message->position, message->n_position,
                                  light->info.position, error);
    }
    if (status == UMB_OK) {
        status = umbw_vector_copy("lights.voxel_m", message->voxel_m, message->n_voxel_m,
                                  light->voxel_m, error);
    }
    if (status == UMB_OK) {
        light->info.kind = (enum umb_light_kind)kind; /* The wire has the same numbers */
        light->info.extent = message->extent;
        light->resolution = message->resolution;
        light->closed = message->closed != 0;
        status = take_curve(message, &light->curve, error);
    }
    return status;
}

static enum umb_status take_lights(const Umbrage__V1__DescribeReply *message,
                                   struct umbw_describe_reply *reply, struct umb_error *error)
{
    if (message->n_lights == 0) {
        return UMB_OK;
    }
    reply->lights = calloc(message->n_lights, sizeof *reply->lights);
    if (reply->lights == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu lights", message->n_lights);
    }
    reply->light_count = (uint32_t)message->n_lights; /* limited before unpacking */
    for (size_t i = 0; i < message->n_lights; i++) {
        UMB__TRY(take_light(message->lights[i], &reply->lights[i], error));
    }
    return UMB_OK;
}

static enum umb_status take_text(const char *name, const char *text, char **out,
                                 struct umb_error *error)
{
    if (!umb__utf8_valid((const uint8_t *)text, strlen(text))) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: not UTF-8 text", name);
    }
    *out = strdup(text);
    return *out != NULL ? UMB_OK : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %s", name);
}

static enum umb_status take_reply(const Umbrage__V1__DescribeReply *message,
                                  struct umbw_describe_reply *reply, struct umb_error *error)
{
    enum umb_status status = umbw_summary_take(message->summary, &reply->summary, error);
    if (status == UMB_OK) {
        status = take_lights(message, reply, error);
    }
    if (status == UMB_OK) {
        status =
            umbw_vector_copy("origin", message->origin, message->n_origin, reply->origin, error);
    }
    if (status == UMB_OK) {
        status = umbw_vector_copy("bounds_min", message->bounds_min, message->n_bounds_min,
                                  reply->bounds.min, error);
    }
    if (status == UMB_OK) {
        status = umbw_vector_copy("bounds_max", message->bounds_max, message->n_bounds_max,
                                  reply->bounds.max, error);
    }
    if (status == UMB_OK) {
        status = umbw_id_copy("scene_hash", message->scene_hash.data, message->scene_hash.len,
                              reply->scene_hash, error);
    }
    if (status == UMB_OK) {
        status = take_text("plan", message->plan, &reply->plan, error);
    }
    if (status == UMB_OK) {
        status = take_text("settings", message->settings, &reply->settings, error);
    }
    return status;
}

enum umb_status umbw_decode_describe_reply(const uint8_t *message, size_t size,
                                           struct umbw_describe_reply *reply,
                                           struct umb_error *error)
{
    static const struct umbw_field field = {2, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "lights"};
    struct umbw_field_found found;
    memset(reply, 0, sizeof *reply);
    enum umb_status status = umbw_proto_scan(message, size, &field, 1, &found, NULL, error);
    if (status == UMB_OK && found.count > UMB_LIGHTS_MAX) {
        status = umb_fail(error, UMB_E_TOO_LARGE, "lights: %zu is over the limit of %d",
                          found.count, UMB_LIGHTS_MAX);
    }
    ProtobufCMessage *whole = NULL;
    if (status == UMB_OK) {
        status = umbw_message_unpack(&umbrage__v1__describe_reply__descriptor, message, size,
                                     &whole, error);
    }
    if (status == UMB_OK) {
        status = take_reply((const Umbrage__V1__DescribeReply *)whole, reply, error);
        umbw_message_free(whole);
        if (status != UMB_OK) {
            umbw_describe_reply_finish(reply);
        }
    }
    return status;
}

/* One light, with the storage that its message points to. */
struct light_parts {
    struct umbw_light light; /* protobuf-c has no const arrays */
    Umbrage__V1__Light message;
    Umbrage__V1__CurveRow rows[UMB_CURVE_ROWS_MAX];
    Umbrage__V1__CurveRow *row_pointers[UMB_CURVE_ROWS_MAX];
};

static void put_curve(struct light_parts *parts)
{
    const struct umbw_curve *curve = &parts->light.curve;
    for (size_t i = 0; i < curve->count && i < UMB_CURVE_ROWS_MAX; i++) {
        Umbrage__V1__CurveRow *row = &parts->rows[i];
        umbrage__v1__curve_row__init(row);
        row->level = curve->rows[i].level;
        row->taps = curve->rows[i].taps;
        row->bound_m = curve->rows[i].bound_m;
        row->visibility_error = curve->rows[i].visibility_error;
        row->nodes = curve->rows[i].nodes;
        row->lines = curve->rows[i].lines;
        row->scattered_ns = curve->scattered_ns[i];
        row->coherent_ns = curve->coherent_ns[i];
        parts->row_pointers[i] = row;
        parts->message.n_curve = i + 1;
    }
    parts->message.curve = parts->row_pointers;
}

static void put_light(struct light_parts *parts)
{
    struct umbw_light *light = &parts->light;
    Umbrage__V1__Light *message = &parts->message;
    umbrage__v1__light__init(message);
    light->info.name[UMB_NAME_SIZE - 1] = '\0';
    message->name = light->info.name;
    message->kind = (Umbrage__V1__LightKind)light->info.kind;
    message->direction = light->info.direction;
    message->n_direction = 3;
    message->position = light->info.position;
    message->n_position = 3;
    message->extent = light->info.extent;
    message->resolution = light->resolution;
    message->voxel_m = light->voxel_m;
    message->n_voxel_m = 3;
    message->closed = light->closed != 0;
    put_curve(parts);
}

/* The whole reply; lights and pointers: [light_count]. */
static enum umb_status append_reply(struct umbw_describe_reply copy, struct light_parts *lights,
                                    Umbrage__V1__Light **pointers, struct umbw_buffer *buffer,
                                    struct umb_error *error)
{
    Umbrage__V1__DescribeReply message = UMBRAGE__V1__DESCRIBE_REPLY__INIT;
    Umbrage__V1__AssetSummary summary;
    for (uint32_t i = 0; i < copy.light_count; i++) {
        lights[i].light = copy.lights[i];
        put_light(&lights[i]);
        pointers[i] = &lights[i].message;
    }
    umbw_summary_put(&copy.summary, &summary);
    message.summary = &summary;
    message.lights = pointers;
    message.n_lights = copy.light_count;
    message.origin = copy.origin;
    message.n_origin = 3;
    message.bounds_min = copy.bounds.min;
    message.n_bounds_min = 3;
    message.bounds_max = copy.bounds.max;
    message.n_bounds_max = 3;
    if (copy.plan != NULL) {
        message.plan = copy.plan;
    }
    if (copy.settings != NULL) {
        message.settings = copy.settings;
    }
    message.scene_hash.data = copy.scene_hash;
    message.scene_hash.len = sizeof copy.scene_hash;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_encode_describe_reply(const struct umbw_describe_reply *reply,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    if (reply->light_count > UMB_LIGHTS_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "lights: %lu is over the limit of %d",
                        (unsigned long)reply->light_count, UMB_LIGHTS_MAX);
    }
    size_t count = (size_t)reply->light_count + 1;
    struct light_parts *lights = calloc(count, sizeof *lights);
    Umbrage__V1__Light **pointers = calloc(count, sizeof *pointers);
    enum umb_status status = lights != NULL && pointers != NULL
                                 ? append_reply(*reply, lights, pointers, buffer, error)
                                 : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %lu lights",
                                            (unsigned long)reply->light_count);
    free(pointers);
    free(lights);
    return status;
}
