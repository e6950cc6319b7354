/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The rasteriser.
 *
 * create bins the casters by tile, once. begin bins a tile's casters by block. block draws them
 * into three layers of integers and decides lit and end. With AVX-512 it draws cell by cell,
 * without layers (depth_cells.h).
 *
 * Invariant: a texel's three integers are the minimum of the predicate over all casters, so the
 * order of drawing does not matter. Bins only leave out casters whose bounding box holds no centre
 * of the block. Blocks have 256x256 texels: three layers of integers fit the second-level cache.
 * Blocks four times as wide were measured more than twice as slow at high resolution.
 */
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "bake/depth/cut_out.h"
#include "bake/depth/depth.h"
#include "bake/depth/depth_cells.h"
#include "bake/depth/proven_squares.h"

/* Number of texels of a layer, of its 8x8 blocks, and of numbers in a thread's layers. */
#define LAYER_TEXELS  ((size_t)UMBB_BLOCK * UMBB_BLOCK)
#define LAYER_FAR     (LAYER_TEXELS / 64)
#define LAYERS_STRIDE (UMBB_LAYER_COUNT * (LAYER_TEXELS + LAYER_FAR))
#define AHEAD         ((size_t)32)   /* triangles that are prefetched before they are drawn */
#define FAR_MAX       ((size_t)2048) /* far sides of a block that wait for near ones */
#define CACHE_LINE    ((size_t)64)

_Static_assert(UMBB_BLOCK <= UMBB_CANVAS_MAX, "a block is a canvas");

/* Number of squares (proven_squares.h) in a block. If at most FEW_SQUARES of them are unproven,
 * these are drawn one by one; else the whole block is drawn at once. */
#define BLOCK_SQUARES ((size_t)1 << (2 * (UMBB_BLOCK_LOG2 - UMBB_SQUARE_LOG2)))
#define FEW_SQUARES   ((size_t)8)

struct raster {
    struct umbb_casters casters; /* the caller's, with `marks` */
    uint8_t *marks;
    const struct umbb_depth_kernels *kernels;
    struct umbb_tile_lists lists;
    struct umbb_cells *cells;     /* [threads]; NULL unless the kernels draw by cells */
    int32_t *layers;              /* [threads][LAYERS_STRIDE] */
    struct umbu_threads *threads; /* for preparation; idle while blocks are drawn */
    struct umb_workers workers;   /* the same threads */
};

static enum umb_status raster_begin(void *state, int slot, struct umbb_tile *tile,
                                    struct umb_error *error)
{
    struct raster *raster = state;
    size_t count;
    const uint32_t *list = umbb_tile_lists_of_tile(&raster->lists, tile->x0, tile->y0, &count);
    umbb_prove_squares(&raster->casters, list, count, &raster->workers, tile);
    return umbb_tile_lists_begin(&raster->lists, slot, tile, error);
}

/* A block being drawn, square by square. */
struct drawing {
    const struct raster *raster;
    struct umbb_tile *tile;
    const uint32_t *list; /* [count] casters of the block */
    size_t count;
    int32_t *texels;           /* [UMBB_LAYER_COUNT][texels of the square] */
    int32_t *far;              /* [UMBB_LAYER_COUNT][LAYER_FAR] */
    struct umbb_cells *cells;  /* NULL: triangles are drawn at once */
    struct umbb_canvas canvas; /* place and size of the square */
    size_t layer;              /* number of texels of the square */
    int has_layers;            /* 1: the layers are in use */
    int often_hidden;          /* 1: the triangles that follow are likely to be hidden */
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
    const struct umbb_casters *casters = &drawing->raster->casters;
    if (!drawing->has_layers) {
        fill(drawing->texels, (casters->closed_rule ? UMBB_LAYER_COUNT : 1) * drawing->layer,
             casters->size);
        fill(drawing->far, UMBB_LAYER_COUNT * LAYER_FAR, casters->size);
        drawing->has_layers = 1;
    }
}

/* Chooses the layers of a kind of triangles. */
static struct umbb_sides choose_sides(const struct drawing *drawing, uint8_t kind)
{
    return (struct umbb_sides){umbb_layer_of(kind, 1), umbb_layer_of(kind, 0),
                               drawing->often_hidden};
}

/* The canvas of a kind's layers; puts the layers in use. */
static const struct umbb_canvas *choose_canvas(struct drawing *drawing, uint8_t kind)
{
    const size_t front = umbb_layer_of(kind, 1), back = umbb_layer_of(kind, 0);
    struct umbb_canvas *canvas = &drawing->canvas;
    need_layers(drawing);
    canvas->front = drawing->texels + front * drawing->layer;
    canvas->back = drawing->texels + back * drawing->layer;
    canvas->front_far = drawing->far + front * LAYER_FAR;
    canvas->back_far = drawing->far + back * LAYER_FAR;
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

/* Returns whether a prepared triangle seems to face the light. A wrong result costs time only. */
static int is_near_side(const struct umbb_coverage *coverage, uint8_t kind)
{
    return coverage->facing != (kind == UMBB_CASTER_CLOSED_FLIPPED);
}

/* Draws or notes prepared triangles of a kind. */
static void draw_prepared(struct drawing *drawing, const struct umbb_coverage *coverages,
                          size_t count, uint8_t kind)
{
    const struct umbb_depth_kernels *kernels = drawing->raster->kernels;
    if (drawing->cells == NULL) {
        kernels->draw(coverages, count, choose_canvas(drawing, kind));
        return;
    }
    const struct umbb_sides sides = choose_sides(drawing, kind);
    for (size_t done = 0; done < count;) {
        done += kernels->cells->note(drawing->cells, coverages + done, count - done, &sides);
        if (done < count) { /* the notes are full */
            need_layers(drawing);
            kernels->cells->draw(drawing->cells, drawing->texels);
        }
    }
}

/* Draws a batch. Triangles that face away from the light go into `later` instead, while it has
 * room. later: NULL: all are drawn now. */
static void batch_draw(struct drawing *drawing, struct batch *batch, struct far_sides *later)
{
    const struct umbb_casters *casters = &drawing->raster->casters;
    size_t drawn = 0;
    if (batch->count == 0) {
        return;
    }
    drawing->raster->kernels->prepare(casters->corners, batch->triangles, batch->count,
                                      casters->size, batch->coverages);
    for (size_t i = 0; i < batch->count; i++) {
        struct umbb_coverage *coverage = &batch->coverages[i];
        if (coverage->row_first > coverage->row_last) {
            continue;
        }
        if (umbb_rays_meet(&drawing->canvas.rays)) {
            umbb_perspective_steady(&drawing->canvas.rays, casters->corners[batch->triangles[i]],
                                    coverage);
        }
        if (later != NULL && later->count < FAR_MAX && !is_near_side(coverage, batch->kind)) {
            later->triangles[later->count++] = batch->triangles[i];
        } else if (drawing->cells != NULL &&
                   !umbb_cells_can_note(&drawing->canvas.rays, coverage)) {
            umbb_draw_plain(coverage, 1, choose_canvas(drawing, batch->kind));
        } else {
            batch->coverages[drawn++] = *coverage;
        }
    }
    draw_prepared(drawing, batch->coverages, drawn, batch->kind);
    batch->count = 0;
}

/* Draws a triangle with holes. In: cut: the number of its cut. */
static void draw_cut(struct drawing *drawing, uint32_t triangle, uint32_t cut)
{
    const struct umbb_casters *casters = &drawing->raster->casters;
    struct umbb_coverage coverage;
    if (umbb_perspective_prepare(casters, triangle, &coverage)) {
        umbb_draw_cut(casters->cuts, cut, &coverage,
                      choose_canvas(drawing, umbb_caster_kind(casters, triangle)));
    }
}

/* Draws a list of triangles. Those that face away from the light go into `later` instead, while it
 * has room. later: NULL: all are drawn now. */
static void draw_list(struct drawing *drawing, const uint32_t *list, size_t count,
                      struct far_sides *later)
{
    const struct umbb_casters *casters = &drawing->raster->casters;
    struct batch batch;
    batch.count = 0;
    batch.kind = UMBB_CASTER_OPEN;
    for (size_t i = 0; i < count; i++) {
        const uint32_t triangle = list[i], cut = umbb_cut_of(casters->cuts, triangle);
        const uint8_t kind = umbb_caster_kind(casters, triangle);
        __builtin_prefetch(casters->corners[list[i + AHEAD < count ? i + AHEAD : i]]);
        if (batch.count == UMBB_DRAW_MAX || kind != batch.kind || cut != UMBS_CUT_NONE) {
            batch_draw(drawing, &batch, later);
            batch.kind = kind;
        }
        if (cut != UMBS_CUT_NONE) {
            draw_cut(drawing, triangle, cut);
        } else {
            batch.triangles[batch.count++] = triangle;
        }
    }
    batch_draw(drawing, &batch, later);
}

/* Writes layers and notes to the square from (x, y) of the tile on. */
static void drawing_store(struct drawing *drawing, int32_t x, int32_t y)
{
    const struct umbb_depth_kernels *kernels = drawing->raster->kernels;
    if (drawing->cells != NULL && !drawing->has_layers) {
        kernels->cells->store(drawing->cells, drawing->tile, x, y);
        return;
    }
    need_layers(drawing);
    if (drawing->cells != NULL) {
        kernels->cells->draw(drawing->cells, drawing->texels);
    }
    kernels->store(drawing->texels, drawing->canvas.n, drawing->tile, x, y);
}

/* Draws the square of n x n texels from (x, y) of the tile on. */
static void draw_square(struct drawing *drawing, int32_t n, int32_t x, int32_t y)
{
    const struct raster *raster = drawing->raster;
    struct far_sides later;
    later.count = 0;
    drawing->layer = (size_t)n * (size_t)n;
    drawing->canvas = (struct umbb_canvas){.x0 = drawing->tile->x0 + x,
                                           .y0 = drawing->tile->y0 + y,
                                           .n = n,
                                           .rays = umbb_rays_of(&raster->casters)};
    drawing->has_layers = drawing->often_hidden = 0;
    if (drawing->cells != NULL) {
        drawing->cells->background = raster->casters.size;
        drawing->cells->rays = drawing->canvas.rays;
        drawing->cells->layer_count = raster->casters.closed_rule ? UMBB_LAYER_COUNT : 1;
        umbb_cells_begin(drawing->cells, n, drawing->canvas.x0, drawing->canvas.y0);
    }
    draw_list(drawing, drawing->list, drawing->count, &later);
    if (drawing->cells == NULL && drawing->has_layers) {
        raster->kernels->find_far(drawing->texels + UMBB_LAYER_OPEN * drawing->layer, n,
                                  drawing->far + UMBB_LAYER_OPEN * LAYER_FAR);
    }
    drawing->often_hidden = 1;
    draw_list(drawing, later.triangles, later.count, NULL);
    drawing_store(drawing, x, y);
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
    const struct raster *raster = state;
    const int32_t n = umbb_tile_block(tile);
    struct drawing drawing = {
        .raster = raster,
        .tile = tile,
        .texels = raster->layers + (size_t)thread * LAYERS_STRIDE,
        .cells = raster->cells == NULL ? NULL : &raster->cells[thread],
    };
    drawing.far = drawing.texels + UMBB_LAYER_COUNT * LAYER_TEXELS;
    drawing.list = umbb_bins_cell(&raster->lists.blocks[slot], bx, by, &drawing.count);
    int32_t x[BLOCK_SQUARES], y[BLOCK_SQUARES];
    const size_t squares =
        raster->marks == NULL ? BLOCK_SQUARES : open_squares(tile, n, bx, by, x, y);
    if (squares == 0) {
        return;
    }
    if (drawing.count == 0) {
        umbb_tile_clear(tile, bx * (n >> 3), by * (n >> 3), n >> 3, raster->casters.size);
    } else if (squares <= FEW_SQUARES) {
        for (size_t i = 0; i < squares; i++) {
            draw_square(&drawing, 1 << UMBB_SQUARE_LOG2, x[i], y[i]);
        }
    } else {
        draw_square(&drawing, n, bx * n, by * n);
    }
}

static void raster_destroy(void *state)
{
    struct raster *raster = state;
    if (raster != NULL) {
        umbb_tile_lists_finish(&raster->lists);
        umbu_threads_destroy(raster->threads);
        free(raster->layers);
        free(raster->cells);
        free(raster->marks);
        free(raster);
    }
}

_Static_assert(LAYERS_STRIDE * sizeof(int32_t) % CACHE_LINE == 0 &&
                   sizeof(struct umbb_cells) % CACHE_LINE == 0,
               "the memory of every thread is aligned");

/* Allocates the threads and their memory, marks the casters and lists them by tile. */
static enum umb_status raster_init(struct raster *raster, const struct umbb_depth_options *options,
                                   struct umb_error *error)
{
    const unsigned threads = options->threads;
    UMB__TRY(umbu_threads_create(threads, &raster->threads, error));
    raster->workers = umbu_threads_workers(raster->threads);
    /* Aligned so that no row of a layer lies across cache lines. */
    raster->layers = aligned_alloc(CACHE_LINE, threads * LAYERS_STRIDE * sizeof *raster->layers);
    if (raster->kernels->cells != NULL) {
        raster->cells = aligned_alloc(CACHE_LINE, threads * sizeof *raster->cells);
    }
    if (raster->layers == NULL || (raster->kernels->cells != NULL && raster->cells == NULL)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "rasteriser: layers of %u threads refused",
                        threads);
    }
    UMB__TRY(umbb_front_marks_make(&raster->casters, options->prove, &raster->workers,
                                   &raster->marks, error));
    raster->casters.marks = raster->marks;
    raster->lists = (struct umbb_tile_lists){
        .casters = &raster->casters,
        .tile_log2 = options->tile_log2,
        .workers = &raster->workers,
        .max_bytes = options->max_bytes > 0 ? options->max_bytes : SIZE_MAX,
    };
    return umbb_tile_lists_fill(&raster->lists, error);
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
    raster->casters = *casters;
    raster->kernels = umbb_depth_kernels(options->plain ? UMBB_VECTORS_NONE : umbb_vectors_best());
    const enum umb_status status = raster_init(raster, options, error);
    if (status != UMB_OK) {
        raster_destroy(raster);
        return status;
    }
    *depth = (struct umbb_depth){
        .state = raster,
        .lists = &raster->lists,
        .begin = raster_begin,
        .block = raster_block,
        .destroy = raster_destroy,
    };
    return UMB_OK;
}
