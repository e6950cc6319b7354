/* SPDX-License-Identifier: Apache-2.0 */
/* Empty notes, and the test whether a triangle can be noted. */
#include "bake/depth/depth_cells.h"

#include <math.h>
#include <string.h>

/* A depth whose double is below this converts to int32_t without a clamp. */
#define DEPTH_MAX 5e8

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

int umbb_cells_can_note(const struct umbb_coverage *c)
{
    double left = c->x[0] < c->x[1] ? c->x[0] : c->x[1];
    double right = c->x[0] < c->x[1] ? c->x[1] : c->x[0];
    left = left < c->x[2] ? left : c->x[2];
    right = right > c->x[2] ? right : c->x[2];
    return fabs(c->anchor_z) + fabs(c->gradient_y) * (c->y[2] - c->y[0] + 9.0) +
               fabs(c->gradient_x) * (right - left + 9.0) <
           DEPTH_MAX;
}
