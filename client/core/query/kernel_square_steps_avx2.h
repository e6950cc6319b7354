/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_SQUARE_STEPS_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_SQUARE_STEPS_AVX2_H
/* The steps of kernel_square_steps.h with AVX2. Sums are in doubles, in the same order as in C; the
 * integers are the same. */
#include "query/kernel_lanes_avx2.h"
#include "query/kernel_runs_avx2.h"
#include "query/kernel_square_steps.h"

/* Returns the voxel indices on an axis of four samples; INT32_MIN beyond 32 bits. */
static inline __m128i umb__floor_four(__m256d v)
{
    return _mm256_cvttpd_epi32(_mm256_floor_pd(v));
}

/* Places the samples of both squares on one axis. In: last: the last voxel, to which indices in z
 * are cut; infinite on other axes. */
UMB__INLINE void umb__place_axis_avx2(const struct umb__receivers *r, uint32_t lane, unsigned axis,
                                      double last, int32_t to[UMB__SAMPLES])
{
    const __m256d edge[2] = {_mm256_set1_pd(r->edge[0][axis][lane]),
                             _mm256_set1_pd(r->edge[1][axis][lane])};
    const __m256d narrow = _mm256_set1_pd(r->centre[0][axis][lane]);
    const __m256d wide = _mm256_set1_pd(r->centre[1][axis][lane]);
    const __m256d half = _mm256_set1_pd(0.5), most = _mm256_set1_pd(last);
    for (uint32_t i = 0; i < UMB__SQUARE_SAMPLES; i += 4) {
        const __m256d from_centre = _mm256_load_pd(umb__lattice[0] + i) * edge[0] +
                                    _mm256_load_pd(umb__lattice[1] + i) * edge[1];
        const __m256d near = _mm256_min_pd(most, narrow + half * from_centre);
        const __m256d far = _mm256_min_pd(most, wide + from_centre);
        _mm_store_si128((__m128i *)(void *)(to + i), umb__floor_four(near));
        _mm_store_si128((__m128i *)(void *)(to + UMB__SQUARE_SAMPLES + i), umb__floor_four(far));
    }
}

static inline uint64_t umb__place_samples_avx2(const struct umb__receivers *r, uint32_t lane,
                                               uint32_t log2_size, struct umb__samples *samples)
{
    const double last = (double)((uint32_t)1 << log2_size) - 1;
    const __m256i beyond = _mm256_set1_epi32(-((int32_t)1 << log2_size));
    uint64_t outside = 0;
    umb__place_axis_avx2(r, lane, 0, INFINITY, samples->x);
    umb__place_axis_avx2(r, lane, 1, INFINITY, samples->y);
    umb__place_axis_avx2(r, lane, 2, last, samples->z);
    for (uint32_t k = 0; k < UMB__SAMPLES; k += 8) {
        const __m256i across = (umb__load_eight(samples->x + k) | umb__load_eight(samples->y + k));
        const __m256i out =
            _mm256_cmpgt_epi32(_mm256_setzero_si256(), umb__load_eight(samples->z + k)) |
            (across & beyond);
        const __m256i in = _mm256_cmpeq_epi32(out, _mm256_setzero_si256());
        outside |= (uint64_t)(~(unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(in)) & 0xff) << k;
    }
    return ~outside;
}

/* Indices of the children of eight samples, in 32 bits each. */
static inline __m256i umb__child_eight(const struct umb__samples *samples, uint32_t k,
                                       __m128i shift)
{
    const __m256i three = _mm256_set1_epi32(3);
    const __m256i x = _mm256_srl_epi32(umb__load_eight(samples->x + k), shift);
    const __m256i y = _mm256_srl_epi32(umb__load_eight(samples->y + k), shift);
    const __m256i z = _mm256_srl_epi32(umb__load_eight(samples->z + k), shift);
    return (x & three) | _mm256_slli_epi32(y & three, 2) | _mm256_slli_epi32(z & three, 4);
}

static inline void umb__child_bytes_avx2(const struct umb__samples *samples, uint32_t level,
                                         struct umb__child_bytes *bytes)
{
    const __m128i shift = _mm_cvtsi32_si128((int)level);
    const __m256i in_order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
    for (uint32_t k = 0; k < UMB__SAMPLES; k += 32) {
        const __m256i first = _mm256_packus_epi32(umb__child_eight(samples, k, shift),
                                                  umb__child_eight(samples, k + 8, shift));
        const __m256i second = _mm256_packus_epi32(umb__child_eight(samples, k + 16, shift),
                                                   umb__child_eight(samples, k + 24, shift));
        const __m256i mixed = _mm256_packus_epi16(first, second);
        _mm256_store_si256((__m256i *)(void *)(bytes->of + k),
                           _mm256_permutevar8x32_epi32(mixed, in_order));
    }
}

/* Does what umb__children_in does, for the samples k .. k + 31. */
static inline uint64_t umb__half_in(const struct umb__child_bytes *bytes, uint32_t k, __m256i mask)
{
    const __m256i bit_of = _mm256_setr_epi8(1, 2, 4, 8, 16, 32, 64, -128, 0, 0, 0, 0, 0, 0, 0, 0, 1,
                                            2, 4, 8, 16, 32, 64, -128, 0, 0, 0, 0, 0, 0, 0, 0);
    const __m256i seven = _mm256_set1_epi8(7);
    const __m256i of = _mm256_load_si256((const __m256i *)(const void *)(bytes->of + k));
    const __m256i byte = _mm256_shuffle_epi8(mask, _mm256_srli_epi16(of, 3) & seven);
    const __m256i bit = _mm256_shuffle_epi8(bit_of, of & seven);
    return (uint32_t)_mm256_movemask_epi8(_mm256_cmpeq_epi8(byte & bit, bit));
}

static inline uint64_t umb__children_in_avx2(const struct umb__child_bytes *bytes, uint64_t these,
                                             uint64_t mask)
{
    const __m256i both = _mm256_set1_epi64x((long long)mask);
    return these & (umb__half_in(bytes, 0, both) | umb__half_in(bytes, 32, both) << 32);
}

static inline uint64_t umb__samples_in_avx2(const struct umb__child_bytes *bytes, uint64_t these,
                                            uint8_t child)
{
    const __m256i same = _mm256_set1_epi8((char)child);
    uint64_t in = 0;
    for (uint32_t k = 0; k < UMB__SAMPLES; k += 32) {
        const __m256i of = _mm256_load_si256((const __m256i *)(const void *)(bytes->of + k));
        in |= (uint64_t)(uint32_t)_mm256_movemask_epi8(_mm256_cmpeq_epi8(of, same)) << k;
    }
    return in & these;
}

#endif
