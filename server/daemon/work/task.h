/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_TASK_H
#define UMBRAGE_SERVER_DAEMON_WORK_TASK_H
/*
 * A task: work of one call away from its loop. Points, volume queries, maps, page ranges and
 * calibrations go to the worker pool (pool.h), job requests to the threads of the jobs
 * (service/job_request.h). All tasks return through `done`. The loop finds the call by (lane,
 * stream_id), never by pointer, because the call may have ended.
 *
 * Each kind of work has a struct that contains a task; the task's `free` frees that struct.
 */
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/queue.h>
#include "umbrage/query.h"

struct umbd_call;
struct umbd_pool;

/* Results of a slice, which are added to those of its task. */
struct umbd_slice_result {
    struct umb_query_stats stats;
    uint64_t cpu_ns;
    struct umb_error error; /* Valid only on failure */
};

TAILQ_HEAD(umbd_tasks, umbd_task);

struct umbd_task {
    /*
     * Does records first .. first + count - 1. Slices that share no record may run at the same
     * time. Long work checks umbd_task_stopped now and then.
     */
    enum umb_status (*run)(struct umbd_task *task, size_t first, size_t count,
                           struct umbd_slice_result *result);
    /* Called once when all slices have succeeded; or NULL. */
    enum umb_status (*end)(struct umbd_task *task, struct umb_error *error);
    /* Answers the call, even after a failure. Called on the loop if the call still exists. */
    void (*answer)(struct umbd_call *call, struct umbd_task *task);
    /* Frees the struct that contains the task. Called after `answer`, unless is_kept is set, or
     * when the call has ended. */
    void (*free)(struct umbd_task *task);
    int is_kept;       /* 1: the call keeps the task after `answer` */
    size_t count;      /* Number of records */
    size_t slice;      /* Records a slice */
    uint64_t turns;    /* Turns that a slice takes, about; 0 counts as 1 */
    const char *items; /* Name of the records in messages; NULL: the work is in one piece */
    size_t answered;   /* Points that the metrics count when it succeeds */

    /* Set when it is sent */
    uint64_t lane;                        /* Serial of the connection */
    int32_t stream_id;                    /* Stream of the call */
    uint64_t deadline_ns;                 /* umbu_clock_ns, 0 = none */
    size_t charged;                       /* Bytes counted for a call that has ended */
    void *home;                           /* Argument of done */
    void (*done)(struct umbd_task *task); /* Any thread; must not block */
    STAILQ_ENTRY(umbd_task) done_link;    /* Link in the list of finished tasks */
    struct umbd_pool *pool; /* Pool that can cancel it; NULL: it cannot be cancelled */
    atomic_int given_up;    /* 1 once it was cancelled */

    /* Results */
    enum umb_status status;
    struct umb_query_stats stats;
    uint64_t cpu_ns;

    /* The pool's, under its mutex */
    uint64_t queued_ns;  /* Time of its submission */
    uint64_t waited;     /* Turns given up for its next slice */
    size_t next_record;  /* First record not handed out */
    size_t in_flight;    /* Slices under way */
    size_t error_record; /* First record of the slice whose error is kept */
    int begun, linked;
    TAILQ_ENTRY(umbd_task) link; /* Link in the ring of heads of lanes, or behind a head */
    struct umbd_tasks followers; /* Later tasks of a head's lane */
    size_t lane_count;           /* Set in a head: number of tasks in its lane, itself too */

    struct umb_error error; /* A result, valid only if status is not OK: never cleared */
};

/* Returns UMB_OK while the call waits for the task; else the status that ended the wait. */
enum umb_status umbd_task_stopped(const struct umbd_task *task);

/* Returns the status of a task whose work in the core ended with `status`. The core knows only that
 * it was stopped (E_CANCELLED); if the deadline did that, it is E_DEADLINE. */
enum umb_status umbd_task_result(const struct umbd_task *task, enum umb_status status,
                                 struct umb_error *error);

#endif
