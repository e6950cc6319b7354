/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a query kernel; included by kernel_base.c, kernel_avx2.c and kernel_avx512.c, which
 * name the functions (UMB__KERNEL, UMB__TENT). Kernels for vector instructions also name the steps
 * that are hand-written with them; else the steps are those in C, listed below. There is no include
 * guard: each file includes this one once.
 *
 * Points go in blocks of 64, and a block goes stage by stage: place (voxel space, window), grid,
 * one stage for each level of wide nodes, bricks, store. One bit a point says whether its look-up
 * goes on. A stage visits the set bits and makes the next stage's word without branching on data.
 * So no branch is mispredicted; a walk point by point would mispredict one or two branches a point.
 * Each stage prefetches the reads of the next, so a block waits for memory once a stage; a walk
 * waits once a point and stage (figures: docs/explained/performance.md). Points in one brick share
 * a look-up (kernel_runs.h).
 *
 * One tap is kernel_points.h, a window kernel_windows.h.
 */
#ifndef UMB__PLACER /* Steps that both kinds of vectors have hand-written */
#define UMB__PLACER         umb__placer
#define UMB__PLACER_INIT    umb__placer_init
#define UMB__PLACE          umb__place_block
#define UMB__PLACE_WINDOWS  umb__place_block
#define UMB__GRID           umb__grid_block
#define UMB__COMPARE_POINTS umb__compare_points
#define UMB__READ_RUNS      umb__read_runs
#define UMB__READ_BRICK     umb__read_brick
#endif
#ifndef UMB__WEIGH_ONE
#define UMB__WEIGH_ONE umb__weigh_one
#endif
#ifndef UMB__WEIGH_WINDOWS
#define UMB__WEIGH_WINDOWS umb__weigh_windows
#endif
#ifndef UMB__TAKE_HEADS /* Steps that only AVX-512 has hand-written */
#define UMB__TAKE_HEADS                            umb__take_heads
#define UMB__MAKE_MASKS                            umb__make_masks
#define UMB__TAKE_WINDOWS                          umb__take_heads
#define UMB__TOUCHED_STATES                        umb__touched_states
#define UMB__SPREAD_SETTLED                        umb__spread_settled
#define UMB__COUNT_WINDOWS                         umb__count_windows
#define UMB__STEP_HEADS                            umb__step_heads
#define UMB__RUNS_OF(runs, heads)                  ((void)(runs), umb__count_bits(heads))
#define UMB__MERGE_HEADS(spread, heads, runs)      ((void)(spread))
#define UMB__ASK_FOR_ANSWERS(query, values, first) ((void)0)
#endif
#include "query/kernel_points.h"
#include "query/kernel_windows.h"

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

UMB__INLINE void answer_blocks(const struct umb__query *query, const struct UMB__PLACER *placer,
                               size_t first, size_t end, const struct umb__tent *tent, void *values,
                               struct umb_query_stats *stats)
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
        count_windows(query, &masks, tent, &block, &idle, &known, stats);
        umb__store_block(query, &block, first, values);
    }
}

static void answer_windows(const struct umb__query *query, const struct UMB__PLACER *placer,
                           size_t first, size_t end, void *values, struct umb_query_stats *stats)
{
    answer_blocks(query, placer, first, end, NULL, values, stats);
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

/* Answers tents. A tent of one texel is a box. */
void UMB__TENT(const struct umb__query *query, const struct umb_points *points, size_t first,
               size_t count, struct umb_answers *answers)
{
    struct umb_query_stats stats = {.points = count};
    struct UMB__PLACER placer;
    struct umb__tent tent;
    UMB__PLACER_INIT(query, points, &placer);
    if (query->taps == 1) {
        answer_points(query, &placer, first, first + count, answers->values, &stats);
    } else {
        umb__tent_make(query->taps, &tent);
        answer_blocks(query, &placer, first, first + count, &tent, answers->values, &stats);
    }
    umb_query_stats_add(&answers->stats, &stats);
}
