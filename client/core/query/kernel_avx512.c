/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The query kernel compiled for x86-64 with AVX-512 (F, VL, BW, DQ, CD), AVX2, POPCNT, BMI and
 * BMI2. Despite the lower clock of AVX-512 it is faster for all but short batches; umb__run_wide
 * chooses. Where it cannot be compiled it is the baseline.
 */
#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512BW__) &&                      \
    defined(__AVX512DQ__) && defined(__AVX512CD__)
#include "query/kernel_place_avx512.h"
#include "query/kernel_runs_avx512.h"
#include "query/kernel_windows_avx512.h"
#define UMB__KERNEL         umb__kernel_avx512
#define UMB__TENT           umb__tent_avx512
#define UMB__PLACER         umb__wide_placer
#define UMB__PLACER_INIT    umb__wide_placer_init
#define UMB__PLACE          umb__wide_place_points
#define UMB__PLACE_WINDOWS  umb__wide_place_windows
#define UMB__GRID           umb__grid_block_avx2
#define UMB__COMPARE_POINTS umb__compare_points_avx512
#define UMB__TAKE_HEADS     umb__take_heads_avx512
#define UMB__READ_RUNS      umb__read_runs_avx512
#define UMB__MAKE_MASKS     umb__make_masks_avx512
#define UMB__TAKE_WINDOWS   umb__take_windows_avx512
#define UMB__TOUCHED_STATES umb__touched_states_avx512
#define UMB__SPREAD_SETTLED umb__spread_settled_avx512
#define UMB__COUNT_WINDOWS  umb__count_windows_avx512
#define UMB__WEIGH_ONE      umb__weigh_one_avx2
#define UMB__WEIGH_WINDOWS  umb__weigh_windows_avx512
#define UMB__RUNS_OF        umb__runs_of_avx512
#define UMB__MERGE_HEADS    umb__merge_heads
#define UMB__READ_BRICK     umb__read_brick_avx512
#define UMB__STEP_HEADS     umb__step_heads_avx512

/* Prefetches the memory of later answers, as the kernels do for points, because hardware
 * prefetchers do not reach that far. */
#define WRITE_AHEAD 1024U /* bytes */

UMB__INLINE void ask_for_answers(const struct umb__query *query, const void *values, size_t first)
{
    const uintptr_t to = (uintptr_t)values + sizeof(float) * first + WRITE_AHEAD;
    for (size_t at = 0; at < sizeof(float) * UMB__BLOCK && query->format == UMB_ANSWER_F32;
         at += 64) {
        __builtin_prefetch((const void *)(to + at), 1);
    }
}
#define UMB__ASK_FOR_ANSWERS ask_for_answers
#include "query/kernel_body.h"
#else
#include "query/query_parts.h"

void umb__kernel_avx512(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers)
{
    umb__kernel_base(query, points, first, count, answers);
}

void umb__tent_avx512(const struct umb__query *query, const struct umb_points *points, size_t first,
                      size_t count, struct umb_answers *answers)
{
    umb__tent_base(query, points, first, count, answers);
}
#endif
