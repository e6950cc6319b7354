/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbb_coverage_prepare for four triangles at a time: its operations in the same order, without
 * fused multiply-add, so the bits are the same. coverage_avx512.c does eight.
 */
#include "bake/depth/depth_kernels.h"

#ifdef __AVX2__
#include <immintrin.h>

#define LANES ((size_t)4)

/* A coverage is four rows of four numbers. */
_Static_assert(sizeof(struct umbb_coverage) == 4 * LANES * sizeof(double), "whole rows");

/* One corner of four triangles. */
struct corner {
    __m256d x, y, z;
};

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

static inline void exchange(__m256d *a, __m256d *b, __m256d later)
{
    const __m256d first = *a;
    *a = _mm256_blendv_pd(first, *b, later);
    *b = _mm256_blendv_pd(*b, first, later);
}

/* Orders two corners canonically; returns the lanes in which they were swapped. */
static inline __m256d order(struct corner *a, struct corner *b)
{
    const __m256d z = _mm256_cmp_pd(a->z, b->z, _CMP_GT_OQ);
    const __m256d same_x = _mm256_cmp_pd(a->x, b->x, _CMP_EQ_OQ);
    const __m256d x = _mm256_or_pd(_mm256_cmp_pd(a->x, b->x, _CMP_GT_OQ), _mm256_and_pd(same_x, z));
    const __m256d same_y = _mm256_cmp_pd(a->y, b->y, _CMP_EQ_OQ);
    const __m256d later =
        _mm256_or_pd(_mm256_cmp_pd(a->y, b->y, _CMP_GT_OQ), _mm256_and_pd(same_y, x));
    exchange(&a->x, &b->x, later);
    exchange(&a->y, &b->y, later);
    exchange(&a->z, &b->z, later);
    return later;
}

static inline __m256d edge_slope(const struct corner *a, const struct corner *b)
{
    const __m256d slope = _mm256_div_pd(_mm256_sub_pd(b->x, a->x), _mm256_sub_pd(b->y, a->y));
    return _mm256_and_pd(slope, _mm256_cmp_pd(a->y, b->y, _CMP_LT_OQ));
}

/* Lanes that are finite: for other values v - v is not 0. */
static inline __m256d are_finite(__m256d v)
{
    return _mm256_cmp_pd(_mm256_sub_pd(v, v), _mm256_setzero_pd(), _CMP_EQ_OQ);
}

static inline __m256d clamp(__m256d v, __m256d high)
{
    return _mm256_min_pd(_mm256_max_pd(v, _mm256_setzero_pd()), high);
}

static inline __m256d product_difference(__m256d a, __m256d b, __m256d c, __m256d d)
{
    return _mm256_sub_pd(_mm256_mul_pd(a, b), _mm256_mul_pd(c, d));
}

/* Smallest integers n with n + 0.5 >= value. */
static inline __m128i first_centre(__m256d value)
{
    return _mm256_cvttpd_epi32(_mm256_ceil_pd(_mm256_sub_pd(value, _mm256_set1_pd(0.5))));
}

/* Interleaves two integers in each 64-bit lane. */
static inline __m256d pairs(__m128i low, __m128i high)
{
    const __m256i upper = _mm256_slli_epi64(_mm256_cvtepu32_epi64(high), 32);
    return _mm256_castsi256_pd(_mm256_or_si256(_mm256_cvtepu32_epi64(low), upper));
}

/* 1 in the lanes of a mask, as integers. */
static inline __m128i ones(__m256d lanes)
{
    const __m256i one = _mm256_srli_epi64(_mm256_castpd_si256(lanes), 63);
    return _mm256_castsi256_si128(
        _mm256_permutevar8x32_epi32(one, _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6)));
}

/* Computes four coverages, each as four rows of numbers. */
static inline void prepare_lanes(struct corner v[3], __m256d size, __m256d rows[4][4])
{
    __m256d odd = order(&v[0], &v[1]);
    odd = _mm256_xor_pd(odd, order(&v[1], &v[2]));
    odd = _mm256_xor_pd(odd, order(&v[0], &v[1]));
    const __m128i first = first_centre(v[0].y);
    __m128i last = _mm_sub_epi32(first_centre(v[2].y), _mm_set1_epi32(1));
    const __m256d ux = _mm256_sub_pd(v[1].x, v[0].x), wx = _mm256_sub_pd(v[2].x, v[0].x);
    const __m256d uy = _mm256_sub_pd(v[1].y, v[0].y), wy = _mm256_sub_pd(v[2].y, v[0].y);
    const __m256d uz = _mm256_sub_pd(v[1].z, v[0].z), wz = _mm256_sub_pd(v[2].z, v[0].z);
    const __m256d area = product_difference(ux, wy, uy, wx);
    const __m256d gx = _mm256_div_pd(product_difference(uz, wy, uy, wz), area);
    const __m256d gy = _mm256_div_pd(product_difference(ux, wz, uz, wx), area);
    const __m256d finite = _mm256_and_pd(are_finite(gx), are_finite(gy));
    /* No rows: all corners have the same x. */
    const __m256d thin = _mm256_and_pd(_mm256_cmp_pd(v[0].x, v[1].x, _CMP_EQ_OQ),
                                       _mm256_cmp_pd(v[1].x, v[2].x, _CMP_EQ_OQ));
    const __m128i none = _mm_sub_epi32(first, _mm_set1_epi32(1));
    last = _mm_blendv_epi8(last, none, _mm_sub_epi32(_mm_setzero_si128(), ones(thin)));
    const __m256d away = _mm256_cmp_pd(area, _mm256_setzero_pd(), _CMP_LT_OQ);
    rows[0][0] = v[0].x;
    rows[0][1] = v[1].x;
    rows[0][2] = v[2].x;
    rows[0][3] = v[0].y;
    rows[1][0] = v[1].y;
    rows[1][1] = v[2].y;
    rows[1][2] = edge_slope(&v[0], &v[1]);
    rows[1][3] = edge_slope(&v[1], &v[2]);
    rows[2][0] = edge_slope(&v[0], &v[2]);
    rows[2][1] = v[0].z;
    rows[2][2] = _mm256_and_pd(gx, finite);
    rows[2][3] = _mm256_and_pd(gy, finite);
    rows[3][0] = clamp(_mm256_min_pd(_mm256_min_pd(v[0].z, v[1].z), v[2].z), size);
    rows[3][1] = clamp(_mm256_max_pd(_mm256_max_pd(v[0].z, v[1].z), v[2].z), size);
    rows[3][2] = pairs(first, last);
    rows[3][3] = pairs(ones(odd), ones(_mm256_xor_pd(away, odd)));
}

/* Loads the corners of four triangles: eight numbers of each as two rows, the ninth apart. */
static inline void corners_load(const double (*corners)[3][3], const uint32_t *triangles,
                                size_t count, struct corner v[3])
{
    __m256d low[4], high[4];
    double ninth[4];
    for (size_t i = 0; i < LANES; i++) {
        const double *from = corners[triangles[i < count ? i : 0]][0];
        low[i] = _mm256_loadu_pd(from);
        high[i] = _mm256_loadu_pd(from + 4);
        ninth[i] = from[8];
    }
    transpose(low);
    transpose(high);
    v[0] = (struct corner){low[0], low[1], low[2]};
    v[1] = (struct corner){low[3], high[0], high[1]};
    v[2] = (struct corner){high[2], high[3], _mm256_loadu_pd(ninth)};
}

void umbb__prepare_avx2(const double (*corners)[3][3], const uint32_t *triangles, size_t count,
                        int32_t size, struct umbb_coverage *coverages)
{
    const __m256d columns = _mm256_set1_pd((double)size);
    for (size_t from = 0; from < count; from += LANES) {
        const size_t left = count - from < LANES ? count - from : LANES;
        struct corner v[3];
        __m256d rows[4][4];
        corners_load(corners, triangles + from, left, v);
        prepare_lanes(v, columns, rows);
        for (size_t row = 0; row < 4; row++) {
            transpose(rows[row]);
            for (size_t i = 0; i < left; i++) {
                double *to = (double *)(void *)&coverages[from + i];
                _mm256_storeu_pd(to + 4 * row, rows[row][i]);
            }
        }
    }
}

#endif
