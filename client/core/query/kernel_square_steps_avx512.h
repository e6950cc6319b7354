/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_SQUARE_STEPS_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_SQUARE_STEPS_AVX512_H
/* The steps of kernel_square_steps.h with AVX-512. Sums are in doubles, in the same order as in C;
 * the integers are the same. */
#include "query/kernel_runs_avx512.h"
#include "query/kernel_square_steps.h"

/* 2^52 + 2^51: in the sum with a number of up to 51 bits, rounded down, the low bits are the
 * number's floor. */
#define UMB__FLOOR_BY 0x1.8p52

/* Returns the floors of eight doubles in the low halves of eight words. */
static inline __m512i umb__floor_words(__m512d v)
{
    return _mm512_castpd_si512(_mm512_add_round_pd(v, _mm512_set1_pd(UMB__FLOOR_BY),
                                                   _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC));
}

/* Computes the voxel coordinates on one axis of a point's 64 samples: those of its narrow square,
 * then those of its wide one. The product in the fused multiply-add is by 1/2 and therefore exact,
 * so the sum has the same bits as in C. */
UMB__INLINE void umb__place_axis_avx512(const struct umb__receivers *r, uint32_t lane,
                                        unsigned axis, __m512i to[4])
{
    const __m512d edge[2] = {_mm512_set1_pd(r->edge[0][axis][lane]),
                             _mm512_set1_pd(r->edge[1][axis][lane])};
    const __m512d narrow = _mm512_set1_pd(r->centre[0][axis][lane]);
    const __m512d wide = _mm512_set1_pd(r->centre[1][axis][lane]);
    const __m512d half = _mm512_set1_pd(0.5);
    const __m512i even =
        _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    __m512i near[4], far[4];
    for (uint32_t i = 0; i < 4; i++) {
        const __m512d from_centre = _mm512_load_pd(umb__lattice[0] + 8 * i) * edge[0] +
                                    _mm512_load_pd(umb__lattice[1] + 8 * i) * edge[1];
        near[i] = umb__floor_words(_mm512_fmadd_pd(half, from_centre, narrow));
        far[i] = umb__floor_words(wide + from_centre);
    }
    for (uint32_t i = 0; i < 2; i++) {
        to[i] = _mm512_permutex2var_epi32(near[2 * i], even, near[2 * i + 1]);
        to[2 + i] = _mm512_permutex2var_epi32(far[2 * i], even, far[2 * i + 1]);
    }
}

/* Stores the low 16 bits of 64 indices. */
static inline void umb__store_low(const __m512i from[4], uint16_t to[UMB__SAMPLES])
{
    const __m512i in_order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
    const __m512i low = _mm512_set1_epi32(0xffff);
    for (uint32_t i = 0; i < 2; i++) {
        const __m512i both = _mm512_packus_epi32(from[2 * i] & low, from[2 * i + 1] & low);
        _mm512_store_si512(to + 32 * i, _mm512_permutexvar_epi64(in_order, both));
    }
}

/* Stores the low bits of samples that were placed in C. */
static inline void umb__low_of(struct umb__samples *samples)
{
    for (uint32_t k = 0; k < UMB__SAMPLES; k++) {
        samples->low[0][k] = (uint16_t)samples->x[k];
        samples->low[1][k] = (uint16_t)samples->y[k];
        samples->low[2][k] = (uint16_t)samples->z[k];
    }
}

static inline uint64_t umb__place_samples_avx512(const struct umb__receivers *r, uint32_t lane,
                                                 uint32_t log2_size, struct umb__samples *samples)
{
    const __m512i beyond = _mm512_set1_epi32(-((int32_t)1 << log2_size));
    const __m512i before = _mm512_set1_epi32(INT32_MIN);
    const __m512i last = _mm512_set1_epi32(((int32_t)1 << log2_size) - 1);
    __m512i x[4], y[4], z[4];
    uint64_t inside = 0;
    if (!r->tame[lane]) {
        inside = umb__place_samples(r, lane, log2_size, samples);
        umb__low_of(samples);
        return inside;
    }
    umb__place_axis_avx512(r, lane, 0, x);
    umb__place_axis_avx512(r, lane, 1, y);
    umb__place_axis_avx512(r, lane, 2, z);
    for (uint32_t i = 0; i < 4; i++) {
        const __m512i out = ((x[i] | y[i]) & beyond) | (z[i] & before);
        inside |= (uint64_t)_mm512_testn_epi32_mask(out, out) << 16 * i;
        z[i] = _mm512_min_epi32(z[i], last);
        _mm512_store_si512(samples->x + 16 * i, x[i]);
        _mm512_store_si512(samples->y + 16 * i, y[i]);
        _mm512_store_si512(samples->z + 16 * i, z[i]);
    }
    umb__store_low(x, samples->low[0]);
    umb__store_low(y, samples->low[1]);
    umb__store_low(z, samples->low[2]);
    return inside;
}

/* Returns a | (b & mask). */
#define UMB__OR_AND(a, b, mask) _mm512_ternarylogic_epi64(b, mask, a, 0xea)

/* Indices of the children of 32 samples, in 16 bits each. */
static inline __m512i umb__child_words(const struct umb__samples *samples, uint32_t k,
                                       __m128i shift)
{
    const __m512i x = _mm512_srl_epi16(_mm512_load_si512(samples->low[0] + k), shift);
    const __m512i y = _mm512_srl_epi16(_mm512_load_si512(samples->low[1] + k), shift);
    const __m512i z = _mm512_srl_epi16(_mm512_load_si512(samples->low[2] + k), shift);
    __m512i child = x & _mm512_set1_epi16(3);
    child = UMB__OR_AND(child, _mm512_slli_epi16(y, 2), _mm512_set1_epi16(12));
    return UMB__OR_AND(child, _mm512_slli_epi16(z, 4), _mm512_set1_epi16(48));
}

static inline void umb__child_bytes_avx512(const struct umb__samples *samples, uint32_t level,
                                           struct umb__child_bytes *bytes)
{
    if (level > 14) { /* Beyond the low 16 bits */
        umb__child_bytes_make(samples, level, bytes);
        return;
    }
    const __m128i shift = _mm_cvtsi32_si128((int)level);
    const __m512i in_order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
    const __m512i both = _mm512_packus_epi16(umb__child_words(samples, 0, shift),
                                             umb__child_words(samples, 32, shift));
    _mm512_store_si512(bytes->of, _mm512_permutexvar_epi64(in_order, both));
}

static inline uint64_t umb__children_in_avx512(const struct umb__child_bytes *bytes, uint64_t these,
                                               uint64_t mask)
{
    const __m512i bit_of = _mm512_set1_epi64((long long)UINT64_C(0x8040201008040201));
    const __m512i seven = _mm512_set1_epi8(7), of = _mm512_load_si512(bytes->of);
    const __m512i byte =
        _mm512_shuffle_epi8(_mm512_set1_epi64((long long)mask), _mm512_srli_epi16(of, 3) & seven);
    const __m512i bit = _mm512_shuffle_epi8(bit_of, of & seven);
    return _mm512_mask_test_epi8_mask(these, byte, bit);
}

static inline uint64_t umb__samples_in_avx512(const struct umb__child_bytes *bytes, uint64_t these,
                                              uint8_t child)
{
    return _mm512_mask_cmpeq_epi8_mask(these, _mm512_load_si512(bytes->of),
                                       _mm512_set1_epi8((char)child));
}

/* A brick is 32 words of 16 bits, two rows of a slice each. */
static inline void umb__slice_places_avx512(const struct umb__samples *samples,
                                            struct umb__slice_places *places)
{
    for (uint32_t k = 0; k < UMB__SAMPLES; k += 32) {
        const __m512i x = _mm512_load_si512(samples->low[0] + k);
        const __m512i y = _mm512_load_si512(samples->low[1] + k);
        const __m512i z = _mm512_load_si512(samples->low[2] + k);
        __m512i at = x & _mm512_set1_epi16(7);
        at = UMB__OR_AND(at, _mm512_slli_epi16(y, 3), _mm512_set1_epi16(8));
        __m512i word = _mm512_srli_epi16(y, 1) & _mm512_set1_epi16(3);
        word = UMB__OR_AND(word, _mm512_slli_epi16(z, 2), _mm512_set1_epi16(28));
        _mm512_store_si512(places->word + k, word);
        _mm512_store_si512(places->bit + k, _mm512_sllv_epi16(_mm512_set1_epi16(1), at));
    }
}

static inline uint64_t umb__lit_in_brick_avx512(const struct umb__samples *samples,
                                                const struct umb__slice_places *places,
                                                uint64_t these, const uint64_t brick[8])
{
    const __m512i words = _mm512_loadu_si512(brick);
    uint64_t lit = 0;
    (void)samples;
    for (uint32_t k = 0; k < UMB__SAMPLES; k += 32) {
        const __m512i of = _mm512_permutexvar_epi16(_mm512_load_si512(places->word + k), words);
        lit |= (uint64_t)_mm512_test_epi16_mask(of, _mm512_load_si512(places->bit + k)) << k;
    }
    return lit & these;
}

#endif
