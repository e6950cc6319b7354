/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_LANES_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_LANES_AVX512_H
/* Lanes (kernel_place_lanes.h) of AVX-512: eight doubles. */
#include <immintrin.h>
#include "query/kernel_eights_avx2.h"
#include "query/kernel_parts.h"

#define UMB__LANES 8U

typedef __m512d umb__lanes;
typedef __m256i umb__lane_ints;
typedef __mmask8 umb__lane_mask;

#define UMB__LANES_OF(value)             _mm512_set1_pd(value)
#define UMB__LANES_SQRT(a)               _mm512_sqrt_pd(a)
#define UMB__LANES_ABS(a)                _mm512_andnot_pd(_mm512_set1_pd(-0.0), a)
#define UMB__LANES_ABOVE(a, b)           _mm512_cmp_pd_mask(a, b, _CMP_GT_OQ)
#define UMB__LANES_AT_LEAST(a, b)        _mm512_cmp_pd_mask(a, b, _CMP_GE_OQ)
#define UMB__LANES_NONE(mask)            ((void)(mask), false)
#define UMB__LANES_ALL(mask)             ((void)(mask), false)
#define UMB__MASK_AND(a, b)              ((umb__lane_mask)((a) & (b)))
#define UMB__MASK_BITS(mask)             (mask)
#define UMB__LANES_SELECT(mask, yes, no) _mm512_mask_blend_pd(mask, no, yes)
/* Rounds towards zero; INT32_MIN for numbers beyond 32 bits and NaN. */
#define UMB__LANES_TRUNCATE(a)  _mm512_cvttpd_epi32(a)
#define UMB__LANES_FROM_INTS(i) _mm512_cvtepi32_pd(i)

/* Returns the lanes in which any of three numbers is negative, or -0. */
static inline unsigned umb__lanes_negative(umb__lanes a, umb__lanes b, umb__lanes c)
{
    return _mm512_movepi64_mask(_mm512_castpd_si512(_mm512_or_pd(_mm512_or_pd(a, b), c)));
}

/* Loads three floats a point, x y z interleaved, of as many points as there are lanes. */
static inline void umb__lanes_load_f32(const uint8_t *at, umb__lanes axis[3])
{
    const __m512i every_third =
        _mm512_setr_epi32(0, 3, 6, 9, 12, 15, 18, 21, 0, 0, 0, 0, 0, 0, 0, 0);
    const __m512 low = _mm512_loadu_ps(at);
    const __m512 high =
        _mm512_castps256_ps512(_mm256_loadu_ps((const float *)(const void *)(at + 64)));
    for (int k = 0; k < 3; k++) {
        const __m512i from = _mm512_add_epi32(every_third, _mm512_set1_epi32(k));
        const __m512 v = _mm512_permutex2var_ps(low, from, high);
        axis[k] = _mm512_cvtps_pd(_mm512_castps512_ps256(v));
    }
}

/* Loads three doubles a point, x y z interleaved, of as many points as there are lanes. */
static inline void umb__lanes_load_f64(const uint8_t *at, umb__lanes axis[3])
{
    const __m512i every_third = _mm512_setr_epi64(0, 3, 6, 9, 12, 15, 18, 21);
    const __m512d a = _mm512_loadu_pd(at), b = _mm512_loadu_pd(at + 64);
    const __m512d c = _mm512_loadu_pd(at + 128);
    for (int k = 0; k < 3; k++) {
        /* `vpermt2pd` ignores the unused high bits of an index. */
        const __m512i from = _mm512_add_epi64(every_third, _mm512_set1_epi64(k));
        const __mmask8 in_c = _mm512_cmpgt_epi64_mask(from, _mm512_set1_epi64(15));
        axis[k] = _mm512_mask_permutexvar_pd(_mm512_permutex2var_pd(a, from, b), in_c, from, c);
    }
}

/* Eight integers from eight lanes. */
static inline umb__eight umb__join_ints(const umb__lane_ints part[8 / UMB__LANES])
{
    return part[0];
}

#endif
