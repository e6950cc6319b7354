/* SPDX-License-Identifier: Apache-2.0 */
/* Codec of the volume queries, see volume_queries.h. */
#include "wire/volume_queries.h"

#include <string.h>

#include "base/try.h"
#include "umbrage/v1/questions.pb-c.h"
#include "wire/codec.h"

/* One-tap points that take about as long (make bench-volume-queries). */
#define SEGMENT_POINTS 64
#define BOX_POINTS     256

const size_t umbw_answer_sizes[UMBW_VOLUME_QUERY_COUNT][UMBW_ANSWER_FIELDS] = {
    [UMBW_SEGMENTS] = {8, 8, 4, 16},
    [UMBW_COLUMNS] = {8, 4, 1, 0},
    [UMBW_BOXES] = {8, 8, 0, 0},
};

#define REQUEST(member) UMBW_AT(umbw_volume_query_request, member)
#define RECORDS(member, type)                                                                      \
    REQUEST(member.at), UMBW_COUNT(umbw_volume_query_request, member.count), .stride = sizeof(type)

/* Rows of the records of a request. */
#define F32 4
#define F64 5

/* Table of a request whose records have `numbers` numbers each. */
#define REQUEST_TABLE(table, message, numbers)                                                     \
    UMBW_TABLE(table, umbrage__v1__##message##_request, "",                                        \
               sizeof(struct umbw_volume_query_request),                                           \
               {1, REQUEST(asset), .flags = UMBW_REQUIRED | UMBW_CHECKED}, {2, REQUEST(light)},    \
               {3, REQUEST(origin), .flags = UMBW_FINITE | UMBW_SPARSE}, {4, REQUEST(want_stats)}, \
               {5, RECORDS(f32, float[numbers])}, {6, RECORDS(f64, double[numbers])},              \
               {7, REQUEST(max_intervals)})

REQUEST_TABLE(SEGMENTS_REQUEST, segments, 6);
REQUEST_TABLE(COLUMNS_REQUEST, columns, 3);
REQUEST_TABLE(BOXES_REQUEST, boxes, 6);

static const struct umbw_table *const REQUESTS[UMBW_VOLUME_QUERY_COUNT] = {
    &SEGMENTS_REQUEST, &COLUMNS_REQUEST, &BOXES_REQUEST};

static const char *name_of(const struct umbw_table *table, size_t row)
{
    return table->descriptor->fields[row].name;
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

enum umb_status umbw_decode_volume_query_request(enum umbw_volume_query volume_query,
                                                 const uint8_t *message, size_t size,
                                                 uint64_t max_points,
                                                 struct umbw_volume_query_request *request,
                                                 struct umb_error *error)
{
    const struct umbw_table *table = REQUESTS[volume_query];
    UMB__TRY(umbw_decode(table, message, size, request, error));
    const size_t f32 = request->f32.count, f64 = request->f64.count, row = f64 > 0 ? F64 : F32;
    if (f32 > 0 && f64 > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: %zu bytes, and %s: %zu bytes; give only one of them",
                        name_of(table, F32), f32 * table->rows[F32].stride, name_of(table, F64),
                        f64 * table->rows[F64].stride);
    }
    const uint64_t points = umbw_volume_query_points(volume_query, request->max_intervals);
    request->volume_query = volume_query;
    request->format = f64 > 0 ? UMB_POINT_F64 : UMB_POINT_F32;
    request->count = f64 > 0 ? f64 : f32;
    request->records = f64 > 0 ? request->f64.at : request->f32.at;
    if (request->count > max_points / points) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "%s: %zu, each counts as %llu points; the limit is %llu points",
                        name_of(table, row), request->count, (unsigned long long)points,
                        (unsigned long long)max_points);
    }
    return UMB_OK;
}

enum umb_status umbw_encode_volume_query_request(const struct umbw_volume_query_request *request,
                                                 struct umbw_buffer *buffer,
                                                 struct umb_error *error)
{
    struct umbw_volume_query_request copy = *request;
    const struct umbw_table *table = REQUESTS[request->volume_query];
    const size_t row = request->format == UMB_POINT_F64 ? F64 : F32;
    const size_t most = UINT32_MAX / table->rows[row].stride;
    if (request->count > most) {
        return umb_fail(error, UMB_E_TOO_LARGE, "%s: %zu is over the limit of %zu",
                        name_of(table, row), request->count, most);
    }
    copy.f32 = copy.f64 = (struct umbw_records){NULL, 0};
    *(row == F64 ? &copy.f64 : &copy.f32) = (struct umbw_records){request->records, request->count};
    return umbw_encode(table, &copy, buffer, error);
}

#define REPLY(member) UMBW_AT(umbw_volume_query_reply, member)
#define ANSWERS(k)    REPLY(fields[k]), UMBW_COUNT(umbw_volume_query_reply, sizes[k])

UMBW_TABLE(STATS, umbrage__v1__question_stats, "stats.", 0, {1, REPLY(nodes)}, {2, REPLY(bricks)},
           {3, REPLY(nanoseconds)});

/* Of all three replies: boxes have no field 6, columns no field 7. */
static const struct umbw_row REPLY_ROWS[] = {
    {1, REPLY(asset_id), .flags = UMBW_REQUIRED},
    {2, UMBW_COUNT(umbw_volume_query_reply, has_stats), .table = &STATS},
    {3, REPLY(ignores_translucent)},
    {4, ANSWERS(0)},
    {5, ANSWERS(1)},
    {6, ANSWERS(2)},
    {7, ANSWERS(3)}};

#define REPLY_TABLE(table, message)                                                                \
    UMBW_TABLE_OF(table, umbrage__v1__##message##_reply, "",                                       \
                  sizeof(struct umbw_volume_query_reply), REPLY_ROWS)

REPLY_TABLE(SEGMENTS_REPLY, segments);
REPLY_TABLE(COLUMNS_REPLY, columns);
REPLY_TABLE(BOXES_REPLY, boxes);

static const struct umbw_table *const REPLIES[UMBW_VOLUME_QUERY_COUNT] = {
    &SEGMENTS_REPLY, &COLUMNS_REPLY, &BOXES_REPLY};

/* Checks the length of one array of answers. */
static enum umb_status check_answers(const char *name, size_t k, size_t count,
                                     struct umbw_volume_query_reply *reply, struct umb_error *error)
{
    const size_t size = reply->sizes[k], each = umbw_answer_sizes[reply->volume_query][k];
    if (k == UMBW_FIELD_INTERVALS) { /* of segments only */
        reply->interval_count = size / each;
        return size % each == 0 ? UMB_OK
                                : umb_fail(error, UMB_E_ARGUMENT,
                                           "%s: length is %zu bytes, must be a multiple of %zu",
                                           name, size, each);
    }
    return size / each == count && size % each == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "%s: length is %zu bytes, must be %zu for %zu",
                          name, size, count * each, count);
}

enum umb_status umbw_decode_volume_query_reply(enum umbw_volume_query volume_query,
                                               const uint8_t *message, size_t size, size_t count,
                                               struct umbw_volume_query_reply *reply,
                                               struct umb_error *error)
{
    const struct umbw_table *table = REPLIES[volume_query];
    UMB__TRY(umbw_decode(table, message, size, reply, error));
    reply->volume_query = volume_query;
    reply->count = count;
    for (size_t k = 0; k < UMBW_ANSWER_FIELDS && umbw_answer_sizes[volume_query][k] > 0; k++) {
        UMB__TRY(check_answers(name_of(table, 3 + k), k, count, reply, error));
    }
    return UMB_OK;
}

enum umb_status umbw_encode_volume_query_reply(const struct umbw_volume_query_reply *reply,
                                               struct umbw_buffer *buffer, struct umb_error *error)
{
    struct umbw_volume_query_reply copy = *reply;
    copy.has_stats = copy.has_stats && (copy.nodes | copy.bricks | copy.nanoseconds) != 0;
    for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
        copy.sizes[k] = umbw_answer_sizes[reply->volume_query][k] *
                        (k == UMBW_FIELD_INTERVALS ? reply->interval_count : reply->count);
    }
    return umbw_encode(REPLIES[reply->volume_query], &copy, buffer, error);
}
