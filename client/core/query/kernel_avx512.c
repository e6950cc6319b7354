/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The kernel of one tap for x86-64 with AVX-512 (F, VL, BW, DQ, CD), AVX2, POPCNT, BMI and BMI2. It
 * is worth its lower clock for all but short batches: umb__run_taps chooses. Where it cannot be
 * compiled it is the baseline.
 */
#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512BW__) &&                      \
    defined(__AVX512DQ__) && defined(__AVX512CD__)
#include "query/kernel_place_avx512.h"
#include "query/kernel_runs_avx512.h"
#define UMB__COMPARE_POINTS umb__compare_points_avx512
#define UMB__TAKE_HEADS     umb__take_heads_avx512
#define UMB__READ_RUNS      umb__read_runs_avx512
#define UMB__RUNS_OF        umb__runs_of_avx512
#define UMB__MERGE_HEADS    umb__merge_heads
#define UMB__READ_BRICK     umb__read_brick_avx512
#define UMB__STEP_HEADS     umb__step_heads_avx512
#include "query/kernel_points.h"

/* Answers are written ahead of where processors look by themselves, as points are read. */
#define WRITE_AHEAD 1024U /* bytes */

static inline __attribute__((always_inline)) void
ask_for_answers(const struct umb_answers *answers, enum umb_answer_format format, size_t first)
{
    const uintptr_t to = (uintptr_t)answers->values + sizeof(float) * first + WRITE_AHEAD;
    for (size_t at = 0; at < sizeof(float) * UMB__BLOCK && format == UMB_ANSWER_F32; at += 64) {
        __builtin_prefetch((const void *)(to + at), 1);
    }
}

void umb__kernel_avx512(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers)
{
    struct umb__block block;
    struct umb__descents descents;
    struct umb__common common = {0};
    struct umb_query_stats stats = {.points = count};
    struct umb__wide_placer placer;
    umb__wide_placer_init(query, points, &placer);
    umb__begin_descents(query, answers->values, &descents);
    for (const size_t end = first + count; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        ask_for_answers(answers, query->format, first);
        umb__wide_place_block(&placer, first, &block, &stats);
        umb__answer_points(query, &block, first, answers->values, &common, &descents, &stats);
    }
    umb__end_descents(&descents, &stats);
    umb_query_stats_add(&answers->stats, &stats);
}
#else
#include "query/query_parts.h"

void umb__kernel_avx512(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers)
{
    umb__kernel_base(query, points, first, count, answers);
}
#endif
