/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The span with AVX2: the operations of umbb_coverage_lit in the same order, four texels at a
 * time, without fused multiply-add, hence the same bits. max and min give their second operand if
 * the first is a NaN, as the comparisons of the plain form do.
 */
#include "bake/depth/depth_span.h"

#include <stddef.h>

#ifdef __AVX2__
#include <immintrin.h>

struct lanes {
    __m256d row_z, gradient, anchor_x, z_min, z_max, half;
};

static inline __m128i four(const struct lanes *k, __m256d centre)
{
    __m256d z = _mm256_mul_pd(k->gradient, _mm256_sub_pd(centre, k->anchor_x));
    z = _mm256_add_pd(k->row_z, z);
    z = _mm256_max_pd(z, k->z_min);
    z = _mm256_min_pd(z, k->z_max);
    return _mm256_cvttpd_epi32(_mm256_ceil_pd(_mm256_sub_pd(z, k->half)));
}

static void span(const struct umbb_coverage *coverage, double row_z, int32_t x_first,
                 int32_t x_last, int32_t x_origin, int32_t *layer)
{
    const struct lanes k = {
        .row_z = _mm256_set1_pd(row_z),
        .gradient = _mm256_set1_pd(coverage->gradient_x),
        .anchor_x = _mm256_set1_pd(coverage->x[0]),
        .z_min = _mm256_set1_pd(coverage->z_min),
        .z_max = _mm256_set1_pd(coverage->z_max),
        .half = _mm256_set1_pd(0.5),
    };
    int32_t x = x_first;
    if (x_last - x_first >= 3) {
        const __m256d step = _mm256_set1_pd(4.0);
        /* Centres are multiples of one half below 2^31: adding four to them is exact. */
        __m256d centre =
            _mm256_add_pd(_mm256_set1_pd((double)x), _mm256_set_pd(3.5, 2.5, 1.5, 0.5));
        int32_t *at = layer + (x_first - x_origin);
        for (; x <= x_last - 3; x += 4, at += 4) {
            const __m128i lit = four(&k, centre);
            const __m128i old = _mm_loadu_si128((const __m128i *)(const void *)at);
            _mm_storeu_si128((__m128i *)(void *)at, _mm_min_epi32(lit, old));
            centre = _mm256_add_pd(centre, step);
        }
    }
    for (; x <= x_last; x++) {
        const int32_t lit = umbb_coverage_lit(coverage, row_z, x);
        int32_t *at = layer + (x - x_origin);
        *at = lit < *at ? lit : *at;
    }
}

umbb_span_fn umbb_span_avx2(void)
{
    return __builtin_cpu_supports("avx2") ? span : NULL;
}

#else

umbb_span_fn umbb_span_avx2(void)
{
    return NULL;
}

#endif
