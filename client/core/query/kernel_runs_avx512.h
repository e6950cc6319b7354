/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RUNS_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_RUNS_AVX512_H
/* The steps of kernel_runs.h sixteen points at a time with AVX-512, without a branch on how long
 * runs are; the same integers. */
#include <immintrin.h>
#include "query/kernel_runs.h"

static inline __m512i umb__load_sixteen(const int32_t *at)
{
    return _mm512_loadu_si512(at);
}

static inline struct umb__closeness umb__compare_points_avx512(struct umb__block *block)
{
    const uint32_t behind = block->size - 1;
    __m512i any = _mm512_setzero_si512();
    uint64_t changes = 0;
    block->x[behind + 1] = block->x[behind];
    block->y[behind + 1] = block->y[behind];
    block->z[behind + 1] = block->z[behind];
    for (uint32_t i = 0; i < block->size; i += 16) {
        __m512i x =
            _mm512_xor_si512(umb__load_sixteen(block->x + i), umb__load_sixteen(block->x + i + 1));
        __m512i y =
            _mm512_xor_si512(umb__load_sixteen(block->y + i), umb__load_sixteen(block->y + i + 1));
        __m512i z =
            _mm512_xor_si512(umb__load_sixteen(block->z + i), umb__load_sixteen(block->z + i + 1));
        __m512i differ = _mm512_or_si512(_mm512_or_si512(x, y), z);
        any = _mm512_or_si512(any, differ);
        changes |= (uint64_t)_mm512_test_epi32_mask(differ, _mm512_set1_epi32(~7)) << i;
    }
    /* Bits beyond the block's points are the caller's business. */
    return (struct umb__closeness){changes << 1, block->todo == UINT64_MAX
                                                     ? (uint32_t)_mm512_reduce_or_epi32(any)
                                                     : UINT32_MAX};
}

static inline void umb__take_heads_avx512(const struct umb__query *q,
                                          const struct umb__block *block, uint64_t starts,
                                          struct umb__block *heads, struct umb__runs *runs)
{
    const __m512i last = _mm512_set1_epi32(((int32_t)1 << q->log2_size) - q->taps);
    const __m512i seven = _mm512_set1_epi32(7), sixteen = _mm512_set1_epi32(16);
    __m512i place = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    /* A run of one point: where it begins the next begins, too, or the block ends. */
    const uint64_t ends = starts >> 1 | (uint64_t)1 << (block->size - 1);
    uint32_t count = 0;
    for (uint32_t i = 0; i < block->size; i += 16) {
        const __mmask16 here = (__mmask16)(starts >> i), longer = (__mmask16)(~ends >> i);
        __m512i x = umb__load_sixteen(block->x + i), y = umb__load_sixteen(block->y + i);
        x = _mm512_min_epi32(_mm512_mask_or_epi32(x, longer, x, seven), last);
        y = _mm512_min_epi32(_mm512_mask_or_epi32(y, longer, y, seven), last);
        _mm512_storeu_si512(heads->x + count, _mm512_maskz_compress_epi32(here, x));
        _mm512_storeu_si512(heads->y + count, _mm512_maskz_compress_epi32(here, y));
        _mm512_storeu_si512(heads->z + count,
                            _mm512_maskz_compress_epi32(here, umb__load_sixteen(block->z + i)));
        _mm_storeu_si128((__m128i *)(void *)(runs->first + count),
                         _mm512_cvtepi32_epi8(_mm512_maskz_compress_epi32(here, place)));
        place = _mm512_add_epi32(place, sixteen);
        count += umb__count_bits(here);
    }
    runs->first[count] = (uint8_t)block->size;
    runs->count = count;
    runs->starts = starts;
    heads->size = count;
    heads->todo = _pext_u64(block->todo, starts);
    /* What the last eight lanes lack: voxel 0, 0, 0. */
    _mm256_storeu_si256((__m256i *)(void *)(heads->x + count), _mm256_setzero_si256());
    _mm256_storeu_si256((__m256i *)(void *)(heads->y + count), _mm256_setzero_si256());
    _mm256_storeu_si256((__m256i *)(void *)(heads->z + count), _mm256_setzero_si256());
    _mm256_storeu_si256((__m256i *)(void *)(heads->lit + count), _mm256_setzero_si256());
}

/* Makes a byte a point: the number of the run that it is in. */
static inline void umb__number_runs(uint64_t starts, uint8_t run[UMB__BLOCK])
{
    uint64_t before = UINT64_MAX; /* a run begins with the first point: it gets 0 */
    for (uint32_t i = 0; i < UMB__BLOCK; i += 8) {
        /* A product with ones in all bytes: the sum of all bytes up to each. */
        const uint64_t eight =
            (_pdep_u64(starts >> i & 0xff, UMB__EVERY_BYTE) + before) * UMB__EVERY_BYTE;
        memcpy(run + i, &eight, sizeof eight);
        before = eight >> 56;
    }
}

/* Words of 32 bits of eight bricks, in registers: two a slice, the lower for y & 4 == 0. */
struct umb__eight_bricks {
    __m512i brick[8];
};

static inline struct umb__eight_bricks umb__load_bricks(const uint64_t *const brick[8])
{
    struct umb__eight_bricks eight;
    for (unsigned k = 0; k < 8; k++) {
        eight.brick[k] = _mm512_loadu_si512(brick[k]);
    }
    return eight;
}

/* The word `word` (0..15) of brick `of` (0..7), sixteen times. */
static inline __m512i umb__pick_words(const struct umb__eight_bricks *from, __m512i of,
                                      __m512i word)
{
    const __m512i which = _mm512_or_si512(word, _mm512_slli_epi32(of, 4)); /* of a pair of bricks */
    const __mmask16 odd = _mm512_test_epi32_mask(of, _mm512_set1_epi32(2));
    const __mmask16 high = _mm512_test_epi32_mask(of, _mm512_set1_epi32(4));
    const __m512i *b = from->brick;
    const __m512i low_half =
        _mm512_mask_blend_epi32(odd, _mm512_permutex2var_epi32(b[0], which, b[1]),
                                _mm512_permutex2var_epi32(b[2], which, b[3]));
    const __m512i high_half =
        _mm512_mask_blend_epi32(odd, _mm512_permutex2var_epi32(b[4], which, b[5]),
                                _mm512_permutex2var_epi32(b[6], which, b[7]));
    return _mm512_mask_blend_epi32(high, low_half, high_half);
}

static inline void umb__read_runs_avx512(struct umb__block *block, const struct umb__block *heads,
                                         const struct umb__runs *runs,
                                         const uint64_t *const brick[UMB__BLOCK])
{
    const __m512i one = _mm512_set1_epi32(1), three = _mm512_set1_epi32(3);
    const __m512i seven = _mm512_set1_epi32(7);
    uint8_t run[UMB__BLOCK];
    (void)heads;
    umb__number_runs(runs->starts, run);
    for (uint32_t h = 0; h < runs->count; h += 8) {
        const struct umb__eight_bricks eight = umb__load_bricks(brick + h);
        for (uint32_t i = 0; i < block->size; i += 16) {
            const __m128i bytes = _mm_loadu_si128((const __m128i *)(const void *)(run + i));
            const __m512i of =
                _mm512_sub_epi32(_mm512_cvtepu8_epi32(bytes), _mm512_set1_epi32((int)h));
            const __mmask16 here = _mm512_cmple_epu32_mask(of, seven);
            const __m512i x = umb__load_sixteen(block->x + i);
            const __m512i y = umb__load_sixteen(block->y + i);
            const __m512i z = _mm512_and_si512(umb__load_sixteen(block->z + i), seven);
            const __m512i word = _mm512_or_si512(_mm512_add_epi32(z, z),
                                                 _mm512_and_si512(_mm512_srli_epi32(y, 2), one));
            const __m512i bit = _mm512_or_si512(_mm512_and_si512(x, seven),
                                                _mm512_slli_epi32(_mm512_and_si512(y, three), 3));
            const __m512i lit = _mm512_srlv_epi32(umb__pick_words(&eight, of, word), bit);
            /* Blended, not stored with a mask: what is stored so is slow to load again. */
            const __mmask16 these = here & (__mmask16)(block->todo >> i);
            const __m512i old = _mm512_loadu_si512(block->lit + i);
            _mm512_storeu_si512(block->lit + i, _mm512_mask_and_epi32(old, these, lit, one));
        }
    }
}

#endif
