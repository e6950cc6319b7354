/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_TENT_SIMD128_H
#define UMBRAGE_CORE_QUERY_KERNEL_TENT_SIMD128_H
/* The step of kernel_tent_steps.h with WebAssembly's vectors of 128 bits; the same integers. */
#include <wasm_simd128.h>
#include "query/kernel_tent_steps.h"

/* Weighted bits of each byte of two slices. In: k: the first of the two bricks. */
UMB__INLINE v128_t umb__weigh_two(const struct umb__tent *tent, v128_t slices, uint32_t planes,
                                  uint32_t x, uint32_t k)
{
    v128_t sum = wasm_i8x16_splat(0);
    for (uint32_t p = planes; p-- > 0;) {
        const v128_t columns = wasm_v128_load(&tent->beside[p][x][k]);
        sum = wasm_i8x16_add(wasm_i8x16_add(sum, sum), wasm_i8x16_popcnt(slices & columns));
    }
    return sum;
}

/* umb__weigh_one, the slices of two bricks at once. */
UMB__INLINE uint32_t umb__weigh_one_simd128(const struct umb__tent *tent, struct umb__voxel at,
                                            uint32_t side, const uint64_t *const *brick)
{
    const uint32_t planes = side == 2 ? UMB__TENT_PLANES - 1 : UMB__TENT_PLANES;
    const uint32_t x = (uint32_t)at.x & 7, y = (uint32_t)at.y & 7, z = (uint32_t)at.z & 7;
    v128_t sums = wasm_i16x8_splat(0);
    for (uint32_t r = 0; r < side; r++) {
        const uint64_t *const *row = brick + side * r;
        const v128_t two = wasm_i64x2_make((int64_t)row[0][z], (int64_t)row[1][z]);
        v128_t rows = umb__weigh_two(tent, two, planes, x, 0);
        if (side == 3) {
            const v128_t third = wasm_i64x2_make((int64_t)row[2][z], 0);
            rows = wasm_i8x16_add(rows, umb__weigh_two(tent, third, planes, x, 2));
        }
        const v128_t weights = wasm_i64x2_splat((int64_t)tent->rows[r][y]);
        sums = wasm_i16x8_add(sums, wasm_u16x8_extmul_low_u8x16(rows, weights));
        sums = wasm_i16x8_add(sums, wasm_u16x8_extmul_high_u8x16(rows, weights));
    }
    const v128_t pairs = wasm_u32x4_extadd_pairwise_u16x8(sums);
    return (uint32_t)(wasm_i32x4_extract_lane(pairs, 0) + wasm_i32x4_extract_lane(pairs, 1) +
                      wasm_i32x4_extract_lane(pairs, 2) + wasm_i32x4_extract_lane(pairs, 3));
}

#endif
