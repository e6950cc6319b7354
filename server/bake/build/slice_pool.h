/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_SLICE_POOL_H
#define UMBRAGE_SERVER_BAKE_BUILD_SLICE_POOL_H
/*
 * Threads that run a numbered set of slices while their owner does other work.
 *
 *     umbb_slice_pool_create(4, &pool, &error);          three threads; the owner is the fourth
 *     umbb_slice_pool_start(pool, run, user, 256);       returns at once
 *     ... other work ...
 *     umbb_slice_pool_wait(pool, tick, tick_user);       helps until all are done
 *     umbb_slice_pool_destroy(pool);
 *
 * Slices are handed out in order and finish in any order; they must not depend on one another.
 * Threads: only the owner calls these functions. Its writes before start are visible to the slices;
 * theirs are visible to it after wait.
 */
#include <stddef.h>
#include <stdint.h>
#include "format/content.h"
#include "umbrage/status.h"

struct umbb_slice_pool; /* opaque */

/* Runs one slice. thread: 0 (the owner) .. threads - 1; running slices have different ones. */
typedef void (*umbb_slice_fn)(void *user, uint32_t slice, unsigned thread);

/* Called by the owner between slices. */
typedef void (*umbb_slice_pool_tick_fn)(void *user);

/*
 * Starts the threads. If the system refuses some, the pool works with fewer.
 *
 * In: threads: 1.. with the owner. Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_slice_pool_create(unsigned threads, struct umbb_slice_pool **out,
                                                   struct umb_error *error);

/* Starts slices 0 .. count - 1. Wait for earlier ones first. */
void umbb_slice_pool_start(struct umbb_slice_pool *pool, umbb_slice_fn run, void *user,
                           uint32_t count);

/* Helps and waits until all started slices are done. tick may be NULL. */
void umbb_slice_pool_wait(struct umbb_slice_pool *pool, umbb_slice_pool_tick_fn tick,
                          void *tick_user);

/*
 * Helps until a certain result of a slice is there, or all slices are done. is_done may be called
 * while the slice still runs, so the slice writes its flag with release and is_done reads it with
 * acquire. It must be quick and call no function of this pool.
 */
void umbb_slice_pool_wait_until(struct umbb_slice_pool *pool, int (*is_done)(void *user),
                                void *user);

/*
 * The pool's threads as workers of the core, while they are idle.
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
