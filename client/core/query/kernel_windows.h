/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_WINDOWS_H
#define UMBRAGE_CORE_QUERY_KERNEL_WINDOWS_H
/*
 * The stages of a window, a part of a kernel's body. kernel_body.h explains stages, and lists those
 * that each kernel defines.
 *
 * A window touches at most four level-5 cells (32 voxels). Each cell is looked up once, and its one
 * node gives all its bricks. Within a brick the window is a rectangle of the slice at depth z: one
 * mask, one popcount (Sintorn et al. 2014, section 6.2). Constant nodes and bricks represent
 * uniform cells and bricks, so that a stage treats all alike.
 */
#include "query/kernel_cells.h"
#include "query/kernel_window_steps.h"

/* Settles windows whose bricks are all lit or all shadowed. The other windows stay in `todo`. */
static void settle_slabs(const struct umb__query *q, const struct umb__window_masks *masks,
                         struct umb__block *block, const struct umb__cells *cells)
{
    uint32_t total = (uint32_t)(q->taps * q->taps), reach = (uint32_t)q->taps - 1;
    uint64_t unsettled = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        const struct umb__voxel at = {block->x[i], block->y[i], block->z[i]};
        const uint32_t states =
            UMB__TOUCHED_STATES(masks, at, reach, cells->node + 4 * cells->of[i]);
        const uint32_t mixed = states & 1, lit = states >> 1 & 1, shadowed = states >> 2;
        block->lit[i] = (0 - lit) & total;
        unsettled |= (uint64_t)(mixed | (lit & shadowed)) << i;
    }
    block->todo = unsettled;
}

/* Finds all bricks that the windows touch. In: side: bricks on each axis. Out: brick: [16 * point
 * ..] the bricks of a window. */
UMB__INLINE void find_bricks(const struct umb__query *q, const struct umb__block *block,
                             const struct umb__cells *cells, uint32_t side, const uint64_t **brick,
                             struct umb_query_stats *stats)
{
    const uint32_t *child[9 * UMB__BLOCK];
    uint16_t slot[9 * UMB__BLOCK];
    uint32_t left = 0, reach = (uint32_t)q->taps - 1;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        uint32_t x = (uint32_t)block->x[i], y = (uint32_t)block->y[i], z = (uint32_t)block->z[i];
        const uint64_t *const *corner = cells->node + 4 * cells->of[i];
        for (uint32_t r = 0; r < side; r++) {
            uint32_t by = umb__least((y >> 3) + r, (y + reach) >> 3);
            const uint64_t *const *row = corner + 2 * ((by >> 2) - (y >> 5));
            uint32_t row_bit = (by & 3) << 2 | (z >> 3 & 3) << 4;
            for (uint32_t c = 0; c < side; c++) {
                uint32_t bx = umb__least((x >> 3) + c, (x + reach) >> 3);
                const uint64_t *node = row[(bx >> 2) - (x >> 5)];
                uint32_t bit = (bx & 3) | row_bit, to = 16 * i + side * r + c;
                brick[to] = umb__uniform_bricks[node[1] >> bit & 1];
                slot[left] = (uint16_t)to;
                child[left] = umb__child_place(node, bit);
                UMB__PREFETCH(child[left]);
                left += (uint32_t)(node[0] >> bit & 1);
            }
        }
    }
    stats->bricks += left;
    for (uint32_t k = 0; k < left; k++) {
        brick[slot[k]] = q->bricks[*child[k]];
        UMB__PREFETCH(brick[slot[k]]);
    }
}

#define GRID_IDLE_BLOCKS  3U /* The grid is tried often: windows that it settles cost least */
#define SLABS_IDLE_BLOCKS 15U
#define WINDOW_RUNS_MAX                                                                            \
    56U /* As UMB__RUNS_MAX; the descent of a window costs more than a
                                 point's */

/* Number of blocks for which each of the two stages that settle windows early is still skipped,
 * after it settled almost nothing. */
struct idle_stages {
    uint32_t grid, slabs;
};

/* Returns whether a stage is to be tried on this block. */
static bool stage_is_due(uint32_t *idle)
{
    *idle -= *idle > 0;
    return *idle == 0;
}

/* Returns for how many blocks to skip a stage; 0 if it settled more than `few` windows. */
static uint32_t idle_after(uint64_t before, uint64_t after, uint32_t few, uint32_t blocks)
{
    bool idle = before != 0 && umb__count_bits(before & ~after) <= few;
    return idle ? blocks + 1 : 0;
}

/* Every point is a run. */
#define FOUR(i)    (i), (i) + 1, (i) + 2, (i) + 3
#define SIXTEEN(i) FOUR(i), FOUR((i) + 4), FOUR((i) + 8), FOUR((i) + 12)
static const struct umb__runs each_alone = {
    UINT64_MAX, UMB__BLOCK, {SIXTEEN(0), SIXTEEN(16), SIXTEEN(32), SIXTEEN(48), UMB__BLOCK},
    false,      {0},
};

static void count_windows(const struct umb__query *q, const struct umb__window_masks *masks,
                          struct umb__block *block, struct idle_stages *idle,
                          struct known_cells *known, struct umb_query_stats *stats)
{
    struct umb__cells cells;
    struct umb__block own, *heads = block;
    struct umb__runs found;
    const struct umb__runs *runs = &each_alone;
    struct umb__closeness close = UMB__COMPARE_POINTS(block);
    uint64_t starts = umb__run_starts(block, close.changes);
    if (umb__count_bits(starts) <= WINDOW_RUNS_MAX) {
        UMB__TAKE_WINDOWS(q, block, starts, &own, &found);
        heads = &own;
        runs = &found;
    }
    uint64_t looked_up = heads->todo;
    if (stage_is_due(&idle->grid)) {
        UMB__GRID(q, heads);
        stats->nodes += umb__count_bits(looked_up & ~heads->todo);
        idle->grid = idle_after(looked_up, heads->todo, 0, GRID_IDLE_BLOCKS);
    }
    if (heads == block) {
        find_cells(q, heads, list_cells(q, heads, false, &cells), &cells, stats);
    } else {
        find_new_cells(q, heads, list_cells(q, heads, true, &cells), &cells, known, stats);
    }
    if (stage_is_due(&idle->slabs)) {
        uint64_t before = heads->todo;
        settle_slabs(q, masks, heads, &cells);
        uint32_t few = umb__count_bits(before) / 8;
        idle->slabs = idle_after(before, heads->todo, few, SLABS_IDLE_BLOCKS);
    }
    const uint64_t settled = looked_up & ~heads->todo;
    if (heads != block && settled != 0) {
        UMB__SPREAD_SETTLED(block, heads, settled, runs);
    }
    const uint64_t *brick[16 * UMB__BLOCK];
    if (q->taps <= 9) {
        find_bricks(q, heads, &cells, 2, brick, stats);
        UMB__COUNT_WINDOWS(masks, block, heads->todo, runs, 2, brick);
    } else {
        find_bricks(q, heads, &cells, 3, brick, stats);
        UMB__COUNT_WINDOWS(masks, block, heads->todo, runs, 3, brick);
    }
}

#endif
