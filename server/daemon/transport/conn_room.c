/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Room for connections and for their bytes, and the share reserved for callers with rights.
 *
 * A connection is a stranger until one of its calls is allowed (umbd_call_is_allowed). With a token
 * file a good token allows a call; without one every call but health is allowed. Strangers may hold
 * a quarter of
 * --max-buffer, a few KiB each, and with a token file three quarters of --max-connections. The
 * oldest one makes room for the next, however busy it is, so a newcomer always gets far enough to
 * show its rights.
 *
 * Without a token file every caller has rights, so the limits apply to single addresses. Every
 * connection keeps a stranger's allowance. Beyond that an address may hold three times what it
 * leaves free of the first three quarters of --max-buffer. The allowances of all connections fit
 * into the last quarter, so small calls are always answered; large calls share the rest.
 *
 * Invariants: the strangers of a loop are in its list, oldest first; their `buffered` add up to
 * the daemon's stranger_buffered; allowance is the stranger's one and `taken`, or SIZE_MAX; an
 * account's `granted` is the sum of its connections' `taken`.
 */
#include "daemon/call/call_rights.h"

#include <string.h>

#define KEPT_SHARE   4 /* one part in this of --max-buffer is reserved */
#define ADDRESS_PART 3 /* times the free bytes: the most that one address may hold */
/* Connections that came or worked more recently are not evicted as idle. */
#define ROOM_IDLE_MS 1000
#define GRANT_BYTES  ((size_t)64 << 10) /* granted to a connection at once */
#define GRANT_SLACK  (4 * GRANT_BYTES)  /* kept by a connection when its calls end */

/* Number of connections that a loop may have: its share, since all loops get equally many. */
static size_t room_of(const struct umbd_loop *loop)
{
    const struct umbd_daemon *daemon = loop->daemon;
    size_t loops = daemon->loop_count;
    return (daemon->max_connections + loops - 1) / loops;
}

static void stranger_link(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    conn->next_stranger = NULL;
    conn->previous_stranger = loop->newest_stranger;
    if (loop->newest_stranger != NULL) {
        loop->newest_stranger->next_stranger = conn;
    } else {
        loop->oldest_stranger = conn;
    }
    loop->newest_stranger = conn;
    loop->stranger_count++;
    atomic_fetch_add(&conn->account->strangers, 1);
    atomic_fetch_add(&loop->daemon->metrics.strangers, 1);
}

static void stranger_unlink(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    if (conn->previous_stranger != NULL) {
        conn->previous_stranger->next_stranger = conn->next_stranger;
    } else {
        loop->oldest_stranger = conn->next_stranger;
    }
    if (conn->next_stranger != NULL) {
        conn->next_stranger->previous_stranger = conn->previous_stranger;
    } else {
        loop->newest_stranger = conn->previous_stranger;
    }
    loop->stranger_count--;
    atomic_fetch_sub(&conn->account->strangers, 1);
    atomic_fetch_sub(&loop->daemon->metrics.strangers, 1);
}

int umbd_conn_is_local(const struct umbd_conn *conn)
{
    return conn->socket.handle.type == UV_NAMED_PIPE;
}

void umbd_conn_enter(struct umbd_conn *conn)
{
    conn->allowance = conn->loop->daemon->stranger_bytes;
    stranger_link(conn);
}

void umbd_conn_leave(struct umbd_conn *conn)
{
    if (!conn->proven) {
        stranger_unlink(conn);
        /* From here on its bytes being written count for the daemon only. */
        atomic_fetch_sub(&conn->loop->daemon->stranger_buffered, conn->buffered);
        conn->proven = 1;
    }
    atomic_fetch_sub(&conn->account->granted, conn->taken);
    conn->taken = 0;
}

void umbd_conn_prove(struct umbd_conn *conn)
{
    struct umbd_daemon *daemon = conn->loop->daemon;
    if (conn->proven) {
        return;
    }
    conn->proven = 1;
    stranger_unlink(conn);
    atomic_fetch_sub(&daemon->stranger_buffered, conn->buffered);
    atomic_fetch_sub(&daemon->stranger_watches, conn->watches);
    if (daemon->tokens != NULL || umbd_conn_is_local(conn)) {
        conn->allowance = SIZE_MAX;
    }
}

void umbd_conn_doubt(struct umbd_conn *conn)
{
    struct umbd_daemon *daemon = conn->loop->daemon;
    if (conn->proven) {
        conn->proven = 0;
        conn->allowance = daemon->stranger_bytes;
        atomic_fetch_add(&daemon->stranger_buffered, conn->buffered);
        atomic_fetch_add(&daemon->stranger_watches, conn->watches);
        stranger_link(conn);
    }
}

/* Gives a connection with rights more of its address's share. */
static int grant(struct umbd_conn *conn, size_t bytes)
{
    struct umbd_daemon *daemon = conn->loop->daemon;
    const uint64_t most = daemon->options.max_buffer - daemon->options.max_buffer / KEPT_SHARE;
    const uint64_t used = atomic_load(&daemon->buffered) + bytes;
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

/* Counts bytes of a stranger. If the strangers together exceed their share, the oldest are closed
 * after the event. */
static void stranger_charge(struct umbd_conn *conn, size_t bytes)
{
    struct umbd_daemon *daemon = conn->loop->daemon;
    uint64_t before = atomic_fetch_add(&daemon->stranger_buffered, bytes);
    if (before + bytes > daemon->options.max_buffer / KEPT_SHARE) {
        conn->loop->crowded = 1;
    }
}

static void stranger_uncharge(struct umbd_conn *conn, size_t bytes)
{
    if (!conn->proven) {
        atomic_fetch_sub(&conn->loop->daemon->stranger_buffered, bytes);
    }
}

void umbd_conn_charge_always(struct umbd_conn *conn, size_t bytes)
{
    struct umbd_daemon *daemon = conn->loop->daemon;
    conn->buffered += bytes;
    atomic_fetch_add(&daemon->buffered, bytes);
    if (!conn->proven) {
        stranger_charge(conn, bytes);
    }
}

int umbd_conn_charge(struct umbd_conn *conn, size_t bytes, uint64_t *limit, const char **option)
{
    struct umbd_daemon *daemon = conn->loop->daemon;
    if (conn->buffered + bytes > daemon->options.connection_buffer) {
        *limit = daemon->options.connection_buffer;
        *option = "--connection-buffer";
        return 0;
    }
    if (conn->buffered + bytes > conn->allowance && !grant(conn, bytes)) {
        *limit = conn->proven ? daemon->options.max_buffer : conn->allowance;
        *option = conn->proven ? "--max-buffer, what one address may hold of it"
                               : "of a connection that has shown no right";
        return 0;
    }
    if (!umbd_daemon_charge(daemon, bytes)) {
        *limit = daemon->options.max_buffer;
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
    umbd_daemon_uncharge(conn->loop->daemon, bytes);
}

/* The connection with rights that has had no such call for the longest time, and at least a
 * second. */
static struct umbd_conn *idlest(const struct umbd_loop *loop)
{
    uint64_t now_ms = uv_now(&loop->uv);
    struct umbd_conn *found = NULL;
    for (struct umbd_conn *conn = loop->first_conn; conn != NULL; conn = conn->next) {
        if (conn->proven && conn->working == 0 && now_ms - conn->last_work_ms >= ROOM_IDLE_MS &&
            (found == NULL || conn->last_work_ms < found->last_work_ms)) {
            found = conn;
        }
    }
    return found;
}

static int evict(struct umbd_conn *conn)
{
    if (conn == NULL) {
        return 0;
    }
    umbd_count(&conn->loop->daemon->metrics.connections_evicted, 1);
    umbd_conn_terminate(conn, NGHTTP2_NO_ERROR);
    umbd_conn_flush(conn);
    umbd_conn_close(conn, "closed to make room for other connections");
    return 1;
}

/* A stranger is safe for a second: a new one may already have sent its call. */
void umbd_conn_evict(struct umbd_loop *loop)
{
    struct umbd_conn *stranger = loop->oldest_stranger;
    if (stranger != NULL && uv_now(&loop->uv) - stranger->opened_ms >= ROOM_IDLE_MS) {
        (void)evict(stranger);
    } else {
        (void)evict(idlest(loop));
    }
}

void umbd_conn_relieve(struct umbd_loop *loop)
{
    struct umbd_daemon *daemon = loop->daemon;
    loop->crowded = 0;
    while (loop->oldest_stranger != NULL &&
           atomic_load(&daemon->stranger_buffered) > daemon->options.max_buffer / KEPT_SHARE) {
        (void)evict(loop->oldest_stranger);
    }
}

int umbd_conn_make_room(struct umbd_loop *loop)
{
    const size_t room = room_of(loop);
    const size_t kept = loop->daemon->tokens != NULL ? room / KEPT_SHARE : 0;
    if (loop->stranger_count >= room - kept) {
        (void)evict(loop->oldest_stranger);
    } else if (loop->conn_count >= room && !evict(idlest(loop))) {
        (void)evict(loop->oldest_stranger);
    }
    return loop->conn_count < room;
}

int umbd_conn_make_room_at(struct umbd_loop *loop, const struct sockaddr_storage *address)
{
    uint8_t key[UMBD_PEER_KEY_BYTES];
    struct umbd_conn *conn = loop->oldest_stranger;
    umbd_peer_key(address, key);
    while (conn != NULL && memcmp(conn->account->key, key, sizeof key) != 0) {
        conn = conn->next_stranger;
    }
    return evict(conn);
}
