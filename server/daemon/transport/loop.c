/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The event loop: timers, finished batches, signals.
 *
 * A batch that ends on a worker's thread is put on done_list, and the loop is woken. Here the loop
 * finds its connection by serial and its stream by number. A batch whose call has ended finds no
 * stream and is only freed.
 */
#include "daemon/transport/loop.h"

#include <signal.h>

#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "daemon/admin.h"
#include "daemon/call/call.h"
#include "daemon/service/job_request.h"
#include "daemon/transport/listener.h"
#include "daemon/transport/loop_group.h"
#include "daemon/transport/loop_reserve.h"
#include "tool/clock.h"

#define LOG_BURST 20 /* warnings about peers at once */
#define LOG_RATE  5  /* warnings a second after the burst */

uint64_t umbd_loop_coarse_ns(const struct umbd_loop *loop)
{
    return uv_now(&loop->uv) * 1000000;
}

int umbd_loop_may_log(struct umbd_loop *loop)
{
    return umbd_bucket_take(&loop->log_budget, uv_hrtime());
}

void umbd_loop_batch_done(struct umbd_batch *batch)
{
    struct umbd_loop *loop = batch->home;
    batch->next_done = NULL;
    pthread_mutex_lock(&loop->done_mutex);
    if (loop->done_last != NULL) {
        loop->done_last->next_done = batch;
    } else {
        loop->done_first = batch;
    }
    loop->done_last = batch;
    pthread_mutex_unlock(&loop->done_mutex);
    uv_async_send(&loop->wake);
}

static void mark_dirty(struct umbd_conn *conn)
{
    if (!conn->dirty) {
        conn->dirty = 1;
        conn->next_dirty = conn->loop->first_dirty;
        conn->loop->first_dirty = conn;
    }
}

void umbd_loop_flush_later(struct umbd_conn *conn)
{
    mark_dirty(conn);
    uv_async_send(&conn->loop->wake);
}

void umbd_loop_forget(struct umbd_conn *conn)
{
    struct umbd_conn **at = &conn->loop->first_dirty;
    if (!conn->dirty) {
        return;
    }
    while (*at != conn) {
        at = &(*at)->next_dirty;
    }
    *at = conn->next_dirty;
    conn->dirty = 0;
}

static void deliver(struct umbd_loop *loop, struct umbd_batch *batch)
{
    struct umbd_conn *conn = umbd_conn_find(loop, batch->lane);
    loop->clock_ns = 0;
    struct umbd_call *call =
        conn != NULL ? nghttp2_session_get_stream_user_data(conn->session, batch->stream_id) : NULL;
    if (call != NULL && call->batch == batch) {
        call->batch = NULL;
        if (batch->work != NULL && umbd_method_asks_points(call->method)) {
            umbd_service_query_calibrated(call, batch);
        } else if (call->method == UMBD_METHOD_REGIONS_DERIVE) {
            umbd_service_derive_done(call, batch);
        } else if (umbd_method_asks_space(call->method)) {
            umbd_service_volume_queries_done(call, batch);
        } else if (batch->work != NULL) {
            umbd_service_regions_done(call, batch);
        } else {
            umbd_service_query_done(call, batch);
        }
        if (umbd_method_takes_many(call->method)) {
            umbd_stream_pump(call);
        }
        mark_dirty(conn);
    } else {
        umbd_daemon_uncharge(loop->daemon, batch->charged);
    }
    umbd_batch_recycle(batch, &loop->spare);
}

/* Goes on with the streams that waited for others, or for the client to read its replies. */
static void pump_streams(struct umbd_conn *conn)
{
    if (!conn->pump_due) {
        return;
    }
    conn->pump_due = 0;
    conn->loop->clock_ns = 0;
    for (struct umbd_call *call = conn->calls; call != NULL; call = call->next) {
        if (call->queue_first != NULL) {
            umbd_stream_pump(call);
        }
    }
}

/* Starts a connection's turn: its time counts from zero in each wake-up. */
static void begin_turn(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    uint64_t now_ms = uv_now(&loop->uv);
    if (loop->inline_at_ms != now_ms) {
        loop->inline_at_ms = now_ms;
        loop->inline_ns = 0;
        loop->clock_ns = 0;
    }
    if (conn->turn_at_ms != now_ms) {
        conn->turn_at_ms = now_ms;
        conn->turn_ns = 0;
    }
}

int umbd_conn_has_turn(struct umbd_conn *conn)
{
    const struct umbd_loop *loop = conn->loop;
    begin_turn(conn);
    return loop->inline_ns < UMBD_INLINE_NS && conn->turn_ns < UMBD_TURN_NS;
}

uint64_t umbd_conn_began(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    begin_turn(conn);
    if (loop->clock_ns == 0) {
        loop->clock_ns = umbu_clock_ns();
    }
    return loop->clock_ns;
}

void umbd_conn_spent(struct umbd_conn *conn, uint64_t began_ns)
{
    struct umbd_loop *loop = conn->loop;
    begin_turn(conn);
    loop->clock_ns = umbu_clock_ns();
    loop->inline_ns += loop->clock_ns - began_ns;
    conn->turn_ns += loop->clock_ns - began_ns;
}

static void release_held(struct umbd_loop *loop)
{
    struct umbd_conn *conn = loop->first_conn;
    while (conn != NULL) {
        struct umbd_conn *next = conn->next;
        umbd_conn_release(conn);
        conn = next;
    }
}

/* Takes the workers' finished batches, then flushes each connection once: the part that a flush
 * leaves for later comes with the loop's next turn. */
static void collect_done(struct umbd_loop *loop)
{
    pthread_mutex_lock(&loop->done_mutex);
    struct umbd_batch *batch = loop->done_first;
    loop->done_first = loop->done_last = NULL;
    pthread_mutex_unlock(&loop->done_mutex);
    while (batch != NULL) {
        struct umbd_batch *next = batch->next_done;
        deliver(loop, batch);
        batch = next;
    }
    umbd_job_requests_collect(loop);
    struct umbd_conn *conn = loop->first_dirty;
    loop->first_dirty = NULL;
    while (conn != NULL) {
        struct umbd_conn *next = conn->next_dirty;
        conn->dirty = 0;
        pump_streams(conn);
        umbd_conn_flush(conn); /* may close this connection, never another */
        umbd_conn_read_again(conn);
        conn = next;
    }
    if (loop->held > 0 && umbd_pool_has_room(loop->daemon->pool)) {
        release_held(loop);
    }
}

static void on_wake(uv_async_t *async)
{
    umbd_loop_take_orders(async->data);
    collect_done(async->data);
}

static void on_tick(uv_timer_t *timer)
{
    struct umbd_loop *loop = timer->data;
    uint64_t now_ms = uv_now(&loop->uv);
    struct umbd_conn *conn = loop->first_conn;
    atomic_store(&loop->ticked_ms, umbu_clock_ns() / 1000000);
    umbd_optimistic_reads_revalidate(loop); /* reads of connections that ended early */
    umbs_reader_refresh(loop->reader);
    loop->tls_looks = 0;
    while (conn != NULL) {
        struct umbd_conn *next = conn->next;
        umbd_conn_tick(conn, now_ms);
        umbd_conn_release(conn);
        conn = next;
    }
    umbd_listeners_tick(loop);
    umbd_admin_tick(loop, now_ms);
    umbd_loop_drain_step(loop);
    if (loop->index == 0) {
        umbd_daemon_alive(loop->daemon, now_ms);
    }
}

static void log_reload(const struct umbd_daemon *daemon, const char *what, enum umb_status status,
                       const struct umb_error *error)
{
    if (status == UMB_OK) {
        umbs_log_event(&daemon->log, UMB_LOG_INFO, "reloaded", "what=%s", what);
    } else {
        umbs_log_event(&daemon->log, UMB_LOG_ERROR, "not_reloaded", "what=%s reason=\"%s\"", what,
                       error->message);
    }
}

/* Reads the small files of secrets; no call waits long for it. An unreadable file changes
 * nothing. */
static void reload_secrets(struct umbd_daemon *daemon)
{
    struct umb_error error;
    if (daemon->tls != NULL) {
        log_reload(daemon, "tls", umbd_tls_reload(daemon->tls, &error), &error);
    }
    if (daemon->tokens != NULL) {
        log_reload(daemon, "tokens", umbd_tokens_reload(daemon->tokens, &error), &error);
    }
}

static void on_signal(uv_signal_t *signal, int number)
{
    struct umbd_loop *loop = signal->data;
    umbs_log_event(&loop->daemon->log, UMB_LOG_INFO, "signal", "number=%d", number);
    if (number == SIGHUP) {
        umbd_daemon_reload(loop->daemon);
        reload_secrets(loop->daemon);
        umbd_store_watch_kick(loop->daemon->watch);
    } else {
        umbd_loop_drain(loop);
    }
}

static void start_handles(struct umbd_loop *loop)
{
    uv_async_init(&loop->uv, &loop->wake, on_wake);
    uv_timer_init(&loop->uv, &loop->tick);
    loop->wake.data = loop->tick.data = loop;
    uv_timer_start(&loop->tick, on_tick, UMBD_TICK_MS, UMBD_TICK_MS);
}

/* Starts what the first loop does for all. */
static void start_watching(struct umbd_loop *loop)
{
    uv_signal_init(&loop->uv, &loop->terminate);
    uv_signal_init(&loop->uv, &loop->interrupt);
    uv_signal_init(&loop->uv, &loop->hangup);
    loop->terminate.data = loop->interrupt.data = loop->hangup.data = loop;
    uv_signal_start(&loop->terminate, on_signal, SIGTERM);
    uv_signal_start(&loop->interrupt, on_signal, SIGINT);
    uv_signal_start(&loop->hangup, on_signal, SIGHUP);
}

static void free_parts(struct umbd_loop *loop)
{
    umbs_reader_close(loop->reader);
    free(loop->read_buffer);
    free(loop->out);
    free(loop->sealed);
}

enum umb_status umbd_loop_init(struct umbd_loop *loop, struct umbd_daemon *daemon, uint32_t index,
                               struct umb_error *error)
{
    memset(loop, 0, sizeof *loop);
    loop->daemon = daemon;
    loop->index = index;
    loop->optimistic.turn = 1;
    UMB__TRY(umbs_reader_open(daemon->store, &loop->reader, error));
    loop->read_buffer = malloc(UMBD_READ_BYTES);
    loop->out = malloc(UMBD_OUT_CAPACITY);
    int code = loop->read_buffer != NULL && loop->out != NULL ? uv_loop_init(&loop->uv) : UV_ENOMEM;
    if (code != 0) {
        free_parts(loop);
        return umb_fail(error, UMB_E_NO_MEMORY, "cannot start a loop: %s", uv_strerror(code));
    }
    enum umb_status status = umbd_loop_reserve(&loop->uv, error);
    if (status != UMB_OK) {
        uv_loop_close(&loop->uv);
        free_parts(loop);
        return status;
    }
    pthread_mutex_init(&loop->done_mutex, NULL);
    umbd_bucket_init(&loop->log_budget, LOG_BURST, LOG_RATE, uv_hrtime());
    start_handles(loop);
    if (index == 0) {
        start_watching(loop);
    }
    return UMB_OK;
}

void umbd_signals_block(void)
{
    sigset_t ours;
    sigemptyset(&ours);
    sigaddset(&ours, SIGTERM);
    sigaddset(&ours, SIGINT);
    sigaddset(&ours, SIGHUP);
    pthread_sigmask(SIG_BLOCK, &ours, NULL);
}

void umbd_loop_run(struct umbd_loop *loop)
{
    sigset_t ours;
    pthread_sigmask(SIG_SETMASK, NULL, &ours);
    sigdelset(&ours, SIGTERM);
    sigdelset(&ours, SIGINT);
    sigdelset(&ours, SIGHUP);
    pthread_sigmask(SIG_SETMASK, &ours, NULL);
    uv_run(&loop->uv, UV_RUN_DEFAULT);
    umbd_signals_block();
}

static void close_handle(uv_handle_t *handle, void *unused)
{
    (void)unused;
    if (!uv_is_closing(handle)) {
        uv_close(handle, NULL);
    }
}

void umbd_loop_stop(struct umbd_loop *loop)
{
    while (loop->first_conn != NULL) {
        umbd_conn_close(loop->first_conn, "server stopped");
    }
    umbd_listeners_close(loop);
    umbd_admin_close(loop);
}

void umbd_loop_finish(struct umbd_loop *loop)
{
    collect_done(loop);
    umbd_optimistic_reads_revalidate(loop);
    free(loop->spare);
    uv_walk(&loop->uv, close_handle, NULL);
    uv_run(&loop->uv, UV_RUN_DEFAULT);
    uv_loop_close(&loop->uv);
    pthread_mutex_destroy(&loop->done_mutex);
    free_parts(loop);
}
