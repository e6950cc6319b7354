/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_H
/*
 * One event loop: it owns its listeners and connections, and gets finished batches from the pool.
 *
 * Life: umbd_loop_init, listen (listener.h), umbd_loop_run, umbd_loop_stop, umbd_loop_finish; for
 * all loops of a daemon: loop_group.h. Loops share only the daemon. A finished batch returns
 * through `done_list` and the async handle, and its connection is looked up by serial, never by
 * pointer.
 */
#include <pthread.h>
#include <uv.h>
#include "daemon/daemon.h"
#include "daemon/transport/h2_guard.h"
#include "daemon/call/optimistic_reads.h"

#define UMBD_TICK_MS      100          /* resolution of all timers */
#define UMBD_READ_BYTES   (256 * 1024) /* the loop's read buffer */
#define UMBD_OUT_SOFT     (256 * 1024) /* output collected before a write */
#define UMBD_SEND_FRAME   (128 * 1024) /* longest DATA frame sent */
#define UMBD_OUT_RESERVE  (64 * 1024)  /* reserve for frames that nghttp2 itself makes */
#define UMBD_OUT_CAPACITY (UMBD_OUT_SOFT + UMBD_SEND_FRAME + 9 + UMBD_OUT_RESERVE)
/* Time for small batches in one wake-up; later ones go to the pool. */
#define UMBD_INLINE_NS    4000000
#define UMBD_TURN_NS      1000000 /* part of it for one connection */
#define UMBD_CONN_BUCKETS 1024    /* buckets of the table by serial; a power of 2 */

struct umbd_conn;
struct umbd_listener;
struct umbd_admin;
struct umbd_handed;

enum umbd_drain {
    UMBD_DRAIN_NO = 0,
    UMBD_DRAIN_DELAY,  /* NOT_SERVING, still listening */
    UMBD_DRAIN_NOTICE, /* listeners closed, first GOAWAY sent */
    UMBD_DRAIN_LAST,   /* final GOAWAY sent, calls finish */
    UMBD_DRAIN_OVER,   /* handles closed */
};

struct umbd_loop {
    uv_loop_t uv;
    struct umbd_daemon *daemon;
    struct umbs_reader *reader; /* reader of the store: calls find assets without a lock */
    uv_async_t wake;
    uv_timer_t tick;
    uv_signal_t terminate, interrupt, hangup;

    uint32_t index;                 /* 0: the loop that listens and takes signals */
    pthread_t thread;               /* thread of the other loops */
    atomic_size_t load;             /* number of connections, with those being handed over */
    atomic_uint_fast64_t ticked_ms; /* Time of the last tick; 0: none yet */
    atomic_uint drain_orders;       /* number of drain orders from the first loop */
    unsigned drain_obeyed;
    struct umbd_handed *handed; /* sockets from the first loop, under done_mutex */

    struct umbd_conn *first_conn;
    uint32_t held; /* connections that umbd_conn_hold stopped */
    struct umbd_conn *by_serial[UMBD_CONN_BUCKETS];
    size_t conn_count;
    struct umbd_conn *oldest_stranger, *newest_stranger; /* connections without rights, in order */
    size_t stranger_count;
    int crowded; /* 1 if these hold more than their share: umbd_conn_relieve */
    struct umbd_listener *listeners;
    struct umbd_admin *admin;

    enum umbd_drain drain;
    uint64_t drain_since_ms; /* start of the stage, uv_now */

    uint8_t *read_buffer; /* [UMBD_READ_BYTES] */
    uint8_t *out;         /* [UMBD_OUT_CAPACITY], output of the connection being flushed */
    size_t out_size;
    uint8_t *sealed; /* [UMBD_SEALED_CAPACITY] records of that connection; NULL until one has TLS */
    size_t sealed_size;
    uint64_t inline_ns;            /* time spent on small batches in this wake-up */
    uint64_t inline_at_ms;         /* uv_now of that wake-up */
    uint64_t clock_ns;             /* umbu_clock_ns as last read in this event, 0 = not yet */
    struct umbd_conn *first_dirty; /* connections to be flushed */
    struct umbd_optimistic_reads optimistic; /* reads of small batches in this event */
    struct umbd_batch *spare;                /* memory of the last small batch, for the next */
    unsigned tls_looks;            /* Number of certificates verified again in this tick */
    struct umbd_bucket log_budget; /* warnings about peers, so that an attack cannot fill a disk */

    pthread_mutex_t done_mutex;
    struct umbd_batch *done_first, *done_last;                     /* under done_mutex */
    struct umbd_job_request *job_request_first, *job_request_last; /* under done_mutex */
};

UMB_CHECKED enum umb_status umbd_loop_init(struct umbd_loop *loop, struct umbd_daemon *daemon,
                                           uint32_t index, struct umb_error *error);

/* Runs until drained. */
void umbd_loop_run(struct umbd_loop *loop);

/*
 * Blocks the signals that the loop handles, in this thread and those it starts afterwards. The
 * loop's thread takes them only while it is in umbd_loop_run. Otherwise libuv's closing of a
 * handle, which restores the default action, would let a signal kill a daemon that is just ending.
 */
void umbd_signals_block(void);

/* Closes connections and listeners. _finish: closes the rest, when no batch is in progress any
 * more. */
void umbd_loop_stop(struct umbd_loop *loop);
void umbd_loop_finish(struct umbd_loop *loop);

/* Flushes a connection after others had their turn. umbd_loop_forget: cancels that. */
void umbd_loop_flush_later(struct umbd_conn *conn);
void umbd_loop_forget(struct umbd_conn *conn);

/* Callback `done` of batches made on a loop; home is the loop. Any thread. */
void umbd_loop_batch_done(struct umbd_batch *batch);

/* 1 if small work of the connection may be done in this wake-up. _began: start of the current work,
 * which is the end of the last one in this event, so the clock is read once for each; _spent: the
 * current work ends now. */
int umbd_conn_has_turn(struct umbd_conn *conn);
uint64_t umbd_conn_began(struct umbd_conn *conn);
void umbd_conn_spent(struct umbd_conn *conn, uint64_t began_ns);

/* Time of uv_hrtime when the event began, in steps of a millisecond. For budgets of frames, where
 * reading the clock would cost more than the frame. */
uint64_t umbd_loop_coarse_ns(const struct umbd_loop *loop);

/* 1 if a warning about a peer may be logged now. */
int umbd_loop_may_log(struct umbd_loop *loop);

/* Starts the drain; a second call ends everything at once. */
void umbd_loop_drain(struct umbd_loop *loop);

/* Advances the drain; called by the tick. */
void umbd_loop_drain_step(struct umbd_loop *loop);

#endif
