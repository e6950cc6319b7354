/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_POINTS_H
#define UMBRAGE_CORE_QUERY_KERNEL_POINTS_H
/*
 * One tap: the points of a block go down from the grid to their bricks, level by level.
 *
 * Who is still on the way stands in a list, and a stage writes the next stage's list over its own:
 * it puts every point at the end and moves the end if the point goes on, so nothing branches on
 * data. What a stage needs of a point's position, it computes for the whole block beforehand, in
 * loops that compilers make vectors of.
 */
#include "query/kernel_parts.h"

/* Points on their way down, and the node or brick that each has reached. */
struct umb__descent {
    uint32_t count;
    uint8_t slot[UMB__BLOCK];
    uint32_t number[UMB__BLOCK];
};

/* Points of a block, rounded up to what vectors hold; all stages fill as many. */
static inline uint32_t umb__padded(const struct umb__block *block)
{
    return (block->size + 7) & ~7U;
}

static inline void umb__start_descent(const struct umb__block *block, struct umb__descent *points)
{
    uint32_t count = 0;
    if (umb__count_bits(block->todo) == UMB__BLOCK) {
        for (; count < UMB__BLOCK; count++) {
            points->slot[count] = (uint8_t)count;
        }
    }
    for (uint64_t rest = count ? 0 : block->todo; rest; rest &= rest - 1) {
        points->slot[count++] = (uint8_t)umb__first_bit(rest);
    }
    points->count = count;
}

/* From the grid's cells, `level` high, to nodes or bricks. */
static inline void umb__enter_cells(const struct umb__query *q, struct umb__block *block,
                                    uint32_t level, struct umb__descent *points)
{
    uint32_t index[UMB__BLOCK], g = q->grid_log2, left = 0;
    for (uint32_t i = 0; i < umb__padded(block); i++) {
        index[i] = ((uint32_t)block->x[i] >> level) + ((uint32_t)block->y[i] >> level << g) +
                   ((uint32_t)block->z[i] >> level << (2 * g));
    }
    for (uint32_t k = 0; k < points->count; k++) {
        UMB__PREFETCH(q->grid + index[points->slot[k]]);
    }
    for (uint32_t k = 0; k < points->count; k++) {
        uint32_t i = points->slot[k], value = q->grid[index[i]];
        block->lit[i] = value & 1;
        points->slot[left] = (uint8_t)i;
        points->number[left] = value - UMB__CELL_FIRST;
        left += value >= UMB__CELL_FIRST;
    }
    for (uint32_t k = 0; k < left; k++) {
        UMB__PREFETCH(level > UMB_LEVEL_BRICK ? q->nodes + points->number[k]
                                              : q->bricks[points->number[k]]);
    }
    points->count = left;
}

/*
 * From nodes to their children of `level`. With the masks shifted so that the child's bit is the
 * highest, that bit is its state, and as many bits as are left up to it is where its number stands
 * in the list; if it is not mixed, what is read is within the node and thrown away.
 */
static inline void umb__enter_children(const struct umb__query *q, struct umb__block *block,
                                       uint32_t level, struct umb__descent *points)
{
    uint32_t above[UMB__BLOCK], left = 0; /* children behind the point's own: 63 - bit */
    const uint32_t *child[UMB__BLOCK];
    for (uint32_t i = 0; i < umb__padded(block); i++) {
        above[i] = umb__child_bit(block->x[i], block->y[i], block->z[i], level) ^ 63;
    }
    for (uint32_t k = 0; k < points->count; k++) {
        uint32_t i = points->slot[k];
        const uint64_t *node = q->nodes + points->number[k];
        uint64_t mixed = node[0] << above[i], lit = node[1] << above[i];
        const uint32_t *numbers = (const uint32_t *)(const void *)node + 3; /* counted from 1 */
        block->lit[i] = (uint32_t)(lit >> 63);
        points->slot[left] = (uint8_t)i;
        child[left] = numbers + umb__count_bits(mixed);
        UMB__PREFETCH(child[left]);
        left += (uint32_t)(mixed >> 63);
    }
    for (uint32_t k = 0; k < left; k++) {
        points->number[k] = *child[k];
        UMB__PREFETCH(level > UMB_LEVEL_BRICK ? q->nodes + *child[k] : q->bricks[*child[k]]);
    }
    points->count = left;
}

static inline void umb__read_bricks(const struct umb__query *q, struct umb__block *block,
                                    const struct umb__descent *points)
{
    uint32_t bit[UMB__BLOCK];
    for (uint32_t i = 0; i < umb__padded(block); i++) {
        bit[i] = ((uint32_t)block->x[i] & 7) | ((uint32_t)block->y[i] & 7) << 3;
    }
    for (uint32_t k = 0; k < points->count; k++) {
        uint32_t i = points->slot[k];
        uint64_t slice = q->bricks[points->number[k]][block->z[i] & 7];
        block->lit[i] = (uint32_t)(slice >> bit[i] & 1);
    }
}

static inline void umb__count_points(const struct umb__query *q, struct umb__block *block,
                                     struct umb_query_stats *stats)
{
    struct umb__descent points;
    uint32_t level = q->log2_size - q->grid_log2;
    umb__start_descent(block, &points);
    stats->nodes += points.count;
    umb__enter_cells(q, block, level, &points);
    while (level > UMB_LEVEL_BRICK && points.count > 0) {
        level -= 2;
        stats->nodes += points.count;
        umb__enter_children(q, block, level, &points);
    }
    stats->bricks += points.count;
    umb__read_bricks(q, block, &points);
}

#endif
