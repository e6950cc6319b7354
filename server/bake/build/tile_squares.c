/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Slices build the squares in the order in which the owner joins them (quarter by quarter), so the
 * owner seldom waits. The squares' pools live as long as the bake: they are cleared, not freed. The
 * pool given back last is reused first, as it may still be in a cache; a single thread uses only
 * one pool.
 */
#include "bake/build/tile_squares.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "base/try.h"

/* Pool and runs in which a square is built. */
struct work {
    struct umb__pool pool;
    struct umbb_runs runs;
};

/* One square of a tile. Its slice writes all fields and then is_done, for which the owner waits. */
struct square {
    struct work *work; /* NULL once the owner has taken its content */
    struct umbb_column column;
    enum umb_status status;
    atomic_int is_done;
};

struct umbb_squares {
    uint32_t level;   /* level of a square */
    size_t max_bytes; /* limit of a square's pool and runs */
    const struct umbb_tile *tile;
    struct square squares[UMBB_SQUARE_COUNT];
    struct work works[UMBB_SQUARE_COUNT];
    pthread_mutex_t lock; /* guards the next two */
    struct work *idle[UMBB_SQUARE_COUNT];
    unsigned idle_count;
    struct umb__pool_numbers numbers;
    /* While a column is built: */
    struct umbu_threads *jobs;
    struct umb__pool *pool;
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
    pthread_mutex_init(&squares->lock, NULL);
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        umb__pool_init_loose(&squares->works[i].pool, NULL, SIZE_MAX);
        squares->idle[squares->idle_count++] = &squares->works[i];
    }
    return UMB_OK;
}

/* Takes a work. There are as many as squares, so there is always one. */
static struct work *work_take(struct umbb_squares *squares)
{
    pthread_mutex_lock(&squares->lock);
    struct work *work = squares->idle[--squares->idle_count];
    pthread_mutex_unlock(&squares->lock);
    return work;
}

static void square_give_back(struct umbb_squares *squares, struct square *square)
{
    pthread_mutex_lock(&squares->lock);
    squares->idle[squares->idle_count++] = square->work;
    pthread_mutex_unlock(&squares->lock);
    square->work = NULL;
}

static void work_release(struct work *work)
{
    umb__pool_finish(&work->pool);
    umb__pool_init_loose(&work->pool, NULL, SIZE_MAX);
    umbb_runs_finish(&work->runs);
}

void umbb_squares_destroy(struct umbb_squares *squares)
{
    if (squares == NULL) {
        return;
    }
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        work_release(&squares->works[i]);
    }
    umb__pool_numbers_finish(&squares->numbers);
    pthread_mutex_destroy(&squares->lock);
    free(squares);
}

/* Returns the bytes of a square's node pool and runs. The table of new node numbers that a merge
 * needs is left out: it takes only a fraction of the pool's bytes. */
static size_t work_bytes(const struct work *work)
{
    return work->pool.bytes + work->runs.capacity * sizeof *work->runs.items;
}

void umbb_squares_allow(struct umbb_squares *squares, size_t max_bytes)
{
    squares->max_bytes = max_bytes / UMBB_SQUARE_COUNT;
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) {
        if (work_bytes(&squares->works[i]) > squares->max_bytes) {
            work_release(&squares->works[i]);
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

/* The even bits of a slice's number, packed together. */
static size_t even_bits(uint32_t job)
{
    size_t bits = 0;
    for (uint32_t i = 0; i < UMBB_SQUARES_ACROSS_LOG2; i++) {
        bits |= (size_t)(job >> (2 * i) & 1) << i;
    }
    return bits;
}

/* The inverse: number of the slice that builds square (x, y). */
static uint32_t job_of(size_t x, size_t y)
{
    uint32_t job = 0;
    for (uint32_t i = 0; i < UMBB_SQUARES_ACROSS_LOG2; i++) {
        job |= (uint32_t)(x >> i & 1) << (2 * i) | (uint32_t)(y >> i & 1) << (2 * i + 1);
    }
    return job;
}

/*
 * Returns whether the tile's tree descends to a square: no square above it is uniform. Below a
 * uniform square texels and pyramid may be unwritten (tile.h).
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
    if (is_wanted(squares->tile, &place)) { /* otherwise the square is never taken */
        struct work *work = work_take(squares);
        umb__pool_clear(&work->pool);
        work->pool.max_bytes = squares->max_bytes / 4 * 3; /* the rest is for runs and numbers */
        work->runs.count = 0;
        square->work = work;
        square->status = umbb_column_of_square(&work->pool, squares->tile, &place, &work->runs,
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
    const struct work *work = square->work;
    UMB__TRY(umb__pool_merge(squares->pool, &work->pool, squares->level, &squares->numbers, error));
    *column = square->column;
    column->run_first = squares->runs->count;
    for (size_t i = 0; i < square->column.run_count; i++) {
        const struct umbb_column_run run = work->runs.items[square->column.run_first + i];
        const uint32_t ref =
            umb__ref_state(run.ref) == UMB__NODE_MIXED ? squares->numbers.refs[run.ref] : run.ref;
        UMB__TRY(umbb_runs_push(squares->runs, column->run_first, run.z_end, ref, error));
    }
    column->run_count = squares->runs->count - column->run_first;
    return UMB_OK;
}

/* The column over a square, as a leaf of the tile's tree. */
static enum umb_status square_take(void *user, size_t x, size_t y, struct umbb_column *column,
                                   struct umb_error *error)
{
    struct umbb_squares *squares = user;
    struct square *square = &squares->squares[job_of(x, y)];
    umbu_threads_wait_until(squares->jobs, square_is_done, square);
    if (square->status == UMB_OK) {
        const enum umb_status status = square_merge(squares, square, column, error);
        square_give_back(squares, square);
        return status;
    }
    work_release(square->work); /* the square needs more than its share */
    square_give_back(squares, square);
    const struct umbb_square place = {squares->level, {x, y}};
    return umbb_column_of_square(squares->pool, squares->tile, &place, squares->runs, column,
                                 error);
}

enum umb_status umbb_squares_column(struct umbb_squares *squares, struct umbu_threads *jobs,
                                    struct umb__pool *pool, struct umbb_runs *runs,
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
    for (uint32_t i = 0; i < UMBB_SQUARE_COUNT; i++) { /* squares that were not waited for */
        struct square *square = &squares->squares[i];
        umbu_threads_wait_until(jobs, square_is_done, square);
        if (square->work != NULL) { /* an error came first */
            square_give_back(squares, square);
        }
    }
    return status;
}
