/* SPDX-License-Identifier: Apache-2.0 */
/* Slices with AVX2: integers only, so equal by construction. */
#include "bake/build/brick_slices.h"

#ifdef __AVX2__
#include "bake/depth/lane_extremes.h"

static inline __m256i load(const int32_t *from)
{
    return _mm256_loadu_si256((const __m256i *)(const void *)from);
}

/* Returns 32 values minus z0, saturated to bytes. A saturated difference still exceeds 7. */
static inline __m256i relative_bytes(const int32_t *values, __m256i base)
{
    __m256i rows[4];
    for (int i = 0; i < 4; i++) {
        rows[i] = _mm256_sub_epi32(load(values + 8 * i), base);
    }
    /* AVX2 packs each half of a register alone: the low half gets the first four bytes of all four
     * rows, the high half the last four. */
    const __m256i halves = _mm256_packs_epi16(_mm256_packs_epi32(rows[0], rows[1]),
                                              _mm256_packs_epi32(rows[2], rows[3]));
    return _mm256_permutevar8x32_epi32(halves, _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7));
}

static void above(const int32_t values[64], int32_t z0, uint64_t slices[8])
{
    const __m256i base = _mm256_set1_epi32(z0);
    const __m256i low = relative_bytes(values, base), high = relative_bytes(values + 32, base);
    for (int z = 0; z < 8; z++) {
        const __m256i depth = _mm256_set1_epi8((char)z);
        const int first = _mm256_movemask_epi8(_mm256_cmpgt_epi8(low, depth));
        const int second = _mm256_movemask_epi8(_mm256_cmpgt_epi8(high, depth));
        slices[z] = (uint64_t)(uint32_t)second << 32 | (uint32_t)first;
    }
}

static int32_t least_from(const int32_t values[64], int32_t z0)
{
    const __m256i below = _mm256_set1_epi32(z0 - 1), none = _mm256_set1_epi32(INT32_MAX);
    __m256i least = none;
    for (int i = 0; i < 8; i++) {
        const __m256i row = load(values + 8 * i);
        const __m256i counts = _mm256_blendv_epi8(none, row, _mm256_cmpgt_epi32(row, below));
        least = _mm256_min_epi32(least, counts);
    }
    return umbb_least_of_8(least);
}

const struct umbb_slicer umbb__slicer_avx2 = {above, least_from};

#endif
