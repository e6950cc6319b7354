/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Masks of slices come from comparing saturated bytes. Runs of equal slices come from intersecting
 * intervals of masks.
 *
 * Filling undefined voxels so that runs get longer halves the bytes of closed scenes, and leaves a
 * quarter of the unique bricks (measured). The free choice of undefined voxels is from Sintorn et
 * al. 2014, section 6.1.
 */
#include "bake/build/brick_slices.h"

#include <stddef.h>

#ifdef __x86_64__ /* with SSE2 always */
#include <emmintrin.h>
#endif

static void above_plain(const int32_t values[64], int32_t z0, uint64_t slices[8])
{
    for (int z = 0; z < 8; z++) {
        uint64_t slice = 0;
        for (int i = 0; i < 64; i++) {
            slice |= (uint64_t)(values[i] > z0 + z) << i;
        }
        slices[z] = slice;
    }
}

static int32_t least_from_plain(const int32_t values[64], int32_t z0)
{
    int32_t least = INT32_MAX;
    for (int i = 0; i < 64; i++) {
        if (values[i] >= z0 && values[i] < least) {
            least = values[i];
        }
    }
    return least;
}

const struct umbb_slicer umbb_slicer_plain = {above_plain, least_from_plain};

#ifdef __x86_64__

/* Returns four values minus z0. Values and z0 are within 0..2^20, so nothing overflows. */
static __m128i relative(const int32_t *values, __m128i base)
{
    return _mm_sub_epi32(_mm_loadu_si128((const __m128i *)(const void *)values), base);
}

/* Returns sixteen values minus z0, saturated to bytes. A saturated difference still exceeds 7. */
static __m128i relative_bytes(const int32_t *values, __m128i base)
{
    const __m128i low = _mm_packs_epi32(relative(values, base), relative(values + 4, base));
    const __m128i high = _mm_packs_epi32(relative(values + 8, base), relative(values + 12, base));
    return _mm_packs_epi16(low, high);
}

static void above_sse2(const int32_t values[64], int32_t z0, uint64_t slices[8])
{
    const __m128i base = _mm_set1_epi32(z0);
    __m128i bytes[4];
    for (int i = 0; i < 4; i++) {
        bytes[i] = relative_bytes(values + 16 * i, base);
    }
    for (int z = 0; z < 8; z++) {
        const __m128i depth = _mm_set1_epi8((char)z);
        uint64_t slice = 0;
        for (int i = 0; i < 4; i++) {
            const int bits = _mm_movemask_epi8(_mm_cmpgt_epi8(bytes[i], depth));
            slice |= (uint64_t)(uint32_t)bits << (16 * i);
        }
        slices[z] = slice;
    }
}

static const struct umbb_slicer slicer_sse2 = {above_sse2, least_from_plain};

#endif

const struct umbb_slicer *umbb_slicer(enum umbb_vectors vectors)
{
    static const struct umbb_slicer *const rows[] = {
#ifdef __x86_64__
        [UMBB_VECTORS_NONE] = &slicer_sse2,
        [UMBB_VECTORS_AVX2] = &umbb__slicer_avx2,
        [UMBB_VECTORS_AVX512] = &umbb__slicer_avx512,
#else
        [UMBB_VECTORS_NONE] = &umbb_slicer_plain,
#endif
    };
    return vectors <= umbb_vectors_best() ? rows[vectors] : NULL;
}

void umbb_slices_fill(const uint64_t visible[8], const uint64_t allowed[8], uint64_t slices[8])
{
    int start = 0;
    while (start < 8) {
        uint64_t low = visible[start], high = allowed[start];
        int next = start + 1;
        while (next < 8) {
            const uint64_t lower = low | visible[next], upper = high & allowed[next];
            if ((lower & ~upper) != 0) {
                break;
            }
            low = lower;
            high = upper;
            next++;
        }
        for (int z = start; z < next; z++) {
            slices[z] = low;
        }
        start = next;
    }
}
