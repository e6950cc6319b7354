/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_TILE_SQUARES_H
#define UMBRAGE_SERVER_BAKE_BUILD_TILE_SQUARES_H
/*
 * Building a tile's nodes with several threads: 64 squares, each built by a slice into a small,
 * loose pool of its own, which the owner merges into the bake's pool.
 *
 *     umbb_squares_create(tile_log2, &squares, &error);
 *     for each tile:
 *         umbb_squares_begin(squares, tile);
 *         start slices 0 .. UMBB_SQUARE_COUNT - 1, each calling umbb_squares_job
 *         umbb_squares_column(squares, jobs, &target, &column, &error);
 *     umbb_squares_destroy(squares);
 *
 * It pays off for one thread too: a square's texels and pool stay in the cache, most equal bricks
 * are neighbours, and the merge prefetches its look-ups (umb__pool_merge). Nodes and even their
 * numbers depend on the order of squares alone, not on threads.
 */
#include "bake/build/columns.h"
#include "tool/threads.h"

#define UMBB_SQUARES_ACROSS_LOG2 3U
#define UMBB_SQUARE_COUNT        (1U << (2 * UMBB_SQUARES_ACROSS_LOG2))

struct umbb_squares; /* opaque */

/* Creates squares. tile_log2: >= UMBB_SQUARES_ACROSS_LOG2 + UMB_LEVEL_BRICK. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_squares_create(uint32_t tile_log2, struct umbb_squares **out,
                                                struct umb_error *error);
/* Frees the object. NULL is allowed. No slice may be running. */
void umbb_squares_destroy(struct umbb_squares *squares);

/*
 * Sets the common limit of the pools from now on; pools over their share release memory. A square
 * that needs more than its share is built by the owner, straight into the bake's pool. No slice may
 * be running.
 */
void umbb_squares_allow(struct umbb_squares *squares, size_t max_bytes);

/* Prepares for a tile, which is borrowed until its column is built. */
void umbb_squares_begin(struct umbb_squares *squares, const struct umbb_tile *tile);

/* Builds square `job`. Threads: any, one slice each. */
void umbb_squares_job(struct umbb_squares *squares, uint32_t job);

/*
 * Waits for the squares, helping with slices, and joins them into the tile's column.
 *
 * In:    jobs: thread pool in which the squares' slices were started, before any other slices.
 * Out:   column: its runs are appended to `runs`.
 * Fails: the errors of umb__pool_brick.
 */
UMB_CHECKED enum umb_status umbb_squares_column(struct umbb_squares *squares,
                                                struct umbu_threads *jobs, struct umb__pool *pool,
                                                struct umbb_runs *runs, struct umbb_column *column,
                                                struct umb_error *error);

#endif
