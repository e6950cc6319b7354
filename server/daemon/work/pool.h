/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_POOL_H
#define UMBRAGE_SERVER_DAEMON_WORK_POOL_H
/*
 * The workers: a fixed number of threads that answer large batches in slices.
 *
 * Life of a batch: made by the loop (umbd_batch_create), handed over (umbd_pool_submit), answered
 * slice by slice, given back exactly once by its `done` callback on some thread, freed by the loop
 * (umbd_batch_destroy). Small batches never come here: umbd_batch_run answers them at once.
 *
 * Fair: each connection (lane) with work gets a slice in turn, whatever the number and size of its
 * batches.
 * Bounded: when the queue is full, the longest lane gives its last batch back (E_BUSY) to admit one
 * of a shorter lane; a submit of the longest lane itself fails. Deadlines are checked before each
 * slice: a batch that expired while it waited is never begun, one that expires midway stops.
 * Cancelling drops the slices that have not begun.
 *
 * Threads: all functions but create and destroy may be called from any thread. A batch belongs to
 * the pool between submit and done; its maker may only cancel it.
 */
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include "store/store.h"
#include "daemon/base/daemon_metrics.h"
#include "daemon/work/picture_work.h"
#include "umbrage/curve.h"
#include "umbrage/query.h"

/* One light of one asset, asked of all points of a batch. */
struct umbd_part {
    struct umbs_entry *entry; /* owned: the one version that answers */
    uint32_t light;
    uint32_t taps, level; /* requested, or chosen by the batch's dial */
    double expected_ns;   /* expected cost of a point, by the calibration of a budget; else 0 */
    struct umb_query query;
    struct umb_query_settings asked; /* settings that the query was made of */
    uint64_t turn; /* turn (optimistic_reads.h) in which entry was known to live; 0 = never */
};

struct umbd_batch;

/* Work instead of points: does records first .. first + count - 1. */
typedef enum umb_status (*umbd_work_fn)(const struct umbd_batch *batch, size_t first, size_t count,
                                        struct umb_error *error);

struct umbd_batch {
    /* set by the maker */
    uint8_t *message; /* message with the points, owned; NULL if they lie elsewhere */
    size_t part_count;
    struct umbd_part *parts; /* [part_limit] */
    size_t part_limit;
    struct umb_points points;
    /* Settings of all parts; light is that of the last one added, taps the largest of any. */
    struct umb_query_settings settings;
    struct umb_dial dial; /* chooses taps and level of each part, if it has a limit */
    const struct umb_calibration *calibration; /* for a budget, until the parts are added */
    /* part_count blocks of part_bytes for the answers, where the maker wants them. */
    uint8_t *values;
    size_t part_bytes, value_bytes;
    uint8_t *reply; /* owned: room for a head, then values; NULL if values lie elsewhere */
    size_t head_room;
    int want_stats, with_targets;
    int is_borrowed;   /* the one part's entry is not the batch's own */
    int is_optimistic; /* its reads are revalidated later (optimistic_reads.h) */
    struct umbd_picture_work
        picture_work;     /* a picture instead of points, and the packing of answers */
    uint64_t deadline_ns; /* CLOCK_MONOTONIC, 0 = none */
    uint64_t lane;        /* serial of the connection */
    uint64_t slice_turns; /* turns of one slice, about; 0 counts as 1 */
    int32_t stream_id;
    size_t charged;                         /* bytes the maker counted for it */
    void (*done)(struct umbd_batch *batch); /* any thread; must not block */
    void *home;                             /* argument of done */
    /* Runs for each slice, of slice_points records, instead of answering points. Then there is no
     * part, and points only has the count. Long work checks given_up now and then. */
    umbd_work_fn work;
    const char *work_items; /* name of the records in messages; NULL: none is needed */
    /* Called once at the end of successful work. NULL: nothing is left to do. */
    enum umb_status (*work_end)(struct umbd_batch *batch, struct umb_error *error);
    void (*work_free)(void *user); /* called when the batch is destroyed */
    void *work_user;
    atomic_int given_up;          /* 1 once it was cancelled */
    struct umbd_batch *next_done; /* link in the list of finished batches */

    /* results, valid in done */
    enum umb_status status;
    struct umb_query_stats stats;
    uint64_t cpu_ns;

    /* the pool's, under its mutex */
    uint64_t queued_ns; /* time of its submission */
    uint64_t waited;    /* turns given up for its next slice */
    size_t next_point;  /* first point not handed out */
    size_t slice_points;
    size_t in_flight;   /* slices being answered */
    size_t error_point; /* first point of the slice whose error is kept */
    int begun, linked;
    struct umbd_batch *ring_next, *ring_previous; /* heads of lanes */
    struct umbd_batch *follower, *last_follower;  /* later batches of the lane */
    size_t lane_count; /* set in a head: number of batches in its lane, itself too */

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

/* umbd_batch_create for at most one part, in the memory of *spare if there is any. _recycle, in
 * place of umbd_batch_destroy, keeps the memory there; it owns nothing, free() ends it. */
UMB_CHECKED enum umb_status umbd_batch_reuse(struct umbd_batch **spare,
                                             const struct umb_query_settings *settings,
                                             const struct umb_points *points,
                                             struct umbd_batch **out, struct umb_error *error);
void umbd_batch_recycle(struct umbd_batch *batch, struct umbd_batch **spare);

/* Adds a part; takes entry over, also on failure, unless is_borrowed is set. Fails: as
 * umb_query_prepare. */
UMB_CHECKED enum umb_status umbd_batch_add(struct umbd_batch *batch, struct umbs_entry *entry,
                                           uint32_t light, struct umb_error *error);

/* Adds the one part of a reused batch again, if the last batch in its memory had the same part in
 * the same turn, and returns 1; else 0. entry: borrowed. */
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

/* Cancels the waiting batches, gives everything back, joins the threads. NULL is allowed. */
void umbd_pool_destroy(struct umbd_pool *pool);

/* Hands a batch over; another one may be given back for it before this returns. Fails: E_BUSY
 * (queue full): the batch stays the caller's. */
UMB_CHECKED enum umb_status umbd_pool_submit(struct umbd_pool *pool, struct umbd_batch *batch,
                                             struct umb_error *error);

/*
 * Stops a batch: no further slice begins. Its done comes when no slice runs any more, perhaps
 * before this returns. Its status is E_CANCELLED unless it had ended before.
 */
void umbd_pool_cancel(struct umbd_pool *pool, struct umbd_batch *batch);

/* Batches waiting for a worker. */
size_t umbd_pool_depth(struct umbd_pool *pool);

/* 1 once half of the queue is free: refused clients may try again. */
int umbd_pool_has_room(struct umbd_pool *pool);

#endif
