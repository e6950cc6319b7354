/* SPDX-License-Identifier: Apache-2.0 */
/* The store in plain C. */
#include "bake/depth/depth_store.h"

#include <string.h>

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
            umbb_texel_decide(nearest, tile->background, &tile->lit[to + i], &tile->end[to + i]);
        }
    }
    umbb_tile_reduce(tile, x0 >> 3, y0 >> 3, n >> 3);
}
