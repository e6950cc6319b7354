/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Calls with a stream of requests: QueryStream, Follow, Submit and reflection.
 *
 * One message is served at a time, so replies come in order. A message that arrives meanwhile waits
 * in a queue. A stream also waits for a task away from the loop, for a client that does not read
 * its replies (UMBD_BACKLOG_BYTES), and for its share of this turn of the loop.
 *
 * While more than UMBD_BACKLOG_BYTES wait, the stream's window is not opened again. Flow control
 * therefore stops a client that writes ahead or does not read: the stream holds at most one window
 * more than that.
 *
 * Invariants: queue_bytes is the sum of the sizes in the queue. The bytes returned to the window
 * and those in window_held add up to the bytes received. A failed call has an empty queue.
 */
#include "daemon/call/call.h"

#include <stdlib.h>
#include <string.h>

#define QUEUED_OVERHEAD 64 /* counted for a queued message beside its bytes */

static int may_serve(const struct umbd_call *call)
{
    return call->task == NULL && !call->reply_ended && umbd_call_unsent(call) < UMBD_BACKLOG_BYTES;
}

/* Bytes of the waiting messages, with their overhead in memory. */
static size_t waiting_bytes(const struct umbd_call *call)
{
    return call->queue_bytes + call->queue_count * QUEUED_OVERHEAD;
}

void umbd_stream_charge(struct umbd_call *call)
{
    if (!umbd_takes_many(call->method)) {
        return;
    }
    size_t held = call->reader.received + waiting_bytes(call) +
                  (call->task != NULL ? call->task_bytes : 0) + umbd_call_unsent(call) +
                  call->kept_bytes;
    if (held < call->charged) {
        umbd_call_uncharge(call, held);
    }
}

static enum umb_status enqueue(struct umbd_call *call, uint8_t *message, size_t size, int owned)
{
    struct umbd_queued *queued = NULL;
    if (umbd_call_charge(call, call->charged + QUEUED_OVERHEAD)) {
        queued = malloc(sizeof *queued);
    }
    if (queued != NULL && !owned) {
        uint8_t *copy = malloc(size > 0 ? size : 1);
        if (copy != NULL && size > 0) {
            memcpy(copy, message, size);
        }
        message = copy;
        owned = 1;
    }
    if (queued == NULL || message == NULL) {
        if (owned) {
            free(message);
        }
        free(queued);
        return UMB_E_NO_MEMORY;
    }
    *queued = (struct umbd_queued){.bytes = message, .size = size};
    STAILQ_INSERT_TAIL(&call->queue, queued, link);
    call->queue_bytes += size;
    call->queue_count++;
    return UMB_OK;
}

void umbd_call_serve(struct umbd_call *call)
{
    call->method->serve(call);
    umbd_call_drop_message(call);
}

/* Ends the reply of a stream whose requests are all served. */
static void end_requests(struct umbd_call *call)
{
    if (call->method->end != NULL) {
        call->method->end(call);
    } else {
        umbd_call_finish(call);
    }
}

static void serve(struct umbd_call *call, uint8_t *message, size_t size, int owned)
{
    call->message = message;
    call->message_size = size;
    call->message_borrowed = !owned;
    umbd_call_serve(call);
}

enum umb_status umbd_stream_message(struct umbd_call *call, uint8_t *message, size_t size,
                                    int owned)
{
    if (STAILQ_EMPTY(&call->queue) && may_serve(call) && umbd_conn_has_turn(call->conn)) {
        serve(call, message, size, owned);
        return call->reply_ended ? UMB_E_CANCELLED : UMB_OK;
    }
    enum umb_status status = enqueue(call, message, size, owned);
    if (status == UMB_OK && may_serve(call)) {
        umbd_stream_later(call);
    }
    return status;
}

/* Opens the stream's window for the bytes that are no longer ahead. */
static void give_back(struct umbd_call *call)
{
    if (call->window_held > 0 && waiting_bytes(call) < UMBD_BACKLOG_BYTES) {
        size_t held = call->window_held;
        call->window_held = 0;
        if (nghttp2_session_consume_stream(call->conn->session, call->stream_id, held) ==
            NGHTTP2_ERR_NOMEM) {
            umbd_conn_terminate(call->conn, NGHTTP2_INTERNAL_ERROR);
        }
    }
}

size_t umbd_stream_window(struct umbd_call *call, size_t size)
{
    if (waiting_bytes(call) < UMBD_BACKLOG_BYTES || call->reply_ended) {
        return size;
    }
    call->window_held += size;
    return 0;
}

void umbd_stream_pump(struct umbd_call *call)
{
    while (!STAILQ_EMPTY(&call->queue) && may_serve(call)) {
        if (!umbd_conn_has_turn(call->conn)) {
            umbd_stream_later(call);
            return;
        }
        struct umbd_queued *first = STAILQ_FIRST(&call->queue);
        uint8_t *bytes = first->bytes;
        size_t size = first->size;
        STAILQ_REMOVE_HEAD(&call->queue, link);
        call->queue_bytes -= size;
        call->queue_count--;
        free(first);
        serve(call, bytes, size, 1);
    }
    give_back(call);
    umbd_stream_charge(call);
    if (call->reply_ended || call->task != NULL || !STAILQ_EMPTY(&call->queue)) {
        return;
    }
    if (call->request_ended) {
        /* Each request pays the price of a call. If a stream had no requests, it pays that price
         * here. */
        if (call->message_count > 0 || umbd_call_take_points(call, UMBD_CALL_POINTS)) {
            end_requests(call);
        }
    } else if (call->last_call) {
        umbd_call_fail(call, UMBW_GRPC_UNAVAILABLE, "server: shutting down");
    }
}

void umbd_stream_last_call(struct umbd_call *call)
{
    call->last_call = 1;
    umbd_stream_pump(call);
}
