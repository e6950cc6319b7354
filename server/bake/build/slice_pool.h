/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_SLICE_POOL_H
#define UMBRAGE_SERVER_BAKE_BUILD_SLICE_POOL_H
/*
 * Threads that work off a numbered set of slices while their owner does something else.
 *
 *     umbb_slice_pool_create(4, &pool, &error);          three threads; the owner is the fourth
 *     umbb_slice_pool_start(pool, run, user, 256);       returns at once
 *     ... something else ...
 *     umbb_slice_pool_wait(pool, tick, tick_user);       helps until all are done
 *     umbb_slice_pool_destroy(pool);
 *
 * Slices are handed out in order and finish in any; they must not depend on one another.
 * Threads: only the owner calls these functions. What it wrote before start is visible to the
 * slices; what they wrote is visible to it after wait.
 */
#include <stddef.h>
#include <stdint.h>
#include "format/content.h"
#include "umbrage/status.h"

struct umbb_slice_pool; /* opaque */

/* One slice. thread: 0 (the owner) .. threads - 1; no two slices under way have the same. */
typedef void (*umbb_slice_fn)(void *user, uint32_t slice, unsigned thread);

/* Called by the owner between slices. */
typedef void (*umbb_slice_pool_tick_fn)(void *user);

/*
 * Starts the threads: those that the system refuses are done without.
 *
 * In: threads: 1.. with the owner. Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_slice_pool_create(unsigned threads, struct umbb_slice_pool **out,
                                                   struct umb_error *error);

/* Starts slices 0 .. count - 1. Those before must have been waited for. */
void umbb_slice_pool_start(struct umbb_slice_pool *pool, umbb_slice_fn run, void *user,
                           uint32_t count);

/* Helps and waits until all started slices are done. tick may be NULL. */
void umbb_slice_pool_wait(struct umbb_slice_pool *pool, umbb_slice_pool_tick_fn tick,
                          void *tick_user);

/*
 * Helps until something that a slice does has been done, or all slices are done. is_done may be
 * asked while the slice is still under way, so it reads with acquire what the slice wrote last,
 * with release. It must be quick and call nothing of this pool.
 */
void umbb_slice_pool_wait_until(struct umbb_slice_pool *pool, int (*is_done)(void *user),
                                void *user);

/*
 * The same threads as helpers of the core, while they have nothing else to do.
 *
 * In: pool: borrowed as long as the result is used.
 */
struct umb_workers umbb_slice_pool_workers(struct umbb_slice_pool *pool);

/* Runs slices 0 .. count - 1 and waits for them. workers: NULL or one: the caller does them all. */
void umbb_workers_run(const struct umb_workers *workers, umbb_slice_fn run, void *user,
                      uint32_t count);

/* Waits for started slices and ends the threads. NULL is allowed. */
void umbb_slice_pool_destroy(struct umbb_slice_pool *pool);

#endif
