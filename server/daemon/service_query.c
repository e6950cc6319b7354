/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shadows.Query. A small batch is answered at once on the loop, within a time budget a wake-up; a
 * larger one goes to the pool, and comes back through umbd_service_query_done.
 *
 * Each batch holds one version of its asset from here to the end of its work, and the reply names
 * that version.
 */
#include "daemon/call.h"

#include <stdlib.h>

/* About 0.2 ms of work at 0.1 us a look-up: below that, two thread switches cost more than they
 * win. */
#define INLINE_WORK 2048

/* Look-ups in units of one tap; wide windows read eight texels of a row at a time. */
static uint64_t work_of(const struct umb_query_settings *settings, size_t count)
{
    uint64_t taps = settings->taps > 0 ? settings->taps : 1;
    return (uint64_t)count * ((taps * taps + 7) / 8);
}

static int fits_inline(struct umbd_loop *loop, const struct umbd_batch *batch)
{
    if (loop->inline_at_ms != uv_now(&loop->uv)) {
        loop->inline_at_ms = uv_now(&loop->uv);
        loop->inline_ns = 0;
    }
    return batch->points.count == 0 ||
           (work_of(&batch->settings, batch->points.count) <= INLINE_WORK &&
            loop->inline_ns < UMBD_INLINE_NS);
}

static void answer_inline(struct umbd_call *call, struct umbd_batch *batch)
{
    struct umbd_loop *loop = call->conn->loop;
    uint64_t from = umbd_now_ns();
    umbd_batch_run(batch, &loop->daemon->metrics);
    loop->inline_ns += umbd_now_ns() - from;
    umbd_service_query_done(call, batch);
    umbd_batch_destroy(batch);
}

/* Refuses for lack of room; the client is told when to come again. */
static void shed(struct umbd_call *call, const struct umb_error *error)
{
    umbd_count(&call->conn->loop->daemon->metrics.shed, 1);
    umbd_call_fail_status(call, UMB_E_BUSY, error);
}

static void answer_by_pool(struct umbd_call *call, struct umbd_batch *batch)
{
    struct umbd_daemon *daemon = call->conn->loop->daemon;
    struct umb_error error;
    batch->deadline_ns = call->deadline_ns;
    batch->lane = call->conn->serial;
    batch->stream_id = call->stream_id;
    batch->done = umbd_loop_batch_done;
    batch->home = call->conn->loop;
    enum umb_status status = umbd_pool_submit(daemon->pool, batch, &error);
    if (status == UMB_OK) {
        call->batch = batch;
        return;
    }
    umbd_batch_destroy(batch);
    if (status == UMB_E_BUSY) {
        shed(call, &error);
    } else {
        umbd_call_fail_status(call, status, &error);
    }
}

void umbd_service_query(struct umbd_call *call)
{
    struct umbd_daemon *daemon = call->conn->loop->daemon;
    struct umbw_query_request request;
    struct umbs_entry *entry = NULL;
    struct umbd_batch *batch = NULL;
    struct umb_error error;
    enum umb_status status = umbw_decode_query_request(
        call->message, call->message_size, (size_t)daemon->options.max_points, &request, &error);
    if (status == UMB_OK) {
        status = umbs_store_acquire(daemon->store, request.asset, &entry, &error);
    }
    if (status == UMB_OK) {
        /* The points lie in the message, so the batch takes it over. */
        uint8_t *message = call->message;
        call->message = NULL;
        status =
            umbd_batch_create(entry, message, &request.settings, &request.points, &batch, &error);
    }
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
        return;
    }
    batch->want_stats = request.want_stats;
    if (!umbd_call_charge(call, call->charged + batch->value_bytes)) {
        umbd_batch_destroy(batch);
        return;
    }
    if (fits_inline(call->conn->loop, batch)) {
        answer_inline(call, batch);
    } else {
        answer_by_pool(call, batch);
    }
}

void umbd_service_query_done(struct umbd_call *call, struct umbd_batch *batch)
{
    struct umbw_buffer head = {0};
    struct umb_error error;
    if (batch->status == UMB_E_BUSY) {
        shed(call, &batch->error);
        return;
    }
    if (batch->status != UMB_OK) {
        umbd_call_fail_status(call, batch->status, &batch->error);
        return;
    }
    struct umbw_query_reply reply = {
        .visibility = batch->values,
        .visibility_bytes = batch->value_bytes,
        .stats = batch->stats,
        .nanoseconds = batch->cpu_ns,
        .has_stats = batch->want_stats,
    };
    const struct umbs_store_item *item = umbs_entry_item(batch->entry);
    for (size_t i = 0; i < UMB_ID_BYTES; i++) {
        reply.asset_id[i] = item->id[i];
    }
    enum umb_status status = umbw_encode_query_reply_head(&reply, &head, &error);
    if (status != UMB_OK) {
        umbw_buffer_finish(&head);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    uint8_t *values = batch->values;
    batch->values = NULL;
    (void)umbd_call_charge(call, batch->value_bytes); /* less than before: cannot fail */
    umbd_call_reply(call, &head, values, batch->value_bytes);
}
