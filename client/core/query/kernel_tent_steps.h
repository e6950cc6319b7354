/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_TENT_STEPS_H
#define UMBRAGE_CORE_QUERY_KERNEL_TENT_STEPS_H
/*
 * Weighs the texels of a window as a tent does: texel i of `taps` weighs min(i + 1, taps - i) on
 * each axis. A slice of a brick is a byte a row. The weight on x of a row's lit texels is a sum
 * over the bits of the weights: the texels whose weight has bit p, counted, times 2^p. A row's sum
 * is at most ((taps + 1) / 2)^2 = 81, so eight rows stay in the eight bytes of a word. The weights
 * on y then come by two multiplications, of the even and of the odd rows. All is in integers.
 */
#include "query/kernel_runs.h"

#define UMB__TENT_PLANES 4 /* Bits of a weight, at most 9; 3 for windows of up to 9 texels */
#define UMB__EVEN_BYTES  UINT64_C(0x00ff00ff00ff00ff)

/* Weights of the texels of a slice. The window begins at texel 0..7 of its first brick; entry k is
 * for the k-th brick from there. */
struct umb__tent {
    _Alignas(64) uint64_t columns[UMB__TENT_PLANES][3][8]; /* Texels whose weight on x has bit p */
    uint64_t rows[3][8];                                   /* Weight on y, a byte a row */
    /* Weights on y of the even rows in words of 16 bits, the last row first ... */
    uint64_t even[3][8];
    uint64_t odd[3][8]; /* ... and those of the odd rows */
    /* Only with AVX2: columns of the bricks of a row side by side, the fourth 0 */
    _Alignas(32) uint64_t beside[UMB__TENT_PLANES][8][4];
};

static inline void umb__tent_make(int32_t taps, struct umb__tent *tent)
{
    uint8_t weights[40] = {0}; /* Weights of the texels from eight before the window on */
    uint32_t bits[UMB__TENT_PLANES] = {0};
    for (int32_t i = 0; i < taps; i++) {
        const int32_t weight = i + 1 < taps - i ? i + 1 : taps - i;
        weights[8 + i] = (uint8_t)weight;
        for (uint32_t p = 0; p < UMB__TENT_PLANES; p++) {
            bits[p] |= ((uint32_t)weight >> p & 1) << i;
        }
    }
    for (uint32_t k = 0; k < 3; k++) {
        for (uint32_t at = 0; at < 8; at++) {
            for (uint32_t p = 0; p < UMB__TENT_PLANES; p++) {
                tent->columns[p][k][at] = (bits[p] << at >> 8 * k & 0xff) * UMB__EVERY_BYTE;
                tent->beside[p][at][k] = tent->columns[p][k][at];
                tent->beside[p][at][3] = 0;
            }
            memcpy(&tent->rows[k][at], weights + 8 + 8 * k - at, 8);
            const uint64_t reversed = __builtin_bswap64(tent->rows[k][at]);
            tent->even[k][at] = reversed >> 8 & UMB__EVEN_BYTES;
            tent->odd[k][at] = reversed & UMB__EVEN_BYTES;
        }
    }
}

/* Returns the number of set bits in each byte of a word. */
static inline uint64_t umb__count_each_byte(uint64_t bits)
{
    bits -= bits >> 1 & UINT64_C(0x5555555555555555);
    bits = (bits & UINT64_C(0x3333333333333333)) + (bits >> 2 & UINT64_C(0x3333333333333333));
    return (bits + (bits >> 4)) & UINT64_C(0x0f0f0f0f0f0f0f0f);
}

/* Returns the weight of the lit texels of a window. In: side: number of bricks on each axis. brick:
 * the bricks that the window touches. The upper words of the products are sums of four weighted
 * rows; no sum reaches 2^16. */
UMB__INLINE uint32_t umb__weigh_one(const struct umb__tent *tent, struct umb__voxel at,
                                    uint32_t side, const uint64_t *const *brick)
{
    const uint32_t planes = side == 2 ? UMB__TENT_PLANES - 1 : UMB__TENT_PLANES;
    const uint32_t x = (uint32_t)at.x & 7, y = (uint32_t)at.y & 7, z = (uint32_t)at.z & 7;
    uint32_t lit = 0;
    for (uint32_t r = 0; r < side; r++) {
        uint64_t rows = 0;
        for (uint32_t c = 0; c < side; c++) {
            const uint64_t slice = brick[side * r + c][z];
            for (uint32_t p = 0; p < planes; p++) {
                rows += umb__count_each_byte(slice & tent->columns[p][c][x]) << p;
            }
        }
        const uint64_t even = (rows & UMB__EVEN_BYTES) * tent->even[r][y];
        const uint64_t odd = (rows >> 8 & UMB__EVEN_BYTES) * tent->odd[r][y];
        lit += (uint32_t)((even + odd) >> 48);
    }
    return lit;
}

/* umb__weigh_one, or one with vectors that gives the same integers. */
typedef uint32_t umb__weigh_fn(const struct umb__tent *tent, struct umb__voxel at, uint32_t side,
                               const uint64_t *const *brick);

/* Adds up the weights of the windows of all runs whose heads are given, each window by `one`. The
 * other arguments are those of umb__count_windows. */
UMB__INLINE void umb__weigh_windows(umb__weigh_fn *one, const struct umb__tent *tent,
                                    struct umb__block *block, uint64_t heads,
                                    const struct umb__runs *runs, uint32_t side,
                                    const uint64_t *const *brick)
{
    for (uint64_t rest = heads; rest; rest &= rest - 1) {
        const uint32_t h = umb__first_bit(rest);
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i++) {
            const struct umb__voxel at = {block->x[i], block->y[i], block->z[i]};
            block->lit[i] = one(tent, at, side, brick + 16 * h);
        }
    }
}

#endif
