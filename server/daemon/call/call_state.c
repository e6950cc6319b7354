/* SPDX-License-Identifier: Apache-2.0 */
/*
 * State of a call: counted bytes, the message, waiting messages, the task.
 *
 * Invariants: `charged` is exactly what this call has counted on its connection and the process.
 * While `task` is set a worker may read the message, so the call neither frees nor changes it. A
 * failed call keeps no request bytes.
 */
#include "daemon/call/call.h"

#include <stdlib.h>
#include <string.h>

#include "daemon/work/pool.h"
#include "tool/clock.h"

uint64_t umbd_call_now_ms(const struct umbd_call *call)
{
    return uv_now(&call->conn->loop->uv);
}

void umbd_call_uncharge(struct umbd_call *call, size_t bytes)
{
    umbd_conn_uncharge(call->conn, call->charged - bytes);
    call->charged = bytes;
}

/* Counts a request of HTTP/1.1. A client that left before the end gets the status 499. */
static void count_web(struct umbd_call *call, uint64_t duration_ns)
{
    struct umbd_server *server = call->server;
    const struct umbd_web *web = call->web;
    const int is_whole = call->reply_ended && umbd_call_unsent(call) == 0;
    const int status = is_whole ? web->status : 499;
    const uint64_t bytes = web->body_bytes;
    umbd_metrics_http(&server->metrics, status, duration_ns);
    umbd_count(&server->metrics.http_bytes, bytes);
    if (server->log.level >= UMB_LOG_DEBUG) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        UMBD_CONN_LOG(call->conn, UMB_LOG_DEBUG, "http",
                      "request=%d path=%s status=%d bytes=%llu dur_us=%llu", call->stream_id,
                      umbs_log_quote(call->path, quoted), status, (unsigned long long)bytes,
                      (unsigned long long)(duration_ns / 1000));
    }
}

void umbd_call_count(struct umbd_call *call, int code)
{
    struct umbd_server *server = call->server;
    if (call->counted || !call->headers_whole) {
        return;
    }
    uint64_t duration_ns = umbu_clock_ns() - call->started_ns;
    call->counted = 1;
    if (call->web != NULL) {
        count_web(call, duration_ns);
        return;
    }
    umbd_metrics_handled(&server->metrics, call->method, code, duration_ns);
    if (server->log.level >= UMB_LOG_DEBUG) {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        UMBD_CONN_LOG(call->conn, UMB_LOG_DEBUG, "call", "stream=%d method=%s code=%s dur_us=%llu",
                      call->stream_id, umbs_log_quote(call->path, quoted), umbw_grpc_name(code),
                      (unsigned long long)(duration_ns / 1000));
    }
}

size_t umbd_call_unsent(const struct umbd_call *call)
{
    return call->out.size - call->sent;
}

int umbd_call_expired(const struct umbd_call *call)
{
    return call->deadline_ns != 0 && umbu_clock_ns() >= call->deadline_ns;
}

int umbd_call_is_open(const struct umbd_call *call)
{
    return call->refusal != UMBD_REFUSE_NOTHING || call->method->scope == UMBD_SCOPE_NONE;
}

void umbd_call_leave_task(struct umbd_call *call)
{
    struct umbd_task *task = call->task;
    call->task = NULL;
    task->charged = call->charged;
    umbd_conn_hand_over(call->conn, call->charged);
    call->charged = 0;
    if (task->pool != NULL) {
        umbd_task_cancel(task);
    }
}

void umbd_call_drop_message(struct umbd_call *call)
{
    if (!call->message_borrowed) {
        free(call->message);
    }
    call->message = NULL;
    call->message_size = 0;
    call->message_borrowed = 0;
}

uint8_t *umbd_call_take_message(struct umbd_call *call)
{
    uint8_t *message = call->message;
    if (call->message_borrowed) {
        message = malloc(call->message_size > 0 ? call->message_size : 1);
        if (message == NULL) {
            return NULL;
        }
        memcpy(message, call->message, call->message_size);
    }
    call->message = NULL;
    call->message_borrowed = 0;
    return message;
}

/* Returns where data at `at` of the old message is in the moved message; NULL for NULL. */
static const void *moved(const void *at, const uint8_t *from, const uint8_t *to)
{
    return at != NULL ? to + ((const uint8_t *)at - from) : NULL;
}

uint8_t *umbd_call_take_message_of(struct umbd_call *call, struct umb_points *points)
{
    const uint8_t *from = call->message;
    uint8_t *message = umbd_call_take_message(call);
    if (message != NULL) {
        points->positions = moved(points->positions, from, message);
        points->normals = moved(points->normals, from, message);
        points->footprints = moved(points->footprints, from, message);
    }
    return message;
}

/* Hands a finished task to its loop. Any thread. */
static void task_done(struct umbd_task *task)
{
    struct umbd_call_home *home = task->home;
    pthread_mutex_lock(&home->mutex);
    STAILQ_INSERT_TAIL(&home->done, task, done_link);
    pthread_mutex_unlock(&home->mutex);
    uv_async_send(&home->loop->wake);
}

void umbd_call_await(struct umbd_call *call, struct umbd_task *task, size_t bytes)
{
    task->deadline_ns = call->deadline_ns;
    task->lane = call->conn->serial;
    task->stream_id = call->stream_id;
    task->done = task_done;
    task->home = call->home;
    call->task = task;
    call->task_bytes = bytes;
}

enum umb_status umbd_call_send_task(struct umbd_call *call, struct umbd_task *task, size_t bytes,
                                    struct umb_error *error)
{
    umbd_call_await(call, task, bytes); /* before the submit: it may come home at once */
    enum umb_status status = umbd_pool_submit(call->backend->pool, task, error);
    if (status != UMB_OK) {
        call->task = NULL;
        call->task_bytes = 0;
    }
    return status;
}

void umbd_stream_drop(struct umbd_call *call)
{
    while (!STAILQ_EMPTY(&call->queue)) {
        struct umbd_queued *first = STAILQ_FIRST(&call->queue);
        STAILQ_REMOVE_HEAD(&call->queue, link);
        free(first->bytes);
        free(first);
    }
    call->queue_bytes = call->queue_count = 0;
}

void umbd_stream_later(struct umbd_call *call)
{
    call->conn->pump_due = 1;
    umbd_loop_flush_later(call->conn);
}
