/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The rasteriser for perspective. As in depth_raster.c, each integer of a texel is the least depth,
 * in voxels, of one layer's fragments at the texel's centre. Bins only leave out casters that cover
 * no centre of a block.
 */
#include "bake/depth/depth_perspective.h"

#include <stdlib.h>

#include "bake/depth/cut_out.h"
#include "bake/depth/depth.h"

/* Greatest width of a sliver, in texels over size^2. */
#define SLIVER 0x1p-49

/* Nearest fragment of each layer of a texel, as `lit`. */
typedef int32_t fragments[UMBB_LAYER_COUNT];

struct perspective {
    const struct umbb_casters *casters;
    struct umbb_tile_lists lists;
    fragments *texels; /* [threads][UMBB_BLOCK * UMBB_BLOCK] */
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

static enum umb_status perspective_begin(void *state, int slot, struct umbb_tile *tile,
                                         struct umb_error *error)
{
    struct perspective *p = state;
    return umbb_tile_lists_begin(&p->lists, slot, tile, error);
}

/* A square of texels being drawn. */
struct square {
    int32_t x0, y0, n;
    fragments *texels; /* [n * n] */
};

static void draw(const struct umbb_casters *casters, uint32_t triangle, const struct square *square)
{
    struct umbb_coverage coverage;
    if (!umbb_perspective_prepare(casters, triangle, &coverage)) {
        return;
    }
    const uint8_t kind = umbb_caster_kind(casters, triangle);
    const uint32_t cut = umbb_cut_of(casters->cuts, triangle);
    int32_t row, last, span[2];
    umbb_coverage_rows_within(&coverage, square->y0, square->n, &row, &last);
    for (; row <= last; row++) {
        const int front = umbb_coverage_row_within(&coverage, row, square->x0, square->n, span);
        const enum umbb_layer layer = umbb_layer_of(kind, front);
        const double row_z = umbb_coverage_row_z(&coverage, row);
        fragments *line = square->texels + (size_t)(row - square->y0) * (size_t)square->n;
        for (int32_t x = span[0]; x <= span[1]; x++) {
            const int32_t lit = umbb_perspective_lit(casters, &coverage, row_z, x);
            int32_t *at = &line[x - square->x0][layer];
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
    const fragments *next = square->texels;
    for (int32_t y = 0; y < n; y++) {
        for (int32_t x = 0; x < n; x++) {
            umbb_tile_put(tile, umbb_tile_index(tile, x0 + x, y0 + y), *next++);
        }
    }
    umbb_tile_reduce(tile, x0 >> 3, y0 >> 3, n >> 3);
}

static void perspective_block(void *state, int slot, unsigned thread, struct umbb_tile *tile,
                              int32_t bx, int32_t by)
{
    struct perspective *p = state;
    const int32_t n = umbb_tile_block(tile), background = p->casters->size;
    size_t count;
    const uint32_t *list = umbb_bins_cell(&p->lists.blocks[slot], bx, by, &count);
    if (count == 0) {
        umbb_tile_clear(tile, bx * (n >> 3), by * (n >> 3), n >> 3, background);
        return;
    }
    const struct square square = {
        .x0 = tile->x0 + bx * n,
        .y0 = tile->y0 + by * n,
        .n = n,
        .texels = p->texels + (size_t)thread * UMBB_BLOCK * UMBB_BLOCK,
    };
    for (size_t i = 0; i < (size_t)n * (size_t)n; i++) {
        for (int layer = 0; layer < UMBB_LAYER_COUNT; layer++) {
            square.texels[i][layer] = background;
        }
    }
    for (size_t i = 0; i < count; i++) {
        draw(p->casters, list[i], &square);
    }
    store(&square, tile);
}

static void perspective_destroy(void *state)
{
    struct perspective *p = state;
    if (p != NULL) {
        umbb_tile_lists_finish(&p->lists);
        free(p->texels);
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
        p->texels = calloc(options->threads, sizeof *p->texels * UMBB_BLOCK * UMBB_BLOCK);
    }
    if (p == NULL || p->texels == NULL) {
        perspective_destroy(p);
        return umb_fail(error, UMB_E_NO_MEMORY, "rasteriser: layers of %u threads refused",
                        options->threads);
    }
    p->casters = casters;
    p->lists = (struct umbb_tile_lists){
        .casters = casters,
        .tile_log2 = options->tile_log2,
        .max_bytes = options->max_bytes > 0 ? options->max_bytes : SIZE_MAX,
    };
    const enum umb_status status = umbb_tile_lists_fill(&p->lists, error);
    if (status != UMB_OK) {
        perspective_destroy(p);
        return status;
    }
    *depth = (struct umbb_depth){
        .state = p,
        .lists = &p->lists,
        .begin = perspective_begin,
        .block = perspective_block,
        .destroy = perspective_destroy,
    };
    return UMB_OK;
}
