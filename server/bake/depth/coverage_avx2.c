/* SPDX-License-Identifier: Apache-2.0 */
/* Preparing four triangles at a time with AVX2 (coverage_lanes.h). */
#include "bake/depth/depth_kernels.h"

#ifdef __AVX2__
#include <immintrin.h>

#define LANES   ((size_t)4)
#define PREPARE umbb__prepare_avx2

typedef __m256d lanes, mask; /* a mask's lanes are all ones or all zeros */
typedef __m128i ints;

#define LOAD               _mm256_loadu_pd
#define SAVE               _mm256_storeu_pd
#define ALL_OF             _mm256_set1_pd
#define LEAST              _mm256_min_pd
#define MOST               _mm256_max_pd
#define LESS(a, b)         _mm256_cmp_pd(a, b, _CMP_LT_OQ)
#define EQUAL(a, b)        _mm256_cmp_pd(a, b, _CMP_EQ_OQ)
#define BOTH               _mm256_and_pd
#define EITHER             _mm256_or_pd
#define DIFFER             _mm256_xor_pd
#define SELECT(m, yes, no) _mm256_blendv_pd(no, yes, m)
#define KEPT(m, v)         _mm256_and_pd(m, v)

/* Transposes four rows of four numbers. */
static inline void transpose(__m256d v[4])
{
    const __m256d a = _mm256_unpacklo_pd(v[0], v[1]), b = _mm256_unpackhi_pd(v[0], v[1]);
    const __m256d c = _mm256_unpacklo_pd(v[2], v[3]), d = _mm256_unpackhi_pd(v[2], v[3]);
    v[0] = _mm256_permute2f128_pd(a, c, 0x20);
    v[1] = _mm256_permute2f128_pd(b, d, 0x20);
    v[2] = _mm256_permute2f128_pd(a, c, 0x31);
    v[3] = _mm256_permute2f128_pd(b, d, 0x31);
}

/* Smallest integers n with n + 0.5 >= value. */
static inline __m128i first_centre(__m256d value)
{
    return _mm256_cvttpd_epi32(_mm256_ceil_pd(value - _mm256_set1_pd(0.5)));
}

static inline __m128i minus_one(__m128i v)
{
    return _mm_sub_epi32(v, _mm_set1_epi32(1));
}

/* 1 in the lanes of a mask, as integers. */
static inline __m128i ones(__m256d m)
{
    const __m256i one = _mm256_srli_epi64(_mm256_castpd_si256(m), 63);
    return _mm256_castsi256_si128(
        _mm256_permutevar8x32_epi32(one, _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6)));
}

static inline __m128i choose(__m256d m, __m128i yes, __m128i no)
{
    return _mm_blendv_epi8(no, yes, _mm_sub_epi32(_mm_setzero_si128(), ones(m)));
}

/* Two integers in each 64-bit lane. */
static inline __m256d pairs(__m128i low, __m128i high)
{
    const __m256i upper = _mm256_slli_epi64(_mm256_cvtepu32_epi64(high), 32);
    return _mm256_castsi256_pd(_mm256_or_si256(_mm256_cvtepu32_epi64(low), upper));
}

#include "bake/depth/coverage_lanes.h"

#endif
