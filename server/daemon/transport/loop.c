/* SPDX-License-Identifier: Apache-2.0 */
/* State of a loop that its connections use: turns, the list of connections to be flushed, and
 * sockets on their way to other loops. */
#include "daemon/transport/conn.h"

#include <stdlib.h>
#include <unistd.h>

#include "tool/clock.h"

uint64_t umbd_loop_coarse_ns(const struct umbd_loop *loop)
{
    return uv_now(&loop->uv) * 1000000;
}

int umbd_loop_may_log(struct umbd_loop *loop)
{
    return umbd_bucket_take(&loop->log_budget, uv_hrtime());
}

void umbd_loop_mark(struct umbd_conn *conn)
{
    if (!conn->dirty) {
        conn->dirty = 1;
        conn->next_dirty = conn->loop->first_dirty;
        conn->loop->first_dirty = conn;
    }
}

void umbd_loop_flush_later(struct umbd_conn *conn)
{
    umbd_loop_mark(conn);
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

/* Starts a connection's turn. In each wake-up of the loop the connection's time starts at zero. */
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

struct umbd_loop *umbd_loops_idlest(struct umbd_server *server)
{
    struct umbd_loop *best = &server->loops[0];
    for (uint32_t i = 1; i < server->loop_count; i++) {
        if (atomic_load(&server->loops[i].load) < atomic_load(&best->load)) {
            best = &server->loops[i];
        }
    }
    return best;
}

struct umbd_loop *umbd_loop_after(struct umbd_loop *loop)
{
    return &loop->server->loops[(loop->index + 1) % loop->server->loop_count];
}

void umbd_loop_hand(struct umbd_loop *to, const struct umbd_socket *socket)
{
    struct umbd_handed *handed = malloc(sizeof *handed);
    if (handed == NULL) {
        close(socket->fd);
        return;
    }
    handed->socket = *socket;
    /* Until the socket is taken; then the connection counts itself. */
    atomic_fetch_add(&to->load, 1);
    pthread_mutex_lock(&to->handed_mutex);
    handed->next = to->handed;
    to->handed = handed;
    pthread_mutex_unlock(&to->handed_mutex);
    uv_async_send(&to->wake);
}

void umbd_loops_drain(struct umbd_loop *from)
{
    struct umbd_server *server = from->server;
    for (uint32_t i = 0; i < server->loop_count; i++) {
        struct umbd_loop *loop = &server->loops[i];
        if (loop != from) {
            atomic_fetch_add(&loop->drain_orders, 1);
            uv_async_send(&loop->wake);
        }
    }
}

uint64_t umbd_loops_tick_age_ms(struct umbd_server *server)
{
    uint64_t now_ms = umbu_clock_ns() / 1000000;
    uint64_t oldest = 0;
    for (uint32_t i = 0; i < server->loop_count; i++) {
        uint64_t ticked = atomic_load(&server->loops[i].ticked_ms);
        uint64_t age = ticked != 0 && ticked < now_ms ? now_ms - ticked : 0;
        oldest = age > oldest ? age : oldest;
    }
    return oldest;
}
