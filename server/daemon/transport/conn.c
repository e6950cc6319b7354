/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Connections of a loop: finding, ending and closing them.
 *
 * Safety rules: nghttp2's callbacks only queue; only this file, conn_io.c and conn_life.c receive,
 * send and close. A closed connection stays in memory, with `closing` set, until libuv has closed
 * its handle. A pointer that is held across a flush therefore stays valid for the rest of the
 * event.
 */
#include "daemon/transport/conn.h"

#include <stdlib.h>

#include "daemon/transport/conn_tls.h"
#include "tool/clock.h"

static size_t bucket_of(uint64_t serial)
{
    return (size_t)serial & (UMBD_CONN_BUCKETS - 1);
}

struct umbd_conn *umbd_conn_find(struct umbd_loop *loop, uint64_t serial)
{
    struct umbd_conn *conn = loop->by_serial[bucket_of(serial)];
    while (conn != NULL && conn->serial != serial) {
        conn = conn->next_in_bucket;
    }
    return conn;
}

void umbd_conn_link(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    struct umbd_conn **bucket = &loop->by_serial[bucket_of(conn->serial)];
    conn->next_in_bucket = *bucket;
    *bucket = conn;
    LIST_INSERT_HEAD(&loop->conns, conn, link);
    loop->conn_count++;
    atomic_fetch_add(&loop->load, 1);
    atomic_fetch_add(&loop->server->metrics.connections, 1);
}

static void unlink_conn(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    struct umbd_conn **at = &loop->by_serial[bucket_of(conn->serial)];
    while (*at != conn) {
        at = &(*at)->next_in_bucket;
    }
    *at = conn->next_in_bucket;
    LIST_REMOVE(conn, link);
    loop->conn_count--;
    loop->held -= conn->held ? 1U : 0U;
    conn->held = 0;
    atomic_fetch_sub(&loop->load, 1);
    atomic_fetch_sub(&loop->server->metrics.connections, 1);
}

void umbd_conn_closed(uv_handle_t *handle)
{
    free(handle->data);
}

/* Sends close_notify, so that a TLS peer can tell a close from a cut. */
static void say_bye(struct umbd_conn *conn)
{
    const uint8_t *bytes = NULL;
    size_t size = 0;
    if (conn->tls == NULL || conn->write_pending) {
        return;
    }
    umbn_tls_bye(conn->tls->session);
    if (umbd_conn_tls_seal(conn, 0, &bytes, &size) && size > 0) {
        uv_buf_t buffer = uv_buf_init((char *)(uintptr_t)bytes, (unsigned)size);
        (void)uv_try_write(&conn->socket.stream, &buffer, 1);
    }
}

void umbd_conn_close(struct umbd_conn *conn, const char *why)
{
    if (conn->closing) {
        return;
    }
    conn->closing = 1;
    UMBD_CONN_LOG(conn, UMB_LOG_DEBUG, "conn_closed", "calls=%zu reason=\"%s\"", conn->call_count,
                  why);
    conn->server->calls->conn_end(conn);
    conn->protocol->stop(conn);
    say_bye(conn);
    umbd_conn_tls_finish(conn);
    umbd_conn_leave(conn);
    umbd_peers_release(conn->server->peers, conn->account, umbu_clock_ns());
    umbd_loop_forget(conn);
    unlink_conn(conn);
    uv_close(&conn->socket.handle, umbd_conn_closed);
}

void umbd_conn_terminate(struct umbd_conn *conn, uint32_t code)
{
    if (!conn->terminated) {
        conn->terminated = 1;
        conn->terminated_ms = uv_now(&conn->loop->uv);
        conn->protocol->terminate(conn, code);
    }
}

void umbd_conn_abuse(struct umbd_conn *conn, enum umbd_abuse kind, const char *why)
{
    umbd_count(&conn->server->metrics.abuse[kind], 1);
    if (umbd_loop_may_log(conn->loop)) {
        UMBD_CONN_LOG(conn, UMB_LOG_WARN, "h2_abuse", "reason=\"%s\"", why);
    }
    umbd_conn_terminate(conn, NGHTTP2_ENHANCE_YOUR_CALM);
}

void umbd_conn_cut(struct umbd_conn *conn, const char *timer)
{
    umbd_count(&conn->server->metrics.abuse[UMBD_ABUSE_TIMEOUT], 1);
    if (umbd_loop_may_log(conn->loop)) {
        UMBD_CONN_LOG(conn, UMB_LOG_INFO, "conn_timeout", "timer=%s", timer);
    }
    umbd_conn_close(conn, timer);
}

void umbd_conn_notice(struct umbd_conn *conn)
{
    conn->leaving = 1;
    conn->protocol->notice(conn);
}

void umbd_conn_last_call(struct umbd_conn *conn)
{
    if (conn->tls != NULL && !umbn_tls_ready(conn->tls->session)) {
        umbd_conn_close(conn, "the server stopped during the handshake");
        return;
    }
    conn->server->calls->conn_last_call(conn);
    if (!conn->closing) {
        conn->protocol->last_call(conn);
    }
}
