/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The drain, as stages that the tick advances. First NOT_SERVING, so that balancers look away. Then
 * listeners close and every connection gets a GOAWAY that still admits requests on their way. A
 * moment later comes the final GOAWAY; then calls finish until the timeout. A second signal ends
 * the drain at once. Every loop drains its own connections; the first loop starts the others and is
 * the last to end.
 *
 * Source: RFC 9113 section 6.8 (two GOAWAYs lose no request that was already sent).
 */
#include "daemon/admin.h"
#include "daemon/call/call.h"
#include "daemon/transport/conn_tls.h"
#include "daemon/transport/listener.h"
#include "daemon/transport/loop_group.h"
#include "daemon/base/service_manager.h"

static void enter(struct umbd_loop *loop, enum umbd_drain stage, const char *name)
{
    loop->drain = stage;
    loop->drain_since_ms = uv_now(&loop->uv);
    umbs_log_event(&loop->daemon->log, UMB_LOG_INFO, "drain", "stage=%s connections=%zu", name,
                   loop->conn_count);
}

static void tell_watchers(struct umbd_conn *conn)
{
    for (struct umbd_call *call = conn->calls; call != NULL; call = call->next) {
        if (call->watch_last >= 0) {
            umbd_service_health_update(call);
        }
    }
}

void umbd_conn_notice(struct umbd_conn *conn)
{
    nghttp2_submit_shutdown_notice(conn->session);
}

/* A drain does not wait for calls without rights: it answers them, then resets those still open. */
static void end_open_calls(struct umbd_conn *conn)
{
    int found = 0;
    for (struct umbd_call *call = conn->calls; call != NULL; call = call->next) {
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
    for (struct umbd_call *call = conn->calls; call != NULL; call = call->next) {
        if (!call->headers_whole || umbd_call_is_open(call)) {
            umbd_call_cut_open(call);
        }
    }
}

/* Watch calls and streams would never end by themselves. */
void umbd_conn_last_call(struct umbd_conn *conn)
{
    if (conn->tls != NULL && !umbd_conn_tls_ready(conn)) {
        umbd_conn_close(conn, "the server stopped during the handshake");
        return;
    }
    end_open_calls(conn);
    if (conn->closing) {
        return;
    }
    for (struct umbd_call *call = conn->calls; call != NULL; call = call->next) {
        if (call->method == UMBD_METHOD_BAKES_WATCH) {
            umbd_call_fail(call, UMBW_GRPC_UNAVAILABLE, "server: shutting down");
        } else if (umbd_method_takes_many(call->method)) {
            umbd_stream_last_call(call);
        }
    }
    nghttp2_submit_goaway(conn->session, NGHTTP2_FLAG_NONE,
                          nghttp2_session_get_last_proc_stream_id(conn->session), NGHTTP2_NO_ERROR,
                          NULL, 0);
}

static void each_conn(struct umbd_loop *loop, void (*act)(struct umbd_conn *conn))
{
    struct umbd_conn *conn = loop->first_conn;
    while (conn != NULL) {
        struct umbd_conn *next = conn->next;
        act(conn);
        umbd_conn_flush(conn);
        conn = next;
    }
}

/* Ends the loop: everything is closed, so uv_run returns. */
static void finish(struct umbd_loop *loop)
{
    enter(loop, UMBD_DRAIN_OVER, "over");
    while (loop->first_conn != NULL) {
        umbd_conn_close(loop->first_conn, "server stopped");
    }
    umbd_listeners_close(loop);
    umbd_admin_close(loop);
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
    atomic_store(&loop->daemon->draining, 1);
    umbd_notify("STOPPING=1\nSTATUS=draining");
    enter(loop, UMBD_DRAIN_DELAY, "delay");
    each_conn(loop, tell_watchers);
    umbd_loop_drain_step(loop);
}

void umbd_loop_drain_step(struct umbd_loop *loop)
{
    const struct umbd_options *options = &loop->daemon->options;
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
        ((loop->conn_count == 0 && (loop->index != 0 || umbd_loops_running(loop->daemon) == 1)) ||
         passed_ms >= options->drain_timeout_ms)) {
        finish(loop);
    }
}
