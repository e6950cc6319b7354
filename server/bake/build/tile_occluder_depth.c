/* SPDX-License-Identifier: Apache-2.0 */
/* Cuts a tile into squares of 64x64 texels and gathers those with undefined voxels. */
#include "bake/build/tile_occluder_depth.h"

#include <string.h>

#include "base/try.h"

#define BLOCKS 8 /* blocks of 8x8 texels along a square's side */

/* Gathered texels of a square. */
struct square {
    int32_t lit[BLOCKS * BLOCKS][64], end[BLOCKS * BLOCKS][64];
    int undefined; /* 1: end > lit at some texel */
};

/* Copies lit and end of block (x, y) of the tile, or the background where texels are unwritten.
 * *undefined becomes 1 if some lit and end differ. */
static void take_block(const struct umbb_tile *tile, size_t x, size_t y, int32_t lit[64],
                       int32_t end[64], int *undefined)
{
    const size_t at = y * (size_t)(tile->size >> 3) + x;
    if (tile->min_end[UMB_LEVEL_BRICK][at] >= tile->background) {
        for (int i = 0; i < 64; i++) {
            lit[i] = end[i] = tile->background;
        }
        return;
    }
    memcpy(lit, tile->lit + at * 64, 64 * sizeof *lit);
    memcpy(end, tile->end + at * 64, 64 * sizeof *end);
    *undefined |= memcmp(lit, end, 64 * sizeof *lit) != 0;
}

enum umb_status umbb_tile_occluder_depth(const struct umbb_tile *tile,
                                         struct umb__occluder_depth *occluder_depth,
                                         struct umb_error *error)
{
    static const size_t side = UMB__OCCLUDER_DEPTH_SIDE;
    const size_t across = (size_t)tile->size / side;
    for (size_t i = 0; i < across * across; i++) {
        struct square square;
        square.undefined = 0;
        for (size_t block = 0; block < BLOCKS * BLOCKS; block++) {
            take_block(tile, i % across * BLOCKS + block % BLOCKS,
                       i / across * BLOCKS + block / BLOCKS, square.lit[block], square.end[block],
                       &square.undefined);
        }
        if (square.undefined) {
            UMB__TRY(umb__occluder_depth_add(
                occluder_depth, (uint32_t)((size_t)tile->x0 / side + i % across),
                (uint32_t)((size_t)tile->y0 / side + i / across), (const int32_t(*)[64])square.lit,
                (const int32_t(*)[64])square.end, error));
        }
    }
    return UMB_OK;
}
