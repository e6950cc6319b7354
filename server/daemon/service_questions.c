/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Questions.Segments, Columns and Boxes: admitted here, answered by the workers (question_work.h)
 * under the queue, turns, deadlines and rates of queries. Never on the loop: what a segment or a
 * box takes is not known before.
 */
#include <stdlib.h>
#include <string.h>

#include "daemon/box_price.h"
#include "daemon/call_rights.h"
#include "daemon/loop.h"
#include "daemon/question_work.h"

/* Points that a slice counts as, about a millisecond. */
#define SLICE_POINTS 4096

#define BRICK_POINTS 16 /* of a brick that a side cuts */

/* Of a box that takes all its steps, 64 a brick. */
#define TURNS_MAX (UMBD_BOX_STEPS_MAX / 64 * BRICK_POINTS / SLICE_POINTS)

#define BOXES_CHUNK 64

static void free_question(void *user)
{
    struct umbd_question *question = user;
    umbs_entry_release(question->entry);
    umbw_buffer_finish(&question->reply);
    free(question->answers);
    free(question->message);
    free(question);
}

/* Points that counting the sides of all boxes counts as. */
static uint64_t side_points(const struct umbd_question *question)
{
    const struct umb_segments pairs = umbd_question_pairs(&question->request);
    const struct umb_asset *asset = umbs_entry_asset(question->entry);
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    double sum = 0;
    if (umb_asset_get_light(asset, question->request.light, &light) != UMB_OK ||
        umb_asset_get_frustum(asset, light.first_frustum, &frustum) != UMB_OK) {
        return 0; /* cannot be: the light was prepared */
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

/* Allocates the answers: stretches first, since they are aligned as malloc's blocks are. */
static enum umb_status make_room(struct umbd_question *question, size_t *bytes,
                                 struct umb_error *error)
{
    const struct umbw_question_request *request = &question->request;
    const size_t *sizes = umbw_answer_sizes[request->question];
    size_t offset = request->count * request->max_stretches * sizes[UMBW_FIELD_STRETCHES];
    size_t offsets[UMBW_ANSWER_FIELDS] = {0};
    for (size_t k = 0; k < UMBW_FIELD_STRETCHES; k++) {
        offsets[k] = offset;
        offset += request->count * sizes[k];
    }
    question->answers = malloc(offset + 1);
    if (question->answers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu bytes of answers", offset);
    }
    for (size_t k = 0; k < UMBW_ANSWER_FIELDS; k++) {
        question->fields[k] = question->answers + offsets[k];
    }
    *bytes = 2 * offset; /* and as a message */
    return UMB_OK;
}

/* Takes the call's message over. */
static enum umb_status take_message(struct umbd_call *call, struct umbd_question *question,
                                    struct umb_error *error)
{
    struct umb_points records = {.positions = question->request.records};
    question->message = umbd_call_take_message_of(call, &records);
    question->request.records = records.positions;
    return question->message != NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the request");
}

/* Reads the request and finds who answers it. */
static enum umb_status open_question(struct umbd_call *call, enum umbw_question kind,
                                     struct umbd_question *question, struct umb_error *error)
{
    struct umbw_question_request *request = &question->request;
    enum umb_status status =
        umbw_decode_question_request(kind, call->message, call->message_size,
                                     call->conn->loop->daemon->options.max_points, request, error);
    if (status == UMB_OK) {
        status = umbd_call_acquire(call, request->asset, &question->entry, error);
    }
    if (status == UMB_OK) {
        status = umb_volume_prepare(umbs_entry_asset(question->entry), request->light,
                                    &question->volume, error);
    }
    if (status == UMB_OK && kind == UMBW_BOXES) {
        status = umb_volume_check_parallel(&question->volume, error);
    }
    return status == UMB_OK && kind == UMBW_COLUMNS
               ? umb_volume_check_columns(&question->volume, error)
               : status;
}

/* Hands the work over; the question is the work's then. */
static enum umb_status hand_over(struct umbd_call *call, struct umbd_question *question,
                                 uint64_t points, size_t bytes, struct umb_error *error)
{
    static const char *const items[UMBW_QUESTION_COUNT] = {
        [UMBW_SEGMENTS] = "segments", [UMBW_COLUMNS] = "columns", [UMBW_BOXES] = "boxes"};
    const size_t count = question->request.count;
    const uint64_t each = points / count + 1, slice = SLICE_POINTS / each;
    const uint64_t turns = each / SLICE_POINTS;
    const struct umbd_work work = {
        .run = umbd_question_run,
        .end = umbd_question_end,
        .free = free_question,
        .user = question,
        .count = count,
        .slice = slice > 0 ? (size_t)slice : 1,
        .items = items[question->request.question],
        .turns = turns < TURNS_MAX ? turns : TURNS_MAX,
        .bytes = call->message_size + bytes,
    };
    enum umb_status status = take_message(call, question, error);
    if (status != UMB_OK) {
        free_question(question);
        return status;
    }
    return umbd_call_send_work(call, &work, error);
}

/* Nothing was asked: says who would have answered. */
static void answer_nothing(struct umbd_call *call, struct umbd_question *question)
{
    struct umb_error error = {0};
    struct umbd_batch nothing = {.work_user = question};
    const enum umb_status status = umbd_question_end(&nothing, &error);
    if (status == UMB_OK) {
        umbd_call_reply(call, &question->reply);
    } else {
        umbd_call_fail_status(call, status, &error);
    }
    free_question(question);
}

static void serve(struct umbd_call *call, enum umbw_question kind)
{
    struct umb_error error = {0};
    struct umbd_question *question = calloc(1, sizeof *question);
    size_t bytes = 0;
    if (question == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    enum umb_status status = open_question(call, kind, question, &error);
    if (status == UMB_OK) {
        status = make_room(question, &bytes, &error);
    }
    if (status != UMB_OK) {
        free_question(question);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    const struct umbw_question_request *request = &question->request;
    uint64_t points = request->count * umbw_question_points(kind, request->max_stretches);
    if (kind == UMBW_BOXES) {
        const uint64_t from = umbd_conn_began(call->conn);
        points += side_points(question);
        umbd_conn_spent(call->conn, from);
    }
    if (!umbd_call_take_points(call, UMBD_CALL_POINTS + points) ||
        !umbd_call_charge(call, call->charged + bytes)) {
        free_question(question);
        return;
    }
    if (request->count == 0) {
        answer_nothing(call, question);
        return;
    }
    status = hand_over(call, question, points, bytes, &error);
    if (status == UMB_E_BUSY) {
        umbd_call_shed(call, &error);
    } else if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
    }
}

void umbd_service_segments(struct umbd_call *call)
{
    serve(call, UMBW_SEGMENTS);
}

void umbd_service_columns(struct umbd_call *call)
{
    serve(call, UMBW_COLUMNS);
}

void umbd_service_boxes(struct umbd_call *call)
{
    serve(call, UMBW_BOXES);
}

void umbd_service_questions_done(struct umbd_call *call, struct umbd_batch *batch)
{
    struct umbd_question *question = batch->work_user;
    struct umbd_metrics *metrics = &call->conn->loop->daemon->metrics;
    if (batch->status == UMB_E_BUSY) {
        umbd_call_shed(call, &batch->error);
    } else if (batch->status != UMB_OK) {
        umbd_call_fail_status(call, batch->status, &batch->error);
    } else if (umbd_call_charge(call, question->reply.size)) {
        umbd_count(&metrics->questions[question->request.question], question->request.count);
        umbd_call_reply(call, &question->reply);
    }
}
