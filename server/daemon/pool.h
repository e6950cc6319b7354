/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_POOL_H
#define UMBRAGE_SERVER_DAEMON_POOL_H
/*
 * The workers: a fixed number of threads that answer large batches in slices.
 *
 * Life of a batch: made by the loop (umbd_batch_create), handed over (umbd_pool_submit), answered
 * slice by slice, given back exactly once by its `done` call-back on some thread, freed by the loop
 * (umbd_batch_destroy). Small batches never come here: umbd_batch_run answers them at once.
 *
 * Fair: each connection (lane) with work gets a slice in turn, whatever the number and size of its
 * batches. Bounded: with as many batches waiting as may, the longest lane gives its last one back
 * (E_BUSY) for one of a shorter lane, and a submit of the longest lane itself fails. Deadlines are
 * looked at before each slice: a batch that expired while it waited is never begun, one that
 * expires midway stops. Cancelling drops what has not been begun.
 *
 * Threads: all functions but create and destroy may be called from any thread. A batch belongs to
 * the pool between submit and done; the maker may only cancel it.
 */
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include "store/store.h"
#include "daemon/daemon_metrics.h"
#include "daemon/picture_work.h"
#include "umbrage/curve.h"
#include "umbrage/query.h"

/* One light of one asset, asked of all points of a batch. */
struct umbd_part {
    struct umbs_entry *entry; /* owned: the one version that answers */
    uint32_t light;
    uint32_t taps, level; /* asked for, or chosen by the batch's dial */
    double expected_ns;   /* a point, by the calibration of a budget; else 0 */
    struct umb_query query;
    struct umb_query_settings asked; /* what the query was made of, */
    uint64_t
        turn; /* and the turn (optimistic_reads.h) in which entry was known to live; 0 = never */
};

struct umbd_batch;

/* Work other than points: records first .. first + count - 1 of it. */
typedef enum umb_status (*umbd_work_fn)(const struct umbd_batch *batch, size_t first, size_t count,
                                        struct umb_error *error);

struct umbd_batch {
    /* set by the maker */
    uint8_t *message; /* owned: what the points lie in; NULL if they lie elsewhere */
    size_t part_count;
    struct umbd_part *parts; /* [part_limit] */
    size_t part_limit;
    struct umb_points points;
    /* Of all parts; light is that of the last one added, taps the most of any. */
    struct umb_query_settings settings;
    struct umb_dial dial; /* chooses taps and level of each part if it wants anything */
    const struct umb_calibration *calibration; /* for a budget, until the parts are added */
    uint8_t *values; /* the answers: part_count blocks of part_bytes, where the maker wants them */
    size_t part_bytes, value_bytes;
    uint8_t *reply; /* owned: room for a head, then values; NULL if values lie elsewhere */
    size_t head_room;
    int want_stats, with_targets;
    int is_borrowed;   /* the one part's entry is not the batch's own */
    int is_optimistic; /* what it reads is revalidated later (optimistic_reads.h) */
    struct umbd_picture_work
        picture_work;     /* a picture instead of points, and how answers are packed */
    uint64_t deadline_ns; /* CLOCK_MONOTONIC, 0 = none */
    uint64_t lane;        /* serial of the connection */
    uint64_t slice_turns; /* that a slice takes, about; 0 counts as 1 */
    int32_t stream_id;
    size_t charged;                         /* bytes the maker counted for it */
    void (*done)(struct umbd_batch *batch); /* any thread; must not block */
    void *home;                             /* for done */
    /* Instead of answering points (then there is no part, and points only has their count): run
     * for each slice, of slice_points records. Long work looks at given_up now and then. */
    umbd_work_fn work;
    const char *work_items; /* what is counted, as messages say it; NULL: nothing to speak of */
    /* Of work that was done well: called once, by whoever ends it. NULL: nothing is left to do. */
    enum umb_status (*work_end)(struct umbd_batch *batch, struct umb_error *error);
    void (*work_free)(void *user); /* when the batch is destroyed */
    void *work_user;
    atomic_int given_up;          /* it was cancelled */
    struct umbd_batch *next_done; /* for done's list */

    /* results, valid in done */
    enum umb_status status;
    struct umb_query_stats stats;
    uint64_t cpu_ns;

    /* the pool's, under its mutex */
    uint64_t queued_ns; /* when it was submitted */
    uint64_t waited;    /* turns that it gave up for its next slice */
    size_t next_point;  /* first point not handed out */
    size_t slice_points;
    size_t in_flight;   /* slices being answered */
    size_t error_point; /* first point of the slice whose error is kept */
    int begun, linked;
    struct umbd_batch *ring_next, *ring_previous; /* heads of lanes */
    struct umbd_batch *follower, *last_follower;  /* later batches of the lane */
    size_t lane_count;                            /* of a head: batches of its lane, itself too */

    struct umb_error error; /* a result too; valid only if status is not OK, so never cleared */
};

/*
 * Makes a batch of up to part_limit parts; then umbd_batch_add each part, umbd_batch_reserve (or
 * set `values`), and hand it over.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbd_batch_create(size_t part_limit,
                                              const struct umb_query_settings *settings,
                                              const struct umb_points *points,
                                              struct umbd_batch **out, struct umb_error *error);

/* The same for at most one part, in the memory of *spare if there is any. _recycle, in place of
 * umbd_batch_destroy, keeps the memory there; it owns nothing, free() ends it. */
UMB_CHECKED enum umb_status umbd_batch_reuse(struct umbd_batch **spare,
                                             const struct umb_query_settings *settings,
                                             const struct umb_points *points,
                                             struct umbd_batch **out, struct umb_error *error);
void umbd_batch_recycle(struct umbd_batch *batch, struct umbd_batch **spare);

/* Adds a part; takes entry over, also on failure, unless is_borrowed is set. Fails: as
 * umb_query_prepare. */
UMB_CHECKED enum umb_status umbd_batch_add(struct umbd_batch *batch, struct umbs_entry *entry,
                                           uint32_t light, struct umb_error *error);

/* Adds the one part of a reused batch as umbd_batch_add did for the last in its memory, if that was
 * the same in the same turn, and returns 1; else 0. entry: borrowed. */
int umbd_batch_repeat(struct umbd_batch *batch, struct umbs_entry *entry, uint64_t turn);

/* Allocates the reply: head_room bytes, then the answers. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_batch_reserve(struct umbd_batch *batch, size_t head_room,
                                               struct umb_error *error);
void umbd_batch_destroy(struct umbd_batch *batch);

/* Checks and answers a whole batch on the calling thread; the results are in the batch. */
void umbd_batch_run(struct umbd_batch *batch, struct umbd_metrics *metrics);

struct umbd_pool; /* opaque */

/* Starts the threads. Fails: E_NO_MEMORY, E_LIMIT (thread). */
UMB_CHECKED enum umb_status umbd_pool_create(uint32_t workers, size_t queue_limit,
                                             struct umbd_metrics *metrics, struct umbd_pool **out,
                                             struct umb_error *error);

/* Cancels what is there, gives everything back, joins the threads. NULL is allowed. */
void umbd_pool_destroy(struct umbd_pool *pool);

/* Hands a batch over; another one may be given back for it before this returns. Fails: E_BUSY
 * (queue full): the batch stays the caller's. */
UMB_CHECKED enum umb_status umbd_pool_submit(struct umbd_pool *pool, struct umbd_batch *batch,
                                             struct umb_error *error);

/*
 * Stops a batch: no further slice is begun. Its done comes as soon as none is under way, perhaps
 * before this returns, with E_CANCELLED unless it had ended before.
 */
void umbd_pool_cancel(struct umbd_pool *pool, struct umbd_batch *batch);

/* Batches waiting for a worker. */
size_t umbd_pool_depth(struct umbd_pool *pool);

/* 1 once half of the queue is free: who was refused may come again. */
int umbd_pool_has_room(struct umbd_pool *pool);

#endif
