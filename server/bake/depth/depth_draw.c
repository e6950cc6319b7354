/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing in plain C. */
#include "bake/depth/depth_draw.h"

static void draw_one(const struct umbb_coverage *coverage, const struct umbb_canvas *canvas)
{
    int32_t row, last, span[2];
    umbb_coverage_rows_within(coverage, canvas->y0, canvas->n, &row, &last);
    for (; row <= last; row++) {
        const int front = umbb_coverage_row_within(coverage, row, canvas->x0, canvas->n, span);
        const double row_z = umbb_coverage_row_z(coverage, row);
        int32_t *line = (front ? canvas->front : canvas->back) +
                        umbb_canvas_row((size_t)canvas->n, (size_t)(row - canvas->y0));
        for (int32_t x = span[0]; x <= span[1]; x++) {
            const int32_t lit = umbb_coverage_lit(coverage, row_z, x);
            int32_t *at = umbb_canvas_at(canvas, line, x);
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
