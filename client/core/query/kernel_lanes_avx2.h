/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_LANES_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_LANES_AVX2_H
/* Lanes (kernel_place_lanes.h) of AVX2: four doubles. */
#include <immintrin.h>
#include "query/kernel_eights_avx2.h"
#include "query/kernel_parts.h"

#define UMB__LANES 4U

typedef __m256d umb__lanes;
typedef __m128i umb__lane_ints;
typedef __m256d umb__lane_mask;

#define UMB__LANES_OF(value)             _mm256_set1_pd(value)
#define UMB__LANES_SQRT(a)               _mm256_sqrt_pd(a)
#define UMB__LANES_ABS(a)                _mm256_andnot_pd(_mm256_set1_pd(-0.0), a)
#define UMB__LANES_ABOVE(a, b)           _mm256_cmp_pd(a, b, _CMP_GT_OQ)
#define UMB__LANES_AT_LEAST(a, b)        _mm256_cmp_pd(a, b, _CMP_GE_OQ)
#define UMB__LANES_NONE(mask)            ((void)(mask), false)
#define UMB__LANES_ALL(mask)             ((void)(mask), false)
#define UMB__MASK_AND(a, b)              _mm256_and_pd(a, b)
#define UMB__MASK_BITS(mask)             ((unsigned)_mm256_movemask_pd(mask))
#define UMB__LANES_SELECT(mask, yes, no) _mm256_blendv_pd(no, yes, mask)
/* Rounds towards zero; INT32_MIN for numbers beyond 32 bits and NaN. */
#define UMB__LANES_TRUNCATE(a)  _mm256_cvttpd_epi32(a)
#define UMB__LANES_FROM_INTS(i) _mm256_cvtepi32_pd(i)

/* Returns the lanes in which any of three numbers is negative, or -0. */
static inline unsigned umb__lanes_negative(umb__lanes a, umb__lanes b, umb__lanes c)
{
    return (unsigned)_mm256_movemask_pd(_mm256_or_pd(_mm256_or_pd(a, b), c));
}

/* Separates the coordinates of four points: from x0 y0 z0 x1, y1 z1 x2 y2, z2 x3 y3 z3 to x, y and
 * z. Blends and converting loads are cheaper than moves between lanes, of which there are three. */
static inline void umb__separate_axes(__m256d a, __m256d b, __m256d c, umb__lanes axis[3])
{
    __m256d xyxy = _mm256_blend_pd(a, b, 0xc);
    __m256d zxzx = _mm256_permute2f128_pd(a, c, 0x21);
    __m256d yzyz = _mm256_blend_pd(b, c, 0xc);
    axis[0] = _mm256_shuffle_pd(xyxy, zxzx, 0xa);
    axis[1] = _mm256_shuffle_pd(xyxy, yzyz, 0x5);
    axis[2] = _mm256_blend_pd(zxzx, yzyz, 0xa);
}

/* Loads three floats a point, x y z interleaved, of as many points as there are lanes. */
static inline void umb__lanes_load_f32(const uint8_t *at, umb__lanes axis[3])
{
    const float *f = (const float *)(const void *)at;
    umb__separate_axes(_mm256_cvtps_pd(_mm_loadu_ps(f)), _mm256_cvtps_pd(_mm_loadu_ps(f + 4)),
                       _mm256_cvtps_pd(_mm_loadu_ps(f + 8)), axis);
}

/* Loads three doubles a point, x y z interleaved, of as many points as there are lanes. */
static inline void umb__lanes_load_f64(const uint8_t *at, umb__lanes axis[3])
{
    const double *d = (const double *)(const void *)at;
    umb__separate_axes(_mm256_loadu_pd(d), _mm256_loadu_pd(d + 4), _mm256_loadu_pd(d + 8), axis);
}

/* Eight integers from two times four lanes. */
static inline umb__eight umb__join_ints(const umb__lane_ints part[8 / UMB__LANES])
{
    return _mm256_inserti128_si256(_mm256_castsi128_si256(part[0]), part[1], 1);
}

#endif
