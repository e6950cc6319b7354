/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Volume queries (segments, columns, boxes). This file checks and submits them; workers answer them
 * (volume_query_work.h) under the queue, turns, deadlines and rates of queries. The loop never
 * answers them itself, because the cost of a segment or a box is not known beforehand.
 */
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "daemon/work/volume_query_work.h"

/* Points that a slice is priced as, about a millisecond. */
#define SLICE_POINTS 4096

#define BRICK_POINTS 16 /* points for a brick that a side cuts */

/* Turns of a box that takes all its steps, 64 a brick. */
#define TURNS_MAX (UMBD_BOX_STEPS_MAX / 64 * BRICK_POINTS / SLICE_POINTS)

#define BOXES_CHUNK 64

static void free_volume_query(struct umbd_task *task)
{
    struct umbd_volume_query *volume_query = (struct umbd_volume_query *)task;
    umbs_entry_release(volume_query->entry);
    umbw_buffer_finish(&volume_query->reply);
    free(volume_query->answers);
    free(volume_query->message);
    free(volume_query);
}

/* Points that counting the sides of all boxes is priced as. */
static uint64_t side_points(const struct umbd_volume_query *volume_query)
{
    const struct umb_segments pairs = umbd_volume_query_pairs(&volume_query->request);
    const struct umb_asset *asset = umbs_entry_asset(volume_query->entry);
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    double sum = 0;
    if (umb_asset_get_light(asset, volume_query->request.light, &light) != UMB_OK ||
        umb_asset_get_frustum(asset, light.first_frustum, &frustum) != UMB_OK) {
        return 0; /* cannot happen: the light was prepared */
    }
    for (size_t at = 0; at < pairs.count; at += BOXES_CHUNK) {
        struct umb_box boxes[BOXES_CHUNK];
        const size_t left = pairs.count - at, count = left < BOXES_CHUNK ? left : BOXES_CHUNK;
        umb_boxes_from_corners(&pairs, at, count, boxes);
        for (size_t i = 0; i < count; i++) {
            sum += umbd_box_bricks(&frustum, &boxes[i]);
        }
    }
    return (uint64_t)(BRICK_POINTS * sum);
}

/* Allocates the arrays of the answers. Intervals come first, because malloc's blocks are aligned
 * for them. */
static enum umb_status make_room(struct umbd_volume_query *volume_query, size_t *bytes,
                                 struct umb_error *error)
{
    const struct umbw_volume_query_request *request = &volume_query->request;
    const size_t *sizes = umbw_answer_sizes[request->volume_query];
    size_t offset = request->count * request->max_intervals * sizes[UMBW_FIELD_INTERVALS];
    size_t offsets[UMBW_ANSWER_FIELDS] = {0};
    for (size_t k = 0; k < UMBW_FIELD_INTERVALS; k++) {
        offsets[k] = offset;
        offset += request->count * sizes[k];
    }
    volume_query->answers = malloc(offset + 1);
    if (volume_query->answers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu bytes of answers", offset);
    }
    for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
        volume_query->fields[k] = volume_query->answers + offsets[k];
    }
    *bytes = 2 * offset; /* the answers, and the message made of them */
    return UMB_OK;
}

/* Takes the call's message over. */
static enum umb_status take_message(struct umbd_call *call, struct umbd_volume_query *volume_query,
                                    struct umb_error *error)
{
    struct umb_points records = {.positions = volume_query->request.records};
    volume_query->message = umbd_call_take_message_of(call, &records);
    volume_query->request.records = records.positions;
    return volume_query->message != NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the request");
}

/* Reads the request and finds the version that answers it. */
static enum umb_status open_volume_query(struct umbd_call *call, enum umbw_volume_query kind,
                                         struct umbd_volume_query *volume_query,
                                         struct umb_error *error)
{
    struct umbw_volume_query_request *request = &volume_query->request;
    UMB__TRY(umbw_decode_volume_query_request(kind, call->message, call->message_size,
                                              call->server->options.max_points, request, error));
    UMB__TRY(umbd_call_acquire(call, request->asset, &volume_query->entry, error));
    UMB__TRY(umb_volume_prepare(umbs_entry_asset(volume_query->entry), request->light,
                                &volume_query->volume, error));
    return kind == UMBW_COLUMNS ? umb_volume_check_columns(&volume_query->volume, error) : UMB_OK;
}

static void answer(struct umbd_call *call, struct umbd_task *task)
{
    struct umbd_volume_query *volume_query = (struct umbd_volume_query *)task;
    if (task->status != UMB_OK) {
        umbd_call_fail_work(call, task->status, &task->error);
    } else if (umbd_call_charge(call, volume_query->reply.size)) {
        umbd_count(&call->server->metrics.volume_queries[volume_query->request.volume_query],
                   volume_query->request.count);
        umbd_call_reply(call, &volume_query->reply);
    }
}

/* Hands the work to the workers, which own the query on success. */
static enum umb_status hand_over(struct umbd_call *call, struct umbd_volume_query *volume_query,
                                 uint64_t points, size_t bytes, struct umb_error *error)
{
    static const char *const items[UMBW_VOLUME_QUERY_COUNT] = {
        [UMBW_SEGMENTS] = "segments", [UMBW_COLUMNS] = "columns", [UMBW_BOXES] = "boxes"};
    struct umbd_task *task = &volume_query->task;
    const size_t message_bytes = call->message_size;
    task->count = volume_query->request.count;
    const uint64_t each = points / task->count + 1, slice = SLICE_POINTS / each;
    const uint64_t turns = each / SLICE_POINTS;
    task->run = umbd_volume_query_run;
    task->end = umbd_volume_query_end;
    task->answer = answer;
    task->free = free_volume_query;
    task->slice = slice > 0 ? (size_t)slice : 1;
    task->items = items[volume_query->request.volume_query];
    task->turns = turns < TURNS_MAX ? turns : TURNS_MAX;
    UMB__TRY(take_message(call, volume_query, error));
    return umbd_call_send_task(call, task, message_bytes + bytes, error);
}

/* Answers an empty request: names the version that would have answered. */
static void answer_nothing(struct umbd_call *call, struct umbd_volume_query *volume_query)
{
    if (umbd_call_ok(call, umbd_volume_query_end(&volume_query->task, umbd_call_error(call)))) {
        umbd_call_reply(call, &volume_query->reply);
    }
}

/* Answers a request that is empty, and submits any other. Returns 1 if the workers own the
 * query. */
static int submit(struct umbd_call *call, enum umbw_volume_query kind,
                  struct umbd_volume_query *volume_query)
{
    size_t bytes = 0;
    if (!umbd_call_ok(call, open_volume_query(call, kind, volume_query, umbd_call_error(call))) ||
        !umbd_call_ok(call, make_room(volume_query, &bytes, umbd_call_error(call)))) {
        return 0;
    }
    const struct umbw_volume_query_request *request = &volume_query->request;
    uint64_t points = request->count * umbw_volume_query_points(kind, request->max_intervals);
    if (kind == UMBW_BOXES) {
        const uint64_t from = umbd_conn_began(call->conn);
        points += side_points(volume_query);
        umbd_conn_spent(call->conn, from);
    }
    if (!umbd_call_take_points(call, UMBD_CALL_POINTS + points) ||
        !umbd_call_charge(call, call->charged + bytes)) {
        return 0;
    }
    if (request->count == 0) {
        answer_nothing(call, volume_query);
        return 0;
    }
    struct umb_error *error = umbd_call_error(call);
    const enum umb_status status = hand_over(call, volume_query, points, bytes, error);
    if (status != UMB_OK) {
        umbd_call_fail_work(call, status, error);
    }
    return status == UMB_OK;
}

void umbd_volume_query_serve(struct umbd_call *call)
{
    const enum umbw_volume_query kind = (enum umbw_volume_query)call->method->variant;
    struct umbd_volume_query *volume_query = calloc(1, sizeof *volume_query);
    if (volume_query == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
    } else if (!submit(call, kind, volume_query)) {
        free_volume_query(&volume_query->task);
    }
}
