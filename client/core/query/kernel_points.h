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

/* Heads are merged, and stand for more than a run, where that is a step of the kernel. */
#ifndef UMB__MERGE_HEADS
#define UMB__MERGE_HEADS(spread, heads, runs) ((void)(spread))
#define UMB__RUNS_OF(runs, heads)             ((void)(runs), umb__count_bits(heads))
#endif

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

/* Point i has met a piece of this value: it is settled, or goes on to a node or a brick, which is
 * asked for at once and not in a loop of its own: with some ten lines on their way from memory a
 * core has no room for more, and while it waits it can compute what the next points need. */
static inline void umb__enter_piece(const struct umb__query *q, struct umb__block *block,
                                    uint32_t i, uint32_t value, struct umb__descent *points)
{
    const uint32_t mixed = value >= UMB__CELL_FIRST, number = value - UMB__CELL_FIRST;
    const uint64_t asked = umb__select(mixed, number, 0);
    block->lit[i] = value & 1;
    points->slot[points->count] = (uint8_t)i;
    points->number[points->count] = number;
    points->count += mixed;
    UMB__PREFETCH(q->column_level > UMB_LEVEL_BRICK ? q->nodes + asked : q->bricks[asked]);
}

/* Points not to be looked up are at voxel 0, 0, 0 and go with the others: what is read for them is
 * thrown away. From columns to pieces, and to the nodes or bricks that these are. */
static inline void umb__enter_columns(const struct umb__query *q, struct umb__block *block,
                                      struct umb__descent *points)
{
    const uint32_t c = q->column_level, row = q->log2_size - c, padded = umb__padded(block);
    uint32_t index[UMB__BLOCK], value[UMB__BLOCK];
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
    points->count = 0;
    if (umb__count_bits(block->todo) == UMB__BLOCK) {
        for (uint32_t i = 0; i < UMB__BLOCK; i++) {
            umb__enter_piece(q, block, i, value[i], points);
        }
    } else {
        for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
            uint32_t i = umb__first_bit(rest);
            umb__enter_piece(q, block, i, value[i], points);
        }
    }
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

/* A mixed cube, and a voxel in it. */
struct umb__cube {
    uint32_t level, number; /* of its node, or brick */
    int32_t x, y, z;
};

/* What a block's points have in common. */
struct umb__common {
    bool found;            /* else every point begins at its column */
    struct umb__cube cube; /* around all of them */
    struct umb__cube last; /* the smallest with a node around the last block that had one; level 0:
                              none yet */
};

/* Settles a whole block. */
static inline void umb__fill_block(struct umb__block *block, uint32_t lit)
{
    for (uint32_t i = 0; i < UMB__BLOCK; i++) {
        block->lit[i] = lit;
    }
}

/* Where the way down of a block begins whose points are all in one cube of the columns' level: at
 * the cube of the last block, if they are in that one, too. A uniform cube has its state as number,
 * others have theirs plus UMB__CELL_FIRST. */
static inline struct umb__cube umb__begin_together(const struct umb__query *q,
                                                   const struct umb__block *block, uint32_t spread,
                                                   const struct umb__cube *last)
{
    const uint32_t c = q->column_level, row = q->log2_size - c;
    struct umb__cube cube = {c, 0, block->x[0], block->y[0], block->z[0]};
    const uint32_t apart = spread | (uint32_t)(cube.x ^ last->x) | (uint32_t)(cube.y ^ last->y) |
                           (uint32_t)(cube.z ^ last->z);
    if (last->level != 0 && apart >> last->level == 0) {
        cube.level = last->level;
        cube.number = last->number + UMB__CELL_FIRST;
        return cube;
    }
    uint64_t column;
    memcpy(&column, q->columns + ((uint32_t)cube.x >> c) + ((uint32_t)cube.y >> c << row),
           sizeof column);
    cube.number = q->pieces[umb__piece_of(column, (uint32_t)cube.z >> c)];
    return cube;
}

/* Goes down with the first point for as long as all others are in the same cubes. Answers the block
 * and returns true if one of these is uniform. Nodes are counted from the column on, wherever the
 * way began: what a batch is said to take does not depend on how it is cut. */
static inline bool umb__descend_together(const struct umb__query *q, struct umb__block *block,
                                         uint32_t spread, struct umb__common *common,
                                         struct umb_query_stats *stats)
{
    common->found = false;
    if (spread >> q->column_level != 0) {
        return false;
    }
    struct umb__cube cube = umb__begin_together(q, block, spread, &common->last);
    while (cube.number >= UMB__CELL_FIRST && cube.level > UMB_LEVEL_BRICK) {
        const uint32_t number = cube.number - UMB__CELL_FIRST;
        common->last = cube;
        common->last.number = number;
        if (spread >> (cube.level - 2) != 0) {
            break;
        }
        const uint64_t *node = q->nodes + number;
        cube.level -= 2;
        const unsigned bit = umb__child_bit(cube.x, cube.y, cube.z, cube.level);
        cube.number = node[0] >> bit & 1 ? *umb__child_place(node, bit) + UMB__CELL_FIRST
                                         : (uint32_t)(node[1] >> bit & 1);
    }
    stats->nodes += 1 + (q->column_level - cube.level) / 2;
    if (cube.number < UMB__CELL_FIRST) {
        umb__fill_block(block, cube.number);
        return true;
    }
    cube.number -= UMB__CELL_FIRST;
    common->cube = cube;
    common->found = true;
    return false;
}

/* What a mixed cube's number leads to, or what stands for a uniform one: a node, or a brick. */
static inline const uint64_t *umb__target(const struct umb__query *q, bool brick, uint64_t mixed,
                                          uint64_t number, uint64_t lit)
{
    /* As integers: of a uniform cube number is any, and there may be no nodes at all. */
    const uintptr_t inner = brick ? (uintptr_t)q->bricks + number * sizeof *q->bricks
                                  : (uintptr_t)q->nodes + number * sizeof *q->nodes;
    const uint64_t *const uniform = brick ? umb__uniform_bricks[lit] : umb__uniform_nodes + 2 * lit;
    return (const uint64_t *)umb__select(mixed, inner, (uintptr_t)uniform);
}

/* From the heads' columns to their nodes, or bricks. Returns who is not settled. */
static inline __attribute__((always_inline)) uint64_t
umb__enter_heads(const struct umb__query *q, const struct umb__block *heads, bool brick,
                 const uint64_t *at[UMB__BLOCK])
{
    const uint32_t c = q->column_level, row = q->log2_size - c;
    uint32_t index[UMB__BLOCK], depth[UMB__BLOCK];
    uint64_t unsettled = 0;
    for (uint32_t i = 0; i < umb__padded(heads); i++) {
        index[i] = ((uint32_t)heads->x[i] >> c) + ((uint32_t)heads->y[i] >> c << row);
        depth[i] = (uint32_t)heads->z[i] >> c;
    }
    for (uint32_t i = 0; i < umb__padded(heads); i++) {
        uint64_t column;
        memcpy(&column, q->columns + index[i], sizeof column);
        const uint32_t value = q->pieces[umb__piece_of(column, depth[i])];
        const uint64_t mixed = value >= UMB__CELL_FIRST;
        at[i] = umb__target(q, brick, mixed, value - UMB__CELL_FIRST, value & 1);
        unsettled |= mixed << i;
    }
    return unsettled & heads->todo;
}

/* From the heads' nodes to their children of `level`, as umb__enter_children does. */
static inline __attribute__((always_inline)) uint64_t
umb__step_heads(const struct umb__query *q, const struct umb__block *heads, uint32_t level,
                bool brick, const uint64_t *at[UMB__BLOCK])
{
    uint32_t above[UMB__BLOCK];
    uint64_t unsettled = 0;
    for (uint32_t i = 0; i < umb__padded(heads); i++) {
        above[i] = umb__child_bit(heads->x[i], heads->y[i], heads->z[i], level) ^ 63;
    }
    for (uint32_t i = 0; i < umb__padded(heads); i++) {
        const uint64_t *node = at[i];
        const uint64_t mixed = node[0] << above[i], lit = node[1] << above[i];
        const uint32_t *numbers = (const uint32_t *)(const void *)node + 3; /* counted from 1 */
        at[i] = umb__target(q, brick, mixed >> 63, numbers[umb__count_bits(mixed)], lit >> 63);
        unsettled |= mixed >> 63 << i;
    }
    return unsettled & heads->todo;
}

/*
 * The brick of every head, a uniform one where it is settled above. Heads are few: all go down all
 * levels, eight at a time, and what is settled goes on through a uniform node, so that no branch
 * depends on who is.
 */
static inline void umb__find_bricks_of(const struct umb__query *q, const struct umb__block *heads,
                                       const struct umb__runs *runs,
                                       const struct umb__common *common,
                                       const uint64_t *brick[UMB__BLOCK],
                                       struct umb_query_stats *stats)
{
    uint32_t level = common->found ? common->cube.level : q->column_level;
    uint64_t unsettled = heads->todo;
    if (common->found) {
        const uint64_t *at = umb__target(q, level == UMB_LEVEL_BRICK, 1, common->cube.number, 0);
        for (uint32_t i = 0; i < umb__padded(heads); i++) {
            brick[i] = at;
        }
    } else {
        stats->nodes += UMB__RUNS_OF(runs, unsettled);
        unsettled = level == UMB_LEVEL_BRICK ? umb__enter_heads(q, heads, true, brick)
                                             : umb__enter_heads(q, heads, false, brick);
    }
    while (level > UMB_LEVEL_BRICK) {
        level -= 2;
        stats->nodes += UMB__RUNS_OF(runs, unsettled);
        unsettled = level == UMB_LEVEL_BRICK ? UMB__STEP_HEADS(q, heads, level, true, brick)
                                             : UMB__STEP_HEADS(q, heads, level, false, brick);
    }
    stats->bricks += UMB__RUNS_OF(runs, unsettled);
}

/* Answers a block whose points share bricks: only the heads of its runs go down. */
static inline void umb__count_runs(const struct umb__query *q, struct umb__block *block,
                                   uint64_t starts, uint32_t spread,
                                   const struct umb__common *common, struct umb_query_stats *stats)
{
    struct umb__block heads;
    struct umb__runs runs;
    const uint64_t *brick[UMB__BLOCK];
    UMB__TAKE_HEADS(q, block, starts, &heads, &runs);
    UMB__MERGE_HEADS(spread, &heads, &runs);
    umb__find_bricks_of(q, &heads, &runs, common, brick, stats);
    UMB__READ_RUNS(block, &heads, &runs, brick);
}

/* Answers a block. common: all zero before the first; kept from block to block. */
static inline void umb__count_points(const struct umb__query *q, struct umb__block *block,
                                     struct umb__common *common, struct umb_query_stats *stats)
{
    struct umb__closeness close = UMB__COMPARE_POINTS(block);
    if (umb__descend_together(q, block, close.spread, common, stats)) {
        return;
    }
    if (common->found && common->cube.level == UMB_LEVEL_BRICK) {
        UMB__READ_BRICK(block, q->bricks[common->cube.number]);
        stats->bricks++;
        return;
    }
    uint64_t starts = umb__run_starts(block, close.changes);
    if (umb__count_bits(starts) <= UMB__RUNS_MAX) {
        umb__count_runs(q, block, starts, close.spread, common, stats);
    } else {
        struct umb__descent points;
        umb__descend(q, block, &points, stats);
        umb__read_bricks(q, block, &points);
    }
}

#endif
