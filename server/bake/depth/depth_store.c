/* SPDX-License-Identifier: Apache-2.0 */
/* The store in plain C. */
#include "bake/depth/depth_store.h"

#include <string.h>

void umbb_store_plain(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0,
                      int32_t y0)
{
    const size_t texels = (size_t)n * (size_t)n;
    const int32_t *open = layers + UMBB_LAYER_OPEN * texels;
    const int32_t *front = layers + UMBB_LAYER_FRONT * texels;
    const int32_t *back = layers + UMBB_LAYER_BACK * texels;
    for (int32_t y = 0; y < n; y++) {
        for (int32_t x = 0; x < n; x += 8) {
            const size_t to = umbb_tile_index(tile, x0 + x, y0 + y);
            const size_t from = (size_t)y * (size_t)n + (size_t)x;
            if (tile->end == tile->lit) {
                memcpy(tile->lit + to, open + from, 8 * sizeof *open);
                continue;
            }
            for (size_t i = 0; i < 8; i++) {
                umbb_texel_decide(front[from + i], back[from + i], open[from + i],
                                  &tile->lit[to + i], &tile->end[to + i]);
            }
        }
    }
    umbb_tile_reduce(tile, x0 >> 3, y0 >> 3, n >> 3);
}
