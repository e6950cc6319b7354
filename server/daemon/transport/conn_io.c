/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A connection's socket: reading and writing. Bytes from the socket pass the TLS session, if there
 * is one, and go to the protocol. What the protocol sends is collected in the loop's buffer, sealed
 * by TLS, and written at once as far as the socket takes it.
 */
#include <openssl/err.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/transport/conn.h"
#include "daemon/transport/conn_tls.h"

#define FLUSH_BYTES (1 << 20) /* bytes of one flush, then other connections have their turn */

/* One write under way; the block follows. */
struct pending_write {
    uv_write_t request;
    struct umbd_conn *conn;
    size_t count;
    uint8_t bytes[];
};

/* Collects output into the loop's buffer. Returns 0 or the protocol's error. */
static int collect(struct umbd_conn *conn)
{
    conn->loop->out_size = 0;
    if (conn->tls != NULL && !umbn_tls_ready(conn->tls->session)) {
        return 0; /* only the handshake has bytes to send yet */
    }
    return conn->protocol->collect(conn);
}

static void on_written(uv_write_t *request, int status)
{
    struct pending_write *write = request->data;
    struct umbd_conn *conn = write->conn;
    umbd_conn_uncharge(conn, write->count);
    free(write);
    conn->write_pending = 0;
    if (conn->closing) {
        return;
    }
    if (status < 0) {
        umbd_conn_close(conn, uv_strerror(status));
    } else {
        umbd_conn_flush(conn);
    }
}

/* Copies the bytes that the socket did not take, and lets libuv write the copy. Returns 0 on
 * failure. The block is counted even beyond all budgets, because budgets only refuse new work. */
static int write_later(struct umbd_conn *conn, const uint8_t *bytes, size_t count)
{
    struct pending_write *write = malloc(sizeof *write + count);
    if (write == NULL) {
        return 0;
    }
    memcpy(write->bytes, bytes, count);
    write->conn = conn;
    write->request.data = write;
    uv_buf_t buffer = uv_buf_init((char *)write->bytes, (unsigned)count);
    if (uv_write(&write->request, &conn->socket.stream, &buffer, 1, on_written) != 0) {
        free(write);
        return 0;
    }
    write->count = count;
    conn->write_pending = 1;
    umbd_conn_charge_always(conn, count);
    return 1;
}

/* Makes the next block to send; *size is 0 if there is nothing to send. Returns 0 if the connection
 * had to be closed. */
static int next_block(struct umbd_conn *conn, const uint8_t **bytes, size_t *size)
{
    struct umbd_loop *loop = conn->loop;
    int code = collect(conn);
    if (code != 0) {
        umbd_conn_close(conn, conn->protocol->error_text(code));
        return 0;
    }
    *bytes = loop->out;
    *size = loop->out_size;
    if (conn->tls != NULL && !umbd_conn_tls_seal(conn, loop->out_size, bytes, size)) {
        umbd_conn_close(conn, "cannot seal");
        return 0;
    }
    return 1;
}

void umbd_conn_flush(struct umbd_conn *conn)
{
    uint64_t until = conn->sent_bytes + FLUSH_BYTES;
    conn->server->calls->loop_settle(conn->loop); /* before frames are made of the replies */
    while (!conn->closing && !conn->write_pending) {
        const uint8_t *bytes = NULL;
        size_t size = 0;
        if (conn->sent_bytes >= until) {
            umbd_loop_flush_later(conn);
            return;
        }
        if (!next_block(conn, &bytes, &size)) {
            return;
        }
        if (size == 0) {
            break;
        }
        conn->sent_bytes += size;
        uv_buf_t buffer = uv_buf_init((char *)(uintptr_t)bytes, (unsigned)size);
        int written = uv_try_write(&conn->socket.stream, &buffer, 1);
        size_t taken = written > 0 ? (size_t)written : 0;
        if (written < 0 && written != UV_EAGAIN) {
            umbd_conn_close(conn, uv_strerror(written));
        } else if (taken < size && !write_later(conn, bytes + taken, size - taken)) {
            umbd_conn_close(conn, "cannot write");
        }
    }
    if (!conn->closing && !conn->write_pending && conn->protocol->is_over(conn)) {
        umbd_conn_close(conn, "session over");
    }
}

static void on_alloc(uv_handle_t *handle, size_t suggested, uv_buf_t *buffer)
{
    struct umbd_conn *conn = handle->data;
    uint8_t *place = NULL;
    const size_t room = conn->protocol->room(conn, &place);
    (void)suggested;
    *buffer = uv_buf_init((char *)place, (unsigned)room);
}

/* The library ended the session: sends its last frames, then closes. */
static void session_broke(struct umbd_conn *conn, int code)
{
    const char *reason = conn->protocol->error_text(code);
    umbd_count(&conn->server->metrics.abuse[UMBD_ABUSE_LIBRARY], 1);
    if (umbd_loop_may_log(conn->loop)) {
        UMBD_CONN_LOG(conn, UMB_LOG_INFO, "h2_error", "reason=\"%s\"", reason);
    }
    umbd_conn_flush(conn);
    umbd_conn_close(conn, reason);
}

/* Sends the alert and closes the connection: TLS failed, or the peer was not accepted. */
static void tls_broke(struct umbd_conn *conn)
{
    umbd_count(&conn->server->metrics.tls_failures, 1);
    if (umbd_loop_may_log(conn->loop)) {
        char reason[160] = "no protocol in common, or cut";
        unsigned long code = ERR_peek_last_error();
        if (code != 0) {
            ERR_error_string_n(code, reason, sizeof reason);
        }
        UMBD_CONN_LOG(conn, UMB_LOG_INFO, "tls_failed", "reason=\"%s\"", reason);
    }
    ERR_clear_error();
    umbd_conn_flush(conn);
    umbd_conn_close(conn, "TLS failed");
}

static int feed_tls(struct umbd_conn *conn, const uint8_t *bytes, size_t count)
{
    int code = umbn_tls_open(conn->tls->session, bytes, count, conn->protocol->feed, conn);
    /* The next connection needs the loop's buffer. */
    if (conn->write_pending && !umbd_conn_tls_keep(conn)) {
        return UMBN_TLS_BROKEN;
    }
    return code;
}

/* Ends a turn that took too long to read, above all because of inflating. libuv reads on as long as
 * a peer sends, so all other connections would wait. A decompression bomb of 4 kB takes 10 ms. */
static void pause_if_long(struct umbd_conn *conn)
{
    if (!conn->closing && conn->turn_ns >= UMBD_INLINE_NS &&
        conn->turn_at_ms == uv_now(&conn->loop->uv)) {
        conn->paused = conn->was_long = 1;
        uv_read_stop(&conn->socket.stream);
        umbd_loop_flush_later(conn);
    }
}

/* Stops reading while the protocol has no room, until umbd_conn_read_again. */
static void pause_if_full(struct umbd_conn *conn)
{
    if (!conn->closing && !conn->protocol->has_room(conn)) {
        conn->paused = 1;
        uv_read_stop(&conn->socket.stream);
    }
}

static void take_read(struct umbd_conn *conn, ssize_t count, const uv_buf_t *buffer)
{
    const uint8_t *bytes = (const uint8_t *)buffer->base;
    if (count < 0) {
        umbd_conn_close(conn, uv_strerror((int)count));
        return;
    }
    if (count == 0 || conn->closing) {
        return;
    }
    unsigned before = conn->filter.odd;
    conn->loop->clock_ns = 0;
    int code = conn->tls != NULL ? feed_tls(conn, bytes, (size_t)count)
                                 : conn->protocol->feed(conn, bytes, (size_t)count);
    for (; code == 0 && !conn->terminated && before != conn->filter.odd; before++) {
        if (!umbd_bucket_take(&conn->control, uv_hrtime())) {
            umbd_conn_abuse(conn, UMBD_ABUSE_CONTROL, "too many frames that nothing needs");
        }
    }
    if (code == UMBN_TLS_BROKEN || code == UMBN_TLS_NO_PROTOCOL) {
        tls_broke(conn);
    } else if (code == UMBN_TLS_OVER) {
        umbd_conn_flush(conn);
        umbd_conn_close(conn, "the peer said goodbye");
    } else if (code != 0) {
        session_broke(conn, code);
    } else {
        umbd_conn_flush(conn);
        pause_if_long(conn);
        pause_if_full(conn);
    }
}

int umbd_conn_dismiss(struct umbd_conn *conn)
{
    if (conn == NULL) {
        return 0;
    }
    umbd_count(&conn->server->metrics.connections_evicted, 1);
    umbd_conn_terminate(conn, NGHTTP2_NO_ERROR);
    umbd_conn_flush(conn);
    umbd_conn_close(conn, "closed to make room for other connections");
    return 1;
}

/* Closes strangers (connections without rights), oldest first, while they hold more than their
 * share of --max-buffer. */
static void relieve(struct umbd_loop *loop)
{
    struct umbd_server *server = loop->server;
    loop->crowded = 0;
    while (TAILQ_FIRST(&loop->strangers) != NULL &&
           atomic_load(&server->stranger_buffered) > server->options.max_buffer / UMBD_KEPT_SHARE) {
        (void)umbd_conn_dismiss(TAILQ_FIRST(&loop->strangers));
    }
}

static void on_read(uv_stream_t *stream, ssize_t count, const uv_buf_t *buffer)
{
    struct umbd_conn *conn = stream->data;
    take_read(conn, count, buffer);
    if (conn->loop->crowded) {
        relieve(conn->loop);
    }
}

int umbd_conn_read_start(struct umbd_conn *conn)
{
    return uv_read_start(&conn->socket.stream, on_alloc, on_read);
}

void umbd_conn_hold(struct umbd_conn *conn)
{
    if (!conn->held && !conn->closing) {
        conn->held = conn->paused = 1;
        conn->loop->held++;
        uv_read_stop(&conn->socket.stream);
    }
}

void umbd_conn_release(struct umbd_conn *conn)
{
    if (conn->held) {
        conn->held = 0;
        conn->loop->held--;
        umbd_conn_read_again(conn);
    }
}

void umbd_conn_read_again(struct umbd_conn *conn)
{
    if (conn->paused && !conn->held && !conn->closing && conn->protocol->has_room(conn)) {
        conn->paused = 0;
        if (umbd_conn_read_start(conn) != 0) {
            umbd_conn_close(conn, "cannot go on reading");
        }
    }
}
