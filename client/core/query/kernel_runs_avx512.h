/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_RUNS_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_RUNS_AVX512_H
/* The steps of kernel_runs.h with AVX-512, for sixteen points at a time. They give the same
 * integers as those in C, and no branch depends on the length of runs. */
#include "query/kernel_runs_avx2.h"

static inline __m512i umb__load_sixteen(const int32_t *at)
{
    return _mm512_loadu_si512(at);
}

/* Returns, for one axis, the coordinate bits in which each of sixteen points differs from the point
 * before it. In and out: before: on entry the sixteen coordinates before these points, on return
 * those of these points. */
static inline __m512i umb__differ_sixteen(const int32_t *axis, __m512i *before)
{
    const __m512i here = umb__load_sixteen(axis);
    const __m512i one_back = _mm512_alignr_epi32(here, *before, 15);
    *before = here;
    return here ^ one_back;
}

/* The first point of a block has no point before it and is compared with point 15. That is
 * harmless: a run begins at the first point anyway, and the bits of this difference occur elsewhere
 * in the block. */
static inline struct umb__closeness umb__compare_points_avx512(const struct umb__block *block)
{
    const __m512i place = _mm512_set1_epi32(~7);
    __m512i x = umb__load_sixteen(block->x), y = umb__load_sixteen(block->y);
    __m512i z = umb__load_sixteen(block->z), any = _mm512_setzero_si512();
    uint64_t changes = 0;
    for (uint32_t i = 0; i < block->size; i += 16) {
        const __m512i differ = umb__differ_sixteen(block->x + i, &x) |
                               umb__differ_sixteen(block->y + i, &y) |
                               umb__differ_sixteen(block->z + i, &z);
        any |= differ;
        changes |= (uint64_t)_mm512_test_epi32_mask(differ, place) << i;
    }
    /* The caller ignores the bits beyond the block's points. */
    return (struct umb__closeness){
        changes, block->todo == UINT64_MAX ? (uint32_t)_mm512_reduce_or_epi32(any) : UINT32_MAX};
}

/* Sets the missing points of the last eight lanes to voxel 0, 0, 0. */
static inline void umb__pad_heads_avx512(struct umb__block *heads)
{
    const __m256i zero = _mm256_setzero_si256();
    _mm256_storeu_si256((__m256i *)(void *)(heads->x + heads->size), zero);
    _mm256_storeu_si256((__m256i *)(void *)(heads->y + heads->size), zero);
    _mm256_storeu_si256((__m256i *)(void *)(heads->z + heads->size), zero);
}

/* Appends the selected ones of sixteen voxels to the heads. */
static inline void umb__append_heads(struct umb__block *heads, __mmask16 wanted, __m512i x,
                                     __m512i y, __m512i z)
{
    _mm512_storeu_si512(heads->x + heads->size, _mm512_maskz_compress_epi32(wanted, x));
    _mm512_storeu_si512(heads->y + heads->size, _mm512_maskz_compress_epi32(wanted, y));
    _mm512_storeu_si512(heads->z + heads->size, _mm512_maskz_compress_epi32(wanted, z));
    heads->size += umb__count_bits(wanted);
}

/* Appends the selected values of `from` to the first `count` values of `to`. */
static inline __m512i umb__append_wanted(__m512i to, uint32_t count, __mmask16 wanted, __m512i from)
{
    return _mm512_mask_expand_epi32(to, (__mmask16)(0xffffU << count),
                                    _mm512_maskz_compress_epi32(wanted, from));
}

/* Stores up to sixteen heads as one vector for each axis, with zeros behind them. One store writes
 * each vector: a later load would wait if several stores had written it. */
static inline void umb__take_few_heads(const struct umb__block *block, uint64_t starts,
                                       struct umb__block *heads)
{
    __m512i x = _mm512_setzero_si512(), y = x, z = x;
    uint32_t count = 0;
    for (uint32_t i = 0; i < UMB__BLOCK; i += 16) {
        const __mmask16 wanted = (__mmask16)(starts >> i);
        x = umb__append_wanted(x, count, wanted, umb__load_sixteen(block->x + i));
        y = umb__append_wanted(y, count, wanted, umb__load_sixteen(block->y + i));
        z = umb__append_wanted(z, count, wanted, umb__load_sixteen(block->z + i));
        count += umb__count_bits(wanted);
    }
    _mm512_store_si512(heads->x, x);
    _mm512_store_si512(heads->y, y);
    _mm512_store_si512(heads->z, z);
    heads->size = count;
}

static inline void umb__take_many_heads(const struct umb__block *block, uint64_t starts,
                                        struct umb__block *heads)
{
    heads->size = 0;
    for (uint32_t i = 0; i < block->size; i += 16) {
        umb__append_heads(heads, (__mmask16)(starts >> i), umb__load_sixteen(block->x + i),
                          umb__load_sixteen(block->y + i), umb__load_sixteen(block->z + i));
    }
    umb__pad_heads_avx512(heads);
}

/* Does what umb__take_heads does for one tap, but does not record where runs begin. */
static inline void umb__take_heads_avx512(const struct umb__query *q,
                                          const struct umb__block *block, uint64_t starts,
                                          struct umb__block *heads, struct umb__runs *runs)
{
    (void)q;
    if (umb__count_bits(starts) <= 16) {
        umb__take_few_heads(block, starts, heads);
    } else {
        umb__take_many_heads(block, starts, heads);
    }
    heads->todo = _pext_u64(block->todo, starts);
    runs->starts = starts;
    runs->count = heads->size;
    runs->merged = false;
}

/* Returns a key for the brick of each of sixteen voxels. Equal keys mean equal bricks if the
 * block's spread is below UMB__KEYS_SPREAD. */
#define UMB__KEYS_SPREAD (1U << 13)

static inline __m512i umb__brick_keys(__m512i x, __m512i y, __m512i z)
{
    const __m512i low = _mm512_set1_epi32(0x3ff), high = _mm512_set1_epi32(0x3ff << 20);
    x = _mm512_srli_epi32(x, 3) & low;
    y = _mm512_slli_epi32(y, 7) & _mm512_set1_epi32(0x3ff << 10);
    z = _mm512_slli_epi32(z, 17) & high;
    return x | y | z;
}

/*
 * Lets one head stand for all runs among sixteen that are in one brick. Such runs occur where the
 * border of two bricks crosses several rows of a picture. Eight heads or fewer are not merged,
 * since eight descend at once anyway. In: spread: `spread` of the block (kernel_runs.h). Below
 * UMB__KEYS_SPREAD it also says that all points have a look-up.
 */
static inline void umb__merge_heads(uint32_t spread, struct umb__block *heads,
                                    struct umb__runs *runs)
{
    if (runs->count <= 8 || runs->count > UMB__MERGED_MAX || spread >= UMB__KEYS_SPREAD) {
        return;
    }
    const __m512i place = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    heads->size = 0; /* Appends never reach the values still to be read */
    for (uint32_t i = 0; i < runs->count; i += 16) {
        const __m512i x = umb__load_sixteen(heads->x + i), y = umb__load_sixteen(heads->y + i);
        const __m512i z = umb__load_sixteen(heads->z + i);
        const uint32_t left = runs->count - i;
        const __mmask16 there = (__mmask16)(left < 16 ? (1U << left) - 1 : 0xffff);
        /* Lane k has a bit for each lane before k with the same key. The lowest bit is the first
         * such lane; no bit: lane k is the first itself. */
        const __m512i equal = _mm512_maskz_conflict_epi32(there, umb__brick_keys(x, y, z));
        const __mmask16 other = _mm512_test_epi32_mask(equal, equal);
        const __mmask16 alone = (__mmask16)(there & ~other);
        const __m512i lowest = equal & _mm512_sub_epi32(_mm512_setzero_si512(), equal);
        const __m512i first = _mm512_sub_epi32(_mm512_set1_epi32(31), _mm512_lzcnt_epi32(lowest));
        const __m512i number = _mm512_add_epi32(_mm512_maskz_expand_epi32(alone, place),
                                                _mm512_set1_epi32((int)heads->size));
        const __m512i of = _mm512_mask_blend_epi32(other, place, first);
        _mm512_store_si512(runs->head + i, _mm512_permutexvar_epi32(of, number));
        umb__append_heads(heads, alone, x, y, z);
    }
    heads->todo = ((uint64_t)1 << heads->size) - 1;
    runs->merged = true;
    if (runs->count > 16) { /* One store wrote up to 16 heads, with zeros behind */
        umb__pad_heads_avx512(heads);
    }
}

/* Returns the number of runs for which the given heads stand. */
static inline uint32_t umb__runs_of_avx512(const struct umb__runs *runs, uint64_t heads)
{
    if (!runs->merged) {
        return umb__count_bits(heads);
    }
    const __m512i these = _mm512_set1_epi32((int)(uint32_t)heads), one = _mm512_set1_epi32(1);
    const __m512i low = _mm512_sllv_epi32(one, _mm512_load_si512(runs->head));
    const __m512i high = _mm512_sllv_epi32(one, _mm512_load_si512(runs->head + 16));
    const uint32_t bits = (uint32_t)_mm512_test_epi32_mask(low, these) |
                          (uint32_t)_mm512_test_epi32_mask(high, these) << 16;
    return umb__count_bits(bits & (uint32_t)(((uint64_t)1 << runs->count) - 1));
}

/* Returns, in a byte for each of eight points, the number of the point's run. In and out: before:
 * on entry the number of the run before these points, on return that of the last point's run. */
static inline uint64_t umb__number_eight(uint64_t starts, uint64_t *before)
{
    /* The product with a word of ones in all bytes: byte k becomes the sum of bytes 0 to k. */
    const uint64_t eight = (_pdep_u64(starts, UMB__EVERY_BYTE) + *before) * UMB__EVERY_BYTE;
    *before = eight >> 56;
    return eight;
}

static inline void umb__number_runs(uint64_t starts, __m512i run[UMB__BLOCK / 16])
{
    uint64_t before = UINT64_MAX; /* a run begins with the first point: it gets 0 */
    for (uint32_t i = 0; i < UMB__BLOCK / 16; i++) {
        const uint64_t low = umb__number_eight(starts >> 16 * i & 0xff, &before);
        const uint64_t high = umb__number_eight(starts >> (16 * i + 8) & 0xff, &before);
        run[i] = _mm512_cvtepu8_epi32(_mm_set_epi64x((long long)high, (long long)low));
    }
}

/* Word of 32 bits in the brick, and bit in that word, of each of sixteen points. */
struct umb__brick_places {
    __m512i word, bit;
};

static inline struct umb__brick_places umb__places_in_bricks(const struct umb__block *block,
                                                             uint32_t i)
{
    const __m512i one = _mm512_set1_epi32(1), three = _mm512_set1_epi32(3);
    const __m512i seven = _mm512_set1_epi32(7);
    const __m512i x = umb__load_sixteen(block->x + i), y = umb__load_sixteen(block->y + i);
    const __m512i z = umb__load_sixteen(block->z + i) & seven;
    return (struct umb__brick_places){
        _mm512_add_epi32(z, z) | (_mm512_srli_epi32(y, 2) & one),
        (x & seven) | _mm512_slli_epi32(y & three, 3),
    };
}

/* Answers a whole block from one brick. */
static inline void umb__read_brick_avx512(struct umb__block *block, const uint64_t brick[8])
{
    const __m512i words = _mm512_loadu_si512(brick), one = _mm512_set1_epi32(1);
    for (uint32_t i = 0; i < UMB__BLOCK; i += 16) {
        const struct umb__brick_places at = umb__places_in_bricks(block, i);
        const __m512i lit = _mm512_srlv_epi32(_mm512_permutexvar_epi32(at.word, words), at.bit);
        _mm512_storeu_si512(block->lit + i, lit & one);
    }
}

/* Eight bricks in registers. A slice is two words of 32 bits, the lower for y & 4 == 0. */
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

/* Returns word `word` (0..15) of brick `of` (0..7), sixteen times. */
static inline __m512i umb__pick_words(const struct umb__eight_bricks *from, __m512i of,
                                      __m512i word)
{
    const __m512i which = word | _mm512_slli_epi32(of, 4); /* Words of a pair of bricks */
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

/* Answers all lanes of a block, whatever its size. Lanes without points read the last run's brick,
 * and their answers are discarded. */
static inline void umb__read_runs_avx512(struct umb__block *block, const struct umb__block *heads,
                                         const struct umb__runs *runs,
                                         const uint64_t *const brick[UMB__BLOCK])
{
    const __m512i one = _mm512_set1_epi32(1), seven = _mm512_set1_epi32(7);
    __m512i run[UMB__BLOCK / 16], lit[UMB__BLOCK / 16];
    struct umb__brick_places at[UMB__BLOCK / 16];
    umb__number_runs(runs->starts, run);
    for (uint32_t i = 0; i < UMB__BLOCK / 16; i++) {
        if (runs->merged) {
            run[i] = _mm512_permutex2var_epi32(_mm512_load_si512(runs->head), run[i],
                                               _mm512_load_si512(runs->head + 16));
        }
        at[i] = umb__places_in_bricks(block, 16 * i);
        lit[i] = _mm512_load_si512(block->lit + 16 * i);
    }
    for (uint32_t h = 0; h < heads->size; h += 8) {
        const struct umb__eight_bricks eight = umb__load_bricks(brick + h);
        const __m512i first = _mm512_set1_epi32((int)h);
        for (uint32_t i = 0; i < UMB__BLOCK / 16; i++) {
            const __m512i of = _mm512_sub_epi32(run[i], first);
            const __mmask16 todo = (__mmask16)(block->todo >> 16 * i);
            const __mmask16 here = _mm512_mask_cmple_epu32_mask(todo, of, seven);
            const __m512i words = umb__pick_words(&eight, of, at[i].word);
            lit[i] = _mm512_mask_and_epi32(lit[i], here, _mm512_srlv_epi32(words, at[i].bit), one);
        }
    }
    for (uint32_t i = 0; i < UMB__BLOCK / 16; i++) {
        _mm512_store_si512(block->lit + 16 * i, lit[i]);
    }
}

/* Finds for each of eight heads the child of `level` that contains it, as 63 minus the child's bit
 * (umb__child_bit). */
static inline __m256i umb__above_eight(const struct umb__block *heads, uint32_t h, uint32_t level)
{
    const __m128i shift = _mm_cvtsi32_si128((int)level);
    const __m256i three = _mm256_set1_epi32(3);
    const __m256i x = _mm256_srl_epi32(umb__load_eight(heads->x + h), shift);
    const __m256i y = _mm256_srl_epi32(umb__load_eight(heads->y + h), shift);
    const __m256i z = _mm256_srl_epi32(umb__load_eight(heads->z + h), shift);
    const __m256i bit =
        (x & three) | _mm256_slli_epi32(y & three, 2) | _mm256_slli_epi32(z & three, 4);
    return bit ^ _mm256_set1_epi32(63);
}

/* A node's masks: mixed, lit. */
static inline __m128i umb__load_pair(const uint64_t *node)
{
    return _mm_loadu_si128((const __m128i *)(const void *)node);
}

/* Loads the masks of four nodes one after another. */
static inline __m512i umb__load_masks(const uint64_t *const node[4])
{
    __m512i masks = _mm512_castsi128_si512(umb__load_pair(node[0]));
    masks = _mm512_inserti64x2(masks, umb__load_pair(node[1]), 1);
    masks = _mm512_inserti64x2(masks, umb__load_pair(node[2]), 2);
    return _mm512_inserti64x2(masks, umb__load_pair(node[3]), 3);
}

/* Returns the states of one child of each of eight nodes: even bits say mixed, odd bits lit. The
 * masks are loaded from the nodes again, because a load of a vector waits if several stores have
 * written it. */
static inline uint32_t umb__child_states(const uint64_t *const node[8], __m256i above)
{
    const __m512i wide = _mm512_cvtepu32_epi64(above);
    const __m512i low = _mm512_sllv_epi64(
        umb__load_masks(node),
        _mm512_permutexvar_epi64(_mm512_setr_epi64(0, 0, 1, 1, 2, 2, 3, 3), wide));
    const __m512i high = _mm512_sllv_epi64(
        umb__load_masks(node + 4),
        _mm512_permutexvar_epi64(_mm512_setr_epi64(4, 4, 5, 5, 6, 6, 7, 7), wide));
    return (uint32_t)_mm512_movepi64_mask(low) | (uint32_t)_mm512_movepi64_mask(high) << 8;
}

/* Loads the numbers of one child of each of eight nodes. For a child that is not mixed, the read
 * stays within the node. */
static inline __m512i umb__child_numbers(const uint64_t *const node[8], __m256i above)
{
    uint32_t by[8] __attribute__((aligned(32))), number[8];
    _mm256_store_si256((__m256i *)(void *)by, above);
    for (uint32_t k = 0; k < 8; k++) {
        const uint32_t *numbers = (const uint32_t *)(const void *)node[k] + 3; /* from 1 */
        number[k] = numbers[umb__count_bits(node[k][0] << by[k])];
    }
    return _mm512_cvtepu32_epi64(_mm256_setr_epi32((int)number[0], (int)number[1], (int)number[2],
                                                   (int)number[3], (int)number[4], (int)number[5],
                                                   (int)number[6], (int)number[7]));
}

/*
 * Does what umb__step_heads does, eight heads at a time. The results of all eight are selected at
 * once by their children's states.
 */
UMB__INLINE uint64_t umb__step_heads_avx512(const struct umb__query *q,
                                            const struct umb__block *heads, uint32_t level,
                                            bool brick, const uint64_t *at[UMB__BLOCK])
{
    const __m512i first =
        _mm512_set1_epi64((long long)(uintptr_t)(brick ? q->bricks[0] : q->nodes));
    const __m512i dark = _mm512_set1_epi64(
        (long long)(uintptr_t)(brick ? umb__uniform_bricks[0] : umb__uniform_nodes));
    const __m512i bright = _mm512_set1_epi64(
        (long long)(uintptr_t)(brick ? umb__uniform_bricks[1] : umb__uniform_nodes + 2));
    uint64_t unsettled = 0;
    for (uint32_t h = 0; h < heads->size; h += 8) {
        const __m256i above = umb__above_eight(heads, h, level);
        const __m512i number = umb__child_numbers(at + h, above);
        const uint32_t states = umb__child_states(at + h, above);
        const __mmask8 is_mixed = (__mmask8)_pext_u32(states, 0x5555);
        const __mmask8 is_lit = (__mmask8)_pext_u32(states, 0xaaaa);
        const __m512i to = _mm512_add_epi64(first, _mm512_slli_epi64(number, brick ? 6 : 3));
        const __m512i uniform = _mm512_mask_blend_epi64(is_lit, dark, bright);
        _mm512_storeu_si512(at + h, _mm512_mask_blend_epi64(is_mixed, uniform, to));
        unsettled |= (uint64_t)is_mixed << h;
    }
    return unsettled & heads->todo;
}

#endif
