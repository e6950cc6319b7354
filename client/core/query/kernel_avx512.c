/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The kernel of one tap for x86-64 with AVX-512 (F, VL, BW, DQ), AVX2, POPCNT, BMI and BMI2. It is
 * worth its lower clock where points share their way down: umb__run_taps chooses. Where it cannot
 * be compiled it is the baseline.
 */
#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512BW__) && defined(__AVX512DQ__)
#include "query/kernel_lanes_avx512.h"
#include "query/kernel_place_lanes.h"
#include "query/kernel_runs_avx512.h"
#define UMB__COMPARE_POINTS umb__compare_points_avx512
#define UMB__TAKE_HEADS     umb__take_heads_avx512
#define UMB__READ_RUNS      umb__read_runs_avx512
#include "query/kernel_points.h"

void umb__kernel_avx512(const struct umb__query *query, const struct umb_points *points,
                        size_t first, size_t count, struct umb_answers *answers)
{
    struct umb__block block;
    struct umb_query_stats stats = {.points = count};
    struct umb__lane_placer placer;
    umb__lane_placer_init(query, points, &placer);
    for (size_t end = first + count; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        umb__lane_place_block(&placer, first, &block, &stats);
        umb__count_points(query, &block, &stats);
        umb__store_block(query, &block, first, answers->values);
    }
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
