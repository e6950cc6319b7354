/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bytes that connections may hold, and the share reserved for callers with rights.
 *
 * A connection is a stranger until one of its calls is allowed (umbd_call_is_allowed). With a token
 * file a good token allows a call; without one every call but health is allowed. Strangers may hold
 * a quarter of --max-buffer, a few KiB each; conn_room.c limits their number.
 *
 * Without a token file every caller has rights, so the limits apply to single addresses. Every
 * connection keeps a stranger's allowance. The allowances of all connections fit into the last
 * quarter of --max-buffer, so small calls are always answered. Large calls share the first three
 * quarters: there one address may hold up to three times as many bytes as are still free.
 *
 * Invariants: the strangers of a loop are in its list, oldest first. Their `buffered` add up to the
 * server's stranger_buffered. A connection's allowance is a stranger's allowance plus `taken`, or
 * SIZE_MAX. An account's `granted` is the sum of its connections' `taken`.
 */
#include "daemon/transport/conn.h"

#define ADDRESS_PART 3                  /* One address may hold this many times the free bytes */
#define GRANT_BYTES  ((size_t)64 << 10) /* Unit in which a connection gets more bytes */
#define GRANT_SLACK  (4 * GRANT_BYTES)  /* Bytes that a connection keeps when its calls end */

/* Limits of a stranger's allowance in bytes. The allowance is the strangers' share of --max-buffer
 * divided by --max-connections, but within these limits. */
#define STRANGER_BYTES     65536
#define STRANGER_BYTES_LOW 16384 /* Enough for a Watch and a call with a token */

void umbd_server_init(struct umbd_server *server, const struct umbd_options *options)
{
    const uint64_t share = options->max_buffer / UMBD_KEPT_SHARE / options->max_connections;
    server->options = *options;
    server->max_connections = options->max_connections;
    server->stranger_bytes = share > STRANGER_BYTES       ? STRANGER_BYTES
                             : share < STRANGER_BYTES_LOW ? STRANGER_BYTES_LOW
                                                          : (size_t)share;
    atomic_store(&server->next_serial, 1);
}

int umbd_server_charge(struct umbd_server *server, size_t bytes)
{
    uint64_t before = atomic_fetch_add(&server->buffered, bytes);
    if (before + bytes > server->options.max_buffer) {
        atomic_fetch_sub(&server->buffered, bytes);
        return 0;
    }
    return 1;
}

void umbd_server_uncharge(struct umbd_server *server, size_t bytes)
{
    atomic_fetch_sub(&server->buffered, bytes);
}

static void stranger_link(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    TAILQ_INSERT_TAIL(&loop->strangers, conn, stranger);
    loop->stranger_count++;
    atomic_fetch_add(&conn->account->strangers, 1);
    atomic_fetch_add(&loop->server->metrics.strangers, 1);
}

static void stranger_unlink(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    TAILQ_REMOVE(&loop->strangers, conn, stranger);
    loop->stranger_count--;
    atomic_fetch_sub(&conn->account->strangers, 1);
    atomic_fetch_sub(&loop->server->metrics.strangers, 1);
}

int umbd_conn_is_local(const struct umbd_conn *conn)
{
    return conn->socket.handle.type == UV_NAMED_PIPE;
}

void umbd_conn_enter(struct umbd_conn *conn)
{
    conn->allowance = conn->server->stranger_bytes;
    stranger_link(conn);
}

void umbd_conn_leave(struct umbd_conn *conn)
{
    if (!conn->proven) {
        stranger_unlink(conn);
        /* The connection's unsent bytes still count in the daemon's sum, but no longer in that of
         * the connections without rights. */
        atomic_fetch_sub(&conn->server->stranger_buffered, conn->buffered);
        conn->proven = 1;
    }
    atomic_fetch_sub(&conn->account->granted, conn->taken);
    conn->taken = 0;
}

void umbd_conn_prove(struct umbd_conn *conn)
{
    struct umbd_server *server = conn->server;
    if (conn->proven) {
        return;
    }
    conn->proven = 1;
    stranger_unlink(conn);
    atomic_fetch_sub(&server->stranger_buffered, conn->buffered);
    atomic_fetch_sub(&server->stranger_watches, conn->watches);
    if (server->has_tokens || umbd_conn_is_local(conn)) {
        conn->allowance = SIZE_MAX;
    }
}

void umbd_conn_doubt(struct umbd_conn *conn)
{
    struct umbd_server *server = conn->server;
    if (conn->proven) {
        conn->proven = 0;
        conn->allowance = server->stranger_bytes;
        atomic_fetch_add(&server->stranger_buffered, conn->buffered);
        atomic_fetch_add(&server->stranger_watches, conn->watches);
        stranger_link(conn);
    }
}

/* Gives a connection with rights more of its address's share. */
static int grant(struct umbd_conn *conn, size_t bytes)
{
    struct umbd_server *server = conn->server;
    const uint64_t most = server->options.max_buffer - server->options.max_buffer / UMBD_KEPT_SHARE;
    const uint64_t used = atomic_load(&server->buffered) + bytes;
    const size_t lacking = conn->buffered + bytes - conn->allowance;
    const size_t wanted = (lacking + GRANT_BYTES - 1) / GRANT_BYTES * GRANT_BYTES;
    uint64_t granted = atomic_load(&conn->account->granted);
    do {
        if (!conn->proven || used > most || granted + lacking > ADDRESS_PART * (most - used)) {
            return 0;
        }
    } while (!atomic_compare_exchange_weak(&conn->account->granted, &granted, granted + wanted));
    conn->taken += wanted;
    conn->allowance += wanted;
    return 1;
}

/* Counts bytes of a stranger, a connection without rights. If all strangers together exceed their
 * share, the oldest ones are closed after the event. */
static void stranger_charge(struct umbd_conn *conn, size_t bytes)
{
    struct umbd_server *server = conn->server;
    uint64_t before = atomic_fetch_add(&server->stranger_buffered, bytes);
    if (before + bytes > server->options.max_buffer / UMBD_KEPT_SHARE) {
        conn->loop->crowded = 1;
    }
}

static void stranger_uncharge(struct umbd_conn *conn, size_t bytes)
{
    if (!conn->proven) {
        atomic_fetch_sub(&conn->server->stranger_buffered, bytes);
    }
}

void umbd_conn_charge_always(struct umbd_conn *conn, size_t bytes)
{
    struct umbd_server *server = conn->server;
    conn->buffered += bytes;
    atomic_fetch_add(&server->buffered, bytes);
    if (!conn->proven) {
        stranger_charge(conn, bytes);
    }
}

int umbd_conn_charge(struct umbd_conn *conn, size_t bytes, uint64_t *limit, const char **option)
{
    struct umbd_server *server = conn->server;
    if (conn->buffered + bytes > server->options.connection_buffer) {
        *limit = server->options.connection_buffer;
        *option = "--connection-buffer";
        return 0;
    }
    if (conn->buffered + bytes > conn->allowance && !grant(conn, bytes)) {
        *limit = conn->proven ? server->options.max_buffer : conn->allowance;
        *option = conn->proven ? "--max-buffer, what one address may hold of it"
                               : "of a connection that has shown no right";
        return 0;
    }
    if (!umbd_server_charge(server, bytes)) {
        *limit = server->options.max_buffer;
        *option = "--max-buffer";
        return 0;
    }
    conn->buffered += bytes;
    if (!conn->proven) {
        stranger_charge(conn, bytes);
    }
    return 1;
}

void umbd_conn_hand_over(struct umbd_conn *conn, size_t bytes)
{
    conn->buffered -= bytes;
    stranger_uncharge(conn, bytes);
    if (conn->taken > 0 && conn->allowance > conn->buffered + 2 * GRANT_SLACK) {
        size_t back = (conn->allowance - conn->buffered) / GRANT_BYTES * GRANT_BYTES - GRANT_SLACK;
        back = back < conn->taken ? back : conn->taken;
        atomic_fetch_sub(&conn->account->granted, back);
        conn->taken -= back;
        conn->allowance -= back;
    }
}

void umbd_conn_uncharge(struct umbd_conn *conn, size_t bytes)
{
    umbd_conn_hand_over(conn, bytes);
    umbd_server_uncharge(conn->server, bytes);
}
