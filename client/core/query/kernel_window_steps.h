/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_WINDOW_STEPS_H
#define UMBRAGE_CORE_QUERY_KERNEL_WINDOW_STEPS_H
/* Steps of kernel_windows.h that are hand-written with vector instructions. */
#include "query/kernel_runs.h"

/* Masks of the texels of a brick's slice that lie in a window, by columns and by rows. The window
 * begins at texel 0..7 of its first brick; mask k is for the k-th brick from there. */
struct umb__window_masks {
    _Alignas(64) uint64_t columns[3][8];
    uint64_t rows[3][8];
    /* Only with AVX-512: masks of the bricks that a window touches, by columns and by rows. The
     * window begins at texel 0..31 of a cell. A mask has a bit for each of a cell's sixteen bricks,
     * and is stored twice, for the two masks of a node. There are words for that cell, for the cell
     * to the right, and for the two cells below. */
    uint64_t cell_columns[32][8], cell_rows[32][8];
};

static inline void umb__make_masks(int32_t taps, struct umb__window_masks *masks)
{
    for (uint32_t at = 0; at < 8; at++) {
        uint32_t window = (((uint32_t)1 << taps) - 1) << at;
        for (uint32_t k = 0; k < 3; k++) {
            masks->columns[k][at] = (window >> 8 * k & 0xff) * UMB__EVERY_BYTE;
            masks->rows[k][at] = umb__spread(window >> 8 * k & 0xff);
        }
    }
}

/* Returns the states of the bricks that a window touches. Bit 0: one is mixed; bit 1: one is lit;
 * bit 2: one is shadowed. Mixed bricks may set bit 1 or 2, too. In: at: the window's first texel.
 * corner: the nodes of its cells. */
UMB__INLINE uint32_t umb__touched_states(const struct umb__window_masks *masks,
                                         struct umb__voxel at, uint32_t reach,
                                         const uint64_t *const corner[4])
{
    uint32_t shift = (uint32_t)at.z >> 3 << 4 & 48;
    uint32_t columns = umb__brick_range((uint32_t)at.x, reach);
    uint32_t rows = umb__brick_range((uint32_t)at.y, reach);
    uint32_t right = columns > 15, down = 2 * (rows > 15);
    uint64_t mixed = 0, lit = 0, shadowed = 0;
    (void)masks;
    for (uint32_t c = 0; c < 4; c++) {
        const uint64_t *node = corner[(c & right) | (c & down)];
        uint64_t bricks = (columns >> 4 * (c & 1) & 15) * UINT64_C(0x1111) &
                          umb__rows_of_four[rows >> 2 * (c & 2) & 15];
        mixed |= node[0] >> shift & bricks;
        lit |= node[1] >> shift & bricks;
        shadowed |= ~(node[1] >> shift) & bricks;
    }
    return (uint32_t)(mixed != 0) | (uint32_t)(lit != 0) << 1 | (uint32_t)(shadowed != 0) << 2;
}

/* Copies the answer of each run's first window, its head, to all windows of the run, if the head's
 * answer is complete. Eight answers are written at a time. Later runs overwrite the excess, and the
 * answers of windows that needed no look-up are put back afterwards. */
static inline void umb__spread_settled(struct umb__block *block, const struct umb__block *heads,
                                       uint64_t settled, const struct umb__runs *runs)
{
    const uint64_t placed = ~block->todo & UINT64_MAX >> (UMB__BLOCK - block->size);
    uint32_t kept[UMB__BLOCK];
    if (placed) {
        memcpy(kept, block->lit, sizeof kept);
    }
    for (uint64_t rest = settled; rest; rest &= rest - 1) {
        const uint32_t h = umb__first_bit(rest), lit = heads->lit[h];
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i += 8) {
            for (uint32_t k = 0; k < 8; k++) {
                block->lit[i + k] = lit;
            }
        }
    }
    for (uint64_t rest = placed; rest; rest &= rest - 1) {
        const uint32_t i = umb__first_bit(rest);
        block->lit[i] = kept[i];
    }
}

/* Adds up the lit texels of the windows of all runs whose heads are given. In: side: bricks on each
 * axis that a head touches. brick: [16 * head ..] those bricks. */
UMB__INLINE void umb__count_windows(const struct umb__window_masks *masks, struct umb__block *block,
                                    uint64_t heads, const struct umb__runs *runs, uint32_t side,
                                    const uint64_t *const *brick)
{
    for (uint64_t rest = heads; rest; rest &= rest - 1) {
        uint32_t h = umb__first_bit(rest);
        const uint64_t *const *of_head = brick + 16 * h;
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i++) {
            uint32_t lit = 0, x = (uint32_t)block->x[i] & 7, y = (uint32_t)block->y[i] & 7;
            uint32_t z = (uint32_t)block->z[i] & 7;
            for (uint32_t r = 0; r < side; r++) {
                for (uint32_t c = 0; c < side; c++) {
                    uint64_t slice = of_head[side * r + c][z];
                    lit += umb__count_bits(slice & masks->columns[c][x] & masks->rows[r][y]);
                }
            }
            block->lit[i] = lit;
        }
    }
}

#endif
