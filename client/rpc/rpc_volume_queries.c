/* SPDX-License-Identifier: Apache-2.0 */
/* Questions.Segments, Columns and Boxes; see umbrage/volume_queries.h. */
#include "umbrage/volume_queries.h"

#include <stdlib.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "rpc_client.h"
#include "wire/volume_queries.h"

/* A call, and the destination of its answers: one of the three. */
struct asked {
    struct umbw_volume_query_request request;
    struct umb_segment_answers *segments;
    struct umb_column_answers *columns;
    struct umb_box_answers *boxes;
    uint64_t told;                        /* Number of intervals, by their counts */
    struct umb_volume_query_reply *reply; /* may be NULL */
};

/* Reads answer i of an array in the message, at any alignment. */
static void load(const struct umbw_volume_query_reply *wire, size_t field, size_t i, void *value)
{
    const size_t bytes = umbw_answer_sizes[wire->volume_query][field];
    memcpy(value, wire->fields[field] + i * bytes, bytes);
}

/* Copies intervals to their places in the answers. In the message they are contiguous; in the
 * answers each segment has interval_max places. */
static enum umb_status take_segments(const struct umbw_volume_query_reply *wire,
                                     struct asked *asked, struct umb_error *error)
{
    struct umb_segment_answers *answers = asked->segments;
    const size_t most = answers->interval_max;
    size_t next = 0;
    for (size_t i = 0; i < wire->count; i++) {
        struct umb_segment_answer *answer = &answers->segments[i];
        uint32_t found;
        load(wire, 0, i, &answer->lit);
        load(wire, 1, i, &answer->lit_m);
        load(wire, 2, i, &found);
        answer->interval_count = found;
        const size_t told = found < most ? found : most;
        for (size_t k = 0; k < told && next < wire->interval_count; k++, next++) {
            load(wire, UMBW_FIELD_INTERVALS, next, &answers->intervals[i * most + k]);
        }
        asked->told += told;
    }
    return asked->told == wire->interval_count
               ? UMB_OK
               : umb_fail(error, UMB_E_PROTOCOL, "stretches: %zu, stretch_counts make %llu",
                          wire->interval_count, (unsigned long long)asked->told);
}

static void take_columns(const struct umbw_volume_query_reply *wire, struct asked *asked)
{
    for (size_t i = 0; i < wire->count; i++) {
        struct umb_column_answer *answer = &asked->columns->columns[i];
        uint8_t outside;
        load(wire, 0, i, &answer->distance_m);
        load(wire, 1, i, &answer->lit);
        load(wire, 2, i, &outside);
        answer->outside = outside != 0;
    }
}

static void take_boxes(const struct umbw_volume_query_reply *wire, struct asked *asked)
{
    for (size_t i = 0; i < wire->count; i++) {
        load(wire, 0, i, &asked->boxes->boxes[i].lit);
        load(wire, 1, i, &asked->boxes->boxes[i].voxels);
    }
}

static enum umb_status decode(void *out, const uint8_t *message, size_t size,
                              struct umb_error *error)
{
    struct asked *asked = out;
    struct umbw_volume_query_reply wire;
    struct umb_volume_stats *stats = NULL;
    asked->told = 0; /* it may be another try */
    UMB__TRY(umbw_decode_volume_query_reply(asked->request.volume_query, message, size,
                                            asked->request.count, &wire, error));
    if (asked->segments != NULL) {
        UMB__TRY(take_segments(&wire, asked, error));
        stats = &asked->segments->stats;
    } else if (asked->columns != NULL) {
        take_columns(&wire, asked);
        stats = &asked->columns->stats;
    } else {
        take_boxes(&wire, asked);
        stats = &asked->boxes->stats;
    }
    stats->nodes += wire.nodes;
    stats->bricks += wire.bricks;
    if (asked->reply != NULL) {
        memcpy(asked->reply->asset_id, wire.asset_id, sizeof wire.asset_id);
        asked->reply->stats = (struct umb_volume_stats){.nodes = wire.nodes, .bricks = wire.bricks};
        asked->reply->nanoseconds = wire.nanoseconds;
        asked->reply->ignores_translucent = wire.ignores_translucent;
    }
    return UMB_OK;
}

/* Starts the call; its input is copied. */
static enum umb_status ask(struct umb_client *client, const struct umb_volume_query *volume_query,
                           const char *path, struct asked *asked, struct umb_client_async *async,
                           struct umb_error *error)
{
    if (UMB__UNKNOWN(volume_query, "volume_query", error)) {
        return UMB_E_ARGUMENT;
    }
    struct umbw_buffer body = {NULL, 0, 0};
    if (asked->reply != NULL) {
        memset(asked->reply, 0, sizeof *asked->reply);
    }
    UMB__TRY(umb__asset_take(volume_query->asset, asked->request.asset, error));
    asked->request.light = volume_query->light;
    asked->request.want_stats = 1;
    const struct umb__ending ending = {asked, sizeof *asked, decode, NULL};
    const struct umb__call_plan plan = {.path = path,
                                        .asset = volume_query->asset,
                                        .safe = true,
                                        .timeout_ms = volume_query->timeout_ms};
    enum umb_status status = umbw_encode_volume_query_request(&asked->request, &body, error);
    return umb__call_run(client, plan, status, &body, &ending, async, error);
}

/* Makes a request of pairs of points. */
static struct umbw_volume_query_request pairs_request(enum umbw_volume_query volume_query,
                                                      const struct umb_segments *pairs)
{
    struct umbw_volume_query_request request = {.volume_query = volume_query,
                                                .records = pairs->ends,
                                                .format = pairs->format,
                                                .count = pairs->count};
    memcpy(request.origin, pairs->origin, sizeof request.origin);
    return request;
}

enum umb_status umb_client_segments(struct umb_client *client,
                                    const struct umb_volume_query *volume_query,
                                    const struct umb_segments *segments,
                                    struct umb_segment_answers *answers,
                                    struct umb_volume_query_reply *reply,
                                    struct umb_client_async *async, struct umb_error *error)
{
    struct asked asked = {
        .request = pairs_request(UMBW_SEGMENTS, segments), .segments = answers, .reply = reply};
    if (UMB__UNKNOWN(segments, "segments", error)) {
        return UMB_E_ARGUMENT;
    }
    if (answers->interval_max > UINT32_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "interval_max: %zu, must be at most %lu",
                        answers->interval_max, (unsigned long)UINT32_MAX);
    }
    asked.request.max_intervals = (uint32_t)answers->interval_max;
    return ask(client, volume_query, UMBW_PATH_SEGMENTS, &asked, async, error);
}

enum umb_status umb_client_columns(struct umb_client *client,
                                   const struct umb_volume_query *volume_query,
                                   const struct umb_points *points,
                                   struct umb_column_answers *answers,
                                   struct umb_volume_query_reply *reply,
                                   struct umb_client_async *async, struct umb_error *error)
{
    struct asked asked = {.request = {.volume_query = UMBW_COLUMNS,
                                      .records = points->positions,
                                      .format = points->format,
                                      .count = points->count},
                          .columns = answers,
                          .reply = reply};
    memcpy(asked.request.origin, points->origin, sizeof asked.request.origin);
    if (UMB__UNKNOWN(points, "points", error)) {
        return UMB_E_ARGUMENT;
    }
    return ask(client, volume_query, UMBW_PATH_COLUMNS, &asked, async, error);
}

_Static_assert(sizeof(struct umb_box) == 6 * sizeof(double), "boxes are pairs of corners");

enum umb_status umb_client_boxes(struct umb_client *client,
                                 const struct umb_volume_query *volume_query,
                                 const struct umb_box *boxes, size_t count,
                                 struct umb_box_answers *answers,
                                 struct umb_volume_query_reply *reply,
                                 struct umb_client_async *async, struct umb_error *error)
{
    const struct umb_segments corners = {.ends = boxes, .format = UMB_POINT_F64, .count = count};
    struct asked asked = {
        .request = pairs_request(UMBW_BOXES, &corners), .boxes = answers, .reply = reply};
    return ask(client, volume_query, UMBW_PATH_BOXES, &asked, async, error);
}
