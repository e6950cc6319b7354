/* SPDX-License-Identifier: Apache-2.0 */
/*
 * All loops together. Loops exchange only sockets, in a list under the receiver's mutex, and the
 * order to drain, a counter; both wake the receiver by its async handle.
 *
 * No socket is lost at the end: the first loop takes sockets only while it listens. Sockets left in
 * the list of an ended loop are closed when all loops have ended.
 */
#include "daemon/transport/loop_group.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "daemon/transport/conn.h"
#include "tool/clock.h"

struct umbd_handed {
    struct umbd_handed *next;
    int socket;
    enum umbn_transport transport;
    uint32_t refusals;
};

enum umb_status umbd_loops_init(struct umbd_daemon *daemon, struct umb_error *error)
{
    uint32_t count = daemon->options.loops;
    daemon->loops = calloc(count, sizeof *daemon->loops);
    if (daemon->loops == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u loops", count);
    }
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(umbd_loop_init(&daemon->loops[i], daemon, i, error));
        daemon->loop_count++;
    }
    return UMB_OK;
}

static void *run_loop(void *argument)
{
    struct umbd_loop *loop = argument;
    uv_run(&loop->uv, UV_RUN_DEFAULT);
    atomic_store(&loop->ticked_ms, 0); /* the loop has ended; it does not hang */
    atomic_fetch_sub(&loop->daemon->loops_running, 1);
    return NULL;
}

enum umb_status umbd_loops_run(struct umbd_daemon *daemon,
                               enum umb_status (*ready)(struct umbd_daemon *daemon,
                                                        struct umb_error *error),
                               struct umb_error *error)
{
    uint32_t started = 1;
    enum umb_status status = UMB_OK;
    atomic_store(&daemon->loops_running, 1);
    for (; status == UMB_OK && started < daemon->loop_count; started++) {
        struct umbd_loop *loop = &daemon->loops[started];
        int code = pthread_create(&loop->thread, NULL, run_loop, loop);
        if (code != 0) {
            status = umb_fail_errno(error, UMB_E_LIMIT, code, "cannot start loop %u", started);
            break;
        }
        atomic_fetch_add(&daemon->loops_running, 1);
    }
    if (status == UMB_OK) {
        status = ready(daemon, error);
    }
    if (status == UMB_OK) {
        umbd_loop_run(&daemon->loops[0]);
    }
    /* The first loop has ended for any reason: the others end now; most have already. */
    umbd_loops_drain(&daemon->loops[0]);
    umbd_loops_drain(&daemon->loops[0]);
    for (uint32_t i = 1; i < started; i++) {
        pthread_join(daemon->loops[i].thread, NULL);
    }
    return status;
}

static void close_handed(struct umbd_loop *loop)
{
    while (loop->handed != NULL) {
        struct umbd_handed *next = loop->handed->next;
        close(loop->handed->socket);
        free(loop->handed);
        loop->handed = next;
    }
}

void umbd_loops_finish(struct umbd_daemon *daemon)
{
    for (uint32_t i = 0; i < daemon->loop_count; i++) {
        umbd_loop_stop(&daemon->loops[i]);
        close_handed(&daemon->loops[i]);
    }
    /* Batches of ended calls are still with the workers: they return before the loops are freed. */
    umbd_pool_destroy(daemon->pool);
    daemon->pool = NULL;
    for (uint32_t i = 0; i < daemon->loop_count; i++) {
        umbd_loop_finish(&daemon->loops[i]);
    }
    free(daemon->loops);
    daemon->loops = NULL;
    daemon->loop_count = 0;
}

struct umbd_loop *umbd_loops_idlest(struct umbd_daemon *daemon)
{
    struct umbd_loop *best = &daemon->loops[0];
    for (uint32_t i = 1; i < daemon->loop_count; i++) {
        if (atomic_load(&daemon->loops[i].load) < atomic_load(&best->load)) {
            best = &daemon->loops[i];
        }
    }
    return best;
}

struct umbd_loop *umbd_loop_after(struct umbd_loop *loop)
{
    return &loop->daemon->loops[(loop->index + 1) % loop->daemon->loop_count];
}

void umbd_loop_hand(struct umbd_loop *to, int socket, enum umbn_transport transport,
                    uint32_t refusals)
{
    struct umbd_handed *handed = malloc(sizeof *handed);
    if (handed == NULL) {
        close(socket);
        return;
    }
    handed->socket = socket;
    handed->transport = transport;
    handed->refusals = refusals;
    /* Until the socket is taken; then the connection counts itself. */
    atomic_fetch_add(&to->load, 1);
    pthread_mutex_lock(&to->done_mutex);
    handed->next = to->handed;
    to->handed = handed;
    pthread_mutex_unlock(&to->done_mutex);
    uv_async_send(&to->wake);
}

void umbd_loops_drain(struct umbd_loop *from)
{
    struct umbd_daemon *daemon = from->daemon;
    for (uint32_t i = 0; i < daemon->loop_count; i++) {
        struct umbd_loop *loop = &daemon->loops[i];
        if (loop != from) {
            atomic_fetch_add(&loop->drain_orders, 1);
            uv_async_send(&loop->wake);
        }
    }
}

uint64_t umbd_loops_tick_age_ms(struct umbd_daemon *daemon)
{
    uint64_t now_ms = umbu_clock_ns() / 1000000;
    uint64_t oldest = 0;
    for (uint32_t i = 0; i < daemon->loop_count; i++) {
        uint64_t ticked = atomic_load(&daemon->loops[i].ticked_ms);
        uint64_t age = ticked != 0 && ticked < now_ms ? now_ms - ticked : 0;
        oldest = age > oldest ? age : oldest;
    }
    return oldest;
}

unsigned umbd_loops_running(struct umbd_daemon *daemon)
{
    return atomic_load(&daemon->loops_running);
}

void umbd_loop_take_orders(struct umbd_loop *loop)
{
    pthread_mutex_lock(&loop->done_mutex);
    struct umbd_handed *handed = loop->handed;
    loop->handed = NULL;
    pthread_mutex_unlock(&loop->done_mutex);
    while (handed != NULL) {
        struct umbd_handed *next = handed->next;
        atomic_fetch_sub(&loop->load, 1);
        umbd_conn_adopt(loop, handed->socket, handed->transport, handed->refusals);
        free(handed);
        handed = next;
    }
    while (loop->drain_obeyed < atomic_load(&loop->drain_orders)) {
        loop->drain_obeyed++;
        umbd_loop_drain(loop);
    }
}
