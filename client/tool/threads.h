/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_THREADS_H
#define UMBRAGE_TOOL_THREADS_H
/*
 * Threads that run a numbered set of equal slices while their owner does something else.
 *
 *     umbu_threads_create(4, &threads, &error);        three threads; the owner is the fourth
 *     umbu_threads_start(threads, run, user, 256);     returns at once
 *     ... something else ...
 *     umbu_threads_wait(threads, tick, tick_user);     helps until all are done
 *     umbu_threads_destroy(threads);
 *
 * Slices start in order and finish in any order; they must not depend on one another.
 * Threads: only the owner calls these functions. Slices see all writes of the owner before start;
 * the owner sees all writes of the slices after wait.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"
#include "umbrage/workers.h"

#define UMBU_THREADS_MAX 256

struct umbu_threads; /* opaque */

/* Runs one slice. In: thread: 0 (the owner) .. threads - 1; no two slices under way have the same
 * number. */
typedef void (*umbu_slice_fn)(void *user, uint32_t slice, unsigned thread);

/*
 * Starts threads. If the system refuses to start some, the others do the work.
 *
 * In: threads: number with the owner, at least 1. Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbu_threads_create(unsigned threads, struct umbu_threads **out,
                                                struct umb_error *error);

/* Starts slices 0 .. count - 1. All earlier slices must be done (umbu_threads_wait). */
void umbu_threads_start(struct umbu_threads *threads, umbu_slice_fn run, void *user,
                        uint32_t count);

/* Runs slices on the owner's thread, too, and waits until all started slices are done. In: tick:
 * called between slices; may be NULL. */
void umbu_threads_wait(struct umbu_threads *threads, void (*tick)(void *user), void *tick_user);

/*
 * Runs slices on the owner's thread, too, until is_done returns nonzero or all slices are done.
 * is_done may run while a slice is still under way: it must read with acquire a value that the
 * slice wrote last, with release. It must be quick and must not call these threads.
 */
void umbu_threads_wait_until(struct umbu_threads *threads, int (*is_done)(void *user), void *user);

/*
 * Returns the threads as workers for the core. Use them only while no other slices run.
 *
 * In: threads: borrowed as long as the result is used.
 */
struct umb_workers umbu_threads_workers(struct umbu_threads *threads);

/* Runs slices 0 .. count - 1 and waits for all of them. In: workers: if NULL, or of one thread, the
 * caller runs all slices. */
void umbu_workers_run(const struct umb_workers *workers, umbu_slice_fn run, void *user,
                      uint32_t count);

/* Waits for started slices and ends the threads. NULL is allowed. */
void umbu_threads_destroy(struct umbu_threads *threads);

/* Does items first .. first + count - 1 of a range. */
typedef enum umb_status (*umbu_block_fn)(void *user, size_t first, size_t count,
                                         struct umb_error *error);

/*
 * Runs fn over the range 0 .. count - 1 in blocks of `block` items (at least 1), the last one
 * shorter. Results do not depend on the number of threads if blocks write to disjoint places.
 *
 * In:    threads: at most this many, 1..UMBU_THREADS_MAX.
 * Fails: with the first failure of fn; blocks that had not started then are left out. E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbu_range_run(unsigned threads, size_t count, size_t block,
                                           umbu_block_fn fn, void *user, struct umb_error *error);

/* Does item i of a range. */
typedef void (*umbu_item_fn)(void *user, size_t i);

/* Runs fn for each item of the range 0 .. count - 1, as umbu_range_run does. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbu_range_each(unsigned threads, size_t count, size_t block,
                                            umbu_item_fn fn, void *user, struct umb_error *error);

/* Number of processors this process may use, 1..UMBU_THREADS_MAX. */
unsigned umbu_processor_count(void);

#endif
