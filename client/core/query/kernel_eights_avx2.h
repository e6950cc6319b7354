/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_EIGHTS_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_EIGHTS_AVX2_H
/* Eight integers of 32 bits (kernel_place_lanes.h) of AVX2. */
#include <immintrin.h>
#include <stdint.h>

typedef __m256i umb__eight;
typedef __m128i umb__eight_shift; /* Number of bits of a shift */

static inline umb__eight umb__eight_of(int32_t value)
{
    return _mm256_set1_epi32(value);
}

static inline umb__eight_shift umb__eight_shift_of(uint32_t bits)
{
    return _mm_cvtsi32_si128((int)bits);
}

static inline umb__eight umb__eight_add(umb__eight a, umb__eight b)
{
    return _mm256_add_epi32(a, b);
}

static inline umb__eight umb__eight_sub(umb__eight a, umb__eight b)
{
    return _mm256_sub_epi32(a, b);
}

static inline umb__eight umb__eight_or(umb__eight a, umb__eight b)
{
    return a | b;
}

/* Returns the lanes that are 0 to 1 << bits, exclusive. */
static inline unsigned umb__eight_below(umb__eight v, umb__eight_shift bits)
{
    const __m256i in = _mm256_cmpeq_epi32(_mm256_srl_epi32(v, bits), _mm256_setzero_si256());
    return (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(in));
}

/* Sets lanes to 0. */
static inline umb__eight umb__eight_clear(umb__eight v, unsigned lanes)
{
    const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    const __m256i cleared = _mm256_set1_epi32((int)lanes) & bits;
    return _mm256_andnot_si256(_mm256_cmpeq_epi32(cleared, bits), v);
}

static inline void umb__eight_store(int32_t *to, umb__eight v)
{
    _mm256_storeu_si256((__m256i *)(void *)to, v);
}

#endif
