/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_WINDOWS_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_WINDOWS_AVX512_H
/* The steps of kernel_window_steps.h with AVX-512. They give the same integers as in C. */
#include "query/kernel_runs_avx512.h"
#include "query/kernel_tent_avx2.h"
#include "query/kernel_window_steps.h"

static inline void umb__make_masks_avx512(int32_t taps, struct umb__window_masks *masks)
{
    umb__make_masks(taps, masks);
    for (uint32_t at = 0; at < 32; at++) {
        const uint64_t range = umb__brick_range(at, (uint32_t)taps - 1);
        for (uint32_t c = 0; c < 4; c++) {
            const uint64_t columns = (range >> 4 * (c & 1) & 15) * UINT64_C(0x1111);
            const uint64_t rows = umb__rows_of_four[range >> 2 * (c & 2) & 15];
            masks->cell_columns[at][2 * c] = masks->cell_columns[at][2 * c + 1] = columns;
            masks->cell_rows[at][2 * c] = masks->cell_rows[at][2 * c + 1] = rows;
        }
    }
}

/* Does what umb__take_heads does, up to sixteen heads of a whole block at once. */
static inline void umb__take_windows_avx512(const struct umb__query *q,
                                            const struct umb__block *block, uint64_t starts,
                                            struct umb__block *heads, struct umb__runs *runs)
{
    if (umb__count_bits(starts) > 16 || block->size != UMB__BLOCK) {
        umb__take_heads(q, block, starts, heads, runs);
        return;
    }
    /* A run has one point if the next run, or the end, follows at once. */
    const uint64_t several = starts & ~(starts >> 1 | (uint64_t)1 << (UMB__BLOCK - 1));
    const __m512i seven = _mm512_set1_epi32(7);
    const __m512i last = _mm512_set1_epi32(((int32_t)1 << q->log2_size) - q->taps);
    const __m512i place = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    __m512i x = _mm512_setzero_si512(), y = x, z = x, first = _mm512_set1_epi32(UMB__BLOCK);
    uint32_t count = 0;
    for (uint32_t i = 0; i < UMB__BLOCK; i += 16) {
        const __mmask16 wanted = (__mmask16)(starts >> i), wide = (__mmask16)(several >> i);
        const __m512i px = umb__load_sixteen(block->x + i), py = umb__load_sixteen(block->y + i);
        const __m512i point = _mm512_add_epi32(place, _mm512_set1_epi32((int)i));
        x = umb__append_wanted(x, count, wanted, _mm512_mask_or_epi32(px, wide, px, seven));
        y = umb__append_wanted(y, count, wanted, _mm512_mask_or_epi32(py, wide, py, seven));
        z = umb__append_wanted(z, count, wanted, umb__load_sixteen(block->z + i));
        first = umb__append_wanted(first, count, wanted, point);
        count += umb__count_bits(wanted);
    }
    _mm512_store_si512(heads->x, _mm512_min_epi32(x, last));
    _mm512_store_si512(heads->y, _mm512_min_epi32(y, last));
    _mm512_store_si512(heads->z, z);
    _mm_storeu_si128((__m128i *)(void *)runs->first, _mm512_cvtepi32_epi8(first));
    runs->first[count] = UMB__BLOCK;
    runs->count = heads->size = count;
    runs->starts = starts;
    heads->todo = _pext_u64(block->todo, starts);
}

/* Does what umb__spread_settled does, sixteen windows at a time. */
static inline void umb__spread_settled_avx512(struct umb__block *block,
                                              const struct umb__block *heads, uint64_t settled,
                                              const struct umb__runs *runs)
{
    if (runs->count > 16) {
        umb__spread_settled(block, heads, settled, runs);
        return;
    }
    const __m512i open = _mm512_set1_epi32(-1);
    const __m512i of_head =
        _mm512_mask_mov_epi32(open, (__mmask16)settled, _mm512_load_si512(heads->lit));
    __m512i run[UMB__BLOCK / 16];
    umb__number_runs(runs->starts, run);
    for (uint32_t i = 0; i < UMB__BLOCK / 16; i++) {
        const __m512i lit = _mm512_permutexvar_epi32(run[i], of_head);
        const __mmask16 here = _mm512_cmpneq_epi32_mask(lit, open);
        const __m512i before = _mm512_load_si512(block->lit + 16 * i);
        _mm512_store_si512(block->lit + 16 * i, _mm512_mask_mov_epi32(before, here, lit));
    }
}

/* Returns the number of set bits in each byte of eight words. */
static inline __m512i umb__count_bytes(__m512i words)
{
    const __m512i low = _mm512_set1_epi8(15);
    const __m512i of =
        _mm512_broadcast_i32x4(_mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4));
    const __m512i high = _mm512_srli_epi64(words, 4) & low;
    return _mm512_add_epi8(_mm512_shuffle_epi8(of, words & low), _mm512_shuffle_epi8(of, high));
}

/* Returns the lit texels of windows i .. i + 7. In: windows that begin in one brick. */
UMB__INLINE __m256i umb__count_eight(const struct umb__window_masks *masks,
                                     const struct umb__block *block, uint32_t i, uint32_t side,
                                     const __m512i brick[9])
{
    const __m512i x = _mm512_cvtepi32_epi64(_mm256_loadu_si256((const void *)(block->x + i)));
    const __m512i y = _mm512_cvtepi32_epi64(_mm256_loadu_si256((const void *)(block->y + i)));
    const __m512i z = _mm512_cvtepi32_epi64(_mm256_loadu_si256((const void *)(block->z + i)));
    __m512i columns[3], lit = _mm512_setzero_si512();
    for (uint32_t c = 0; c < side; c++) {
        columns[c] = _mm512_permutexvar_epi64(x, _mm512_load_si512(masks->columns[c]));
    }
    for (uint32_t r = 0; r < side; r++) {
        const __m512i rows = _mm512_permutexvar_epi64(y, _mm512_load_si512(masks->rows[r]));
        for (uint32_t c = 0; c < side; c++) {
            const __m512i slices = _mm512_permutexvar_epi64(z, brick[side * r + c]);
            const __m512i inside = slices & columns[c] & rows;
            lit = _mm512_add_epi8(lit, umb__count_bytes(inside)); /* 72 at most in a byte */
        }
    }
    return _mm512_cvtepi64_epi32(_mm512_sad_epu8(lit, _mm512_setzero_si512()));
}

/* Does what umb__count_windows does, eight windows of a run at a time. If every run has one point,
 * the windows are counted one by one. */
UMB__INLINE void umb__count_windows_avx512(const struct umb__window_masks *masks,
                                           struct umb__block *block, uint64_t heads,
                                           const struct umb__runs *runs, uint32_t side,
                                           const uint64_t *const *brick)
{
    if (runs->count == block->size) {
        umb__count_windows(masks, block, heads, runs, side, brick);
        return;
    }
    for (uint64_t rest = heads; rest; rest &= rest - 1) {
        const uint32_t h = umb__first_bit(rest), end = runs->first[h + 1];
        __m512i of_head[9];
        for (uint32_t k = 0; k < side * side; k++) {
            of_head[k] = _mm512_loadu_si512(brick[16 * h + k]);
        }
        for (uint32_t i = runs->first[h]; i < end; i += 8) {
            const __mmask8 in_run = (__mmask8)_bzhi_u32(0xff, end - i);
            _mm256_mask_storeu_epi32(block->lit + i, in_run,
                                     umb__count_eight(masks, block, i, side, of_head));
        }
    }
}

/* Returns, for each byte of eight words, the number of set bits times 1 << plane. */
UMB__INLINE __m512i umb__weigh_bytes(__m512i words, uint32_t plane)
{
    const __m512i low = _mm512_set1_epi8(15);
    const __m128i counts = _mm_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
    const __m512i of = _mm512_broadcast_i32x4(_mm_slli_epi16(counts, (int)plane));
    const __m512i high = _mm512_srli_epi64(words, 4) & low;
    return _mm512_add_epi8(_mm512_shuffle_epi8(of, words & low), _mm512_shuffle_epi8(of, high));
}

/* Returns the weights of windows i .. i + 7. In: windows that begin in one brick. */
UMB__INLINE __m256i umb__weigh_eight(const struct umb__tent *tent, const struct umb__block *block,
                                     uint32_t i, uint32_t side, const __m512i brick[9])
{
    const __m512i x = _mm512_cvtepi32_epi64(_mm256_loadu_si256((const void *)(block->x + i)));
    const __m512i y = _mm512_cvtepi32_epi64(_mm256_loadu_si256((const void *)(block->y + i)));
    const __m512i z = _mm512_cvtepi32_epi64(_mm256_loadu_si256((const void *)(block->z + i)));
    const uint32_t planes = side == 2 ? UMB__TENT_PLANES - 1 : UMB__TENT_PLANES;
    __m512i sums = _mm512_setzero_si512();
    for (uint32_t r = 0; r < side; r++) {
        const __m512i weights = _mm512_permutexvar_epi64(y, _mm512_load_si512(tent->rows[r]));
        __m512i row = _mm512_setzero_si512(); /* A byte is at most 81 */
        for (uint32_t c = 0; c < side; c++) {
            const __m512i slices = _mm512_permutexvar_epi64(z, brick[side * r + c]);
            for (uint32_t p = 0; p < planes; p++) {
                const __m512i columns =
                    _mm512_permutexvar_epi64(x, _mm512_load_si512(tent->columns[p][c]));
                row = _mm512_add_epi8(row, umb__weigh_bytes(slices & columns, p));
            }
        }
        sums = _mm512_add_epi16(sums, _mm512_maddubs_epi16(row, weights));
    }
    sums = _mm512_madd_epi16(sums, _mm512_set1_epi16(1));
    return _mm512_cvtepi64_epi32(_mm512_add_epi32(sums, _mm512_srli_epi64(sums, 32)));
}

/* Does what umb__weigh_windows does, eight windows of a run at a time as in
 * umb__count_windows_avx512. */
UMB__INLINE void umb__weigh_windows_avx512(umb__weigh_fn *one, const struct umb__tent *tent,
                                           struct umb__block *block, uint64_t heads,
                                           const struct umb__runs *runs, uint32_t side,
                                           const uint64_t *const *brick)
{
    if (runs->count == block->size) {
        umb__weigh_windows(one, tent, block, heads, runs, side, brick);
        return;
    }
    for (uint64_t rest = heads; rest; rest &= rest - 1) {
        const uint32_t h = umb__first_bit(rest), end = runs->first[h + 1];
        __m512i of_head[9];
        for (uint32_t k = 0; k < side * side; k++) {
            of_head[k] = _mm512_loadu_si512(brick[16 * h + k]);
        }
        for (uint32_t i = runs->first[h]; i < end; i += 8) {
            const __mmask8 in_run = (__mmask8)_bzhi_u32(0xff, end - i);
            _mm256_mask_storeu_epi32(block->lit + i, in_run,
                                     umb__weigh_eight(tent, block, i, side, of_head));
        }
    }
}

/* Does what umb__touched_states does, four cells at a time. */
UMB__INLINE uint32_t umb__touched_states_avx512(const struct umb__window_masks *masks,
                                                struct umb__voxel at, uint32_t reach,
                                                const uint64_t *const corner[4])
{
    const uint32_t x = (uint32_t)at.x & 31, y = (uint32_t)at.y & 31;
    const uint32_t right = (x + reach) >> 5, down = (y + reach) >> 5 << 1;
    const uint64_t *const nodes[4] = {corner[0], corner[right], corner[down], corner[right | down]};
    const __m512i touched =
        _mm512_load_si512(masks->cell_columns[x]) & _mm512_load_si512(masks->cell_rows[y]);
    const __m512i states =
        _mm512_srl_epi64(umb__load_masks(nodes), _mm_cvtsi32_si128(at.z << 1 & 48));
    const uint32_t any = _mm512_test_epi64_mask(states, touched);
    const uint32_t not_all = _mm512_cmpneq_epi64_mask(states & touched, touched);
    return (uint32_t)((any & 0x55) != 0) | (uint32_t)((any & 0xaa) != 0) << 1 |
           (uint32_t)((not_all & 0xaa) != 0) << 2;
}

#endif
