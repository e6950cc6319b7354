/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage.v1.Questions between its bytes and the structs of volume_queries.h. All fields are
 * numbers and byte strings, so that they are written by hand, without a struct of protobuf-c for
 * each message.
 */
#include "wire/volume_queries.h"

#include <string.h>

#include "base/try.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "wire/query_check.h"
#include "wire/wire_buffer.h"

/* One-tap points that take about as long (make bench-volume-queries). */
#define SEGMENT_POINTS 64
#define BOX_POINTS     256

const size_t umbw_answer_sizes[UMBW_VOLUME_QUERY_COUNT][UMBW_ANSWER_FIELDS] = {
    [UMBW_SEGMENTS] = {8, 8, 4, 16},
    [UMBW_COLUMNS] = {8, 4, 1, 0},
    [UMBW_BOXES] = {8, 8, 0, 0},
};

/* Fields of requests; those of replies are ANSWER_FIELDS. */
enum request_field {
    FIELD_ASSET,
    FIELD_LIGHT,
    FIELD_ORIGIN,
    FIELD_WANT_STATS,
    FIELD_NARROW,
    FIELD_WIDE,
    FIELD_MAX_INTERVALS,
    FIELD_COUNT,
};

static const char *const record_names[UMBW_VOLUME_QUERY_COUNT][2] = {
    [UMBW_SEGMENTS] = {"segments", "segments_f64"},
    [UMBW_COLUMNS] = {"points", "points_f64"},
    [UMBW_BOXES] = {"boxes", "boxes_f64"},
};

static const char *const answer_names[UMBW_VOLUME_QUERY_COUNT][UMBW_ANSWER_FIELDS] = {
    [UMBW_SEGMENTS] = {"lit", "lit_m", "stretch_counts", "stretches"},
    [UMBW_COLUMNS] = {"distance_m", "lit", "outside", NULL},
    [UMBW_BOXES] = {"lit", "voxels", NULL, NULL},
};

static size_t record_bytes(enum umbw_volume_query volume_query, enum umb_point_format format)
{
    const size_t scalar = format == UMB_POINT_F64 ? sizeof(double) : sizeof(float);
    return (volume_query == UMBW_COLUMNS ? 3 : 6) * scalar;
}

uint64_t umbw_volume_query_points(enum umbw_volume_query volume_query, uint32_t max_intervals)
{
    switch (volume_query) {
    case UMBW_SEGMENTS:
        return max_intervals > SEGMENT_POINTS ? max_intervals : SEGMENT_POINTS;
    case UMBW_BOXES:
        return BOX_POINTS;
    default:
        return 1;
    }
}

static enum umb_status take_records(const struct umbw_field_found found[FIELD_COUNT],
                                    uint64_t max_points, struct umbw_volume_query_request *request,
                                    struct umb_error *error)
{
    const char *const *names = record_names[request->volume_query];
    const struct umbw_field_found *narrow = &found[FIELD_NARROW], *wide = &found[FIELD_WIDE];
    if (narrow->size > 0 && wide->size > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: %zu bytes, and %s: %zu bytes; give only one of them", names[0],
                        narrow->size, names[1], wide->size);
    }
    const struct umbw_field_found *field = wide->size > 0 ? wide : narrow;
    const char *name = names[wide->size > 0];
    request->format = wide->size > 0 ? UMB_POINT_F64 : UMB_POINT_F32;
    const size_t bytes = record_bytes(request->volume_query, request->format);
    if (field->size % bytes != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: length is %zu bytes, must be a multiple of %zu",
                        name, field->size, bytes);
    }
    const uint64_t points = umbw_volume_query_points(request->volume_query, request->max_intervals);
    request->count = field->size / bytes;
    request->records = field->bytes;
    if (request->count > max_points / points) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "%s: %zu, each counts as %llu points; the limit is %llu points", name,
                        request->count, (unsigned long long)points, (unsigned long long)max_points);
    }
    return UMB_OK;
}

enum umb_status umbw_decode_volume_query_request(enum umbw_volume_query volume_query,
                                                 const uint8_t *message, size_t size,
                                                 uint64_t max_points,
                                                 struct umbw_volume_query_request *request,
                                                 struct umb_error *error)
{
    const struct umbw_field fields[FIELD_COUNT] = {
        [FIELD_ASSET] = {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset"},
        [FIELD_LIGHT] = {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "light"},
        [FIELD_ORIGIN] = {3, UMBW_FIELD_PACKED, UMBW_WIRE_FIXED64, "origin"},
        [FIELD_WANT_STATS] = {4, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "want_stats"},
        [FIELD_NARROW] = {5, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, record_names[volume_query][0]},
        [FIELD_WIDE] = {6, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, record_names[volume_query][1]},
        [FIELD_MAX_INTERVALS] = {7, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "max_stretches"},
    };
    const size_t field_count = volume_query == UMBW_SEGMENTS ? FIELD_COUNT : FIELD_MAX_INTERVALS;
    struct umbw_field_found found[FIELD_COUNT] = {0};
    memset(request, 0, sizeof *request);
    request->volume_query = volume_query;
    enum umb_status status =
        umbw_proto_scan(message, size, fields, field_count, found, NULL, error);
    if (status == UMB_OK) {
        status = umbw_asset_copy(found[FIELD_ASSET].bytes, found[FIELD_ASSET].size, request->asset,
                                 error);
    }
    if (status == UMB_OK && found[FIELD_ORIGIN].count > 0) {
        status = umbw_scan_vector(message, size, &fields[FIELD_ORIGIN], request->origin, error);
    }
    if (status == UMB_OK) {
        status = umbw_query_check_origin(request->origin, error);
    }
    request->light = (uint32_t)found[FIELD_LIGHT].number;
    request->want_stats = found[FIELD_WANT_STATS].number != 0;
    request->max_intervals = (uint32_t)found[FIELD_MAX_INTERVALS].number;
    return status == UMB_OK ? take_records(found, max_points, request, error) : status;
}

/* Numbers of replies' fields; answers follow. */
enum {
    REPLY_ASSET_ID = 1,
    REPLY_STATS,
    REPLY_IGNORES,
    REPLY_ANSWERS
};

static enum umb_status take_stats(const struct umbw_field_found *field,
                                  struct umbw_volume_query_reply *reply, struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "stats.nodes"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "stats.bricks"},
        {3, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "stats.nanoseconds"},
    };
    struct umbw_field_found found[3];
    reply->has_stats = field->count > 0;
    if (!reply->has_stats) {
        return UMB_OK;
    }
    enum umb_status status =
        umbw_proto_scan(field->bytes, field->size, fields, 3, found, NULL, error);
    if (status == UMB_OK) {
        reply->nodes = found[0].number;
        reply->bricks = found[1].number;
        reply->nanoseconds = found[2].number;
    }
    return status;
}

/* One array of answers. */
static enum umb_status take_answers(const struct umbw_field_found *found, size_t k, size_t count,
                                    struct umbw_volume_query_reply *reply, struct umb_error *error)
{
    const char *name = answer_names[reply->volume_query][k];
    const size_t bytes = umbw_answer_sizes[reply->volume_query][k];
    reply->fields[k] = found->bytes;
    if (reply->volume_query == UMBW_SEGMENTS && k == UMBW_FIELD_INTERVALS) {
        reply->interval_count = found->size / bytes;
        return found->size % bytes == 0
                   ? UMB_OK
                   : umb_fail(error, UMB_E_ARGUMENT,
                              "%s: length is %zu bytes, must be a multiple of %zu", name,
                              found->size, bytes);
    }
    return found->size / bytes == count && found->size % bytes == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "%s: length is %zu bytes, must be %zu for %zu",
                          name, found->size, count * bytes, count);
}

enum umb_status umbw_decode_volume_query_reply(enum umbw_volume_query volume_query,
                                               const uint8_t *message, size_t size, size_t count,
                                               struct umbw_volume_query_reply *reply,
                                               struct umb_error *error)
{
    struct umbw_field fields[REPLY_ANSWERS - 1 + UMBW_ANSWER_FIELDS] = {
        {REPLY_ASSET_ID, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset_id"},
        {REPLY_STATS, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "stats"},
        {REPLY_IGNORES, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "ignores_translucent"},
    };
    struct umbw_field_found found[REPLY_ANSWERS - 1 + UMBW_ANSWER_FIELDS];
    size_t answers = 0;
    memset(reply, 0, sizeof *reply);
    reply->volume_query = volume_query;
    reply->count = count;
    while (answers < UMBW_ANSWER_FIELDS && umbw_answer_sizes[volume_query][answers] > 0) {
        fields[REPLY_ANSWERS - 1 + answers] =
            (struct umbw_field){REPLY_ANSWERS + (uint32_t)answers, UMBW_FIELD_IN_PLACE,
                                UMBW_WIRE_BYTES, answer_names[volume_query][answers]};
        answers++;
    }
    enum umb_status status =
        umbw_proto_scan(message, size, fields, REPLY_ANSWERS - 1 + answers, found, NULL, error);
    if (status == UMB_OK) {
        status = umbw_id_copy("asset_id", found[0].bytes, found[0].size, reply->asset_id, error);
    }
    if (status == UMB_OK) {
        status = take_stats(&found[1], reply, error);
    }
    for (size_t k = 0; status == UMB_OK && k < answers; k++) {
        status = take_answers(&found[REPLY_ANSWERS - 1 + k], k, count, reply, error);
    }
    reply->ignores_translucent = status == UMB_OK && found[2].number != 0;
    return status;
}

/* A field to be written: bytes, or a number where bytes is NULL. Empty ones and zeros are left out,
 * as proto3 has it. */
struct item {
    uint32_t number;
    const void *bytes;
    size_t size;
    uint64_t value;
};

static int is_left_out(const struct item *item)
{
    return item->bytes != NULL ? item->size == 0 : item->value == 0;
}

static size_t varint_bytes(uint64_t value)
{
    uint8_t scratch[10];
    return umbw_varint_write(value, scratch);
}

static size_t item_bytes(const struct item *item)
{
    if (is_left_out(item)) {
        return 0;
    }
    return 1 + (item->bytes != NULL ? varint_bytes(item->size) + item->size
                                    : varint_bytes(item->value));
}

static uint8_t *put_item(const struct item *item, uint8_t *at)
{
    if (is_left_out(item)) {
        return at;
    }
    const unsigned type = item->bytes != NULL ? UMBW_WIRE_BYTES : UMBW_WIRE_VARINT;
    *at++ = (uint8_t)(item->number << 3 | type); /* numbers are below 16 */
    at += umbw_varint_write(item->bytes != NULL ? item->size : item->value, at);
    if (item->bytes != NULL) {
        memcpy(at, item->bytes, item->size);
        at += item->size;
    }
    return at;
}

/* Appends a message of items, with its prefix. */
static enum umb_status put_message(const struct item *items, size_t count,
                                   struct umbw_buffer *buffer, struct umb_error *error)
{
    uint64_t size = 0;
    for (size_t i = 0; i < count; i++) {
        size += item_bytes(&items[i]);
    }
    UMB__TRY(umbw_buffer_begin_message(buffer, size, (size_t)size, error));
    uint8_t *at = buffer->bytes + buffer->size;
    for (size_t i = 0; i < count; i++) {
        at = put_item(&items[i], at);
    }
    buffer->size += (size_t)size;
    return UMB_OK;
}

enum umb_status umbw_encode_volume_query_request(const struct umbw_volume_query_request *request,
                                                 struct umbw_buffer *buffer,
                                                 struct umb_error *error)
{
    char asset[UMBW_ASSET_NAME_MAX + 1];
    const int wide = request->format == UMB_POINT_F64;
    const size_t bytes = record_bytes(request->volume_query, request->format);
    enum umb_status status =
        umbw_asset_copy((const uint8_t *)request->asset,
                        strnlen(request->asset, sizeof request->asset), asset, error);
    if (status == UMB_OK) {
        status = umbw_query_check_origin(request->origin, error);
    }
    if (status == UMB_OK && request->count > UINT32_MAX / bytes) {
        status =
            umb_fail(error, UMB_E_TOO_LARGE, "%s: %zu is over the limit of %zu",
                     record_names[request->volume_query][wide], request->count, UINT32_MAX / bytes);
    }
    if (status != UMB_OK) {
        return status;
    }
    const double *o = request->origin;
    const struct item items[] = {
        {1, asset, strlen(asset), 0},
        {2, NULL, 0, request->light},
        {3, o, o[0] != 0 || o[1] != 0 || o[2] != 0 ? sizeof request->origin : 0, 0},
        {4, NULL, 0, request->want_stats != 0},
        {wide ? 6 : 5, request->count > 0 ? request->records : "", request->count * bytes, 0},
        {7, NULL, 0, request->volume_query == UMBW_SEGMENTS ? request->max_intervals : 0},
    };
    return put_message(items, sizeof items / sizeof items[0], buffer, error);
}

enum umb_status umbw_encode_volume_query_reply(const struct umbw_volume_query_reply *reply,
                                               struct umbw_buffer *buffer, struct umb_error *error)
{
    const struct item stats[] = {
        {1, NULL, 0, reply->nodes}, {2, NULL, 0, reply->bricks}, {3, NULL, 0, reply->nanoseconds}};
    uint8_t stats_bytes[3 * 11];
    uint8_t *stats_end = stats_bytes;
    for (size_t i = 0; reply->has_stats && i < 3; i++) {
        stats_end = put_item(&stats[i], stats_end);
    }
    struct item items[REPLY_ANSWERS - 1 + UMBW_ANSWER_FIELDS] = {
        {REPLY_ASSET_ID, reply->asset_id, UMB_ID_BYTES, 0},
        {REPLY_STATS, stats_bytes, (size_t)(stats_end - stats_bytes), 0},
        {REPLY_IGNORES, NULL, 0, reply->ignores_translucent != 0},
    };
    size_t count = REPLY_ANSWERS - 1;
    for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
        const size_t bytes = umbw_answer_sizes[reply->volume_query][k];
        const int intervals = reply->volume_query == UMBW_SEGMENTS && k == UMBW_FIELD_INTERVALS;
        const size_t answers = intervals ? reply->interval_count : reply->count;
        if (bytes > 0 && answers > 0) {
            items[count++] =
                (struct item){REPLY_ANSWERS + (uint32_t)k, reply->fields[k], answers * bytes, 0};
        }
    }
    return put_message(items, count, buffer, error);
}
