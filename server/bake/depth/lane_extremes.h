/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_LANE_EXTREMES_H
#define UMBRAGE_SERVER_BAKE_DEPTH_LANE_EXTREMES_H
/* The least and the most of four or eight lanes, for units with AVX2. */
#include <stdint.h>

#include <immintrin.h>

static inline int32_t umbb_least_of_4(__m128i v)
{
    v = _mm_min_epi32(v, _mm_shuffle_epi32(v, 0x4e));
    v = _mm_min_epi32(v, _mm_shuffle_epi32(v, 0xb1));
    return _mm_cvtsi128_si32(v);
}

static inline int32_t umbb_most_of_4(__m128i v)
{
    v = _mm_max_epi32(v, _mm_shuffle_epi32(v, 0x4e));
    v = _mm_max_epi32(v, _mm_shuffle_epi32(v, 0xb1));
    return _mm_cvtsi128_si32(v);
}

static inline int32_t umbb_least_of_8(__m256i v)
{
    return umbb_least_of_4(
        _mm_min_epi32(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1)));
}

static inline int32_t umbb_most_of_8(__m256i v)
{
    return umbb_most_of_4(_mm_max_epi32(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1)));
}

#endif
