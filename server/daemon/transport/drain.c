/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The drain, as stages that the tick advances:
 * 1. Health reports NOT_SERVING, so that balancers choose other servers.
 * 2. Listeners close, and every connection gets a GOAWAY that still admits requests on their way.
 * 3. A moment later comes the final GOAWAY. Then calls finish until the timeout.
 *
 * A second signal ends the drain at once. Every loop drains its own connections; the first loop
 * starts the others and is the last to end.
 *
 * Source: RFC 9113 section 6.8 (two GOAWAYs lose no request that was already sent).
 */
#include "daemon/base/service_manager.h"
#include "daemon/transport/conn.h"
#include "daemon/transport/listener.h"

static void enter(struct umbd_loop *loop, enum umbd_drain stage, const char *name)
{
    loop->drain = stage;
    loop->drain_since_ms = uv_now(&loop->uv);
    umbs_log_event(&loop->server->log, UMB_LOG_INFO, "drain", "stage=%s connections=%zu", name,
                   loop->conn_count);
}

/* Health watchers learn the state that begins now. */
static void tick_calls(struct umbd_conn *conn)
{
    (void)conn->server->calls->conn_tick(conn, uv_now(&conn->loop->uv));
}

static void each_conn(struct umbd_loop *loop, void (*act)(struct umbd_conn *conn))
{
    struct umbd_conn *conn = LIST_FIRST(&loop->conns);
    while (conn != NULL) {
        struct umbd_conn *next = LIST_NEXT(conn, link);
        act(conn);
        umbd_conn_flush(conn);
        conn = next;
    }
}

/* Ends the loop: everything is closed, so uv_run returns. */
static void finish(struct umbd_loop *loop)
{
    enter(loop, UMBD_DRAIN_OVER, "over");
    while (!LIST_EMPTY(&loop->conns)) {
        umbd_conn_close(LIST_FIRST(&loop->conns), "server stopped");
    }
    umbd_listeners_close(loop);
    if (loop->index == 0) {
        loop->server->daemon->drained(loop->server);
    }
    uv_stop(&loop->uv);
}

void umbd_loop_drain(struct umbd_loop *loop)
{
    if (loop->index == 0) {
        umbd_loops_drain(loop);
    }
    if (loop->drain != UMBD_DRAIN_NO) {
        if (loop->drain != UMBD_DRAIN_OVER) {
            finish(loop);
        }
        return;
    }
    atomic_store(&loop->server->draining, 1);
    umbd_notify("STOPPING=1\nSTATUS=draining");
    enter(loop, UMBD_DRAIN_DELAY, "delay");
    each_conn(loop, tick_calls);
    umbd_loop_drain_step(loop);
}

void umbd_loop_drain_step(struct umbd_loop *loop)
{
    const struct umbd_options *options = &loop->server->options;
    uint64_t passed_ms = uv_now(&loop->uv) - loop->drain_since_ms;
    if (loop->drain == UMBD_DRAIN_DELAY && passed_ms >= options->drain_delay_ms) {
        umbd_listeners_close(loop);
        enter(loop, UMBD_DRAIN_NOTICE, "notice");
        each_conn(loop, umbd_conn_notice);
        passed_ms = 0;
    }
    if (loop->drain == UMBD_DRAIN_NOTICE &&
        (passed_ms >= UMBD_NOTICE_MS || loop->conn_count == 0)) {
        enter(loop, UMBD_DRAIN_LAST, "last");
        each_conn(loop, umbd_conn_last_call);
        passed_ms = 0;
    }
    if (loop->drain == UMBD_DRAIN_LAST &&
        ((loop->conn_count == 0 &&
          (loop->index != 0 || atomic_load(&loop->server->loops_running) == 1)) ||
         passed_ms >= options->drain_timeout_ms)) {
        finish(loop);
    }
}
