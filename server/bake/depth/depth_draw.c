/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing in plain C. */
#include "bake/depth/depth_draw.h"

#include <stddef.h>

void umbb_draw_plain(const struct umbb_coverage *coverage, const struct umbb_canvas *canvas)
{
    const int32_t bottom = canvas->y0 + canvas->n - 1, right = canvas->x0 + canvas->n - 1;
    const int32_t last = coverage->row_last < bottom ? coverage->row_last : bottom;
    int32_t row = coverage->row_first > canvas->y0 ? coverage->row_first : canvas->y0;
    for (; row <= last; row++) {
        int32_t x_first, x_last;
        const int front = umbb_coverage_row(coverage, row, &x_first, &x_last);
        const double row_z = umbb_coverage_row_z(coverage, row);
        int32_t *line = (front ? canvas->front : canvas->back) +
                        (ptrdiff_t)(row - canvas->y0) * (ptrdiff_t)canvas->n;
        x_first = x_first > canvas->x0 ? x_first : canvas->x0;
        x_last = x_last < right ? x_last : right;
        for (int32_t x = x_first; x <= x_last; x++) {
            const int32_t lit = umbb_coverage_lit(coverage, row_z, x);
            int32_t *at = line + (x - canvas->x0);
            *at = lit < *at ? lit : *at;
        }
    }
}
