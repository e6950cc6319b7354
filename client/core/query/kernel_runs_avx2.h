/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RUNS_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_RUNS_AVX2_H
/* The grid stage, and the steps of kernel_runs.h, with AVX2 for eight points at a time. The
 * integers are the same as in C. */
#include <immintrin.h>
#include "query/kernel_runs.h"

static inline __m256i umb__load_eight(const int32_t *at)
{
    return _mm256_loadu_si256((const __m256i *)(const void *)at);
}

/* Reads eight cells of the grid by column, row and layer. */
static inline __m256i umb__gather_eight(const struct umb__query *q, __m256i x, __m256i y, __m256i z)
{
    __m128i g = _mm_cvtsi32_si128((int)q->grid_log2);
    __m256i index = _mm256_add_epi32(y, _mm256_sll_epi32(z, g));
    index = _mm256_add_epi32(x, _mm256_sll_epi32(index, g));
    return _mm256_i32gather_epi32((const int *)(const void *)q->grid, index, 4);
}

/* Does what umb__grid_block does, eight points at a time. */
static inline void umb__grid_block_avx2(const struct umb__query *q, struct umb__block *block)
{
    const __m128i level = _mm_cvtsi32_si128((int)(q->log2_size - q->grid_log2));
    const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    const __m256i two = _mm256_set1_epi32(UMB__CELL_FIRST), reach = _mm256_set1_epi32(q->taps - 1);
    const __m256i total = _mm256_set1_epi32((int)q->total);
    uint64_t mixed = 0;
    for (uint32_t i = 0; i < block->size; i += 8) {
        __m256i x = umb__load_eight(block->x + i);
        __m256i y = umb__load_eight(block->y + i);
        __m256i z = umb__load_eight(block->z + i);
        __m256i lit = _mm256_loadu_si256((const __m256i *)(const void *)(block->lit + i));
        z = _mm256_srl_epi32(z, level);
        __m256i cx = _mm256_srl_epi32(x, level), cy = _mm256_srl_epi32(y, level);
        __m256i cell = umb__gather_eight(q, cx, cy, z);
        __m256i right = _mm256_srl_epi32(_mm256_add_epi32(x, reach), level);
        __m256i down = _mm256_srl_epi32(_mm256_add_epi32(y, reach), level);
        __m256i same = _mm256_cmpeq_epi32(cell, umb__gather_eight(q, right, cy, z));
        same &= _mm256_cmpeq_epi32(cell, umb__gather_eight(q, cx, down, z));
        same &= _mm256_cmpeq_epi32(cell, umb__gather_eight(q, right, down, z));
        __m256i uniform = _mm256_cmpeq_epi32(_mm256_min_epu32(cell, two), cell);
        uniform = _mm256_andnot_si256(_mm256_cmpeq_epi32(cell, two), uniform);
        unsigned todo = (unsigned)(block->todo >> i & 0xff);
        __m256i which = _mm256_set1_epi32((int)todo);
        which = _mm256_cmpeq_epi32(which & bits, bits);
        __m256i settled = uniform & same & which;
        /* A uniform cell's value is 1 if lit, else 0. */
        lit = _mm256_blendv_epi8(lit, _mm256_mullo_epi32(cell, total), settled);
        _mm256_storeu_si256((__m256i *)(void *)(block->lit + i), lit);
        unsigned done = (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(settled));
        mixed |= (uint64_t)(todo & ~done) << i;
    }
    block->todo = mixed;
}

static inline struct umb__closeness umb__compare_points_avx2(struct umb__block *block)
{
    const uint32_t behind = block->size - 1;
    __m256i any = _mm256_setzero_si256();
    uint64_t same = 0;
    block->x[behind + 1] = block->x[behind];
    block->y[behind + 1] = block->y[behind];
    block->z[behind + 1] = block->z[behind];
    for (uint32_t i = 0; i < block->size; i += 8) {
        __m256i x = umb__load_eight(block->x + i) ^ umb__load_eight(block->x + i + 1);
        __m256i y = umb__load_eight(block->y + i) ^ umb__load_eight(block->y + i + 1);
        __m256i z = umb__load_eight(block->z + i) ^ umb__load_eight(block->z + i + 1);
        __m256i differ = x | y | z;
        __m256i equal = _mm256_cmpeq_epi32(_mm256_srli_epi32(differ, 3), _mm256_setzero_si256());
        any |= differ;
        same |= (uint64_t)(unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(equal)) << i;
    }
    const __m128i half = _mm256_castsi256_si128(any) | _mm256_extracti128_si256(any, 1);
    const uint64_t spread = (uint64_t)(half[0] | half[1]);
    /* The caller ignores the bits beyond the block's points. */
    return (struct umb__closeness){
        ~same << 1, block->todo == UINT64_MAX ? (uint32_t)(spread | spread >> 32) : UINT32_MAX};
}

/* A brick in two registers, each with four slices. A slice is two words of 32 bits, the lower one
 * for y & 4 == 0. */
struct umb__brick_lanes {
    __m256i low, high;
};

static inline struct umb__brick_lanes umb__load_brick(const uint64_t brick[8])
{
    const __m256i *words = (const __m256i *)(const void *)brick;
    return (struct umb__brick_lanes){_mm256_loadu_si256(words), _mm256_loadu_si256(words + 1)};
}

/* Answers the points i .. i + 7 from a brick. */
static inline void umb__read_eight(struct umb__block *block, uint32_t i,
                                   struct umb__brick_lanes brick)
{
    const __m256i one = _mm256_set1_epi32(1), three = _mm256_set1_epi32(3);
    const __m256i seven = _mm256_set1_epi32(7);
    __m256i x = umb__load_eight(block->x + i), y = umb__load_eight(block->y + i);
    __m256i z = umb__load_eight(block->z + i);
    /* The low three bits of the shift choose a word within one half of the brick, and the fourth
     * bit chooses the half. */
    __m256i which = _mm256_add_epi32(z, z) | (_mm256_srli_epi32(y, 2) & one);
    __m256 word =
        _mm256_blendv_ps(_mm256_castsi256_ps(_mm256_permutevar8x32_epi32(brick.low, which)),
                         _mm256_castsi256_ps(_mm256_permutevar8x32_epi32(brick.high, which)),
                         _mm256_castsi256_ps(_mm256_slli_epi32(z, 29)));
    __m256i bit = (x & seven) | _mm256_slli_epi32(y & three, 3);
    __m256i lit = _mm256_srlv_epi32(_mm256_castps_si256(word), bit);
    _mm256_storeu_si256((__m256i *)(void *)(block->lit + i), lit & one);
}

#endif
