/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The loops: timers, signals, and data between loops. Loops exchange two things: sockets, in a list
 * under the receiver's mutex, and the order to drain, a counter. For both the sender wakes the
 * receiver by its async handle.
 *
 * No socket is lost at the end: the first loop accepts sockets only while it listens, and sockets
 * left in the list of an ended loop are closed when all loops have ended.
 */
#define _GNU_SOURCE /* dup3 */
#include "daemon/transport/loop.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/try.h"
#include "daemon/transport/conn.h"
#include "daemon/transport/listener.h"
#include "tool/clock.h"

#define LOG_BURST 20 /* warnings about peers at once */
#define LOG_RATE  5  /* warnings a second after the burst */
#define SIGNALS   3

/* Signals that the first loop takes: drain, drain, reload. */
static const int signals[SIGNALS] = {SIGTERM, SIGINT, SIGHUP};

static void on_event(uv_poll_t *poll, int status, int events)
{
    (void)poll;
    (void)status;
    (void)events;
}

/*
 * Grows the loop's table for all descriptors that the process may have (RLIMIT_NOFILE). That limit
 * must not be raised afterwards. libuv indexes this table by descriptor and ends the process if the
 * table cannot grow; a connection that comes when memory is short must not cause that. A short
 * watch on the highest descriptor makes libuv grow the table now.
 * Fails: E_LIMIT.
 * Cost:  8 bytes a descriptor; if memory is short the process ends here, at the start.
 * Source: libuv 1.44, src/unix/core.c, maybe_resize.
 */
static enum umb_status reserve_descriptors(uv_loop_t *loop, struct umb_error *error)
{
    struct rlimit limit;
    uv_poll_t poll;
    int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0 || getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur > (1U << 24)) {
        enum umb_status status = umb_fail_errno(error, UMB_E_LIMIT, fd < 0 ? errno : ERANGE,
                                                "cannot prepare a loop for its descriptors");
        if (fd >= 0) {
            (void)close(fd);
        }
        return status;
    }
    /* The highest descriptor may be in use by a sanitizer or a parent; then the next lower one is
     * tried. */
    int high = -1;
    for (int number = (int)limit.rlim_cur - 1; high < 0 && number > fd; number--) {
        if (fcntl(number, F_GETFD) < 0) {
            high = dup3(fd, number, O_CLOEXEC);
        }
    }
    if (high >= 0 && uv_poll_init(loop, &poll, high) == 0) {
        (void)uv_poll_start(&poll, UV_READABLE, on_event);
        (void)uv_poll_stop(&poll);
        uv_close((uv_handle_t *)&poll, NULL);
        (void)uv_run(loop, UV_RUN_NOWAIT); /* closes the handle */
    }
    if (high >= 0) {
        (void)close(high);
    }
    (void)close(fd);
    return UMB_OK;
}

static void release_held(struct umbd_loop *loop)
{
    struct umbd_conn *conn = LIST_FIRST(&loop->conns);
    while (conn != NULL) {
        struct umbd_conn *next = LIST_NEXT(conn, link);
        umbd_conn_release(conn);
        conn = next;
    }
}

/* Takes the finished tasks, then flushes each connection once. If a flush leaves data for later,
 * the loop's next turn sends it. */
static void collect_done(struct umbd_loop *loop)
{
    const struct umbd_call_events *calls = loop->server->calls;
    calls->loop_woken(loop);
    struct umbd_conn *conn = loop->first_dirty;
    loop->first_dirty = NULL;
    while (conn != NULL) {
        struct umbd_conn *next = conn->next_dirty;
        conn->dirty = 0;
        if (conn->pump_due) {
            conn->pump_due = 0;
            loop->clock_ns = 0;
            calls->conn_pump(conn);
        }
        umbd_conn_flush(conn); /* may close this connection, never another */
        umbd_conn_read_again(conn);
        conn = next;
    }
    if (loop->held > 0 && calls->loop_has_room(loop)) {
        release_held(loop);
    }
}

/* Takes the sockets and orders that other loops left. */
static void take_orders(struct umbd_loop *loop)
{
    pthread_mutex_lock(&loop->handed_mutex);
    struct umbd_handed *handed = loop->handed;
    loop->handed = NULL;
    pthread_mutex_unlock(&loop->handed_mutex);
    while (handed != NULL) {
        struct umbd_handed *next = handed->next;
        atomic_fetch_sub(&loop->load, 1);
        umbd_conn_adopt(loop, &handed->socket);
        free(handed);
        handed = next;
    }
    while (loop->drain_obeyed < atomic_load(&loop->drain_orders)) {
        loop->drain_obeyed++;
        umbd_loop_drain(loop);
    }
}

static void on_wake(uv_async_t *async)
{
    take_orders(async->data);
    collect_done(async->data);
}

static void on_tick(uv_timer_t *timer)
{
    struct umbd_loop *loop = timer->data;
    uint64_t now_ms = uv_now(&loop->uv);
    struct umbd_conn *conn = LIST_FIRST(&loop->conns);
    atomic_store(&loop->ticked_ms, umbu_clock_ns() / 1000000);
    loop->server->calls->loop_tick(loop);
    loop->tls_looks = 0;
    while (conn != NULL) {
        struct umbd_conn *next = LIST_NEXT(conn, link);
        umbd_conn_tick(conn, now_ms);
        umbd_conn_release(conn);
        conn = next;
    }
    umbd_listeners_tick(loop);
    if (loop->index == 0) {
        loop->server->daemon->tick(loop->server, now_ms);
    }
    umbd_loop_drain_step(loop);
}

static void on_signal(uv_signal_t *signal, int number)
{
    struct umbd_loop *loop = signal->data;
    umbs_log_event(&loop->server->log, UMB_LOG_INFO, "signal", "number=%d", number);
    if (number == SIGHUP) {
        loop->server->daemon->reload(loop->server);
    } else {
        umbd_loop_drain(loop);
    }
}

static void start_handles(struct umbd_loop *loop)
{
    uv_async_init(&loop->uv, &loop->wake, on_wake);
    uv_timer_init(&loop->uv, &loop->tick);
    loop->wake.data = loop->tick.data = loop;
    uv_timer_start(&loop->tick, on_tick, UMBD_TICK_MS, UMBD_TICK_MS);
}

/* Starts what the first loop does for all. */
static void start_watching(struct umbd_loop *loop)
{
    uv_signal_t *const handles[] = {&loop->terminate, &loop->interrupt, &loop->hangup};
    for (size_t i = 0; i < SIGNALS; i++) {
        uv_signal_init(&loop->uv, handles[i]);
        handles[i]->data = loop;
        uv_signal_start(handles[i], on_signal, signals[i]);
    }
}

static void free_parts(struct umbd_loop *loop)
{
    loop->server->calls->loop_close(loop);
    free(loop->read_buffer);
    free(loop->out);
    free(loop->sealed);
}

static enum umb_status init_loop(struct umbd_loop *loop, struct umbd_server *server, uint32_t index,
                                 struct umb_error *error)
{
    memset(loop, 0, sizeof *loop);
    loop->server = server;
    loop->index = index;
    TAILQ_INIT(&loop->strangers);
    UMB__TRY(server->calls->loop_open(loop, error));
    loop->read_buffer = malloc(UMBD_READ_BYTES);
    loop->out = malloc(UMBD_OUT_CAPACITY);
    int code = loop->read_buffer != NULL && loop->out != NULL ? uv_loop_init(&loop->uv) : UV_ENOMEM;
    if (code != 0) {
        free_parts(loop);
        return umb_fail(error, UMB_E_NO_MEMORY, "cannot start a loop: %s", uv_strerror(code));
    }
    enum umb_status status = reserve_descriptors(&loop->uv, error);
    if (status != UMB_OK) {
        uv_loop_close(&loop->uv);
        free_parts(loop);
        return status;
    }
    pthread_mutex_init(&loop->handed_mutex, NULL);
    umbd_bucket_init(&loop->log_budget, LOG_BURST, LOG_RATE, uv_hrtime());
    start_handles(loop);
    if (index == 0) {
        start_watching(loop);
    }
    return UMB_OK;
}

enum umb_status umbd_loops_init(struct umbd_server *server, struct umb_error *error)
{
    uint32_t count = server->options.loops;
    server->loops = calloc(count, sizeof *server->loops);
    if (server->loops == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u loops", count);
    }
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(init_loop(&server->loops[i], server, i, error));
        server->loop_count++;
    }
    return UMB_OK;
}

static void change_mask(int how)
{
    sigset_t ours;
    sigemptyset(&ours);
    for (size_t i = 0; i < SIGNALS; i++) {
        sigaddset(&ours, signals[i]);
    }
    pthread_sigmask(how, &ours, NULL);
}

void umbd_signals_block(void)
{
    change_mask(SIG_BLOCK);
}

/* Runs the first loop, which takes the signals, until it is drained. */
static void run_first(struct umbd_loop *loop)
{
    change_mask(SIG_UNBLOCK);
    uv_run(&loop->uv, UV_RUN_DEFAULT);
    umbd_signals_block();
}

static void *run_loop(void *argument)
{
    struct umbd_loop *loop = argument;
    uv_run(&loop->uv, UV_RUN_DEFAULT);
    atomic_store(&loop->ticked_ms, 0); /* the loop has ended; it does not hang */
    atomic_fetch_sub(&loop->server->loops_running, 1);
    return NULL;
}

enum umb_status umbd_loops_run(struct umbd_server *server,
                               enum umb_status (*ready)(struct umbd_server *server,
                                                        struct umb_error *error),
                               struct umb_error *error)
{
    uint32_t started = 1;
    enum umb_status status = UMB_OK;
    atomic_store(&server->loops_running, 1);
    for (; status == UMB_OK && started < server->loop_count; started++) {
        struct umbd_loop *loop = &server->loops[started];
        int code = pthread_create(&loop->thread, NULL, run_loop, loop);
        if (code != 0) {
            status = umb_fail_errno(error, UMB_E_LIMIT, code, "cannot start loop %u", started);
            break;
        }
        atomic_fetch_add(&server->loops_running, 1);
    }
    if (status == UMB_OK) {
        status = ready(server, error);
    }
    if (status == UMB_OK) {
        run_first(&server->loops[0]);
    }
    /* The first loop has ended, for any reason. The other loops end now, if they have not ended
     * already. */
    umbd_loops_drain(&server->loops[0]);
    umbd_loops_drain(&server->loops[0]);
    for (uint32_t i = 1; i < started; i++) {
        pthread_join(server->loops[i].thread, NULL);
    }
    return status;
}

static void close_handle(uv_handle_t *handle, void *unused)
{
    (void)unused;
    if (!uv_is_closing(handle)) {
        uv_close(handle, NULL);
    }
}

void umbd_loops_stop(struct umbd_server *server)
{
    for (uint32_t i = 0; i < server->loop_count; i++) {
        struct umbd_loop *loop = &server->loops[i];
        while (!LIST_EMPTY(&loop->conns)) {
            umbd_conn_close(LIST_FIRST(&loop->conns), "server stopped");
        }
        umbd_listeners_close(loop);
        while (loop->handed != NULL) {
            struct umbd_handed *next = loop->handed->next;
            close(loop->handed->socket.fd);
            free(loop->handed);
            loop->handed = next;
        }
    }
}

void umbd_loops_finish(struct umbd_server *server)
{
    for (uint32_t i = 0; i < server->loop_count; i++) {
        struct umbd_loop *loop = &server->loops[i];
        collect_done(loop);
        uv_walk(&loop->uv, close_handle, NULL);
        uv_run(&loop->uv, UV_RUN_DEFAULT);
        uv_loop_close(&loop->uv);
        pthread_mutex_destroy(&loop->handed_mutex);
        free_parts(loop);
    }
    free(server->loops);
    server->loops = NULL;
    server->loop_count = 0;
}
