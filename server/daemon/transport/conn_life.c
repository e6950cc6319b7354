/* SPDX-License-Identifier: Apache-2.0 */
/* A connection's life: admission and timers. */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/transport/conn.h"
#include "daemon/transport/conn_tls.h"
#include "tool/clock.h"

#define TERMINATED_MS 5000   /* for a GOAWAY to be sent and the peer to leave */
#define KEEPALIVE_S   60     /* silence after which the kernel probes a peer */
#define SLOWEST_BYTES 16     /* bytes a millisecond that a peer must read while a reply waits */
#define HOLD_MS       600000 /* milliseconds in which a peer must read all bytes held for it */
#define AGE_SHARE                                                                                  \
    10 /* Largest deviation of a connection's age limit from --max-age, as a divisor: 10 = a
          tenth */
#define STALL_MARGIN_MS 1000 /* stalled streams are reset first, the others go on */

/* Returns the time when a connection is asked to leave. Connections that came together must not
 * leave together. So each gets its own age limit, within a tenth of --max-age, by a multiplicative
 * hash of its serial. */
static uint64_t retirement_ms(const struct umbd_conn *conn, uint64_t max_age_ms)
{
    uint64_t spread_ms = 2 * max_age_ms / AGE_SHARE;
    uint64_t draw = (conn->serial * 0x9E3779B97F4A7C15U) >> 32;
    return max_age_ms == 0 ? 0
                           : conn->opened_ms + max_age_ms - spread_ms / 2 +
                                 (uint64_t)(((double)spread_ms * (double)draw) / 4294967296.0);
}

/* A connection that is being admitted. */
struct newcomer {
    struct umbd_conn *conn;
    struct umbd_socket socket;
    int room_elsewhere; /* 1: its address has connections without rights on another loop */
    const char *reason; /* Reason why it is not admitted */
};

/* Identifies the peer and counts the connection for its address. Returns 0 if the address has too
 * many connections. */
static int know_peer(struct newcomer *newcomer)
{
    struct umbd_conn *conn = newcomer->conn;
    const enum umbn_transport transport = newcomer->socket.transport;
    struct umbd_server *server = conn->server;
    struct sockaddr_storage address;
    memset(&address, 0, sizeof address);
    int size = sizeof address;
    if (transport == UMBN_UNIX) {
        snprintf(conn->peer, sizeof conn->peer, "unix");
    } else if (uv_tcp_getpeername(&conn->socket.tcp, (struct sockaddr *)&address, &size) == 0) {
        umbd_address_text(&address, conn->peer, sizeof conn->peer);
    } else {
        snprintf(conn->peer, sizeof conn->peer, "unknown");
    }
    const struct sockaddr_storage *from = transport == UMBN_UNIX ? NULL : &address;
    /* Peers of a Unix socket have no addresses; the mode of the socket decides which users
     * connect. */
    const size_t limit = from != NULL ? server->options.max_address_connections : SIZE_MAX;
    size_t strangers = 0;
    const int known = umbd_peers_acquire(server->peers, from, limit, &conn->account, &strangers,
                                         &newcomer->reason) ||
                      (umbd_conn_make_room_at(conn->loop, from) &&
                       umbd_peers_acquire(server->peers, from, limit, &conn->account, &strangers,
                                          &newcomer->reason));
    newcomer->room_elsewhere = !known && strangers > 0;
    return known;
}

/* Charges a TLS handshake to the rate of its address. Returns 0 if the rate is exceeded. */
static int may_shake_hands(struct umbd_conn *conn, const char **reason)
{
    struct umbd_server *server = conn->server;
    uint64_t wait_ns = 0;
    *reason = "too many TLS handshakes of one address";
    if (umbd_rate_take(&conn->account->handshake_until_ns, server->options.address_handshakes, 1,
                       umbu_clock_ns(), &wait_ns)) {
        return 1;
    }
    umbd_count(&server->metrics.handshakes_refused, 1);
    return 0;
}

/* Checks the address's limits first and then makes room, so a refused connection evicts no
 * connection of another address. Returns 0 with the reason; the account is then released. */
static int admit(struct newcomer *newcomer)
{
    struct umbd_conn *conn = newcomer->conn;
    if (!know_peer(newcomer)) {
        return 0;
    }
    int admitted =
        newcomer->socket.transport != UMBN_TLS || may_shake_hands(conn, &newcomer->reason);
    if (admitted && !umbd_conn_make_room(conn->loop)) {
        newcomer->reason = "too many connections";
        admitted = 0;
    }
    if (!admitted) {
        umbd_peers_release(conn->server->peers, conn->account, umbu_clock_ns());
    }
    return admitted;
}

static void refuse(struct umbd_conn *conn, const char *reason)
{
    umbd_count(&conn->server->metrics.connections_refused, 1);
    umbs_log_event(&conn->server->log, UMB_LOG_DEBUG, "conn_refused", "peer=\"%s\" reason=\"%s\"",
                   conn->peer, reason);
    uv_close(&conn->socket.handle, umbd_conn_closed);
}

/* Passes a copy of the socket to the next loop, which may close a stranger of the same address.
 * Returns 0 if there is no such loop or no descriptor. */
static int pass_on(const struct newcomer *newcomer)
{
    uv_os_fd_t fd = -1;
    struct umbd_conn *conn = newcomer->conn;
    struct umbd_socket onward = newcomer->socket;
    onward.refusals++;
    if (!newcomer->room_elsewhere || onward.refusals >= conn->server->loop_count ||
        uv_fileno(&conn->socket.handle, &fd) != 0) {
        return 0;
    }
    onward.fd = fcntl(fd, F_DUPFD_CLOEXEC, 0);
    if (onward.fd >= 0) {
        umbd_loop_hand(umbd_loop_after(conn->loop), &onward);
    }
    return onward.fd >= 0;
}

static struct umbd_conn *make_conn(struct umbd_loop *loop, const struct umbd_socket *socket)
{
    struct umbd_conn *conn = calloc(1, sizeof *conn);
    if (conn == NULL) {
        return NULL;
    }
    conn->loop = loop;
    conn->server = loop->server;
    conn->serial = atomic_fetch_add(&loop->server->next_serial, 1);
    conn->language = socket->language;
    conn->protocol = socket->language == UMBD_HTTP1 ? &umbd_protocol_http1 : &umbd_protocol_h2;
    if (socket->transport == UMBN_UNIX) {
        uv_pipe_init(&loop->uv, &conn->socket.pipe, 0);
    } else {
        uv_tcp_init(&loop->uv, &conn->socket.tcp);
    }
    conn->socket.handle.data = conn;
    return conn;
}

/* Begins a connection whose socket is open. code: result of opening the socket. */
static void begin(struct newcomer *newcomer, int code)
{
    struct umbd_conn *conn = newcomer->conn;
    const enum umbn_transport transport = newcomer->socket.transport;
    struct umbd_loop *loop = conn->loop;
    struct umbd_server *server = loop->server;
    newcomer->reason = code != 0 ? uv_strerror(code) : "the server ends";
    if (code != 0 || loop->drain >= UMBD_DRAIN_LAST || !admit(newcomer)) {
        if (pass_on(newcomer)) {
            uv_close(&conn->socket.handle, umbd_conn_closed);
        } else {
            refuse(conn, newcomer->reason);
        }
        return;
    }
    conn->opened_ms = conn->last_call_ms = conn->last_work_ms = conn->ticked_ms = uv_now(&loop->uv);
    umbd_conn_enter(conn);
    conn->patience_ms = (int64_t)server->options.stall_timeout_ms;
    conn->retire_at_ms = retirement_ms(conn, server->options.max_age_ms);
    umbd_conn_link(conn);
    umbd_count(&server->metrics.connections_opened, 1);
    if (transport != UMBN_UNIX) {
        uv_tcp_nodelay(&conn->socket.tcp, 1);
        uv_tcp_keepalive(&conn->socket.tcp, 1, KEEPALIVE_S);
    }
    if (conn->protocol->start(conn) != UMB_OK ||
        (transport == UMBN_TLS && umbd_conn_tls_start(conn) != UMB_OK) ||
        umbd_conn_read_start(conn) != 0) {
        umbd_conn_close(conn, "cannot start");
        return;
    }
    /* The connection was being accepted when the others got the GOAWAY. */
    if (loop->drain == UMBD_DRAIN_NOTICE) {
        umbd_conn_notice(conn);
    }
    umbd_conn_flush(conn);
}

void umbd_conn_adopt(struct umbd_loop *loop, const struct umbd_socket *socket)
{
    struct umbd_conn *conn = make_conn(loop, socket);
    if (conn == NULL) {
        close(socket->fd);
        return;
    }
    int code = socket->transport == UMBN_UNIX ? uv_pipe_open(&conn->socket.pipe, socket->fd)
                                              : uv_tcp_open(&conn->socket.tcp, socket->fd);
    if (code != 0) {
        close(socket->fd);
    }
    struct newcomer newcomer = {.conn = conn, .socket = *socket};
    begin(&newcomer, code);
}

/*
 * Returns 1 if the peer reads its replies too slowly. The peer's patience shrinks while data waits
 * to be sent, and grows with the bytes that the peer takes, up to --stall-timeout. So neither
 * silence nor a byte now and then can hold replies in memory for long.
 */
static int is_stalled(struct umbd_conn *conn, uint64_t now_ms)
{
    int64_t most = (int64_t)conn->server->options.stall_timeout_ms;
    uint64_t taken = conn->sent_bytes - uv_stream_get_write_queue_size(&conn->socket.stream);
    uint64_t rate = SLOWEST_BYTES + conn->buffered / HOLD_MS;
    if (conn->write_pending || conn->server->calls->conn_is_sending(conn)) {
        conn->patience_ms += (int64_t)((taken - conn->taken_bytes) / rate);
        conn->patience_ms = conn->patience_ms < most ? conn->patience_ms : most;
        conn->patience_ms -= (int64_t)(now_ms - conn->ticked_ms);
    } else {
        conn->patience_ms = most;
    }
    conn->taken_bytes = taken;
    conn->ticked_ms = now_ms;
    return conn->patience_ms < -STALL_MARGIN_MS;
}

/* Asks a connection to leave when its time has come, in the same steps as a drain. Returns 1 if the
 * connection had to be closed. */
static int retire(struct umbd_conn *conn, uint64_t now_ms)
{
    const struct umbd_loop *loop = conn->loop;
    if (conn->retire_at_ms == 0 || now_ms < conn->retire_at_ms || loop->drain != UMBD_DRAIN_NO) {
        return 0;
    }
    switch (conn->retired) {
    case UMBD_DRAIN_NO:
        umbd_count(&loop->server->metrics.connections_retired, 1);
        umbd_conn_notice(conn);
        conn->retired = UMBD_DRAIN_NOTICE;
        conn->retire_at_ms = now_ms + UMBD_NOTICE_MS;
        return 0;
    case UMBD_DRAIN_NOTICE:
        umbd_conn_last_call(conn);
        conn->retired = UMBD_DRAIN_LAST;
        conn->retire_at_ms = now_ms + loop->server->options.drain_timeout_ms;
        return 0;
    default:
        umbd_conn_close(conn, "too old, and calls that do not end");
        return 1;
    }
}

void umbd_conn_tick(struct umbd_conn *conn, uint64_t now_ms)
{
    const struct umbd_options *options = &conn->server->options;
    if (conn->protocol->is_late(conn, now_ms)) {
        umbd_conn_flush(conn);
        umbd_conn_cut(conn, "headers");
        return;
    }
    if (!conn->is_greeted && now_ms - conn->opened_ms > options->handshake_timeout_ms) {
        umbd_conn_cut(conn, "handshake");
        return;
    }
    if (conn->tls != NULL && !umbd_conn_tls_is_admitted(conn)) {
        umbd_count(&conn->server->metrics.tls_failures, 1);
        umbs_log_event(&conn->server->log, UMB_LOG_INFO, "conn_revoked", "peer=\"%s\" conn=%llu",
                       conn->peer, (unsigned long long)conn->serial);
        umbd_conn_close(conn, "its certificate is no longer accepted");
        return;
    }
    if (is_stalled(conn, now_ms)) {
        umbd_conn_cut(conn, "stall");
        return;
    }
    if (conn->terminated && now_ms - conn->terminated_ms > TERMINATED_MS) {
        umbd_conn_close(conn, "did not go after GOAWAY");
        return;
    }
    if (!conn->server->calls->conn_tick(conn, now_ms)) {
        umbd_conn_cut(conn, "headers");
        return;
    }
    if (LIST_EMPTY(&conn->calls) && now_ms - conn->last_call_ms > options->idle_timeout_ms &&
        conn->retired == UMBD_DRAIN_NO) {
        conn->retire_at_ms = now_ms; /* a call may be on its way: no abrupt end */
    }
    if (retire(conn, now_ms)) {
        return;
    }
    umbd_conn_flush(conn);
}
