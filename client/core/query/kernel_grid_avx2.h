/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_GRID_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_GRID_AVX2_H
/* The grid stage eight points at a time with AVX2; the same integers. */
#include <immintrin.h>
#include "query/kernel_parts.h"

/* Reads eight cells of the grid by column, row and layer. */
static inline __m256i umb__gather_eight(const struct umb__query *q, __m256i x, __m256i y, __m256i z)
{
    __m128i g = _mm_cvtsi32_si128((int)q->grid_log2);
    __m256i index = _mm256_add_epi32(y, _mm256_sll_epi32(z, g));
    index = _mm256_add_epi32(x, _mm256_sll_epi32(index, g));
    return _mm256_i32gather_epi32((const int *)(const void *)q->grid, index, 4);
}

/* umb__grid_block, eight points at a time. */
static inline void umb__grid_block_avx2(const struct umb__query *q, struct umb__block *block)
{
    const __m128i level = _mm_cvtsi32_si128((int)(q->log2_size - q->grid_log2));
    const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    const __m256i two = _mm256_set1_epi32(UMB__CELL_FIRST), reach = _mm256_set1_epi32(q->taps - 1);
    const __m256i total = _mm256_set1_epi32(q->taps * q->taps);
    uint64_t mixed = 0;
    for (uint32_t i = 0; i < block->size; i += 8) {
        __m256i x = _mm256_loadu_si256((const __m256i *)(const void *)(block->x + i));
        __m256i y = _mm256_loadu_si256((const __m256i *)(const void *)(block->y + i));
        __m256i z = _mm256_loadu_si256((const __m256i *)(const void *)(block->z + i));
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

#endif
