/* SPDX-License-Identifier: Apache-2.0 */
/* Slices with AVX-512: all 64 texels in one register of bytes. All operations are on integers, so
 * the bits equal those of the plain form. */
#include "bake/build/brick_slices.h"

#ifdef __AVX512F__
#include <immintrin.h>

/* Returns sixteen values minus z0, saturated to bytes. A saturated difference still exceeds 7. */
static inline __m128i relative_bytes(const int32_t *values, __m512i base)
{
    return _mm512_cvtsepi32_epi8(_mm512_sub_epi32(_mm512_loadu_si512(values), base));
}

static void above(const int32_t values[64], int32_t z0, uint64_t slices[8])
{
    const __m512i base = _mm512_set1_epi32(z0);
    __m512i bytes = _mm512_castsi128_si512(relative_bytes(values, base));
    bytes = _mm512_inserti32x4(bytes, relative_bytes(values + 16, base), 1);
    bytes = _mm512_inserti32x4(bytes, relative_bytes(values + 32, base), 2);
    bytes = _mm512_inserti32x4(bytes, relative_bytes(values + 48, base), 3);
    for (int z = 0; z < 8; z++) {
        slices[z] = _mm512_cmpgt_epi8_mask(bytes, _mm512_set1_epi8((char)z));
    }
}

static int32_t least_from(const int32_t values[64], int32_t z0)
{
    const __m512i from = _mm512_set1_epi32(z0);
    __m512i least = _mm512_set1_epi32(INT32_MAX);
    for (int i = 0; i < 64; i += 16) {
        const __m512i row = _mm512_loadu_si512(values + i);
        least = _mm512_mask_min_epi32(least, _mm512_cmpge_epi32_mask(row, from), least, row);
    }
    return _mm512_reduce_min_epi32(least);
}

const struct umbb_slicer umbb__slicer_avx512 = {above, least_from};

#endif
