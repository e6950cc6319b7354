/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a query kernel; included by kernel_base.c and kernel_avx2.c, which name the function
 * (UMB__KERNEL) and the two stages that vector instructions are worth writing by hand for
 * (UMB__PLACE, UMB__GRID). No guard: each includes it once.
 *
 * Points go in blocks of 64, and a block goes stage by stage: place (voxel space, window), grid,
 * one stage for each level of wide nodes, bricks, store. Who is still to be looked up is one bit a
 * point; a stage visits the bits that are set and makes the next stage's word without branching on
 * data. So no branch is mispredicted, where a walk point by point mispredicts one or two, and each
 * stage prefetches what the next will read: a block waits for memory once a stage, where a walk
 * waits once a point and stage (docs/performance.md has what that gives).
 *
 * One tap is kernel_points.h. A window is found by the level-5 cells (32 voxels) it touches, four
 * at most: each is looked up once, all its bricks are taken from that one node ("share",
 * reference/core.md section 3). Within a brick the window is a rectangle of the slice at depth z:
 * one mask, one popcount (Sintorn et al. 2014, section 6.2). Cells and bricks that are lit or
 * shadowed throughout stand as constants in the place of nodes and slices, so that a stage need not
 * tell them apart.
 */
#include "query/kernel_points.h"

/* Lists the level-5 cells that the windows touch, each once. */
static uint32_t list_cells(const struct umb__query *q, const struct umb__block *block,
                           struct umb__cells *cells)
{
    int32_t reach = q->taps - 1;
    uint32_t count = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        int32_t cx = block->x[i] >> UMB__SHARE_LEVEL, cy = block->y[i] >> UMB__SHARE_LEVEL;
        uint32_t right = (uint32_t)(((block->x[i] + reach) >> UMB__SHARE_LEVEL) - cx);
        uint32_t down = (uint32_t)(((block->y[i] + reach) >> UMB__SHARE_LEVEL) - cy);
        cells->slot[count] = (uint16_t)(4 * i);
        count++;
        cells->slot[count] = (uint16_t)(4 * i + 1);
        count += right;
        cells->slot[count] = (uint16_t)(4 * i + 2);
        count += down;
        cells->slot[count] = (uint16_t)(4 * i + 3);
        count += right & down;
    }
    return count;
}

/* Finds the node of every listed cell, or the uniform one that stands for it. */
static void find_cells(const struct umb__query *q, const struct umb__block *block, uint32_t count,
                       struct umb__cells *cells, struct umb_query_stats *stats)
{
    const uint64_t *const nodes[2] = {umb__uniform_nodes, q->nodes};
    const uint32_t *child[4 * UMB__BLOCK];
    uint32_t level = q->column_level, row = q->log2_size - level, left = 0;
    stats->nodes += count;
    for (uint32_t k = 0; k < count; k++) {
        struct umb__voxel v = umb__cell_corner(block, cells->slot[k]);
        uint64_t column;
        memcpy(&column, q->columns + ((uint32_t)v.x >> level) + ((uint32_t)v.y >> level << row),
               sizeof column);
        child[k] = q->pieces + umb__piece_of(column, (uint32_t)v.z >> level);
        UMB__PREFETCH(child[k]);
    }
    for (uint32_t k = 0; k < count; k++) {
        uint32_t slot = cells->slot[k], value = *child[k];
        uint32_t mixed = value >= UMB__CELL_FIRST;
        cells->node[slot] = nodes[mixed] + umb__select(mixed, value - UMB__CELL_FIRST, 2 * value);
        UMB__PREFETCH(cells->node[slot]);
        cells->slot[left] = (uint16_t)slot;
        left += mixed;
    }
    while (level > UMB__SHARE_LEVEL) {
        level -= 2;
        count = left;
        left = 0;
        stats->nodes += count;
        for (uint32_t k = 0; k < count; k++) {
            uint32_t slot = cells->slot[k];
            struct umb__voxel v = umb__cell_corner(block, slot);
            const uint64_t *node = cells->node[slot];
            unsigned bit = umb__child_bit(v.x, v.y, v.z, level);
            cells->node[slot] = umb__uniform_nodes + 2 * (node[1] >> bit & 1);
            cells->slot[left] = (uint16_t)slot;
            child[left] = umb__child_place(node, bit);
            UMB__PREFETCH(child[left]);
            left += (uint32_t)(node[0] >> bit & 1);
        }
        for (uint32_t k = 0; k < left; k++) {
            cells->node[cells->slot[k]] = q->nodes + *child[k];
            UMB__PREFETCH(q->nodes + *child[k]);
        }
    }
    stats->nodes += left;
}

/* Settles windows whose bricks are all lit or all shadowed; the others stay in the list. */
static void settle_slabs(const struct umb__query *q, struct umb__block *block,
                         const struct umb__cells *cells)
{
    uint32_t total = (uint32_t)(q->taps * q->taps), reach = (uint32_t)q->taps - 1;
    uint64_t unsettled = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest), shift = (uint32_t)block->z[i] >> 3 << 4 & 48;
        uint32_t columns = umb__brick_range((uint32_t)block->x[i], reach);
        uint32_t rows = umb__brick_range((uint32_t)block->y[i], reach);
        uint32_t right = columns > 15, down = 2 * (rows > 15);
        uint64_t mixed = 0, lit = 0, shadowed = 0;
        for (uint32_t c = 0; c < 4; c++) {
            const uint64_t *node = cells->node[4 * i + ((c & right) | (c & down))];
            uint64_t bricks = (columns >> 4 * (c & 1) & 15) * UINT64_C(0x1111) &
                              umb__rows_of_four[rows >> 2 * (c & 2) & 15];
            mixed |= node[0] >> shift & bricks;
            lit |= node[1] >> shift & bricks;
            shadowed |= ~(node[1] >> shift) & bricks;
        }
        block->lit[i] = lit ? total : 0;
        unsettled |= (uint64_t)((mixed != 0) | ((lit != 0) & (shadowed != 0))) << i;
    }
    block->todo = unsettled;
}

/* Finds the slices of all bricks that the windows touch, `side` each way; slot 16 * point + brick.
 */
static inline __attribute__((always_inline)) void find_slices(const struct umb__query *q,
                                                              const struct umb__block *block,
                                                              const struct umb__cells *cells,
                                                              uint32_t side, const uint64_t **slice,
                                                              struct umb_query_stats *stats)
{
    const uint32_t *child[9 * UMB__BLOCK];
    uint16_t slot[9 * UMB__BLOCK];
    uint32_t left = 0, reach = (uint32_t)q->taps - 1;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        uint32_t x = (uint32_t)block->x[i], y = (uint32_t)block->y[i], z = (uint32_t)block->z[i];
        const uint64_t *const *corner = cells->node + 4 * i;
        for (uint32_t r = 0; r < side; r++) {
            uint32_t by = umb__least((y >> 3) + r, (y + reach) >> 3);
            const uint64_t *const *row = corner + 2 * ((by >> 2) - (y >> 5));
            uint32_t row_bit = (by & 3) << 2 | (z >> 3 & 3) << 4;
            for (uint32_t c = 0; c < side; c++) {
                uint32_t bx = umb__least((x >> 3) + c, (x + reach) >> 3);
                const uint64_t *node = row[(bx >> 2) - (x >> 5)];
                uint32_t bit = (bx & 3) | row_bit, to = 16 * i + side * r + c;
                slice[to] = umb__uniform_slices + (node[1] >> bit & 1);
                slot[left] = (uint16_t)to;
                child[left] = umb__child_place(node, bit);
                UMB__PREFETCH(child[left]);
                left += (uint32_t)(node[0] >> bit & 1);
            }
        }
    }
    stats->bricks += left;
    for (uint32_t k = 0; k < left; k++) {
        int32_t z = block->z[slot[k] / 16];
        slice[slot[k]] = q->bricks[*child[k]] + (z & 7);
        UMB__PREFETCH(slice[slot[k]]);
    }
}

/* Adds up the windows from the slices of their bricks. */
static inline __attribute__((always_inline)) void count_slices(const struct umb__query *q,
                                                               struct umb__block *block,
                                                               uint32_t side,
                                                               const uint64_t *const *slice)
{
    uint32_t window = ((uint32_t)1 << q->taps) - 1;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest), lit = 0;
        uint32_t columns = window << (block->x[i] & 7), rows = window << (block->y[i] & 7);
        for (uint32_t r = 0; r < side; r++) {
            uint64_t row_mask = umb__spread(rows >> 8 * r & 0xff);
            for (uint32_t c = 0; c < side; c++) {
                uint64_t mask = row_mask & (columns >> 8 * c & 0xff) * UMB__EVERY_BYTE;
                lit += (uint32_t)__builtin_popcountll(*slice[16 * i + side * r + c] & mask);
            }
        }
        block->lit[i] = lit;
    }
}

/* `idle`: blocks for which settle_slabs is left out, because it settled next to nothing. */
static void count_windows(const struct umb__query *q, struct umb__block *block, uint32_t *idle,
                          struct umb_query_stats *stats)
{
    struct umb__cells cells;
    uint32_t values[UMB__BLOCK];
    uint64_t looked_up = block->todo;
    UMB__GRID(q, block, values);
    stats->nodes += umb__count_bits(looked_up & ~block->todo);
    find_cells(q, block, list_cells(q, block, &cells), &cells, stats);
    if (*idle > 0) {
        --*idle;
    } else {
        uint64_t before = umb__count_bits(block->todo);
        settle_slabs(q, block, &cells);
        *idle = umb__count_bits(block->todo) > before - before / 8 ? UMB__IDLE_BLOCKS : 0;
    }
    const uint64_t *slice[16 * UMB__BLOCK];
    if (q->taps <= 9) {
        find_slices(q, block, &cells, 2, slice, stats);
        count_slices(q, block, 2, slice);
    } else {
        find_slices(q, block, &cells, 3, slice, stats);
        count_slices(q, block, 3, slice);
    }
}

void UMB__KERNEL(const struct umb__query *query, const struct umb_points *points, size_t first,
                 size_t count, struct umb_answers *answers)
{
    struct umb__block block;
    struct umb_query_stats stats = {.points = count};
    uint32_t idle = 0;
    for (size_t end = first + count; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__PLACE(query, points, first, &block, &stats);
        if (query->taps == 1) {
            umb__count_points(query, &block, &stats);
        } else {
            count_windows(query, &block, &idle, &stats);
        }
        umb__store_block(query, &block, first, answers->values);
    }
    umb__add_stats(&stats, &answers->stats);
}
