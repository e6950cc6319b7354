/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage.v1.QueryRequest between its bytes and struct umbw_query_request.
 *
 * The points and normals stay where they are in the message; the few numbers are read by the scan
 * itself, without an allocation, since a frame loop asks many times for few points. Both directions
 * apply the same checks, so that a client says what is wrong before it sends, in the words the
 * server would use.
 */
#include "wire/messages.h"

#include <stdbool.h>
#include <string.h>
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"
#include "wire/picture_codec.h"
#include "wire/proto_scan.h"
#include "wire/query_check.h"
#include "base/compat.h"

enum request_field {
    FIELD_ASSET,
    FIELD_LIGHT,
    FIELD_TAPS,
    FIELD_BIAS_MODE,
    FIELD_BIAS,
    FIELD_FORMAT,
    FIELD_ORIGIN,
    FIELD_WANT_STATS,
    FIELD_TARGETS,
    FIELD_NORMALS,
    FIELD_POINTS,
    FIELD_POINTS_F64,
    FIELD_LEVEL,
    FIELD_MAX_ERROR,
    FIELD_MAX_VISIBILITY,
    FIELD_BUDGET,
    FIELD_FILTER,
    FIELD_LIGHT_EXTENT,
    FIELD_DEPTH,
    FIELD_PICTURE,
    FIELD_PACK,
    FIELD_BASE,
    FIELD_FOOTPRINTS,
    FIELD_FOOTPRINT,
    FIELD_EYE,
    FIELD_PIXEL,
    FIELD_OPAQUE_ONLY,
    FIELD_COUNT,
};

static const struct umbw_field REQUEST_FIELDS[FIELD_COUNT] = {
    [FIELD_ASSET] = {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset"},
    [FIELD_LIGHT] = {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "light"},
    [FIELD_TAPS] = {3, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "taps"},
    [FIELD_BIAS_MODE] = {4, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "bias_mode"},
    [FIELD_BIAS] = {5, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "bias"},
    [FIELD_FORMAT] = {6, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "format"},
    [FIELD_ORIGIN] = {7, UMBW_FIELD_PACKED, UMBW_WIRE_FIXED64, "origin"},
    [FIELD_WANT_STATS] = {8, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "want_stats"},
    [FIELD_TARGETS] = {9, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "targets"},
    [FIELD_NORMALS] = {11, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "normals"},
    [FIELD_POINTS] = {12, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "points"},
    [FIELD_POINTS_F64] = {13, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "points_f64"},
    [FIELD_LEVEL] = {20, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "level"},
    [FIELD_MAX_ERROR] = {21, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "max_error_m"},
    [FIELD_MAX_VISIBILITY] = {22, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "max_visibility"},
    [FIELD_BUDGET] = {23, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "budget_ns"},
    [FIELD_FILTER] = {30, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "filter"},
    [FIELD_LIGHT_EXTENT] = {31, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "light_extent"},
    [FIELD_DEPTH] = {14, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "depth"},
    [FIELD_PICTURE] = {24, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "picture"},
    [FIELD_PACK] = {25, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "pack"},
    [FIELD_BASE] = {26, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "base_mark"},
    [FIELD_FOOTPRINTS] = {32, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "footprints"},
    [FIELD_FOOTPRINT] = {33, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "footprint_m"},
    [FIELD_EYE] = {34, UMBW_FIELD_PACKED, UMBW_WIRE_FIXED64, "eye"},
    [FIELD_PIXEL] = {35, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "pixel_rad"},
    [FIELD_OPAQUE_ONLY] = {36, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "opaque_only"},
};

/* The two enums are numbered differently: on the wire 0 must be the usual answer (U8). */
struct format_pair {
    enum umb_answer_format ours;
    Umbrage__V1__AnswerFormat wire;
};

static const struct format_pair FORMATS[] = {
    {UMB_ANSWER_U8, UMBRAGE__V1__ANSWER_FORMAT__ANSWER_U8},
    {UMB_ANSWER_F32, UMBRAGE__V1__ANSWER_FORMAT__ANSWER_F32},
    {UMB_ANSWER_BIT, UMBRAGE__V1__ANSWER_FORMAT__ANSWER_BIT},
};

struct bias_pair {
    enum umb_bias_mode ours;
    Umbrage__V1__BiasMode wire;
};

static const struct bias_pair BIAS_MODES[] = {
    {UMB_BIAS_AUTO, UMBRAGE__V1__BIAS_MODE__BIAS_AUTO},
    {UMB_BIAS_VOXELS, UMBRAGE__V1__BIAS_MODE__BIAS_VOXELS},
    {UMB_BIAS_METRES, UMBRAGE__V1__BIAS_MODE__BIAS_METRES},
    {UMB_BIAS_NONE, UMBRAGE__V1__BIAS_MODE__BIAS_NONE},
};

static enum umb_status format_from_wire(int wire, enum umb_answer_format *format,
                                        struct umb_error *error)
{
    for (size_t i = 0; i < sizeof FORMATS / sizeof FORMATS[0]; i++) {
        if ((int)FORMATS[i].wire == wire) {
            *format = FORMATS[i].ours;
            return UMB_OK;
        }
    }
    return umb_fail(error, UMB_E_ARGUMENT, "format: %d is not one of 0 (U8), 1 (F32), 2 (BIT)",
                    wire);
}

static enum umb_status bias_mode_from_wire(int wire, enum umb_bias_mode *mode,
                                           struct umb_error *error)
{
    for (size_t i = 0; i < sizeof BIAS_MODES / sizeof BIAS_MODES[0]; i++) {
        if ((int)BIAS_MODES[i].wire == wire) {
            *mode = BIAS_MODES[i].ours;
            return UMB_OK;
        }
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "bias_mode: %d is not one of 0 (AUTO), 1 (VOXELS), 2 (METRES), 3 (NONE)", wire);
}

static double double_of(uint64_t bits)
{
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Numbers as protobuf has them: the last of a field counts, and no more bits than its type has. */
static enum umb_status take_settings(const struct umbw_field_found found[FIELD_COUNT],
                                     const uint8_t *message, size_t size,
                                     struct umbw_query_request *request, struct umb_error *error)
{
    struct umb_query_settings *settings = &request->settings;
    uint32_t taps = (uint32_t)found[FIELD_TAPS].number;
    settings->light = (uint32_t)found[FIELD_LIGHT].number;
    settings->level = (uint32_t)found[FIELD_LEVEL].number;
    settings->bias = double_of(found[FIELD_BIAS].number);
    request->dial.max_error_m = double_of(found[FIELD_MAX_ERROR].number);
    request->dial.max_visibility = double_of(found[FIELD_MAX_VISIBILITY].number);
    request->dial.budget_ns = double_of(found[FIELD_BUDGET].number);
    request->want_stats = found[FIELD_WANT_STATS].number != 0;
    enum umb_status status = umbw_query_check_dial(&request->dial, taps, settings->level, error);
    settings->taps = taps == 0 && !umbw_query_is_dialled(&request->dial) ? 1 : taps;
    if (status == UMB_OK && settings->taps != 0) {
        status = umbw_query_check_taps(settings->taps, error);
    }
    if (status == UMB_OK) {
        status = bias_mode_from_wire((int)(uint32_t)found[FIELD_BIAS_MODE].number,
                                     &settings->bias_mode, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_bias(settings->bias, error);
    }
    if (status == UMB_OK) {
        status =
            format_from_wire((int)(uint32_t)found[FIELD_FORMAT].number, &settings->format, error);
    }
    const int64_t filter = (int64_t)found[FIELD_FILTER].number;
    settings->light_extent = double_of(found[FIELD_LIGHT_EXTENT].number);
    if (status == UMB_OK) {
        status = umbw_query_check_filter(filter, settings->light_extent, error);
        settings->filter = status == UMB_OK ? (enum umb_filter)filter : UMB_FILTER_BOX;
    }
    settings->footprint_m = double_of(found[FIELD_FOOTPRINT].number);
    settings->pixel_rad = double_of(found[FIELD_PIXEL].number);
    settings->opaque_only = found[FIELD_OPAQUE_ONLY].number != 0;
    if (status == UMB_OK && found[FIELD_EYE].count > 0) {
        status = umbw_scan_vector(message, size, &REQUEST_FIELDS[FIELD_EYE], settings->eye, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_footprint(settings, found[FIELD_FOOTPRINTS].size > 0, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_eye(settings, found[FIELD_EYE].count > 0, error);
    }
    if (status == UMB_OK && found[FIELD_ORIGIN].count > 0) {
        status = umbw_scan_vector(message, size, &REQUEST_FIELDS[FIELD_ORIGIN],
                                  request->points.origin, error);
    }
    return status == UMB_OK ? umbw_query_check_origin(request->points.origin, error) : status;
}

/* Asset and light, or targets. */
static enum umb_status take_names(const struct umbw_field_found found[FIELD_COUNT],
                                  const uint8_t *message, size_t size,
                                  struct umbw_query_request *request, struct umb_error *error)
{
    const struct umbw_field_found *asset = &found[FIELD_ASSET];
    request->target_count = found[FIELD_TARGETS].count;
    if (request->target_count == 0) {
        return umbw_asset_copy(asset->bytes, asset->size, request->asset, error);
    }
    if (request->target_count > UMBW_TARGETS_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "targets: %zu are over the limit of %d",
                        request->target_count, UMBW_TARGETS_MAX);
    }
    if (asset->size > 0 || found[FIELD_LIGHT].count > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "targets: %zu, beside asset or light; give either those or targets",
                        request->target_count);
    }
    request->targets_at = message;
    request->targets_end = message + size;
    return UMB_OK;
}

enum umb_status umbw_query_target_next(struct umbw_query_request *request,
                                       struct umbw_query_target *target, struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "targets.asset"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "targets.light"},
    };
    struct umbw_field_found found[2];
    struct umbw_item item = {0};
    enum umb_status status = UMB_OK;
    while (status == UMB_OK && item.number != REQUEST_FIELDS[FIELD_TARGETS].number) {
        if (request->targets_at == request->targets_end) {
            return umb_fail(error, UMB_E_ARGUMENT, "targets: there are no more");
        }
        status = umbw_item_read(request->targets_at, &request->targets_at, request->targets_end,
                                &item, error);
    }
    if (status == UMB_OK) {
        status = umbw_proto_scan(item.payload, item.payload_size, fields, 2, found, NULL, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    target->light = (uint32_t)found[1].number;
    return umbw_asset_copy(found[0].bytes, found[0].size, target->asset, error);
}

static enum umb_status take_points(const struct umbw_field_found found[FIELD_COUNT],
                                   size_t max_points, struct umb_points *points,
                                   struct umb_error *error)
{
    const struct umbw_field_found *single = &found[FIELD_POINTS];
    const struct umbw_field_found *twice = &found[FIELD_POINTS_F64];
    if (single->size > 0 && twice->size > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "points: %zu bytes, and points_f64: %zu bytes; give only one of them",
                        single->size, twice->size);
    }
    bool wide = twice->size > 0;
    const bool picture = found[FIELD_PICTURE].count > 0;
    const struct umbw_field_found *field = picture ? &found[FIELD_DEPTH] : wide ? twice : single;
    const char *name = picture ? "depth" : wide ? "points_f64" : "points";
    size_t point_bytes = picture ? sizeof(float) : 3 * (wide ? sizeof(double) : sizeof(float));
    if (picture && single->size + twice->size > 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "picture: beside points; give only one of them");
    }
    if (field->size % point_bytes != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: length is %zu bytes, must be a multiple of %zu",
                        name, field->size, point_bytes);
    }
    points->count = field->size / point_bytes;
    if (points->count > max_points) {
        return umb_fail(error, UMB_E_TOO_LARGE, "%s: %zu is over the limit of %zu points", name,
                        points->count, max_points);
    }
    if (found[FIELD_TARGETS].count > 1 && points->count > max_points / found[FIELD_TARGETS].count) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "%s: %zu for each of %zu targets is over the limit of %zu answers", name,
                        points->count, found[FIELD_TARGETS].count, max_points);
    }
    points->positions = points->count > 0 ? field->bytes : NULL;
    points->format = wide ? UMB_POINT_F64 : UMB_POINT_F32;
    const struct umbw_field_found *normals = &found[FIELD_NORMALS];
    if (normals->size > 0 && normals->size != points->count * 3 * sizeof(float)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "normals: length is %zu bytes, must be 0 or %zu for %zu points",
                        normals->size, points->count * 3 * sizeof(float), points->count);
    }
    points->normals = normals->size > 0 ? normals->bytes : NULL;
    const struct umbw_field_found *own = &found[FIELD_FOOTPRINTS];
    if (own->size > 0 && own->size != points->count * sizeof(float)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "footprints: length is %zu bytes, must be 0 or %zu for %zu points",
                        own->size, points->count * sizeof(float), points->count);
    }
    points->footprints = own->size > 0 ? own->bytes : NULL;
    return UMB_OK;
}

enum umb_status umbw_decode_query_request(const uint8_t *message, size_t size, size_t max_points,
                                          struct umbw_query_request *request,
                                          struct umb_error *error)
{
    struct umbw_field_found found[FIELD_COUNT] UMB__UNSET; /* set by the scan */
    memset(request, 0, sizeof *request);
    enum umb_status status =
        umbw_proto_scan(message, size, REQUEST_FIELDS, FIELD_COUNT, found, NULL, error);
    if (status == UMB_OK) {
        status = take_names(found, message, size, request, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    status = take_settings(found, message, size, request, error);
    if (status == UMB_OK && request->dial.budget_ns > 0 && request->target_count > 1) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "budget_ns: %.9g beside %zu targets; it is of one light at a time",
                        request->dial.budget_ns, request->target_count);
    }
    if (status == UMB_OK) {
        status = take_points(found, max_points, &request->points, error);
    }
    request->pack = found[FIELD_PACK].number != 0;
    request->base_mark = found[FIELD_BASE].number;
    if (status == UMB_OK) {
        status = umbw_take_picture(&found[FIELD_PICTURE], &found[FIELD_DEPTH], request, error);
    }
    return status == UMB_OK ? umbw_query_check_has_footprint(request, error) : status;
}

/* Settings as the wire has them; the checks are the decoder's. */
static enum umb_status put_settings(const struct umbw_query_request *request,
                                    Umbrage__V1__QueryRequest *message, struct umb_error *error)
{
    const struct umb_query_settings *settings = &request->settings;
    message->light = settings->light;
    message->taps =
        settings->taps == 0 && !umbw_query_is_dialled(&request->dial) ? 1 : settings->taps;
    message->level = settings->level;
    message->max_error_m = request->dial.max_error_m;
    message->max_visibility = request->dial.max_visibility;
    message->budget_ns = request->dial.budget_ns;
    message->bias = settings->bias;
    message->filter = (Umbrage__V1__Filter)settings->filter;
    message->light_extent = settings->light_extent;
    message->footprint_m = settings->footprint_m;
    message->pixel_rad = settings->pixel_rad;
    message->opaque_only = settings->opaque_only != 0;
    message->want_stats = request->want_stats != 0;
    enum umb_status status =
        umbw_query_check_dial(&request->dial, settings->taps, settings->level, error);
    if (status == UMB_OK && message->taps != 0) {
        status = umbw_query_check_taps(message->taps, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_bias(settings->bias, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_filter((int64_t)settings->filter, settings->light_extent, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_footprint(settings, request->points.footprints != NULL, error);
    }
    if (status == UMB_OK) {
        const double *eye = settings->eye;
        status = umbw_query_check_eye(settings, eye[0] != 0 || eye[1] != 0 || eye[2] != 0, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_has_footprint(request, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_origin(request->points.origin, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    size_t format = 0;
    while (format < sizeof FORMATS / sizeof FORMATS[0] &&
           FORMATS[format].ours != settings->format) {
        format++;
    }
    size_t mode = 0;
    while (mode < sizeof BIAS_MODES / sizeof BIAS_MODES[0] &&
           BIAS_MODES[mode].ours != settings->bias_mode) {
        mode++;
    }
    if (format == sizeof FORMATS / sizeof FORMATS[0]) {
        return umb_fail(error, UMB_E_ARGUMENT, "format: %d is unknown", (int)settings->format);
    }
    if (mode == sizeof BIAS_MODES / sizeof BIAS_MODES[0]) {
        return umb_fail(error, UMB_E_ARGUMENT, "bias_mode: %d is unknown",
                        (int)settings->bias_mode);
    }
    message->format = FORMATS[format].wire;
    message->bias_mode = BIAS_MODES[mode].wire;
    return UMB_OK;
}

/* protobuf-c has no const bytes; pack only reads them. */
static ProtobufCBinaryData bytes_view(const void *bytes, size_t size)
{
    ProtobufCBinaryData view = {.len = size, .data = NULL};
    memcpy(&view.data, &bytes, sizeof view.data);
    return view;
}

static enum umb_status put_points(const struct umb_points *points,
                                  Umbrage__V1__QueryRequest *message, struct umb_error *error)
{
    if (points->format != UMB_POINT_F32 && points->format != UMB_POINT_F64) {
        return umb_fail(error, UMB_E_ARGUMENT, "points: format %d is unknown", (int)points->format);
    }
    bool wide = points->format == UMB_POINT_F64;
    size_t point_bytes = 3 * (wide ? sizeof(double) : sizeof(float));
    if (points->count > UINT32_MAX / 24) { /* the most a point takes, in bytes */
        return umb_fail(error, UMB_E_TOO_LARGE, "points: %zu is over the limit of %zu points",
                        points->count, (size_t)(UINT32_MAX / 24));
    }
    if (points->normals != NULL) {
        message->normals = bytes_view(points->normals, points->count * 3 * sizeof(float));
    }
    if (points->footprints != NULL) {
        message->footprints = bytes_view(points->footprints, points->count * sizeof(float));
    }
    if (message->picture != NULL) {
        return UMB_OK;
    }
    if (points->count > 0 && points->positions == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "points: no positions for %zu points",
                        points->count);
    }
    ProtobufCBinaryData view = bytes_view(points->positions, points->count * point_bytes);
    if (wide) {
        message->points_f64 = view;
    } else {
        message->points = view;
    }
    return UMB_OK;
}

enum umb_status umbw_encode_query_request(const struct umbw_query_request *request,
                                          struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__QueryRequest message = UMBRAGE__V1__QUERY_REQUEST__INIT;
    char asset[UMBW_ASSET_NAME_MAX + 1];
    double origin[3], eye[3];
    enum umb_status status =
        umbw_asset_copy((const uint8_t *)request->asset,
                        strnlen(request->asset, sizeof request->asset), asset, error);
    if (status == UMB_OK) {
        status = put_settings(request, &message, error);
    }
    struct umbw_picture_message picture;
    if (status == UMB_OK && request->has_picture) {
        status = umbw_put_picture(request, &picture, error);
        message.picture = &picture.message;
        message.depth = bytes_view(request->picture.depth, request->points.count * sizeof(float));
    }
    if (status == UMB_OK) {
        status = put_points(&request->points, &message, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    message.asset = asset;
    message.pack = request->pack != 0;
    message.base_mark = request->base_mark;
    memcpy(origin, request->points.origin, sizeof origin);
    if (origin[0] != 0 || origin[1] != 0 || origin[2] != 0) {
        message.origin = origin;
        message.n_origin = 3;
    }
    memcpy(eye, request->settings.eye, sizeof eye);
    if (request->settings.pixel_rad > 0) {
        message.eye = eye;
        message.n_eye = 3;
    }
    return umbw_message_append(&message.base, buffer, error);
}
