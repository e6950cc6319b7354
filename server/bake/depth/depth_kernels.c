/* SPDX-License-Identifier: Apache-2.0 */
/* The table of kernels, their plain forms, and the functions that all forms of notes share. */
#include "bake/depth/depth_kernels.h"

#include <math.h>
#include <string.h>

#include "bake/depth/cut_out.h"
#include "bake/depth/depth_cells.h"

/* A depth whose double is below this converts to int32_t without a clamp. */
#define DEPTH_MAX 5e8

const struct umbb_depth_kernels *umbb_depth_kernels(enum umbb_vectors vectors)
{
    static const struct umbb_depth_kernels rows[] = {
        [UMBB_VECTORS_NONE] = {umbb_prepare_plain, umbb_draw_plain, umbb_far_plain,
                               umbb_store_plain, NULL},
#ifdef __x86_64__
        [UMBB_VECTORS_AVX2] = {umbb__prepare_avx2, umbb__draw_avx2, umbb__far_avx2,
                               umbb__store_avx2, NULL},
        [UMBB_VECTORS_AVX512] = {umbb__prepare_avx512, umbb__draw_avx2, umbb__far_avx2,
                                 umbb__store_avx2, &umbb__cells_avx512},
#endif
    };
    return vectors <= umbb_vectors_best() ? &rows[vectors] : NULL;
}

void umbb_prepare_plain(const double (*corners)[3][3], const uint32_t *triangles, size_t count,
                        int32_t size, struct umbb_coverage *coverages)
{
    for (size_t i = 0; i < count; i++) {
        if (!umbb_coverage_prepare(corners[triangles[i]], size, &coverages[i])) {
            coverages[i] = (struct umbb_coverage){.row_first = 0, .row_last = -1};
        }
    }
}

void umbb_draw_cut(const struct umbb_cuts *cuts, uint32_t cut, const struct umbb_coverage *coverage,
                   const struct umbb_canvas *canvas)
{
    int32_t row, last, span[2];
    umbb_coverage_rows_within(coverage, canvas->y0, canvas->n, &row, &last);
    for (; row <= last; row++) {
        const int front = umbb_coverage_row_within(coverage, row, canvas->x0, canvas->n, span);
        const double row_z = umbb_coverage_row_z(coverage, row);
        int32_t *line = (front ? canvas->front : canvas->back) +
                        umbb_canvas_row((size_t)canvas->n, (size_t)(row - canvas->y0));
        for (int32_t x = span[0]; x <= span[1]; x++) {
            const int32_t lit = umbb_rays_lit(&canvas->rays, coverage, row_z, x);
            const size_t column = (size_t)(x - canvas->x0);
            int32_t *at = line + 64 * (column >> 3) + (column & 7);
            if (lit < *at && (cuts == NULL || umbb_cut_casts(cuts, cut, x, row))) {
                *at = lit;
            }
        }
    }
}

void umbb_draw_plain(const struct umbb_coverage *coverages, size_t count,
                     const struct umbb_canvas *canvas)
{
    for (size_t i = 0; i < count; i++) {
        umbb_draw_cut(NULL, 0, &coverages[i], canvas);
    }
}

void umbb_far_plain(const int32_t *layer, int32_t n, int32_t *far)
{
    const size_t blocks = (size_t)(n >> 3) * (size_t)(n >> 3);
    for (size_t block = 0; block < blocks; block++, layer += 64) {
        int32_t most = layer[0];
        for (size_t i = 1; i < 64; i++) {
            most = layer[i] > most ? layer[i] : most;
        }
        far[block] = most;
    }
}

void umbb_store_plain(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0,
                      int32_t y0)
{
    const size_t width = (size_t)n, texels = width * width;
    for (int32_t y = 0; y < n; y += 8) {
        /* Eight rows of a block lie together in both layouts. */
        const int32_t *from = layers + (size_t)y * width;
        const size_t to = umbb_tile_index(tile, x0, y0 + y);
        if (tile->end == tile->lit) {
            memcpy(tile->lit + to, from + UMBB_LAYER_OPEN * texels, 8 * width * sizeof *from);
            continue;
        }
        for (size_t i = 0; i < 8 * width; i++) {
            const int32_t nearest[UMBB_LAYER_COUNT] = {
                from[UMBB_LAYER_OPEN * texels + i],
                from[UMBB_LAYER_FRONT * texels + i],
                from[UMBB_LAYER_BACK * texels + i],
            };
            umbb_tile_put(tile, to + i, nearest);
        }
    }
    umbb_tile_reduce(tile, x0 >> 3, y0 >> 3, n >> 3);
}

void umbb_cells_begin(struct umbb_cells *cells, int32_t n, int32_t x0, int32_t y0)
{
    const size_t count = (size_t)(n >> 3) * (size_t)(n >> 3);
    cells->x0 = x0;
    cells->y0 = y0;
    cells->n = n;
    cells->plane_count = 0;
    cells->part_count = 1;
    for (int i = 0; i < cells->layer_count; i++) {
        struct umbb_cell_layer *layer = &cells->layers[i];
        memset(layer->covered, 0, count * sizeof *layer->covered);
        memset(layer->most, 0, count * sizeof *layer->most);
        memset(layer->first, 0, count * sizeof *layer->first);
        for (size_t k = 0; k < count; k++) {
            layer->far[k] = cells->background;
        }
    }
}

int umbb_cells_can_note(const struct umbb_rays *rays, const struct umbb_coverage *c)
{
    if (umbb_rays_meet(rays)) {
        return 1; /* q and z are clamped before z becomes an integer */
    }
    double left = c->x[0] < c->x[1] ? c->x[0] : c->x[1];
    double right = c->x[0] < c->x[1] ? c->x[1] : c->x[0];
    left = left < c->x[2] ? left : c->x[2];
    right = right > c->x[2] ? right : c->x[2];
    return fabs(c->anchor_z) + fabs(c->gradient_y) * (c->y[2] - c->y[0] + 9.0) +
               fabs(c->gradient_x) * (right - left + 9.0) <
           DEPTH_MAX;
}
