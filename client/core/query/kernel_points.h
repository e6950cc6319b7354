/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_POINTS_H
#define UMBRAGE_CORE_QUERY_KERNEL_POINTS_H
/*
 * One tap: the points of a block go down from their columns to their bricks, level by level.
 *
 * Who is still on the way stands in a list, and a stage writes the next stage's list over its own:
 * it puts every point at the end and moves the end if the point goes on, so nothing branches on
 * data. What a stage needs of a point's position, it computes for the whole block beforehand, in
 * loops that compilers make vectors of.
 */
#include "query/kernel_runs.h"

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

/* Points not to be looked up are at voxel 0, 0, 0 and go with the others: what is read for them is
 * thrown away. From columns to pieces, and to the nodes or bricks that these are. */
static inline void umb__enter_columns(const struct umb__query *q, struct umb__block *block,
                                      struct umb__descent *points)
{
    const uint32_t c = q->column_level, row = q->log2_size - c, padded = umb__padded(block);
    uint32_t index[UMB__BLOCK], value[UMB__BLOCK], left = 0;
    uint64_t column[UMB__BLOCK];
    for (uint32_t i = 0; i < padded; i++) {
        index[i] = ((uint32_t)block->x[i] >> c) + ((uint32_t)block->y[i] >> c << row);
    }
    for (uint32_t i = 0; i < padded; i++) {
        memcpy(&column[i], q->columns + index[i], sizeof column[i]);
    }
    for (uint32_t i = 0; i < padded; i++) {
        index[i] = umb__piece_of(column[i], (uint32_t)block->z[i] >> c);
    }
    for (uint32_t i = 0; i < padded; i++) {
        value[i] = q->pieces[index[i]];
    }
    if (umb__count_bits(block->todo) == UMB__BLOCK) {
        for (uint32_t i = 0; i < UMB__BLOCK; i++) {
            block->lit[i] = value[i] & 1;
        }
        for (uint32_t i = 0; i < UMB__BLOCK; i++) {
            points->slot[left] = (uint8_t)i;
            points->number[left] = value[i] - UMB__CELL_FIRST;
            left += value[i] >= UMB__CELL_FIRST;
        }
    } else {
        for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
            uint32_t i = umb__first_bit(rest);
            block->lit[i] = value[i] & 1;
            points->slot[left] = (uint8_t)i;
            points->number[left] = value[i] - UMB__CELL_FIRST;
            left += value[i] >= UMB__CELL_FIRST;
        }
    }
    for (uint32_t k = 0; k < left; k++) {
        UMB__PREFETCH(c > UMB_LEVEL_BRICK ? q->nodes + points->number[k]
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

/* From columns to bricks, level by level; points settled on the way leave the list. */
static inline void umb__descend(const struct umb__query *q, struct umb__block *block,
                                struct umb__descent *points, struct umb_query_stats *stats)
{
    uint32_t level = q->column_level;
    stats->nodes += umb__count_bits(block->todo);
    umb__enter_columns(q, block, points);
    while (level > UMB_LEVEL_BRICK && points->count > 0) {
        level -= 2;
        stats->nodes += points->count;
        umb__enter_children(q, block, level, points);
    }
    stats->bricks += points->count;
}

/* Answers a block whose points are all in one cube of the columns' level, if that is uniform. */
static inline bool umb__settle_cube(const struct umb__query *q, struct umb__block *block,
                                    struct umb_query_stats *stats)
{
    const uint32_t c = q->column_level, row = q->log2_size - c;
    uint64_t column;
    memcpy(&column, q->columns + ((uint32_t)block->x[0] >> c) + ((uint32_t)block->y[0] >> c << row),
           sizeof column);
    const uint32_t value = q->pieces[umb__piece_of(column, (uint32_t)block->z[0] >> c)];
    if (value >= UMB__CELL_FIRST) {
        return false;
    }
    for (uint32_t i = 0; i < UMB__BLOCK; i++) {
        block->lit[i] = value;
    }
    stats->nodes++;
    return true;
}

/* Answers a block whose points share bricks: only the heads of its runs go down. */
static inline void umb__count_runs(const struct umb__query *q, struct umb__block *block,
                                   uint64_t starts, struct umb_query_stats *stats)
{
    struct umb__block heads;
    struct umb__runs runs;
    struct umb__descent points;
    const uint64_t *brick[UMB__BLOCK];
    umb__take_heads(q, block, starts, &heads, &runs);
    umb__descend(q, &heads, &points, stats);
    for (uint32_t h = 0; h < runs.count; h++) {
        brick[h] = umb__uniform_bricks[heads.lit[h] & 1];
    }
    for (uint32_t k = 0; k < points.count; k++) {
        brick[points.slot[k]] = q->bricks[points.number[k]];
    }
    UMB__READ_RUNS(block, &heads, &runs, brick);
}

static inline void umb__count_points(const struct umb__query *q, struct umb__block *block,
                                     struct umb_query_stats *stats)
{
    struct umb__descent points;
    struct umb__closeness close = UMB__COMPARE_POINTS(block, q->column_level);
    if (close.one_cube && umb__settle_cube(q, block, stats)) {
        return;
    }
    uint64_t starts = umb__run_starts(block, close.changes);
    if (umb__count_bits(starts) <= UMB__RUNS_MAX) {
        umb__count_runs(q, block, starts, stats);
    } else {
        umb__descend(q, block, &points, stats);
        umb__read_bricks(q, block, &points);
    }
}

#endif
