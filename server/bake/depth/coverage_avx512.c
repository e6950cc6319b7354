/* SPDX-License-Identifier: Apache-2.0 */
/* Preparing eight triangles at a time with AVX-512 (coverage_lanes.h). */
#include "bake/depth/depth_kernels.h"

#ifdef __AVX512F__
#include <immintrin.h>

#define LANES   ((size_t)8)
#define PREPARE umbb__prepare_avx512

typedef __m512d lanes;
typedef __mmask8 mask;
typedef __m256i ints;

#define LOAD               _mm512_loadu_pd
#define SAVE               _mm512_storeu_pd
#define ALL_OF             _mm512_set1_pd
#define LEAST              _mm512_min_pd
#define MOST               _mm512_max_pd
#define LESS(a, b)         _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ)
#define EQUAL(a, b)        _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ)
#define BOTH(a, b)         (__mmask8)((a) & (b))
#define EITHER(a, b)       (__mmask8)((a) | (b))
#define DIFFER(a, b)       (__mmask8)((a) ^ (b))
#define SELECT(m, yes, no) _mm512_mask_blend_pd(m, no, yes)
#define KEPT               _mm512_maskz_mov_pd

/* Transposes eight rows of eight numbers. */
static inline void transpose(__m512d v[8])
{
    __m512d a[8], b[8];
    for (size_t i = 0; i < 8; i += 2) {
        a[i] = _mm512_unpacklo_pd(v[i], v[i + 1]);
        a[i + 1] = _mm512_unpackhi_pd(v[i], v[i + 1]);
    }
    for (size_t i = 0; i < 8; i += 4) {
        for (size_t k = 0; k < 2; k++) {
            b[i + k] = _mm512_shuffle_f64x2(a[i + k], a[i + k + 2], 0x88);
            b[i + k + 2] = _mm512_shuffle_f64x2(a[i + k], a[i + k + 2], 0xdd);
        }
    }
    for (size_t k = 0; k < 4; k++) {
        v[k] = _mm512_shuffle_f64x2(b[k], b[k + 4], 0x88);
        v[k + 4] = _mm512_shuffle_f64x2(b[k], b[k + 4], 0xdd);
    }
}

/* Smallest integers n with n + 0.5 >= value. */
static inline __m256i first_centre(__m512d value)
{
    return _mm512_cvt_roundpd_epi32(value - _mm512_set1_pd(0.5),
                                    _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC);
}

static inline __m256i minus_one(__m256i v)
{
    return _mm256_sub_epi32(v, _mm256_set1_epi32(1));
}

/* 1 in the lanes of a mask, as integers. */
static inline __m256i ones(__mmask8 m)
{
    return _mm256_maskz_set1_epi32(m, 1);
}

static inline __m256i choose(__mmask8 m, __m256i yes, __m256i no)
{
    return _mm256_mask_blend_epi32(m, no, yes);
}

/* Two integers in each 64-bit lane. */
static inline __m512d pairs(__m256i low, __m256i high)
{
    const __m512i upper = _mm512_slli_epi64(_mm512_cvtepu32_epi64(high), 32);
    return _mm512_castsi512_pd(_mm512_or_si512(_mm512_cvtepu32_epi64(low), upper));
}

#include "bake/depth/coverage_lanes.h"

#endif
