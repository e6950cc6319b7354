/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a query kernel; included by kernel_base.c, kernel_avx2.c and kernel_avx512.c, which
 * name the function (UMB__KERNEL) and the stages that vector instructions are worth writing by hand
 * for: placing (UMB__PLACER, UMB__PLACER_INIT, UMB__PLACE, UMB__PLACE_WINDOWS), UMB__GRID,
 * UMB__COMPARE_POINTS; of one tap UMB__TAKE_HEADS, UMB__STEP_HEADS, UMB__READ_RUNS,
 * UMB__READ_BRICK; of windows UMB__MAKE_MASKS, UMB__TAKE_WINDOWS, UMB__TOUCHED_STATES,
 * UMB__SPREAD_SETTLED, UMB__COUNT_WINDOWS. No guard: each includes it once.
 *
 * Points go in blocks of 64, and a block goes stage by stage: place (voxel space, window), grid,
 * one stage for each level of wide nodes, bricks, store. Who is still to be looked up is one bit a
 * point; a stage visits the bits that are set and makes the next stage's word without branching on
 * data. So no branch is mispredicted, where a walk point by point mispredicts one or two, and each
 * stage prefetches what the next will read: a block waits for memory once a stage, where a walk
 * waits once a point and stage (docs/explained/performance.md has what that gives). Points in one
 * brick share a look-up (kernel_runs.h).
 *
 * One tap is kernel_points.h, a window kernel_windows.h.
 */
#include "query/kernel_points.h"
#include "query/kernel_windows.h"

/* Memory of answers that are written some blocks later. */
#ifndef UMB__ASK_FOR_ANSWERS
#define UMB__ASK_FOR_ANSWERS(query, values, first) ((void)0)
#endif

static void answer_points(const struct umb__query *query, const struct UMB__PLACER *placer,
                          size_t first, size_t end, void *values, struct umb_query_stats *stats)
{
    struct umb__block block;
    struct umb__descents descents;
    struct umb__common common = {0};
    umb__begin_descents(query, values, &descents);
    for (; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__ASK_FOR_ANSWERS(query, values, first);
        UMB__PLACE(placer, first, &block, stats);
        umb__answer_points(query, &block, first, values, &common, &descents, stats);
    }
    umb__end_descents(&descents, stats);
}

static void answer_windows(const struct umb__query *query, const struct UMB__PLACER *placer,
                           size_t first, size_t end, void *values, struct umb_query_stats *stats)
{
    struct umb__block block;
    struct umb__window_masks masks;
    struct idle_stages idle = {0, 0};
    struct known_cells known;
    UMB__MAKE_MASKS(query->taps, &masks);
    forget_cells(&known);
    for (; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__ASK_FOR_ANSWERS(query, values, first);
        UMB__PLACE_WINDOWS(placer, first, &block, stats);
        count_windows(query, &masks, &block, &idle, &known, stats);
        umb__store_block(query, &block, first, values);
    }
}

void UMB__KERNEL(const struct umb__query *query, const struct umb_points *points, size_t first,
                 size_t count, struct umb_answers *answers)
{
    struct umb_query_stats stats = {.points = count};
    struct UMB__PLACER placer;
    UMB__PLACER_INIT(query, points, &placer);
    (query->taps == 1 ? answer_points : answer_windows)(query, &placer, first, first + count,
                                                        answers->values, &stats);
    umb_query_stats_add(&answers->stats, &stats);
}
