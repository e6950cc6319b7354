/* SPDX-License-Identifier: Apache-2.0 */
/* Handlers of the transport's events for calls, and the return of finished tasks to their calls. */
#include "daemon/call/call.h"

#include <stdlib.h>

#include "daemon/work/pool.h"

/* --- Of a connection --- */

static int is_sending(const struct umbd_conn *conn)
{
    const struct umbd_call *call = LIST_FIRST(&conn->calls);
    while (call != NULL && umbd_call_unsent(call) == 0) {
        call = LIST_NEXT(call, link);
    }
    return call != NULL;
}

static int tick(struct umbd_conn *conn, uint64_t now_ms)
{
    for (struct umbd_call *call = LIST_FIRST(&conn->calls); call != NULL;
         call = LIST_NEXT(call, link)) {
        if (!umbd_call_tick(call, now_ms)) {
            return 0;
        }
    }
    return 1;
}

static void pump(struct umbd_conn *conn)
{
    for (struct umbd_call *call = LIST_FIRST(&conn->calls); call != NULL;
         call = LIST_NEXT(call, link)) {
        if (!STAILQ_EMPTY(&call->queue)) {
            umbd_stream_pump(call);
        }
    }
}

/* Ends the connection's calls without rights for a drain, which does not wait for them. They are
 * answered first; those that are still open are then reset. */
static void end_open_calls(struct umbd_conn *conn)
{
    int found = 0;
    for (struct umbd_call *call = LIST_FIRST(&conn->calls); call != NULL;
         call = LIST_NEXT(call, link)) {
        const int is_open = !call->headers_whole || umbd_call_is_open(call);
        if (is_open && call->headers_whole) {
            umbd_call_fail(call, UMBW_GRPC_UNAVAILABLE, "server: shutting down");
        }
        found |= is_open;
    }
    if (!found) {
        return;
    }
    umbd_conn_flush(conn); /* ends calls; may close the connection, which then has none */
    for (struct umbd_call *call = LIST_FIRST(&conn->calls); call != NULL;
         call = LIST_NEXT(call, link)) {
        if (!call->headers_whole || umbd_call_is_open(call)) {
            umbd_call_cut_open(call);
        }
    }
}

static void last_call(struct umbd_conn *conn)
{
    end_open_calls(conn);
    for (struct umbd_call *call = LIST_FIRST(&conn->calls); call != NULL;
         call = LIST_NEXT(call, link)) {
        if ((call->method->traits & UMBD_ENDLESS) != 0) {
            umbd_call_fail(call, UMBW_GRPC_UNAVAILABLE, "server: shutting down");
        } else if (umbd_takes_many(call->method)) {
            umbd_stream_last_call(call);
        }
    }
}

static void end(struct umbd_conn *conn)
{
    while (!LIST_EMPTY(&conn->calls)) {
        umbd_call_destroy(LIST_FIRST(&conn->calls));
    }
    umbd_conn_forget_rights(conn);
}

/* --- Of a loop --- */

static enum umb_status open_home(struct umbd_loop *loop, struct umb_error *error)
{
    struct umbd_call_home *home = calloc(1, sizeof *home);
    if (home == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a loop");
    }
    home->loop = loop;
    home->backend = loop->server->backend;
    home->optimistic.turn = 1;
    STAILQ_INIT(&home->done);
    enum umb_status status = umbs_reader_open(home->backend->store, &home->reader, error);
    if (status != UMB_OK) {
        free(home);
        return status;
    }
    pthread_mutex_init(&home->mutex, NULL);
    loop->home = home;
    return UMB_OK;
}

static void settle(struct umbd_loop *loop)
{
    umbd_optimistic_reads_revalidate(loop->home);
}

static void close_home(struct umbd_loop *loop)
{
    settle(loop);
    umbs_reader_close(loop->home->reader);
    pthread_mutex_destroy(&loop->home->mutex);
    free(loop->home->spare);
    free(loop->home);
    loop->home = NULL;
}

/* Gives a finished task back to its call. If the call has ended, the task is only freed. */
static void deliver(struct umbd_loop *loop, struct umbd_task *task)
{
    struct umbd_conn *conn = umbd_conn_find(loop, task->lane);
    loop->clock_ns = 0;
    struct umbd_call *call = conn != NULL ? conn->protocol->find(conn, task->stream_id) : NULL;
    if (call == NULL || call->task != task) {
        umbd_server_uncharge(loop->server, task->charged);
        task->free(task);
        return;
    }
    call->task = NULL;
    task->answer(call, task);
    if (umbd_takes_many(call->method)) {
        umbd_stream_pump(call);
    }
    umbd_loop_mark(conn);
    if (!task->is_kept) {
        task->free(task);
    }
}

static void take_done(struct umbd_loop *loop)
{
    struct umbd_call_home *home = loop->home;
    pthread_mutex_lock(&home->mutex);
    struct umbd_task *task = STAILQ_FIRST(&home->done);
    STAILQ_INIT(&home->done);
    pthread_mutex_unlock(&home->mutex);
    while (task != NULL) {
        struct umbd_task *next = STAILQ_NEXT(task, done_link);
        deliver(loop, task);
        task = next;
    }
}

static void tick_home(struct umbd_loop *loop)
{
    settle(loop); /* reads of connections that ended early */
    umbs_reader_refresh(loop->home->reader);
}

static int has_room(const struct umbd_loop *loop)
{
    return umbd_pool_has_room(loop->home->backend->pool);
}

static struct umbd_call *find_web(struct umbd_conn *conn, int32_t number)
{
    struct umbd_call *call = LIST_FIRST(&conn->calls);
    while (call != NULL && call->stream_id != number) {
        call = LIST_NEXT(call, link);
    }
    return call;
}

const struct umbd_call_events umbd_call_events = {
    .open = umbd_call_create,
    .header = umbd_call_header,
    .headers_end = umbd_call_headers_end,
    .room = umbd_call_room,
    .data = umbd_call_data,
    .request_end = umbd_call_request_end,
    .take_body = umbd_call_take_body,
    .close = umbd_call_destroy,
    .web_request = umbd_web_request,
    .web_unsent = umbd_call_unsent,
    .web_is_over = umbd_web_is_over,
    .web_find = find_web,
    .conn_is_sending = is_sending,
    .conn_tick = tick,
    .conn_pump = pump,
    .conn_last_call = last_call,
    .conn_end = end,
    .loop_open = open_home,
    .loop_close = close_home,
    .loop_woken = take_done,
    .loop_tick = tick_home,
    .loop_settle = settle,
    .loop_has_room = has_room,
};
