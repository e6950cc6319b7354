/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The rasteriser.
 *
 * Invariant: a texel's three integers are the minimum of the predicate over all casters; bins only
 * leave out casters whose bounding box holds no centre of the block. Blocks have 256x256 texels:
 * three layers of integers fit the second-level cache. Blocks four times as wide were measured more
 * than twice as slow at high resolution.
 */
#include "bake/depth/depth_raster.h"

#include <stdlib.h>
#include <string.h>

#include "tool/threads.h"
#include "bake/depth/coverage.h"
#include "bake/depth/cut_out.h"
#include "bake/depth/depth_cells.h"
#include "bake/depth/depth_draw.h"
#include "bake/depth/depth_store.h"
#include "bake/depth/front_marks.h"
#include "bake/depth/proven_squares.h"
#include "bake/depth/triangle_bins.h"

/* Sizes of a layer, of its array of 8x8 blocks, and of a thread's layers. */
#define LAYER_TEXELS  ((size_t)UMBB_BLOCK * UMBB_BLOCK)
#define LAYER_FAR     (LAYER_TEXELS / 64)
#define LAYERS_STRIDE (UMBB_LAYER_COUNT * (LAYER_TEXELS + LAYER_FAR))
#define AHEAD         ((size_t)32)   /* triangles that are prefetched before they are drawn */
#define FAR_MAX       ((size_t)2048) /* far sides of a block that wait for near ones */
#define CACHE_LINE    ((size_t)64)

_Static_assert(UMBB_BLOCK <= UMBB_CANVAS_MAX, "a block is a canvas");

/* Squares of a block that may be proven, and the most unproven ones that are drawn one by one. */
#define BLOCK_SQUARES ((size_t)1 << (2 * (UMBB_BLOCK_LOG2 - UMBB_SQUARE_LOG2)))
#define FEW_SQUARES   ((size_t)8)

struct raster {
    const struct umbb_casters *casters; /* casters with their marks (`marked`) */
    struct umbb_casters marked;
    uint8_t *marks;
    struct umbb_depth_options options;
    umbb_prepare_fn prepare;
    umbb_draw_fn draw;
    umbb_far_fn find_far;
    umbb_store_fn store;
    const struct umbb_cells_steps *steps; /* NULL: triangles are drawn at once, by draw */
    struct umbb_cells *cells;             /* [threads], with steps */
    struct umbb_bins tiles;               /* the whole map by tile */
    struct umbb_bins blocks[2];           /* a tile by block, one a slot */
    int32_t *layers;                      /* [threads][LAYERS_STRIDE] */
    struct umbu_threads *jobs;            /* threads for preparation; idle while blocks are drawn */
    struct umb_workers workers;
};

static size_t entry_bytes(const struct umbb_bins *bins)
{
    return (size_t)bins->capacity * sizeof *bins->entries;
}

static size_t raster_allow(void *state, size_t max_bytes)
{
    struct raster *raster = state;
    raster->options.max_bytes = max_bytes;
    return entry_bytes(&raster->tiles) + entry_bytes(&raster->blocks[0]) +
           entry_bytes(&raster->blocks[1]);
}

static const struct umbb_casters *raster_reach(void *state, int32_t x0, int32_t y0,
                                               const uint32_t **list, size_t *count)
{
    const struct raster *raster = state;
    *list = umbb_bins_cell(&raster->tiles, raster->options.tile_log2, x0, y0, count);
    return raster->casters;
}

static enum umb_status raster_begin(void *state, int slot, struct umbb_tile *tile,
                                    struct umb_error *error)
{
    struct raster *raster = state;
    const uint32_t tile_log2 = raster->options.tile_log2;
    size_t count;
    const uint32_t *list = umbb_bins_cell(&raster->tiles, tile_log2, tile->x0, tile->y0, &count);
    const uint32_t block_log2 = tile_log2 < UMBB_BLOCK_LOG2 ? tile_log2 : UMBB_BLOCK_LOG2;
    const size_t others =
        entry_bytes(&raster->tiles) + entry_bytes(&raster->blocks[slot == 0 ? 1 : 0]);
    const struct umbb_bins_input input = {
        .max_bytes = raster->options.max_bytes > others ? raster->options.max_bytes - others : 0,
        .casters = raster->casters,
        .list = list,
        .count = count,
        .x0 = tile->x0,
        .y0 = tile->y0,
        .cell_log2 = block_log2,
        .cells_x = 1U << (tile_log2 - block_log2),
        .workers = &raster->workers,
    };
    tile->background = raster->casters->size;
    umbb_prove_squares(raster->casters, input.list, input.count, input.workers, tile);
    return umbb_bins_fill(&raster->blocks[slot], &input, error);
}

/* A block being drawn. */
struct drawing {
    const struct raster *raster;
    int32_t *texels;          /* [UMBB_LAYER_COUNT][count] */
    int32_t *far;             /* [UMBB_LAYER_COUNT][LAYER_FAR] */
    struct umbb_cells *cells; /* NULL: none are noted */
    size_t count;
    struct umbb_canvas canvas; /* place and size */
    int has_layers;            /* 1: the layers are in use */
    int often_hidden;          /* 1: what is to come is likely to be hidden */
};

static void fill(int32_t *layer, size_t count, int32_t value)
{
    const size_t chunk = count < 512 ? count : 512;
    for (size_t i = 0; i < chunk; i++) {
        layer[i] = value;
    }
    for (size_t i = chunk; i < count; i += chunk) { /* copying is faster than setting */
        memcpy(layer + i, layer, (count - i < chunk ? count - i : chunk) * sizeof *layer);
    }
}

/* Clears the layers and puts them in use, unless they are. */
static void need_layers(struct drawing *drawing)
{
    const struct umbb_casters *casters = drawing->raster->casters;
    if (!drawing->has_layers) {
        fill(drawing->texels, (casters->closed_rule ? UMBB_LAYER_COUNT : 1) * drawing->count,
             casters->size);
        fill(drawing->far, UMBB_LAYER_COUNT * LAYER_FAR, casters->size);
        drawing->has_layers = 1;
    }
}

/* Chooses the layers of a kind of triangles. */
static struct umbb_sides choose_sides(const struct drawing *drawing, uint8_t kind)
{
    struct umbb_sides sides = {UMBB_LAYER_OPEN, UMBB_LAYER_OPEN, drawing->often_hidden};
    if (drawing->raster->casters->closed_rule && kind != UMBB_CASTER_OPEN) {
        const int flipped = kind == UMBB_CASTER_CLOSED_FLIPPED;
        sides.front = flipped ? UMBB_LAYER_BACK : UMBB_LAYER_FRONT;
        sides.back = flipped ? UMBB_LAYER_FRONT : UMBB_LAYER_BACK;
    }
    return sides;
}

/* The canvas of a kind's layers; puts the layers in use. */
static const struct umbb_canvas *choose_canvas(struct drawing *drawing, uint8_t kind)
{
    const struct umbb_sides sides = choose_sides(drawing, kind);
    struct umbb_canvas *canvas = &drawing->canvas;
    need_layers(drawing);
    canvas->front = drawing->texels + (size_t)sides.front * drawing->count;
    canvas->back = drawing->texels + (size_t)sides.back * drawing->count;
    canvas->front_far = drawing->far + (size_t)sides.front * LAYER_FAR;
    canvas->back_far = drawing->far + (size_t)sides.back * LAYER_FAR;
    canvas->fresh = !drawing->often_hidden;
    return canvas;
}

/* Triangles of one kind. */
struct batch {
    uint32_t triangles[UMBB_DRAW_MAX];
    struct umbb_coverage coverages[UMBB_DRAW_MAX];
    size_t count;
    uint8_t kind;
};

/*
 * Triangles that face away from the light. They are drawn after those that face it: far sides lie
 * behind near sides, and most of them then need not be drawn.
 */
struct far_sides {
    uint32_t triangles[FAR_MAX];
    size_t count;
};

/* True if a prepared triangle seems to be the near side of a solid; this affects time only. */
static int is_near_side(const struct umbb_coverage *coverage, uint8_t kind)
{
    return coverage->facing != (kind == UMBB_CASTER_CLOSED_FLIPPED);
}

/* Draws or notes prepared triangles of a kind. */
static void draw_prepared(struct drawing *drawing, const struct umbb_coverage *coverages,
                          size_t count, uint8_t kind)
{
    const struct raster *raster = drawing->raster;
    if (drawing->cells == NULL) {
        raster->draw(coverages, count, choose_canvas(drawing, kind));
        return;
    }
    const struct umbb_sides sides = choose_sides(drawing, kind);
    for (size_t done = 0; done < count;) {
        done += raster->steps->note(drawing->cells, coverages + done, count - done, &sides);
        if (done < count) { /* the notes are full */
            need_layers(drawing);
            raster->steps->draw(drawing->cells, drawing->texels);
        }
    }
}

/* Draws a batch, except far sides that `later` has room for (NULL: none). */
static void batch_draw(struct drawing *drawing, struct batch *batch, struct far_sides *later)
{
    const struct raster *raster = drawing->raster;
    const struct umbb_casters *casters = raster->casters;
    size_t drawn = 0;
    if (batch->count == 0) {
        return;
    }
    raster->prepare(casters->corners, batch->triangles, batch->count, casters->size,
                    batch->coverages);
    for (size_t i = 0; i < batch->count; i++) {
        const struct umbb_coverage *coverage = &batch->coverages[i];
        if (coverage->row_first > coverage->row_last) {
            continue;
        }
        if (later != NULL && later->count < FAR_MAX && !is_near_side(coverage, batch->kind)) {
            later->triangles[later->count++] = batch->triangles[i];
        } else if (drawing->cells != NULL && !umbb_cells_can_note(coverage)) {
            umbb_draw_plain(coverage, 1, choose_canvas(drawing, batch->kind));
        } else {
            batch->coverages[drawn++] = *coverage;
        }
    }
    draw_prepared(drawing, batch->coverages, drawn, batch->kind);
    batch->count = 0;
}

/* Draws a triangle with holes. */
static void draw_cut(struct drawing *drawing, uint32_t triangle)
{
    const struct umbb_casters *casters = drawing->raster->casters;
    struct umbb_coverage coverage;
    if (umbb_coverage_prepare(casters->corners[triangle], casters->size, &coverage)) {
        umbb_cut_draw(casters->cuts, umbb_cut_of(casters->cuts, triangle), &coverage,
                      choose_canvas(drawing, casters->kinds[triangle]));
    }
}

/* Draws the triangles of a list, except far sides that `later` has room for (NULL: none). */
static void draw_list(struct drawing *drawing, const uint32_t *list, size_t count,
                      struct far_sides *later)
{
    const struct umbb_casters *casters = drawing->raster->casters;
    struct batch batch;
    batch.count = 0;
    batch.kind = UMBB_CASTER_OPEN;
    for (size_t i = 0; i < count; i++) {
        const uint32_t triangle = list[i];
        const int has_holes = umbb_cut_of(casters->cuts, triangle) != UMBS_CUT_NONE;
        __builtin_prefetch(casters->corners[list[i + AHEAD < count ? i + AHEAD : i]]);
        if (batch.count == UMBB_DRAW_MAX || casters->kinds[triangle] != batch.kind || has_holes) {
            batch_draw(drawing, &batch, later);
            batch.kind = casters->kinds[triangle];
        }
        if (has_holes) {
            draw_cut(drawing, triangle);
        } else {
            batch.triangles[batch.count++] = triangle;
        }
    }
    batch_draw(drawing, &batch, later);
}

/* Writes layers and notes to the square from (x, y) of the tile on. */
static void drawing_store(struct drawing *drawing, struct umbb_tile *tile, int32_t x, int32_t y)
{
    const struct raster *raster = drawing->raster;
    if (drawing->cells != NULL && !drawing->has_layers) {
        raster->steps->store(drawing->cells, tile, x, y);
        return;
    }
    need_layers(drawing);
    if (drawing->cells != NULL) {
        raster->steps->draw(drawing->cells, drawing->texels);
    }
    raster->store(drawing->texels, drawing->canvas.n, tile, x, y);
}

/* Draws a square of n texels from (x, y) of the tile on. */
static void draw_square(const struct raster *raster, unsigned thread, struct umbb_tile *tile,
                        const uint32_t *list, size_t count, int32_t n, int32_t x, int32_t y)
{
    struct drawing drawing = {
        .raster = raster,
        .texels = raster->layers + (size_t)thread * LAYERS_STRIDE,
        .cells = raster->steps == NULL ? NULL : &raster->cells[thread],
        .count = (size_t)n * (size_t)n,
        .canvas = {.x0 = tile->x0 + x, .y0 = tile->y0 + y, .n = n},
    };
    struct far_sides later;
    drawing.far = drawing.texels + UMBB_LAYER_COUNT * LAYER_TEXELS;
    later.count = 0;
    if (drawing.cells != NULL) {
        drawing.cells->background = raster->casters->size;
        drawing.cells->layer_count = raster->casters->closed_rule ? UMBB_LAYER_COUNT : 1;
        umbb_cells_begin(drawing.cells, n, drawing.canvas.x0, drawing.canvas.y0);
    }
    draw_list(&drawing, list, count, &later);
    if (drawing.cells == NULL && drawing.has_layers) {
        raster->find_far(drawing.texels + UMBB_LAYER_OPEN * drawing.count, n,
                         drawing.far + UMBB_LAYER_OPEN * LAYER_FAR);
    }
    drawing.often_hidden = 1;
    draw_list(&drawing, later.triangles, later.count, NULL);
    drawing_store(&drawing, tile, x, y);
}

/* Finds the unproven squares of a block; their places go to x and y. */
static size_t open_squares(const struct umbb_tile *tile, int32_t n, int32_t bx, int32_t by,
                           int32_t x[BLOCK_SQUARES], int32_t y[BLOCK_SQUARES])
{
    const int32_t square = 1 << UMBB_SQUARE_LOG2, across = tile->size >> UMBB_SQUARE_LOG2;
    size_t count = 0;
    for (int32_t at_y = by * n; at_y < (by + 1) * n; at_y += square) {
        for (int32_t at_x = bx * n; at_x < (bx + 1) * n; at_x += square) {
            if (!tile->proven[(at_y >> UMBB_SQUARE_LOG2) * across + (at_x >> UMBB_SQUARE_LOG2)]) {
                x[count] = at_x;
                y[count++] = at_y;
            }
        }
    }
    return count;
}

static void raster_block(void *state, int slot, unsigned thread, struct umbb_tile *tile, int32_t bx,
                         int32_t by)
{
    struct raster *raster = state;
    const struct umbb_bins *bins = &raster->blocks[slot];
    const int32_t n = umbb_tile_block(tile);
    const size_t cell = (size_t)by * bins->cells_x + (size_t)bx;
    const size_t count = (size_t)(bins->first[cell + 1] - bins->first[cell]);
    const uint32_t *list = bins->entries == NULL ? NULL : bins->entries + bins->first[cell];
    int32_t x[BLOCK_SQUARES], y[BLOCK_SQUARES];
    const size_t squares =
        raster->marks == NULL ? BLOCK_SQUARES : open_squares(tile, n, bx, by, x, y);
    if (squares == 0) {
        return;
    }
    if (count == 0) {
        umbb_tile_clear(tile, bx * (n >> 3), by * (n >> 3), n >> 3, raster->casters->size);
    } else if (squares <= FEW_SQUARES) {
        for (size_t i = 0; i < squares; i++) {
            draw_square(raster, thread, tile, list, count, 1 << UMBB_SQUARE_LOG2, x[i], y[i]);
        }
    } else {
        draw_square(raster, thread, tile, list, count, n, bx * n, by * n);
    }
}

static void raster_destroy(void *state)
{
    struct raster *raster = state;
    if (raster != NULL) {
        umbb_bins_finish(&raster->tiles);
        umbb_bins_finish(&raster->blocks[0]);
        umbb_bins_finish(&raster->blocks[1]);
        umbu_threads_destroy(raster->jobs);
        free(raster->layers);
        free(raster->cells);
        free(raster->marks);
        free(raster);
    }
}

_Static_assert(sizeof(struct umbb_cells) % CACHE_LINE == 0, "every thread's are aligned");

/* Allocates layers aligned so that no row lies across cache lines. */
static int32_t *layers_alloc(unsigned threads)
{
    int32_t *layers = NULL;
    _Static_assert(LAYERS_STRIDE * sizeof *layers % CACHE_LINE == 0, "every thread's are aligned");
    return aligned_alloc(CACHE_LINE, threads * LAYERS_STRIDE * sizeof *layers);
}

enum umb_status umbb_depth_raster_create(const struct umbb_casters *casters,
                                         const struct umbb_depth_options *options,
                                         struct umbb_depth *depth, struct umb_error *error)
{
    *depth = (struct umbb_depth){0};
    struct raster *raster = calloc(1, sizeof *raster);
    if (raster == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "rasteriser: memory refused");
    }
    raster->marked = *casters;
    raster->casters = &raster->marked;
    raster->options = *options;
    raster->options.max_bytes = options->max_bytes > 0 ? options->max_bytes : SIZE_MAX;
    raster->draw = options->plain ? umbb_draw_plain : umbb_draw_quickest();
    raster->prepare = options->plain ? umbb_prepare_plain : umbb_prepare_quickest();
    const umbb_far_fn quick_far = options->plain ? NULL : umbb_far_avx2();
    raster->find_far = quick_far != NULL ? quick_far : umbb_canvas_far;
    const umbb_store_fn quick_store = options->plain ? NULL : umbb_store_avx2();
    raster->store = quick_store != NULL ? quick_store : umbb_store_plain;
    enum umb_status status = umbu_threads_create(options->threads, &raster->jobs, error);
    if (status != UMB_OK) {
        goto fail;
    }
    raster->workers = umbu_threads_workers(raster->jobs);
    raster->layers = layers_alloc(options->threads);
    raster->steps = options->plain ? NULL : umbb_cells_avx512();
    if (raster->steps != NULL) {
        raster->cells = aligned_alloc(CACHE_LINE, options->threads * sizeof *raster->cells);
    }
    if (raster->layers == NULL || (raster->steps != NULL && raster->cells == NULL)) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "rasteriser: layers of %u threads refused",
                          options->threads);
        goto fail;
    }
    status =
        umbb_front_marks_make(casters, options->prove, &raster->workers, &raster->marks, error);
    if (status != UMB_OK) {
        goto fail;
    }
    raster->marked.marks = raster->marks;
    const struct umbb_bins_input input = {
        .casters = raster->casters,
        .all = 1,
        .borders = raster->marks != NULL,
        .cell_log2 = options->tile_log2,
        .cells_x = (uint32_t)casters->size >> options->tile_log2,
        .max_bytes = raster->options.max_bytes,
        .workers = &raster->workers,
    };
    status = umbb_bins_fill(&raster->tiles, &input, error);
    if (status != UMB_OK) {
        goto fail;
    }
    *depth = (struct umbb_depth){
        .state = raster,
        .begin = raster_begin,
        .block = raster_block,
        .allow = raster_allow,
        .reach = raster_reach,
        .destroy = raster_destroy,
    };
    return UMB_OK;
fail:
    raster_destroy(raster);
    return status;
}
