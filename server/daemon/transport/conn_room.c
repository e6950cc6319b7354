/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Room for connections. With a token file, strangers (conn_budget.c) may have three quarters of
 * --max-connections. Beyond that the oldest stranger is closed for the next one, even while it is
 * busy. A new connection therefore always gets far enough to show its rights.
 */
#include "daemon/transport/conn.h"

#include <string.h>

/* Age and idle time in milliseconds below which a connection is not evicted. */
#define ROOM_IDLE_MS 1000

/* Returns how many connections a loop may have. All loops get equal shares. */
static size_t room_of(const struct umbd_loop *loop)
{
    const struct umbd_server *server = loop->server;
    size_t loops = server->loop_count;
    return (server->max_connections + loops - 1) / loops;
}

/* Returns the connection with rights that has been idle for the longest time, at least a second;
 * else NULL. */
static struct umbd_conn *idlest(const struct umbd_loop *loop)
{
    uint64_t now_ms = uv_now(&loop->uv);
    struct umbd_conn *found = NULL;
    for (struct umbd_conn *conn = LIST_FIRST(&loop->conns); conn != NULL;
         conn = LIST_NEXT(conn, link)) {
        if (conn->proven && conn->working == 0 && now_ms - conn->last_work_ms >= ROOM_IDLE_MS &&
            (found == NULL || conn->last_work_ms < found->last_work_ms)) {
            found = conn;
        }
    }
    return found;
}

/* Evicts the oldest stranger if it is at least a second old, else the idlest connection with
 * rights. A younger stranger may already have sent a call that shows its rights. */
void umbd_conn_evict(struct umbd_loop *loop)
{
    struct umbd_conn *stranger = TAILQ_FIRST(&loop->strangers);
    if (stranger != NULL && uv_now(&loop->uv) - stranger->opened_ms >= ROOM_IDLE_MS) {
        (void)umbd_conn_dismiss(stranger);
    } else {
        (void)umbd_conn_dismiss(idlest(loop));
    }
}

int umbd_conn_make_room(struct umbd_loop *loop)
{
    const size_t room = room_of(loop);
    const size_t kept = loop->server->has_tokens ? room / UMBD_KEPT_SHARE : 0;
    if (loop->stranger_count >= room - kept) {
        (void)umbd_conn_dismiss(TAILQ_FIRST(&loop->strangers));
    } else if (loop->conn_count >= room && !umbd_conn_dismiss(idlest(loop))) {
        (void)umbd_conn_dismiss(TAILQ_FIRST(&loop->strangers));
    }
    return loop->conn_count < room;
}

int umbd_conn_make_room_at(struct umbd_loop *loop, const struct sockaddr_storage *address)
{
    uint8_t key[UMBD_PEER_KEY_BYTES];
    struct umbd_conn *conn = TAILQ_FIRST(&loop->strangers);
    umbd_peer_key(address, key);
    while (conn != NULL && memcmp(conn->account->key, key, sizeof key) != 0) {
        conn = TAILQ_NEXT(conn, stranger);
    }
    return umbd_conn_dismiss(conn);
}
