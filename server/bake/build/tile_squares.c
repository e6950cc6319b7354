/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Squares are jobs in the order in which the owner wants them (quarter by quarter, as columns are
 * joined), so that it seldom waits. Their pools live as long as the bake: cleared, not freed.
 */
#include "bake/build/tile_squares.h"

#include <stdatomic.h>
#include <stdlib.h>

/* One square. Its job writes all of it and then says so; until then the owner leaves it alone. */
struct square {
    struct umb_pool pool;
    struct umbb_runs runs;
    struct umbb_column column;
    enum umb_status status;
    atomic_int is_done;
};

struct umbb_squares {
    uint32_t level;   /* of a square */
    size_t max_bytes; /* of a square's pool and runs */
    const struct umbb_tile *tile;
    struct square squares[UMBB_SQUARE_COUNT];
    struct umb_pool_numbers numbers;
    /* While a column is made: */
    struct umbb_jobs *jobs;
    struct umb_pool *pool;
    struct umbb_runs *runs;
};

enum umb_status umbb_squares_create(uint32_t tile_log2, struct umbb_squares **out,
                                    struct umb_error *error)
{
    struct umbb_squares *squares = calloc(1, sizeof *squares);
    *out = squares;
    if (squares == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "squares of a tile: %zu bytes refused",
                        sizeof *squares);
    }
    squares->level = tile_log2 - UMBB_SQUARES_ACROSS_LOG2;
    squares->max_bytes = SIZE_MAX;
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        umb_pool_init(&squares->squares[i].pool, NULL, SIZE_MAX);
    }
    return UMB_OK;
}

static void square_release(struct square *square)
{
    umb_pool_finish(&square->pool);
    umbb_runs_finish(&square->runs);
}

void umbb_squares_destroy(struct umbb_squares *squares)
{
    if (squares == NULL) {
        return;
    }
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        square_release(&squares->squares[i]);
    }
    umb_pool_numbers_finish(&squares->numbers);
    free(squares);
}

/* Runs, and the numbers that a merge gives, grow with the pool, to a fraction of it. */
static size_t square_bytes(const struct square *square)
{
    return square->pool.bytes + square->runs.capacity * sizeof *square->runs.items;
}

void umbb_squares_allow(struct umbb_squares *squares, size_t max_bytes)
{
    squares->max_bytes = max_bytes / UMBB_SQUARE_COUNT;
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        struct square *square = &squares->squares[i];
        if (square_bytes(square) > squares->max_bytes) {
            square_release(square);
        }
    }
}

void umbb_squares_begin(struct umbb_squares *squares, const struct umbb_tile *tile)
{
    squares->tile = tile;
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        atomic_store_explicit(&squares->squares[i].is_done, 0, memory_order_relaxed);
    }
}

/* The even bits of a job's number, moved together. */
static size_t even_bits(uint32_t job)
{
    size_t bits = 0;
    for (uint32_t i = 0; i < UMBB_SQUARES_ACROSS_LOG2; i++) {
        bits |= (size_t)(job >> (2 * i) & 1) << i;
    }
    return bits;
}

/* The inverse: which job builds square (x, y). */
static uint32_t job_of(size_t x, size_t y)
{
    uint32_t job = 0;
    for (uint32_t i = 0; i < UMBB_SQUARES_ACROSS_LOG2; i++) {
        job |= (uint32_t)(x >> i & 1) << (2 * i) | (uint32_t)(y >> i & 1) << (2 * i + 1);
    }
    return job;
}

/*
 * Whether the tile's tree comes down to a square: nothing above it is uniform. Below what is, the
 * texels and the pyramid need not have been written (tile.h).
 */
static int is_wanted(const struct umbb_tile *tile, const struct umbb_square *square)
{
    for (uint32_t level = tile->log2_size; level > square->level; level--) {
        const size_t x = square->place[0] >> (level - square->level);
        const size_t y = square->place[1] >> (level - square->level);
        const size_t at = (y << (tile->log2_size - level)) + x;
        const struct umbb_column column =
            umbb_column_bounds(level, tile->max_lit[level][at], tile->min_end[level][at]);
        if (column.mixed_first == column.mixed_end) {
            return 0;
        }
    }
    return 1;
}

void umbb_squares_job(struct umbb_squares *squares, uint32_t job)
{
    struct square *square = &squares->squares[job];
    const struct umbb_square place = {squares->level, {even_bits(job), even_bits(job >> 1)}};
    if (is_wanted(squares->tile, &place)) { /* if not, nobody takes it */
        umb_pool_clear(&square->pool);
        square->pool.alloc = NULL;
        square->pool.max_bytes = squares->max_bytes / 4 * 3; /* the rest is for runs and numbers */
        square->runs.count = 0;
        square->status = umbb_column_of_square(&square->pool, squares->tile, &place, &square->runs,
                                               &square->column, NULL);
    }
    atomic_store_explicit(&square->is_done, 1, memory_order_release);
}

static int square_is_done(void *user)
{
    struct square *square = user;
    return atomic_load_explicit(&square->is_done, memory_order_acquire);
}

/* Moves a square's nodes into the bake's pool. */
static enum umb_status square_merge(struct umbb_squares *squares, const struct square *square,
                                    struct umbb_column *column, struct umb_error *error)
{
    enum umb_status status =
        umb_pool_merge(squares->pool, &square->pool, squares->level, &squares->numbers, error);
    *column = square->column;
    column->run_first = squares->runs->count;
    for (size_t i = 0; i < square->column.run_count && status == UMB_OK; i++) {
        const struct umbb_run run = square->runs.items[square->column.run_first + i];
        const uint32_t ref =
            umb_ref_state(run.ref) == UMB_NODE_MIXED ? squares->numbers.refs[run.ref] : run.ref;
        status = umbb_runs_push(squares->runs, column->run_first, run.z_end, ref, error);
    }
    column->run_count = squares->runs->count - column->run_first;
    return status;
}

/* The column over a square, as a leaf of the tile's tree. */
static enum umb_status square_take(void *user, size_t x, size_t y, struct umbb_column *column,
                                   struct umb_error *error)
{
    struct umbb_squares *squares = user;
    struct square *square = &squares->squares[job_of(x, y)];
    umbb_jobs_wait_until(squares->jobs, square_is_done, square);
    if (square->status == UMB_OK) {
        return square_merge(squares, square, column, error);
    }
    square_release(square); /* it has more than its share */
    const struct umbb_square place = {squares->level, {x, y}};
    return umbb_column_of_square(squares->pool, squares->tile, &place, squares->runs, column,
                                 error);
}

enum umb_status umbb_squares_column(struct umbb_squares *squares, struct umbb_jobs *jobs,
                                    struct umb_pool *pool, struct umbb_runs *runs,
                                    struct umbb_column *column, struct umb_error *error)
{
    const struct umbb_tile *tile = squares->tile;
    squares->jobs = jobs;
    squares->pool = pool;
    squares->runs = runs;
    const struct umbb_column_tree tree = {
        .pool = pool,
        .runs = runs,
        .log2_size = tile->log2_size,
        .leaf_level = squares->level,
        .max_lit = tile->max_lit,
        .min_end = tile->min_end,
        .leaf = square_take,
        .user = squares,
    };
    const size_t whole[2] = {0, 0};
    const enum umb_status status =
        umbb_column_of_tree(&tree, tile->log2_size, whole, column, error);
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) { /* those of uniform parts of the tile */
        umbb_jobs_wait_until(jobs, square_is_done, &squares->squares[i]);
    }
    return status;
}
