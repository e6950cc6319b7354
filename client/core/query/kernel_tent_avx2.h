/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_TENT_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_TENT_AVX2_H
/* The step of kernel_tent_steps.h with AVX2. It gives the same integers as in C. */
#include <immintrin.h>
#include "query/kernel_tent_steps.h"

/* Returns, for each byte, the number of set bits times 1 << plane. */
UMB__INLINE __m256i umb__weigh_bytes_avx2(__m256i words, uint32_t plane)
{
    const __m256i low = _mm256_set1_epi8(15);
    const __m128i counts = _mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
    const __m256i of = _mm256_broadcastsi128_si256(_mm_slli_epi16(counts, (int)plane));
    const __m256i high = _mm256_srli_epi64(words, 4) & low;
    return _mm256_add_epi8(_mm256_shuffle_epi8(of, words & low), _mm256_shuffle_epi8(of, high));
}

/* Does what umb__weigh_one does, with the slices of a row of bricks at once. */
UMB__INLINE uint32_t umb__weigh_one_avx2(const struct umb__tent *tent, struct umb__voxel at,
                                         uint32_t side, const uint64_t *const *brick)
{
    const uint32_t planes = side == 2 ? UMB__TENT_PLANES - 1 : UMB__TENT_PLANES;
    const uint32_t x = (uint32_t)at.x & 7, y = (uint32_t)at.y & 7, z = (uint32_t)at.z & 7;
    __m256i sums = _mm256_setzero_si256();
    for (uint32_t r = 0; r < side; r++) {
        const uint64_t *const *row = brick + side * r;
        const __m256i slices = _mm256_set_epi64x(0, side == 3 ? (long long)row[2][z] : 0,
                                                 (long long)row[1][z], (long long)row[0][z]);
        __m256i rows = _mm256_setzero_si256();
        for (uint32_t p = 0; p < planes; p++) {
            const __m256i columns = _mm256_load_si256((const void *)tent->beside[p][x]);
            rows = _mm256_add_epi8(rows, umb__weigh_bytes_avx2(slices & columns, p));
        }
        const __m256i weights = _mm256_set1_epi64x((long long)tent->rows[r][y]);
        sums = _mm256_add_epi16(sums, _mm256_maddubs_epi16(rows, weights));
    }
    sums = _mm256_madd_epi16(sums, _mm256_set1_epi16(1));
    __m128i half = _mm_add_epi32(_mm256_castsi256_si128(sums), _mm256_extracti128_si256(sums, 1));
    half = _mm_add_epi32(half, _mm_shuffle_epi32(half, 0x4e));
    return (uint32_t)(_mm_cvtsi128_si32(half) + _mm_extract_epi32(half, 1));
}

#endif
