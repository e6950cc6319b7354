/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_H
/* One event loop, with its listeners and connections. The loops share only the server. */
#include <pthread.h>
#include <sys/queue.h>
#include <uv.h>
#include "daemon/transport/h2_guard.h"
#include "daemon/transport/server.h"

#define UMBD_TICK_MS      100          /* resolution of all timers */
#define UMBD_READ_BYTES   (256 * 1024) /* size of the loop's read buffer */
#define UMBD_OUT_SOFT     (256 * 1024) /* output collected before a write */
#define UMBD_SEND_FRAME   (128 * 1024) /* longest DATA frame sent */
#define UMBD_OUT_RESERVE  (64 * 1024)  /* reserve for frames that nghttp2 itself makes */
#define UMBD_OUT_CAPACITY (UMBD_OUT_SOFT + UMBD_SEND_FRAME + 9 + UMBD_OUT_RESERVE)
/* Time for small batches in one wake-up; later ones go to the pool. */
#define UMBD_INLINE_NS    4000000
#define UMBD_TURN_NS      1000000 /* part of that time for one connection */
#define UMBD_CONN_BUCKETS 1024    /* number of buckets of the table by serial; a power of 2 */

struct umbd_call_home;
struct umbd_listener;
struct umbd_handed;

enum umbd_drain {
    UMBD_DRAIN_NO = 0,
    UMBD_DRAIN_DELAY,  /* NOT_SERVING, still listening */
    UMBD_DRAIN_NOTICE, /* Listeners are closed, the first GOAWAY is sent */
    UMBD_DRAIN_LAST,   /* The final GOAWAY is sent, calls finish */
    UMBD_DRAIN_OVER,   /* Handles are closed */
};

struct umbd_loop {
    uv_loop_t uv;
    struct umbd_server *server;
    struct umbd_call_home *home; /* State of the loop's calls */
    uv_async_t wake;
    uv_timer_t tick;
    uv_signal_t terminate, interrupt, hangup;

    uint32_t index;                 /* 0: the loop that listens and takes signals */
    pthread_t thread;               /* Thread; not of the first loop */
    atomic_size_t load;             /* Number of connections, with those being handed over */
    atomic_uint_fast64_t ticked_ms; /* Time of the last tick; 0: none yet */
    atomic_uint drain_orders;       /* Number of drain orders from the first loop */
    unsigned drain_obeyed;
    pthread_mutex_t handed_mutex;
    struct umbd_handed *handed; /* Sockets from other loops, under handed_mutex */

    LIST_HEAD(, umbd_conn) conns;
    uint32_t held; /* Number of connections that umbd_conn_hold stopped */
    struct umbd_conn *by_serial[UMBD_CONN_BUCKETS];
    size_t conn_count;
    TAILQ_HEAD(, umbd_conn) strangers; /* Connections without rights, oldest first */
    size_t stranger_count;
    int crowded; /* 1: these hold more than their share; the event's end closes some */
    struct umbd_listener *listeners;

    enum umbd_drain drain;
    uint64_t drain_since_ms; /* Start of the stage, uv_now */

    uint8_t *read_buffer; /* [UMBD_READ_BYTES] */
    uint8_t *out;         /* [UMBD_OUT_CAPACITY], output of the connection being flushed */
    size_t out_size;
    uint8_t *sealed; /* Sealed records of one connection, [UMBD_SEALED_CAPACITY] bytes; NULL until a
                        connection uses TLS */
    size_t sealed_size;
    uint64_t inline_ns;    /* Time spent on small batches in this wake-up */
    uint64_t inline_at_ms; /* Time of that wake-up, uv_now */
    uint64_t clock_ns;     /* Clock as last read in this event (umbu_clock_ns), 0 = not yet */
    struct umbd_conn *first_dirty; /* Connections to be flushed */
    unsigned tls_looks;            /* Number of certificates verified again in this tick */
    struct umbd_bucket log_budget; /* Warnings about peers: an attack must not fill a disk */
};

/* Flushes a connection after other connections had their turn. umbd_loop_forget cancels such a
 * flush. */
void umbd_loop_flush_later(struct umbd_conn *conn);
void umbd_loop_forget(struct umbd_conn *conn);

/* Marks a connection that must be flushed when the loop has taken its finished tasks. */
void umbd_loop_mark(struct umbd_conn *conn);

/* Returns 1 if the connection may still answer small requests on the loop's thread in this wake-up:
 * neither the loop's time (UMBD_INLINE_NS) nor the connection's part of it (UMBD_TURN_NS) is used
 * up. umbd_conn_began returns the time at which a piece of work begins: the clock as last read in
 * this wake-up, so that each piece of work reads the clock only once, at its end. umbd_conn_spent
 * ends the work and adds its time to both sums. */
int umbd_conn_has_turn(struct umbd_conn *conn);
uint64_t umbd_conn_began(struct umbd_conn *conn);
void umbd_conn_spent(struct umbd_conn *conn, uint64_t began_ns);

/* Returns the time of uv_hrtime at which the event began, in steps of a millisecond. The budgets of
 * HTTP/2 frames use this time, because reading the clock would cost more than a frame. */
uint64_t umbd_loop_coarse_ns(const struct umbd_loop *loop);

/* 1 if a warning about a peer may be logged now. */
int umbd_loop_may_log(struct umbd_loop *loop);

/* umbd_loops_idlest returns the loop with the fewest connections, umbd_loop_after the next loop in
 * a ring. */
struct umbd_loop *umbd_loops_idlest(struct umbd_server *server);
struct umbd_loop *umbd_loop_after(struct umbd_loop *loop);

/* A connected socket that is not a connection of a loop yet. */
struct umbd_socket {
    int fd;
    enum umbn_transport transport;
    enum umbd_language language;
    uint32_t refusals; /* Number of loops that had no room for it */
};

/* A socket on its way to another loop. */
struct umbd_handed {
    struct umbd_handed *next;
    struct umbd_socket socket;
};

/* Passes a socket to another loop; closes it if memory is short. */
void umbd_loop_hand(struct umbd_loop *to, const struct umbd_socket *socket);

/* Starts the drain of every other loop; a second call ends these loops at once. */
void umbd_loops_drain(struct umbd_loop *from);

/* Starts the drain of a loop (drain.c); a second call ends everything at once. umbd_loop_drain_step
 * advances the drain and is called with each tick. */
void umbd_loop_drain(struct umbd_loop *loop);
void umbd_loop_drain_step(struct umbd_loop *loop);

/* Returns the milliseconds since the last tick of the loop that ticked least recently. Any
 * thread. */
uint64_t umbd_loops_tick_age_ms(struct umbd_server *server);

/*
 * All loops of a server (loop_group.c). The first runs on the main thread: only it listens, takes
 * signals and serves the admin port. The others run on threads of their own. The first loop passes
 * new connections to them, so that each loop owns equally many.
 */

/* Creates as many loops as --loops says; the first is server->loops. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_loops_init(struct umbd_server *server, struct umb_error *error);

/*
 * Starts the threads, calls `ready`, and runs until all loops are drained. If ready fails, the
 * threads end and nothing runs. Fails: E_LIMIT (no thread), or the status of ready.
 */
UMB_CHECKED enum umb_status umbd_loops_run(struct umbd_server *server,
                                           enum umb_status (*ready)(struct umbd_server *server,
                                                                    struct umb_error *error),
                                           struct umb_error *error);

/* Closes all connections and listeners. umbd_loops_finish frees the loops; call it when no task
 * runs any more. */
void umbd_loops_stop(struct umbd_server *server);
void umbd_loops_finish(struct umbd_server *server);

/*
 * Blocks the signals that the loop handles, in this thread and all threads that it starts later.
 * The loop's thread accepts them only inside umbd_loops_run. When libuv closes a signal handle it
 * restores the default action, so an unblocked signal could kill a daemon that is just ending.
 */
void umbd_signals_block(void);

#endif
