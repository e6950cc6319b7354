/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The rasteriser for perspective. As in depth_raster.c a texel's integers are the minimum of the
 * predicate over all casters; bins only leave out casters that cover no centre of a block.
 */
#include "bake/depth/depth_perspective.h"

#include <stdlib.h>
#include <string.h>

#include "bake/depth/cut_out.h"
#include "bake/depth/triangle_bins.h"

/* Greatest width of a sliver, in texels over size^2. */
#define SLIVER 0x1p-49

/* Nearest front face, back face and other face of a texel, each as `lit`. */
struct fragment {
    int32_t front, back, open;
};

struct perspective {
    const struct umbb_casters *casters;
    struct umbb_depth_options options;
    struct umbb_bins tiles;     /* the whole map by tile */
    struct umbb_bins blocks[2]; /* a tile by block, one a slot */
    struct fragment *fragments; /* [threads][UMBB_BLOCK * UMBB_BLOCK] */
};

int umbb_perspective_prepare(const struct umbb_casters *casters, size_t triangle,
                             struct umbb_coverage *coverage)
{
    const double(*v)[3] = casters->corners[triangle];
    double longest[3] = {0.0, 0.0, 0.0}, square = 0.0;
    if (!umbb_coverage_prepare(v, casters->size, coverage)) {
        return 0;
    }
    if (!(casters->depth_scale > 0.0)) {
        return 1;
    }
    for (int i = 0; i < 3; i++) {
        const double *a = v[i], *b = v[(i + 1) % 3];
        const double x = b[0] - a[0], y = b[1] - a[1];
        if (x * x + y * y > square) {
            square = x * x + y * y;
            longest[0] = x;
            longest[1] = y;
            longest[2] = b[2] - a[2];
        }
    }
    const double area =
        (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]) - (v[1][1] - v[0][1]) * (v[2][0] - v[0][0]);
    const double size = (double)casters->size, width = SLIVER * size * size;
    if (area * area < width * width * square) {
        coverage->gradient_x = longest[2] * longest[0] / square;
        coverage->gradient_y = longest[2] * longest[1] / square;
    }
    return 1;
}

static size_t entry_bytes(const struct umbb_bins *bins)
{
    return (size_t)bins->capacity * sizeof *bins->entries;
}

static size_t perspective_allow(void *state, size_t max_bytes)
{
    struct perspective *p = state;
    p->options.max_bytes = max_bytes;
    return entry_bytes(&p->tiles) + entry_bytes(&p->blocks[0]) + entry_bytes(&p->blocks[1]);
}

static const struct umbb_casters *perspective_reach(void *state, int32_t x0, int32_t y0,
                                                    const uint32_t **list, size_t *count)
{
    const struct perspective *p = state;
    *list = umbb_bins_cell(&p->tiles, p->options.tile_log2, x0, y0, count);
    return p->casters;
}

static enum umb_status perspective_begin(void *state, int slot, struct umbb_tile *tile,
                                         struct umb_error *error)
{
    struct perspective *p = state;
    tile->background = p->casters->size;
    const uint32_t tile_log2 = p->options.tile_log2;
    size_t count;
    const uint32_t *list = umbb_bins_cell(&p->tiles, tile_log2, tile->x0, tile->y0, &count);
    const uint32_t block_log2 = tile_log2 < UMBB_BLOCK_LOG2 ? tile_log2 : UMBB_BLOCK_LOG2;
    const size_t others = entry_bytes(&p->tiles) + entry_bytes(&p->blocks[slot == 0 ? 1 : 0]);
    const struct umbb_bins_input input = {
        .max_bytes = p->options.max_bytes > others ? p->options.max_bytes - others : 0,
        .casters = p->casters,
        .list = list,
        .count = count,
        .x0 = tile->x0,
        .y0 = tile->y0,
        .cell_log2 = block_log2,
        .cells_x = 1U << (tile_log2 - block_log2),
    };
    return umbb_bins_fill(&p->blocks[slot], &input, error);
}

/* The number of a fragment that a face of a triangle lowers. */
static int32_t *layer_of(struct fragment *fragment, uint8_t kind, int front)
{
    if (kind == UMBB_CASTER_OPEN) {
        return &fragment->open;
    }
    return front != (kind == UMBB_CASTER_CLOSED_FLIPPED) ? &fragment->front : &fragment->back;
}

/* A square of texels being drawn. */
struct square {
    int32_t x0, y0, n;
    struct fragment *fragments; /* [n * n] */
};

static void draw(const struct umbb_casters *casters, uint32_t triangle, const struct square *square)
{
    struct umbb_coverage coverage;
    if (!umbb_perspective_prepare(casters, triangle, &coverage)) {
        return;
    }
    const uint8_t kind = casters->closed_rule ? casters->kinds[triangle] : UMBB_CASTER_OPEN;
    const uint32_t cut = umbb_cut_of(casters->cuts, triangle);
    int32_t row, last, span[2];
    umbb_coverage_rows_within(&coverage, square->y0, square->n, &row, &last);
    for (; row <= last; row++) {
        const int front = umbb_coverage_row_within(&coverage, row, square->x0, square->n, span);
        const double row_z = umbb_coverage_row_z(&coverage, row);
        struct fragment *line = square->fragments + (size_t)(row - square->y0) * (size_t)square->n;
        for (int32_t x = span[0]; x <= span[1]; x++) {
            const int32_t lit = umbb_perspective_lit(casters, &coverage, row_z, x);
            int32_t *at = layer_of(&line[x - square->x0], kind, front);
            if (lit < *at && (cut == UMBS_CUT_NONE || umbb_cut_casts(casters->cuts, cut, x, row))) {
                *at = lit;
            }
        }
    }
}

static void store(const struct square *square, struct umbb_tile *tile)
{
    const int32_t n = square->n;
    const int32_t x0 = square->x0 - tile->x0, y0 = square->y0 - tile->y0;
    for (int32_t y = 0; y < n; y++) {
        for (int32_t x = 0; x < n; x++) {
            const struct fragment *f = &square->fragments[(size_t)y * (size_t)n + (size_t)x];
            const size_t at = umbb_tile_index(tile, x0 + x, y0 + y);
            int32_t end;
            const int32_t nearest[3] = {f->open, f->front, f->back};
            umbb_texel_decide(nearest, tile->background, &tile->lit[at], &end);
            tile->end[at] = end; /* lit's array without the closed rule; end equals lit then */
        }
    }
    umbb_tile_reduce(tile, x0 >> 3, y0 >> 3, n >> 3);
}

static void perspective_block(void *state, int slot, unsigned thread, struct umbb_tile *tile,
                              int32_t bx, int32_t by)
{
    struct perspective *p = state;
    const struct umbb_bins *bins = &p->blocks[slot];
    const int32_t n = umbb_tile_block(tile), background = p->casters->size;
    const size_t cell = (size_t)by * bins->cells_x + (size_t)bx;
    if (bins->first[cell] == bins->first[cell + 1]) {
        umbb_tile_clear(tile, bx * (n >> 3), by * (n >> 3), n >> 3, background);
        return;
    }
    const struct square square = {
        .x0 = tile->x0 + bx * n,
        .y0 = tile->y0 + by * n,
        .n = n,
        .fragments = p->fragments + (size_t)thread * UMBB_BLOCK * UMBB_BLOCK,
    };
    for (size_t i = 0; i < (size_t)n * (size_t)n; i++) {
        square.fragments[i] = (struct fragment){background, background, background};
    }
    for (uint64_t i = bins->first[cell]; i < bins->first[cell + 1]; i++) {
        draw(p->casters, bins->entries[i], &square);
    }
    store(&square, tile);
}

static void perspective_destroy(void *state)
{
    struct perspective *p = state;
    if (p != NULL) {
        umbb_bins_finish(&p->tiles);
        umbb_bins_finish(&p->blocks[0]);
        umbb_bins_finish(&p->blocks[1]);
        free(p->fragments);
        free(p);
    }
}

enum umb_status umbb_depth_perspective_create(const struct umbb_casters *casters,
                                              const struct umbb_depth_options *options,
                                              struct umbb_depth *depth, struct umb_error *error)
{
    *depth = (struct umbb_depth){0};
    struct perspective *p = calloc(1, sizeof *p);
    if (p != NULL) {
        p->fragments = calloc(options->threads, sizeof *p->fragments * UMBB_BLOCK * UMBB_BLOCK);
    }
    if (p == NULL || p->fragments == NULL) {
        perspective_destroy(p);
        return umb_fail(error, UMB_E_NO_MEMORY, "rasteriser: layers of %u threads refused",
                        options->threads);
    }
    p->casters = casters;
    p->options = *options;
    p->options.max_bytes = options->max_bytes > 0 ? options->max_bytes : SIZE_MAX;
    const struct umbb_bins_input input = {
        .casters = casters,
        .all = 1,
        .cell_log2 = options->tile_log2,
        .cells_x = (uint32_t)casters->size >> options->tile_log2,
        .max_bytes = p->options.max_bytes,
    };
    const enum umb_status status = umbb_bins_fill(&p->tiles, &input, error);
    if (status != UMB_OK) {
        perspective_destroy(p);
        return status;
    }
    *depth = (struct umbb_depth){
        .state = p,
        .begin = perspective_begin,
        .block = perspective_block,
        .allow = perspective_allow,
        .reach = perspective_reach,
        .destroy = perspective_destroy,
    };
    return UMB_OK;
}
