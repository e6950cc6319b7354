/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Loop over the tiles of a frustum, and building of the levels above the tiles.
 *
 * The grid of tiles keeps the greatest lit, the least end and the column's runs of each tile. The
 * levels above the tiles need no more, so their nodes do not depend on the division into tiles.
 */
#include "bake/build/tile_loop.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "bake/build/columns.h"
#include "base/try.h"
#include "tool/threads.h"
#include "bake/build/tile_occluder_depth.h"
#include "bake/build/tile_squares.h"
#include "tool/clock.h"

/* Divisor of the unallocated budget: a tile's squares may use one part in SQUARES_SHARE. */
#define SQUARES_SHARE 8U

struct loop {
    const struct umbb_depth *depth;
    const struct umbb_bake_options *options;
    struct umb__pool *pool; /* shared by all frusta */
    struct umbu_threads *jobs;
    struct umbb_tile own[2], *tiles; /* `tiles`: the options', else `own` */
    struct umbb_squares *squares;
    struct umbb_runs runs;       /* working stack */
    struct umbb_runs kept;       /* runs of the tiles' columns */
    struct umbb_column *columns; /* [tiles] */
    /* Pyramids of the grid above the tiles: levels tile_log2 .. log2_size. */
    int32_t *max_lit[UMB_LEVEL_MAX + 1], *min_end[UMB_LEVEL_MAX + 1];
    atomic_uint_fast64_t texels_done;
    size_t spare_bytes;   /* unallocated part of the shared budget */
    atomic_int failed;    /* 1: blocks not yet begun are skipped */
    int only;             /* 1: only some tiles, for the tile cache */
    int drawn_slot;       /* slot of the tile whose depth is being drawn */
    int ruled_slot;       /* slot of the tile under the static rule */
    uint32_t square_jobs; /* number of slices that build the tile before */
    struct umbb_bake_figures figures;
};

static int is_cancelled(const struct loop *loop)
{
    return loop->options->cancelled != NULL && loop->options->cancelled();
}

static enum umb_status check_cancelled(const struct loop *loop, struct umb_error *error)
{
    return is_cancelled(loop) ? umb_fail(error, UMB_E_CANCELLED, "interrupted: nothing was written")
                              : UMB_OK;
}

size_t umbb_bake_tile_bytes(uint32_t log2_size, uint32_t tile_log2, int closed_rule)
{
    return (log2_size == tile_log2 ? 1 : 2) * umbb_tile_bytes(tile_log2, closed_rule);
}

/* Number of tiles along a side. */
static uint32_t grid_width(const struct umbb_bake_options *options)
{
    return 1U << (options->log2_size - options->tile_log2);
}

/* Allocates a tile unless an earlier frustum left one of the same shape. */
static enum umb_status tile_reserve(struct umbb_tile *tile, const struct umbb_bake_options *o,
                                    struct umb_error *error)
{
    const int closed_rule = o->closed_rule || o->rule != NULL;
    if (tile->memory != NULL && tile->log2_size == o->tile_log2 &&
        (tile->end != tile->lit) == closed_rule) {
        return UMB_OK;
    }
    umbb_tile_finish(tile);
    return umbb_tile_init(tile, o->tile_log2, closed_rule, error);
}

static enum umb_status loop_init(struct loop *loop, struct umb_error *error)
{
    const struct umbb_bake_options *o = loop->options;
    loop->pool->max_bytes = o->octree_max_bytes;
    UMB__TRY(umbu_threads_create(o->threads, &loop->jobs, error));
    UMB__TRY(umbb_squares_create(o->tile_log2, &loop->squares, error));
    const int slots = o->tile_log2 == o->log2_size ? 1 : 2;
    for (int i = 0; i < slots; i++) {
        UMB__TRY(tile_reserve(&loop->tiles[i], o, error));
    }
    const size_t n = grid_width(o);
    loop->columns = calloc(n * n, sizeof *loop->columns);
    int complete = loop->columns != NULL;
    for (uint32_t level = o->tile_log2; level <= o->log2_size; level++) {
        const size_t count = (size_t)1 << (2 * (o->log2_size - level));
        int32_t *bounds = malloc(2 * count * sizeof *bounds);
        complete = complete && bounds != NULL;
        loop->max_lit[level] = bounds;
        loop->min_end[level] = bounds == NULL ? NULL : bounds + count;
    }
    return complete ? UMB_OK
                    : umb_fail(error, UMB_E_NO_MEMORY, "grid of %zu tiles: memory refused", n * n);
}

static void loop_finish(struct loop *loop)
{
    umbu_threads_destroy(loop->jobs);
    umbb_squares_destroy(loop->squares);
    umbb_tile_finish(&loop->own[0]);
    umbb_tile_finish(&loop->own[1]);
    umbb_runs_finish(&loop->runs);
    umbb_runs_finish(&loop->kept);
    free(loop->columns);
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        free(loop->max_lit[level]);
    }
}

/* Draws one block of depth. */
static void depth_job(struct loop *loop, uint32_t job, unsigned thread)
{
    struct umbb_tile *tile = &loop->tiles[loop->drawn_slot];
    const int32_t block = umbb_tile_block(tile);
    const uint32_t across = (uint32_t)(tile->size / block);
    if (!is_cancelled(loop) && !atomic_load_explicit(&loop->failed, memory_order_relaxed)) {
        loop->depth->block(loop->depth->state, loop->drawn_slot, thread, tile,
                           (int32_t)(job % across), (int32_t)(job / across));
        atomic_fetch_add_explicit(&loop->texels_done, (uint64_t)block * (uint64_t)block,
                                  memory_order_relaxed);
    }
}

/* Runs a slice: first squares of the tile being built, then blocks of the tile being drawn. */
static void run_job(void *user, uint32_t job, unsigned thread)
{
    struct loop *loop = user;
    if (job < loop->square_jobs) {
        umbb_squares_job(loop->squares, job);
    } else {
        depth_job(loop, job - loop->square_jobs, thread);
    }
}

static void show_progress(void *user)
{
    struct loop *loop = user;
    if (loop->options->progress != NULL) {
        loop->options->progress(loop->options->progress_user,
                                atomic_load_explicit(&loop->texels_done, memory_order_relaxed),
                                loop->figures.tiles, loop->figures.tiles_found);
    }
}

static size_t at_most(size_t value, size_t limit)
{
    return value < limit ? value : limit;
}

/* Divides the shared budget: the octree, the columns and the depth path's lists may each use all
 * that the other two have not taken. */
static enum umb_status share_memory(struct loop *loop, struct umb_error *error)
{
    const struct umbb_bake_options *o = loop->options;
    const size_t limit = o->shared_max_bytes > 0 ? o->shared_max_bytes : SIZE_MAX;
    const size_t runs =
        (loop->runs.capacity + loop->kept.capacity) * sizeof *loop->runs.items +
        (o->occluder_depth != NULL ? umb__occluder_depth_bytes(o->occluder_depth) : 0);
    if (runs > limit || loop->pool->bytes > limit - runs) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: the shadow octree's %zu MiB and its columns' %zu MiB are more "
                        "than the %zu MiB left; give more or lower the resolution",
                        loop->pool->bytes >> 20, runs >> 20, limit >> 20);
    }
    const size_t lists =
        umbb_tile_lists_allow(loop->depth->lists, limit - runs - loop->pool->bytes);
    loop->pool->max_bytes =
        at_most(o->octree_max_bytes, limit - runs - at_most(lists, limit - runs));
    loop->spare_bytes = loop->pool->max_bytes - at_most(loop->pool->bytes, loop->pool->max_bytes);
    const size_t squares = loop->spare_bytes / SQUARES_SHARE;
    umbb_squares_allow(loop->squares, squares);
    loop->spare_bytes -= squares;
    loop->pool->max_bytes -= squares;
    return UMB_OK;
}

static struct umbb_tile_place place_of(const struct loop *loop, uint32_t number)
{
    const uint32_t n = grid_width(loop->options);
    return (struct umbb_tile_place){
        .x0 = (int32_t)((number % n) << loop->options->tile_log2),
        .y0 = (int32_t)((number / n) << loop->options->tile_log2),
        .number = number,
    };
}

/* Prepares the drawing of a tile. Out: blocks: number of slices. */
static enum umb_status depth_begin(struct loop *loop, uint32_t number, int slot, uint32_t *blocks,
                                   struct umb_error *error)
{
    const struct umbb_tile_place place = place_of(loop, number);
    struct umbb_tile *tile = &loop->tiles[slot];
    tile->x0 = place.x0;
    tile->y0 = place.y0;
    UMB__TRY(share_memory(loop, error));
    UMB__TRY(loop->depth->begin(loop->depth->state, slot, tile, error));
    const uint32_t across = (uint32_t)(tile->size / umbb_tile_block(tile));
    loop->drawn_slot = slot;
    *blocks = across * across;
    return share_memory(loop, error); /* shares the rest after begin */
}

/* Keeps the part of a tile's result that the levels above need. */
static enum umb_status result_keep(struct loop *loop, uint32_t number,
                                   const struct umbb_tile_result *result, struct umb_error *error)
{
    const uint32_t level = loop->options->tile_log2;
    loop->max_lit[level][number] = result->max_lit;
    loop->min_end[level][number] = result->min_end;
    loop->columns[number] = result->column;
    if (loop->only) { /* the levels above are built elsewhere */
        const struct umb_alloc *alloc = loop->pool->alloc;
        umb__pool_finish(loop->pool);
        umb__pool_init(loop->pool, alloc, loop->options->octree_max_bytes);
        return UMB_OK;
    }
    return umbb_runs_keep(&loop->kept, &loop->runs, &loop->columns[number], error);
}

/* Takes over a tile's nodes, whose squares are being built. */
static enum umb_status tile_build(struct loop *loop, uint32_t number, int slot,
                                  struct umb_error *error)
{
    const struct umbb_cached_tiles *cached_tiles = loop->options->cached_tiles;
    const struct umbb_tile *tile = &loop->tiles[slot];
    const uint32_t level = tile->log2_size;
    struct umbb_tile_result result = {
        .max_lit = tile->max_lit[level][0],
        .min_end = tile->min_end[level][0],
    };
    loop->runs.count = 0;
    UMB__TRY(umbb_squares_column(loop->squares, loop->jobs, loop->pool, &loop->runs, &result.column,
                                 error));
    if (loop->options->occluder_depth != NULL) {
        UMB__TRY(umbb_tile_occluder_depth(tile, loop->options->occluder_depth, error));
    }
    if (cached_tiles != NULL) {
        const struct umbb_tile_place place = place_of(loop, number);
        UMB__TRY(share_memory(loop, error));
        const struct umbb_tile_nodes nodes = {loop->pool, &loop->runs, loop->spare_bytes};
        UMB__TRY(cached_tiles->keep(cached_tiles->user, &place, &nodes, &result, error));
    }
    return result_keep(loop, number, &result, error);
}

/* Looks a tile up in the tile cache. */
static enum umb_status tile_find(struct loop *loop, uint32_t number, int *found,
                                 struct umb_error *error)
{
    const struct umbb_cached_tiles *cached_tiles = loop->options->cached_tiles;
    const struct umbb_tile_place place = place_of(loop, number);
    struct umbb_tile_result result;
    UMB__TRY(share_memory(loop, error));
    /* A quarter of the spare bytes is for the cache's work, three quarters are for the nodes that
     * the cache adds to the pool. */
    const struct umbb_tile_nodes nodes = {loop->pool, &loop->runs, loop->spare_bytes / 4};
    loop->pool->max_bytes -= nodes.max_bytes;
    loop->runs.count = 0;
    UMB__TRY(cached_tiles->find(cached_tiles->user, &place, &nodes, &result, found, error));
    if (*found) {
        loop->figures.tiles++;
        loop->figures.tiles_found++;
        UMB__TRY(result_keep(loop, number, &result, error));
        show_progress(loop);
    }
    return UMB_OK;
}

/* Advances *number to the first tile at or after *number that the tile cache lacks, or to `end`. */
static enum umb_status next_unknown(struct loop *loop, uint32_t *number, uint32_t end,
                                    struct umb_error *error)
{
    int found = loop->options->cached_tiles != NULL;
    while (found && *number < end) {
        UMB__TRY(check_cancelled(loop, error));
        UMB__TRY(tile_find(loop, *number, &found, error));
        *number += found != 0;
    }
    return UMB_OK;
}

/* Applies the static rule to a band of the next tile to be built. */
static void static_job(void *user, uint32_t job, unsigned thread)
{
    struct loop *loop = user;
    (void)thread;
    if (!umbb_static_band(loop->options->rule, &loop->tiles[loop->ruled_slot], job)) {
        atomic_store_explicit(&loop->failed, 1, memory_order_relaxed);
    }
}

/* Applies the static rule to a drawn tile. Returns 0 if out of memory. */
static int static_bands(struct loop *loop, int slot)
{
    struct umbb_tile *tile = &loop->tiles[slot];
    umbb_static_begin(loop->options->rule, tile);
    loop->ruled_slot = slot;
    umbu_threads_start(loop->jobs, static_job, loop, (uint32_t)tile->size / UMBB_STATIC_BAND);
    umbu_threads_wait(loop->jobs, NULL, NULL);
    return !atomic_load_explicit(&loop->failed, memory_order_relaxed);
}

/*
 * Builds a drawn tile while the next is drawn.
 *
 * In: number: number of the tile in `slot`. next: number of the tile to be drawn next, or `end` if
 *     there is none.
 */
static enum umb_status tile_step(struct loop *loop, uint32_t number, uint32_t next, uint32_t end,
                                 int slot, struct umb_error *error)
{
    uint32_t blocks = 0;
    UMB__TRY(next < end ? depth_begin(loop, next, 1 - slot, &blocks, error)
                        : share_memory(loop, error));
    if (loop->options->rule != NULL && !static_bands(loop, slot)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "static rule: memory for a band refused");
    }
    umbb_tile_pyramid(&loop->tiles[slot]);
    umbb_squares_begin(loop->squares, &loop->tiles[slot]);
    loop->square_jobs = UMBB_SQUARE_COUNT;
    umbu_threads_start(loop->jobs, run_job, loop, loop->square_jobs + blocks);
    return tile_build(loop, number, slot, error);
}

/* Builds the wanted tiles, one after another. */
static enum umb_status build_tiles(struct loop *loop, struct umb_error *error)
{
    const uint32_t n = grid_width(loop->options);
    const uint32_t end = loop->only ? loop->options->only_end : n * n;
    uint32_t number = loop->only ? loop->options->only_first : 0;
    uint32_t blocks = 0;
    int slot = 0;
    UMB__TRY(next_unknown(loop, &number, end, error));
    if (number < end) {
        UMB__TRY(depth_begin(loop, number, slot, &blocks, error));
    }
    umbu_threads_start(loop->jobs, run_job, loop, blocks);
    while (number < end) {
        const double start = umbu_clock_s();
        umbu_threads_wait(loop->jobs, show_progress, loop);
        show_progress(loop);
        const double depth_done = umbu_clock_s();
        loop->figures.seconds_depth += depth_done - start;
        UMB__TRY(check_cancelled(loop, error));
        uint32_t next = number + 1;
        UMB__TRY(next_unknown(loop, &next, end, error));
        const enum umb_status status = tile_step(loop, number, next, end, slot, error);
        loop->figures.tiles++;
        show_progress(loop);
        UMB__TRY(status);
        number = next;
        slot = 1 - slot;
        loop->figures.seconds_build += umbu_clock_s() - depth_done;
    }
    return UMB_OK;
}

/* Draws every tile for the static rule's survey of triangles. */
static enum umb_status static_survey(struct loop *loop, struct umb_error *error)
{
    const uint32_t n = grid_width(loop->options);
    for (uint32_t number = 0; number < n * n; number++) {
        uint32_t blocks = 0;
        UMB__TRY(check_cancelled(loop, error));
        UMB__TRY(depth_begin(loop, number, 0, &blocks, error));
        umbu_threads_start(loop->jobs, run_job, loop, blocks);
        umbu_threads_wait(loop->jobs, NULL, NULL);
        umbb_static_survey(loop->options->rule, &loop->tiles[0], loop->jobs,
                           loop->options->cancelled);
    }
    atomic_store(&loop->texels_done, 0); /* the tiles were not built */
    return UMB_OK;
}

/* Fills the pyramids of the grid above the tiles. */
static void grid_reduce(struct loop *loop)
{
    const struct umbb_bake_options *o = loop->options;
    for (uint32_t level = o->tile_log2 + 1; level <= o->log2_size; level++) {
        const size_t n = (size_t)1 << (o->log2_size - level);
        umbb_pyramid_step(loop->max_lit[level - 1], loop->min_end[level - 1], n,
                          loop->max_lit[level], loop->min_end[level]);
    }
}

/* The column over a tile, as a leaf of the tree above the tiles. */
static enum umb_status tile_column(void *user, size_t x, size_t y, struct umbb_column *column,
                                   struct umb_error *error)
{
    struct loop *loop = user;
    *column = loop->columns[y * grid_width(loop->options) + x];
    return umbb_runs_keep(&loop->runs, &loop->kept, column, error);
}

/* Builds the levels above the tiles, and the root. */
static enum umb_status build_root(struct loop *loop, uint32_t *root, struct umb_error *error)
{
    const uint32_t level = loop->options->log2_size;
    grid_reduce(loop);
    loop->runs.count = 0;
    struct umbb_column column;
    const struct umbb_column_tree tree = {
        .pool = loop->pool,
        .runs = &loop->runs,
        .log2_size = level,
        .leaf_level = loop->options->tile_log2,
        .max_lit = loop->max_lit,
        .min_end = loop->min_end,
        .leaf = tile_column,
        .user = loop,
    };
    const size_t whole[2] = {0, 0};
    UMB__TRY(umbb_column_of_tree(&tree, level, whole, &column, error));
    /* The column has a single node: shadowed if mixed_end is 0, else lit, unless it is mixed. */
    *root = column.mixed_end == 0 ? UMB__REF_SHADOWED : UMB__REF_LIT;
    if (column.mixed_first < column.mixed_end) {
        *root = loop->runs.items[column.run_first].ref;
    }
    loop->figures.octree_bytes = loop->pool->bytes;
    return UMB_OK;
}

/* Bakes after everything is set up. The caller ends the threads after a failure. */
static enum umb_status loop_run(struct loop *loop, uint32_t *root, struct umb_error *error)
{
    UMB__TRY(loop_init(loop, error));
    if (loop->options->rule != NULL) {
        UMB__TRY(static_survey(loop, error));
    }
    UMB__TRY(build_tiles(loop, error));
    if (!loop->only) {
        const double start = umbu_clock_s();
        UMB__TRY(build_root(loop, root, error));
        loop->figures.seconds_build += umbu_clock_s() - start;
    }
    return UMB_OK;
}

enum umb_status umbb_bake_into(const struct umbb_depth *depth,
                               const struct umbb_bake_options *options, struct umb__pool *pool,
                               uint32_t *root, struct umbb_bake_figures *figures,
                               struct umb_error *error)
{
    struct loop loop = {.depth = depth,
                        .options = options,
                        .pool = pool,
                        .only = options->only_end > options->only_first};
    loop.tiles = options->tiles != NULL ? options->tiles : loop.own;
    atomic_init(&loop.texels_done, 0);
    atomic_init(&loop.failed, 0);
    const enum umb_status status = loop_run(&loop, root, error);
    atomic_store_explicit(&loop.failed, status != UMB_OK, memory_order_relaxed);
    loop.figures.texels = atomic_load(&loop.texels_done);
    loop_finish(&loop);
    if (figures != NULL) {
        *figures = loop.figures;
    }
    return status;
}
