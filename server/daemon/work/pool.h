/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_POOL_H
#define UMBRAGE_SERVER_DAEMON_WORK_POOL_H
/*
 * The workers: a fixed number of threads that run tasks in slices.
 *
 * - Fair: each connection with work (a lane) gets a slice in turn, whatever the number and size of
 *   its tasks.
 * - Bounded: when the queue is full, the longest lane's last task is given back (E_BUSY) to admit a
 *   task of a shorter lane. A submit of the longest lane itself fails.
 * - Deadlines are checked before each slice: a task that expired while it waited is never begun,
 *   and one that expires midway stops.
 * - Cancelling drops the slices that have not begun.
 *
 * Threads: all functions but create and destroy may be called from any thread. A task belongs to
 * the pool between submit and done; in that time its maker may only cancel it.
 */
#include <pthread.h>
#include "daemon/base/daemon_metrics.h"
#include "daemon/work/task.h"

/* Starts the threads. Fails: E_NO_MEMORY, E_LIMIT (thread). */
UMB_CHECKED enum umb_status umbd_pool_create(uint32_t workers, size_t queue_limit,
                                             struct umbd_metrics *metrics, struct umbd_pool **out,
                                             struct umb_error *error);

/* Cancels the waiting tasks, gives all tasks back and joins the threads. NULL is allowed. */
void umbd_pool_destroy(struct umbd_pool *pool);

/* Submits a task. The pool may give another task back for it before this call returns. Fails:
 * E_BUSY (queue full): the task stays the caller's. */
UMB_CHECKED enum umb_status umbd_pool_submit(struct umbd_pool *pool, struct umbd_task *task,
                                             struct umb_error *error);

/*
 * Stops a submitted task: no further slice begins. `done` is called when no slice runs any more,
 * perhaps before this call returns. The task's status is E_CANCELLED unless the task had ended
 * before.
 */
void umbd_task_cancel(struct umbd_task *task);

/* Number of tasks that wait for a worker. */
size_t umbd_pool_depth(struct umbd_pool *pool);

/* 1 once half of the queue is free: refused clients may try again. */
int umbd_pool_has_room(struct umbd_pool *pool);

#endif
