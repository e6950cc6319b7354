/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows.Sample: points near shadow boundaries, drawn by one worker. */
#include <stdlib.h>

#include "base/try.h"
#include "daemon/call/call.h"
#include "daemon/service/services.h"

/* Price of a drawn point, in one-tap points of a query that take as long. Measured: a drawn point
 * takes 1.0 to 1.6 us, a scattered point of a query 15 to 50 ns, and the two passes over the usual
 * grid of a frustum 0.5 ms. */
#define DRAWN_POINTS 32
#define GRID_POINTS  16384 /* of each frustum of the light */
#define TURN_DRAWN   1024  /* drawn points of a turn, about a millisecond */

struct sampling {
    struct umbd_task task;    /* The first field */
    struct umbs_entry *entry; /* owned */
    struct umbw_sample_request request;
    struct umb_sample sample;
    struct umb_error error;
    enum umb_status status;
    double *positions; /* [3 * request.settings.count], owned */
};

static int is_given_up(void *user)
{
    const struct sampling *s = user;
    return umbd_task_stopped(&s->task) != UMB_OK;
}

/* Reads voxels; a fault may leave it midway. It owns nothing. */
static void draw(void *user)
{
    struct sampling *s = user;
    s->status = umb_asset_sample(umbs_entry_asset(s->entry), &s->request.settings, s->positions,
                                 &s->sample, &s->error);
}

/* Draws the points on a worker's thread. It is the `run` of a task with one record. */
static enum umb_status work(struct umbd_task *task, size_t first, size_t count,
                            struct umbd_slice_result *result)
{
    (void)first;
    (void)count;
    struct sampling *s = (struct sampling *)task;
    UMB__TRY(umbs_entry_read(s->entry, draw, s, &result->error));
    result->error = s->error;
    return umbd_task_result(task, s->status, &result->error);
}

static void free_sampling(struct umbd_task *task)
{
    struct sampling *s = (struct sampling *)task;
    umbs_entry_release(s->entry);
    free(s->positions);
    free(s);
}

static void answer(struct umbd_call *call, struct umbd_task *task)
{
    const struct sampling *s = (const struct sampling *)task;
    if (task->status != UMB_OK) {
        umbd_call_fail_work(call, task->status, &task->error);
        return;
    }
    const struct umbw_sample_reply reply = {.sample = s->sample,
                                            .points = (const uint8_t *)s->positions};
    struct umbw_buffer message = {0};
    if (umbd_call_ok(call, umbw_encode_sample_reply(&reply, &message, umbd_call_error(call)))) {
        umbd_call_reply(call, &message); /* charged since the request */
    }
}

/* Reads the request, finds the version that answers it and makes room for the points. */
static enum umb_status ready(const struct umbd_options *options, struct umbd_call *call,
                             struct sampling *s, struct umb_error *error)
{
    const uint32_t *count = &s->request.settings.count;
    UMB__TRY(umbw_decode_sample_request(call->message, call->message_size, &s->request, error));
    UMB__TRY(umbd_call_acquire(call, s->request.asset, &s->entry, error));
    if (*count > options->max_points) {
        return umb_fail(error, UMB_E_TOO_LARGE, "count: %u, the limit is %llu", *count,
                        (unsigned long long)options->max_points);
    }
    s->request.settings.cancelled = is_given_up;
    s->request.settings.cancel_user = s;
    s->task.turns = *count / TURN_DRAWN;
    s->positions = malloc(*count * UMBW_SAMPLE_POINT_BYTES);
    return s->positions != NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u points", *count);
}

/* Returns the price of a sample, in points that count against the rates. A light that does not
 * exist is refused by the core. */
static uint64_t price_of(const struct sampling *s)
{
    const uint32_t count = s->request.settings.count, light = s->request.settings.light;
    struct umb_light_info info;
    const uint64_t frusta = umb_asset_get_light(umbs_entry_asset(s->entry), light, &info) == UMB_OK
                                ? info.frustum_count
                                : 0;
    return UMBD_CALL_POINTS + frusta * GRID_POINTS + (uint64_t)count * DRAWN_POINTS;
}

void umbd_sample_serve(struct umbd_call *call)
{
    struct umb_error error = {0};
    struct sampling *s = calloc(1, sizeof *s);
    if (s == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    s->task = (struct umbd_task){
        .run = work, .answer = answer, .free = free_sampling, .count = 1, .slice = 1};
    enum umb_status status = ready(&call->server->options, call, s, &error);
    /* The points, and their message. */
    const size_t bytes = 2 * s->request.settings.count * UMBW_SAMPLE_POINT_BYTES;
    const int may = status == UMB_OK && umbd_call_take_points(call, price_of(s)) &&
                    umbd_call_charge(call, call->charged + bytes);
    if (may) {
        status = umbd_call_send_task(call, &s->task, bytes, &error);
    }
    if (!may || status != UMB_OK) {
        free_sampling(&s->task);
    }
    if (status != UMB_OK) {
        umbd_call_fail_work(call, status, &error);
    }
}
