/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RUNS_SIMD128_H
#define UMBRAGE_CORE_QUERY_KERNEL_RUNS_SIMD128_H
/* The steps of kernel_runs.h with WebAssembly's vectors of 128 bits. The integers are the same as
 * in C. */
#include <wasm_simd128.h>
#include "query/kernel_runs.h"

static inline struct umb__closeness umb__compare_points_simd128(struct umb__block *block)
{
    const uint32_t behind = block->size - 1;
    v128_t any = wasm_i32x4_splat(0);
    uint64_t same = 0;
    block->x[behind + 1] = block->x[behind];
    block->y[behind + 1] = block->y[behind];
    block->z[behind + 1] = block->z[behind];
    for (uint32_t i = 0; i < block->size; i += 4) {
        const v128_t x = wasm_v128_load(block->x + i) ^ wasm_v128_load(block->x + i + 1);
        const v128_t y = wasm_v128_load(block->y + i) ^ wasm_v128_load(block->y + i + 1);
        const v128_t z = wasm_v128_load(block->z + i) ^ wasm_v128_load(block->z + i + 1);
        const v128_t differ = x | y | z;
        const v128_t equal = wasm_i32x4_eq(wasm_u32x4_shr(differ, 3), wasm_i32x4_splat(0));
        any |= differ;
        same |= (uint64_t)wasm_i32x4_bitmask(equal) << i;
    }
    const uint64_t spread =
        (uint64_t)(wasm_i64x2_extract_lane(any, 0) | wasm_i64x2_extract_lane(any, 1));
    /* The caller masks bits beyond the block's points. */
    return (struct umb__closeness){
        ~same << 1, block->todo == UINT64_MAX ? (uint32_t)(spread | spread >> 32) : UINT32_MAX};
}

/* A brick in four registers, each with two slices. A byte is a row of a slice. */
struct umb__brick_lanes {
    v128_t of[4];
};

static inline struct umb__brick_lanes umb__load_brick(const uint64_t brick[8])
{
    return (struct umb__brick_lanes){{wasm_v128_load(brick), wasm_v128_load(brick + 2),
                                      wasm_v128_load(brick + 4), wasm_v128_load(brick + 6)}};
}

/* Low three bits of each of eight integers, in the low eight bytes. */
UMB__INLINE v128_t umb__low_bits(const int32_t *at)
{
    const v128_t seven = wasm_i16x8_splat(7);
    const v128_t low = wasm_v128_load(at), high = wasm_v128_load(at + 4);
    const v128_t words = wasm_i16x8_shuffle(low, high, 0, 2, 4, 6, 8, 10, 12, 14) & seven;
    return wasm_u8x16_narrow_i16x8(words, words);
}

/* Answers the points i .. i + 7 from a brick: finds the row of each as one of 64 bytes, and the
 * texel's bit in it. A swizzle gives 0 for indices beyond its 16 bytes. */
UMB__INLINE void umb__read_eight(struct umb__block *block, uint32_t i,
                                 struct umb__brick_lanes brick)
{
    const v128_t bits = wasm_i8x16_make(1, 2, 4, 8, 16, 32, 64, -128, 0, 0, 0, 0, 0, 0, 0, 0);
    const v128_t z = umb__low_bits(block->z + i), y = umb__low_bits(block->y + i);
    const v128_t row = wasm_i16x8_shl(z, 3) | y;
    v128_t byte = wasm_i8x16_swizzle(brick.of[0], row);
    for (int k = 1; k < 4; k++) {
        const v128_t in = wasm_i8x16_sub(row, wasm_i8x16_splat((int8_t)(16 * k)));
        byte |= wasm_i8x16_swizzle(brick.of[k], in);
    }
    byte &= wasm_i8x16_swizzle(bits, umb__low_bits(block->x + i));
    const v128_t dark = wasm_i8x16_eq(byte, wasm_i8x16_splat(0));
    const v128_t words = wasm_i16x8_extend_low_i8x16(wasm_i8x16_add(dark, wasm_i8x16_splat(1)));
    wasm_v128_store(block->lit + i, wasm_u32x4_extend_low_u16x8(words));
    wasm_v128_store(block->lit + i + 4, wasm_u32x4_extend_high_u16x8(words));
}

#endif
