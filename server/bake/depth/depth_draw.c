/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing in plain C. */
#include "bake/depth/depth_draw.h"

static void draw_one(const struct umbb_coverage *coverage, const struct umbb_canvas *canvas)
{
    const int32_t bottom = canvas->y0 + canvas->n - 1, right = canvas->x0 + canvas->n - 1;
    const int32_t last = coverage->row_last < bottom ? coverage->row_last : bottom;
    int32_t row = coverage->row_first > canvas->y0 ? coverage->row_first : canvas->y0;
    for (; row <= last; row++) {
        int32_t x_first, x_last;
        const int front = umbb_coverage_row(coverage, row, &x_first, &x_last);
        const double row_z = umbb_coverage_row_z(coverage, row);
        int32_t *line = (front ? canvas->front : canvas->back) +
                        umbb_canvas_row((size_t)canvas->n, (size_t)(row - canvas->y0));
        x_first = x_first > canvas->x0 ? x_first : canvas->x0;
        x_last = x_last < right ? x_last : right;
        for (int32_t x = x_first; x <= x_last; x++) {
            const int32_t lit = umbb_coverage_lit(coverage, row_z, x);
            const size_t column = (size_t)(x - canvas->x0);
            int32_t *at = line + 64 * (column >> 3) + (column & 7);
            *at = lit < *at ? lit : *at;
        }
    }
}

void umbb_draw_plain(const struct umbb_coverage *coverages, size_t count,
                     const struct umbb_canvas *canvas)
{
    for (size_t i = 0; i < count; i++) {
        draw_one(&coverages[i], canvas);
    }
}

void umbb_canvas_far(const int32_t *layer, int32_t n, int32_t *far)
{
    const size_t blocks = (size_t)(n >> 3) * (size_t)(n >> 3);
    for (size_t block = 0; block < blocks; block++, layer += 64) {
        int32_t most[4] = {layer[0], layer[1], layer[2], layer[3]};
        for (size_t i = 4; i < 64; i += 4) {
            for (size_t k = 0; k < 4; k++) {
                most[k] = layer[i + k] > most[k] ? layer[i + k] : most[k];
            }
        }
        most[0] = most[0] > most[1] ? most[0] : most[1];
        most[2] = most[2] > most[3] ? most[2] : most[3];
        far[block] = most[0] > most[2] ? most[0] : most[2];
    }
}

umbb_draw_fn umbb_draw_quickest(void)
{
    const umbb_draw_fn draw = umbb_draw_avx2();
    return draw != NULL ? draw : umbb_draw_plain;
}
