/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a query kernel; included by kernel_base.c and kernel_avx2.c, which name the function
 * (UMB__KERNEL) and how a block of points is placed (UMB__PLACE). No guard: each includes it once.
 *
 * Points go in blocks, and a block goes stage by stage: place (voxel space, window), grid, one
 * stage for each level of wide nodes, bricks, store. A stage is a loop without branches on data:
 * what is settled and what goes on is told apart by compaction (write the index, advance the count
 * by 0 or 1). So no branch is mispredicted, where a walk point by point mispredicts one or two, and
 * the loads of many points are in flight at once, where a walk waits for each (docs/performance.md
 * has what that gives).
 *
 * A window is found by the level-5 cells (32 voxels) it touches, four at most: each is looked up
 * once, all its bricks are taken from that one node ("share", reference/core.md section 3). Within
 * a brick the window is a rectangle of the slice at depth z: one mask, one popcount (Sintorn et
 * al. 2014, section 6.2). Cells and bricks that are lit or shadowed throughout stand as constants
 * in the place of nodes and slices, so that a stage need not tell them apart.
 */
#include "query/kernel_parts.h"

static void prefetch_grid(const struct umb__query *q, const struct umb__block *block)
{
    uint32_t level = q->log2_size - q->grid_log2, g = q->grid_log2;
    for (uint32_t k = 0; k < block->count; k++) {
        uint32_t i = block->list[k];
        UMB__PREFETCH(q->grid + umb__grid_index(block->x[i], block->y[i], block->z[i], level, g));
    }
}

/* One tap: cells are looked up down to the brick. */
static void count_points(const struct umb__query *q, struct umb__block *block,
                         struct umb_query_stats *stats)
{
    uint32_t level = q->log2_size - q->grid_log2, g = q->grid_log2, count = 0;
    uint32_t number[UMB__BLOCK];
    const uint32_t *child[UMB__BLOCK];
    uint32_t above = 0 - (uint32_t)(level > UMB_LEVEL_BRICK); /* else they are bricks' numbers */
    prefetch_grid(q, block);
    for (uint32_t k = 0; k < block->count; k++) {
        uint32_t i = block->list[k];
        uint32_t value = q->grid[umb__grid_index(block->x[i], block->y[i], block->z[i], level, g)];
        uint32_t mixed = value >= UMB__CELL_FIRST;
        block->lit[i] = value & 1; /* of a mixed cell: said later */
        block->list[count] = (uint16_t)i;
        number[count] = (value - UMB__CELL_FIRST) & (0 - mixed);
        UMB__PREFETCH(q->nodes + (number[count] & above));
        count += mixed;
    }
    stats->nodes += block->count;
    while (level > UMB_LEVEL_BRICK) {
        level -= 2;
        stats->nodes += count;
        uint32_t left = 0;
        for (uint32_t k = 0; k < count; k++) {
            uint32_t i = block->list[k];
            const uint64_t *node = q->nodes + number[k];
            unsigned bit = umb__child_bit(block->x[i], block->y[i], block->z[i], level);
            block->lit[i] = (uint32_t)(node[1] >> bit & 1);
            block->list[left] = (uint16_t)i;
            child[left] = umb__child_place(node, bit);
            UMB__PREFETCH(child[left]);
            left += (uint32_t)(node[0] >> bit & 1);
        }
        count = left;
        for (uint32_t k = 0; k < count; k++) {
            number[k] = *child[k];
            if (level > UMB_LEVEL_BRICK) {
                UMB__PREFETCH(q->nodes + number[k]);
            }
        }
    }
    for (uint32_t k = 0; k < count; k++) {
        UMB__PREFETCH(&q->bricks[number[k]][block->z[block->list[k]] & 7]);
    }
    stats->bricks += count;
    for (uint32_t k = 0; k < count; k++) {
        uint32_t i = block->list[k];
        uint64_t slice = q->bricks[number[k]][block->z[i] & 7];
        block->lit[i] = (uint32_t)(slice >> ((block->x[i] & 7) | (block->y[i] & 7) << 3)) & 1;
    }
}

/* Settles windows whose grid cells are all lit or all shadowed; the others stay in the list. */
static void settle_uniform(const struct umb__query *q, struct umb__block *block,
                           struct umb_query_stats *stats)
{
    uint32_t level = q->log2_size - q->grid_log2, g = q->grid_log2;
    uint32_t total = (uint32_t)(q->taps * q->taps), count = 0;
    int32_t reach = q->taps - 1;
    prefetch_grid(q, block);
    for (uint32_t k = 0; k < block->count; k++) {
        uint32_t i = block->list[k];
        int32_t x0 = block->x[i], y0 = block->y[i];
        const uint32_t *cell = q->grid + umb__grid_index(x0, y0, block->z[i], level, g);
        size_t right = (size_t)((x0 + reach) >> level) - (size_t)(x0 >> level);
        size_t down = ((size_t)((y0 + reach) >> level) - (size_t)(y0 >> level)) << g;
        uint32_t value = cell[0];
        uint32_t differ =
            (value ^ cell[right]) | (value ^ cell[down]) | (value ^ cell[right + down]);
        block->lit[i] = (value & 1) * total;
        block->list[count] = (uint16_t)i;
        count += (value >= UMB__CELL_FIRST) | (differ != 0);
    }
    stats->nodes += block->count - count;
    block->count = count;
}

/* Lists the level-5 cells that the windows touch, each once. */
static uint32_t list_cells(const struct umb__query *q, const struct umb__block *block,
                           struct umb__cells *cells)
{
    int32_t reach = q->taps - 1;
    uint32_t count = 0;
    for (uint32_t k = 0; k < block->count; k++) {
        uint32_t i = block->list[k];
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
    uint32_t level = q->log2_size - q->grid_log2, g = q->grid_log2, left = 0;
    stats->nodes += count;
    for (uint32_t k = 0; k < count; k++) {
        uint32_t slot = cells->slot[k];
        struct umb__voxel v = umb__cell_corner(block, slot);
        uint32_t value = q->grid[umb__grid_index(v.x, v.y, v.z, level, g)];
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

/* Finds the slices of all bricks that the windows touch, `side` each way; slot 16 * k + brick. */
static inline __attribute__((always_inline)) void find_slices(const struct umb__query *q,
                                                              const struct umb__block *block,
                                                              const struct umb__cells *cells,
                                                              uint32_t side, const uint64_t **slice,
                                                              struct umb_query_stats *stats)
{
    const uint32_t *child[9 * UMB__BLOCK];
    uint16_t slot[9 * UMB__BLOCK];
    uint32_t left = 0, reach = (uint32_t)q->taps - 1;
    for (uint32_t k = 0; k < block->count; k++) {
        uint32_t i = block->list[k];
        uint32_t x = (uint32_t)block->x[i], y = (uint32_t)block->y[i], z = (uint32_t)block->z[i];
        for (uint32_t b = 0; b < side * side; b++) {
            uint32_t bx = umb__least((x >> 3) + b % side, (x + reach) >> 3);
            uint32_t by = umb__least((y >> 3) + b / side, (y + reach) >> 3);
            const uint64_t *node =
                cells->node[4 * i + ((bx >> 2) - (x >> 5)) + 2 * ((by >> 2) - (y >> 5))];
            unsigned bit = (bx & 3) | (by & 3) << 2 | (z >> 3 & 3) << 4;
            slice[16 * k + b] = umb__uniform_slices + (node[1] >> bit & 1);
            slot[left] = (uint16_t)(16 * k + b);
            child[left] = umb__child_place(node, bit);
            UMB__PREFETCH(child[left]);
            left += (uint32_t)(node[0] >> bit & 1);
        }
    }
    stats->bricks += left;
    for (uint32_t k = 0; k < left; k++) {
        int32_t z = block->z[block->list[slot[k] / 16]];
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
    for (uint32_t k = 0; k < block->count; k++) {
        uint32_t i = block->list[k], lit = 0;
        uint32_t columns = window << (block->x[i] & 7), rows = window << (block->y[i] & 7);
        for (uint32_t r = 0; r < side; r++) {
            uint64_t row_mask = umb__spread(rows >> 8 * r & 0xff);
            for (uint32_t c = 0; c < side; c++) {
                uint64_t mask = row_mask & (columns >> 8 * c & 0xff) * UMB__EVERY_BYTE;
                lit += (uint32_t)__builtin_popcountll(*slice[16 * k + side * r + c] & mask);
            }
        }
        block->lit[i] = lit;
    }
}

static void count_windows(const struct umb__query *q, struct umb__block *block,
                          struct umb_query_stats *stats)
{
    struct umb__cells cells;
    settle_uniform(q, block, stats);
    find_cells(q, block, list_cells(q, block, &cells), &cells, stats);
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
    for (size_t end = first + count; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__PLACE(query, points, first, &block, &stats);
        if (query->taps == 1) {
            count_points(query, &block, &stats);
        } else {
            count_windows(query, &block, &stats);
        }
        umb__store_block(query, &block, first, answers->values);
    }
    umb__add_stats(&stats, &answers->stats);
}
