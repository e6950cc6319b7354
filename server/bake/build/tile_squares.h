/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_TILE_SQUARES_H
#define UMBRAGE_SERVER_BAKE_BUILD_TILE_SQUARES_H
/*
 * A tile's nodes by several threads: 64 squares, each built by a job into a small, loose pool of
 * its own, which the owner adds to the one of the bake.
 *
 *     umbb_squares_create(tile_log2, &squares, &error);
 *     for each tile:
 *         umbb_squares_begin(squares, tile, max_bytes);
 *         start jobs 0 .. UMBB_SQUARE_COUNT - 1, each calling umbb_squares_job
 *         umbb_squares_column(squares, jobs, &target, &column, &error);
 *     umbb_squares_destroy(squares);
 *
 * It pays for one thread as well: a square's texels and pool stay in the cache, most equal bricks
 * are neighbours, and what is left is merged with its look-ups asked for ahead (umb_pool_merge).
 * Nodes and even their numbers depend on the order of squares alone, not on threads.
 */
#include "bake/build/columns.h"
#include "tool/threads.h"

#define UMBB_SQUARES_ACROSS_LOG2 3U
#define UMBB_SQUARE_COUNT        (1U << (2 * UMBB_SQUARES_ACROSS_LOG2))

struct umbb_squares; /* opaque */

/* In: tile_log2: at least UMBB_SQUARES_ACROSS_LOG2 + UMB_LEVEL_BRICK. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_squares_create(uint32_t tile_log2, struct umbb_squares **out,
                                                struct umb_error *error);
/* NULL is allowed. No job may be under way. */
void umbb_squares_destroy(struct umbb_squares *squares);

/*
 * Says what the pools may take together from now on; those that have more give up theirs. A square
 * that needs more than its share is built by the owner, straight into the pool of the bake.
 * No job may be under way.
 */
void umbb_squares_allow(struct umbb_squares *squares, size_t max_bytes);

/* Makes ready for a tile. Borrows it until its column is made. */
void umbb_squares_begin(struct umbb_squares *squares, const struct umbb_tile *tile);

/* Builds square `job`. Threads: any, one job each. */
void umbb_squares_job(struct umbb_squares *squares, uint32_t job);

/*
 * Waits for the squares, helping with jobs, and joins them into the tile's column.
 *
 * In:    jobs: where the squares' jobs were started, before any others.
 * Out:   column: its runs are the last of `runs`.
 * Fails: as umb_pool_brick.
 */
UMB_CHECKED enum umb_status umbb_squares_column(struct umbb_squares *squares,
                                                struct umbu_threads *jobs, struct umb_pool *pool,
                                                struct umbb_runs *runs, struct umbb_column *column,
                                                struct umb_error *error);

#endif
