/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbb_coverage_prepare for eight triangles at a time: its operations in the same order, never
 * fused, so the bits are the same. Corners are loaded and coverages stored as rows of eight
 * doubles. In between they are transposed, so that a register holds one number of eight triangles.
 */
#include "bake/depth/depth_kernels.h"

#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512BW__) && defined(__AVX512DQ__)
#include <immintrin.h>

#define LANES ((size_t)8)
#define UP    (_MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC)

/* A coverage is two rows of eight numbers: first x, y and two slopes, then the rest. */
_Static_assert(sizeof(struct umbb_coverage) == 2 * LANES * sizeof(double), "whole rows");

/* One corner of eight triangles. */
struct corner {
    __m512d x, y, z;
};

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

/* Orders two corners canonically; returns the lanes in which they were swapped. */
static inline __mmask8 order(struct corner *a, struct corner *b)
{
    const __mmask8 z = _mm512_cmp_pd_mask(a->z, b->z, _CMP_GT_OQ);
    const __mmask8 x = _mm512_cmp_pd_mask(a->x, b->x, _CMP_GT_OQ);
    const __mmask8 y = _mm512_cmp_pd_mask(a->y, b->y, _CMP_GT_OQ);
    const __mmask8 same_x = _mm512_cmp_pd_mask(a->x, b->x, _CMP_EQ_OQ);
    const __mmask8 same_y = _mm512_cmp_pd_mask(a->y, b->y, _CMP_EQ_OQ);
    const __mmask8 later = (__mmask8)(y | (same_y & (x | (same_x & z))));
    const struct corner first = *a;
    a->x = _mm512_mask_mov_pd(a->x, later, b->x);
    a->y = _mm512_mask_mov_pd(a->y, later, b->y);
    a->z = _mm512_mask_mov_pd(a->z, later, b->z);
    b->x = _mm512_mask_mov_pd(b->x, later, first.x);
    b->y = _mm512_mask_mov_pd(b->y, later, first.y);
    b->z = _mm512_mask_mov_pd(b->z, later, first.z);
    return later;
}

static inline __m512d edge_slope(const struct corner *a, const struct corner *b)
{
    return _mm512_maskz_div_pd(_mm512_cmp_pd_mask(a->y, b->y, _CMP_LT_OQ),
                               _mm512_sub_pd(b->x, a->x), _mm512_sub_pd(b->y, a->y));
}

/* Lanes that are finite. */
static inline __mmask8 are_finite(__m512d v)
{
    return (__mmask8)~_mm512_fpclass_pd_mask(v, 0x99); /* NaNs and infinities */
}

static inline __m512d clamp(__m512d v, __m512d high)
{
    return _mm512_min_pd(_mm512_max_pd(v, _mm512_setzero_pd()), high);
}

static inline __m512d product_difference(__m512d a, __m512d b, __m512d c, __m512d d)
{
    return _mm512_sub_pd(_mm512_mul_pd(a, b), _mm512_mul_pd(c, d));
}

/* Computes eight coverages. */
static inline void prepare_lanes(struct corner v[3], __m512d size, __m512d rows[2][8])
{
    __mmask8 odd = order(&v[0], &v[1]);
    odd ^= order(&v[1], &v[2]);
    odd ^= order(&v[0], &v[1]);
    const __m512d half = _mm512_set1_pd(0.5);
    const __m256i first = _mm512_cvt_roundpd_epi32(_mm512_sub_pd(v[0].y, half), UP);
    __m256i last = _mm512_cvt_roundpd_epi32(_mm512_sub_pd(v[2].y, half), UP);
    last = _mm256_sub_epi32(last, _mm256_set1_epi32(1));
    const __m512d ux = _mm512_sub_pd(v[1].x, v[0].x), wx = _mm512_sub_pd(v[2].x, v[0].x);
    const __m512d uy = _mm512_sub_pd(v[1].y, v[0].y), wy = _mm512_sub_pd(v[2].y, v[0].y);
    const __m512d uz = _mm512_sub_pd(v[1].z, v[0].z), wz = _mm512_sub_pd(v[2].z, v[0].z);
    const __m512d area = product_difference(ux, wy, uy, wx);
    const __m512d gx = _mm512_div_pd(product_difference(uz, wy, uy, wz), area);
    const __m512d gy = _mm512_div_pd(product_difference(ux, wz, uz, wx), area);
    const __mmask8 finite = are_finite(gx) & are_finite(gy);
    /* No rows: all corners have the same x. */
    const __mmask8 thin = _mm512_cmp_pd_mask(v[0].x, v[1].x, _CMP_EQ_OQ) &
                          _mm512_cmp_pd_mask(v[1].x, v[2].x, _CMP_EQ_OQ);
    last = _mm256_mask_sub_epi32(last, thin, first, _mm256_set1_epi32(1));
    const __mmask8 facing = _mm512_cmp_pd_mask(area, _mm512_setzero_pd(), _CMP_LT_OQ) ^ odd;
    __m512d *lower = rows[0], *upper = rows[1];
    for (size_t i = 0; i < 3; i++) {
        lower[i] = v[i].x;
        lower[3 + i] = v[i].y;
    }
    lower[6] = edge_slope(&v[0], &v[1]);
    lower[7] = edge_slope(&v[1], &v[2]);
    upper[0] = edge_slope(&v[0], &v[2]);
    upper[1] = v[0].z;
    upper[2] = _mm512_maskz_mov_pd(finite, gx);
    upper[3] = _mm512_maskz_mov_pd(finite, gy);
    upper[4] = clamp(_mm512_min_pd(_mm512_min_pd(v[0].z, v[1].z), v[2].z), size);
    upper[5] = clamp(_mm512_max_pd(_mm512_max_pd(v[0].z, v[1].z), v[2].z), size);
    const __m512i ends = _mm512_or_si512(_mm512_cvtepu32_epi64(first),
                                         _mm512_slli_epi64(_mm512_cvtepu32_epi64(last), 32));
    const __m512i one = _mm512_set1_epi64(1);
    const __m512i sides =
        _mm512_or_si512(_mm512_maskz_mov_epi64(odd, one),
                        _mm512_slli_epi64(_mm512_maskz_mov_epi64(facing, one), 32));
    upper[6] = _mm512_castsi512_pd(ends);
    upper[7] = _mm512_castsi512_pd(sides);
}

/* Loads the corners of eight triangles: eight numbers of each as a row, the ninth apart. */
static inline void corners_load(const double (*corners)[3][3], const uint32_t *triangles,
                                size_t count, struct corner v[3])
{
    __m512d rows[8];
    double ninth[8];
    for (size_t i = 0; i < LANES; i++) {
        const double *from = corners[triangles[i < count ? i : 0]][0];
        rows[i] = _mm512_loadu_pd(from);
        ninth[i] = from[8];
    }
    transpose(rows);
    v[0] = (struct corner){rows[0], rows[1], rows[2]};
    v[1] = (struct corner){rows[3], rows[4], rows[5]};
    v[2] = (struct corner){rows[6], rows[7], _mm512_loadu_pd(ninth)};
}

void umbb__prepare_avx512(const double (*corners)[3][3], const uint32_t *triangles, size_t count,
                          int32_t size, struct umbb_coverage *coverages)
{
    const __m512d columns = _mm512_set1_pd((double)size);
    for (size_t from = 0; from < count; from += LANES) {
        const size_t left = count - from < LANES ? count - from : LANES;
        struct corner v[3];
        __m512d rows[2][8];
        corners_load(corners, triangles + from, left, v);
        prepare_lanes(v, columns, rows);
        transpose(rows[0]);
        transpose(rows[1]);
        for (size_t i = 0; i < left; i++) {
            double *to = (double *)(void *)&coverages[from + i];
            _mm512_storeu_pd(to, rows[0][i]);
            _mm512_storeu_pd(to + 8, rows[1][i]);
        }
    }
}

#endif
