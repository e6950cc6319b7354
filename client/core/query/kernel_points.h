/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_POINTS_H
#define UMBRAGE_CORE_QUERY_KERNEL_POINTS_H
/* Answers queries of one tap. Points that share bricks are answered by runs (kernel_runs.h),
 * scattered points by a descent for each (kernel_descent.h). */
#include "query/kernel_descent.h"
#include "query/kernel_runs.h"

/* A mixed cube, and a voxel in it. */
struct umb__cube {
    uint32_t level;
    uint32_t number; /* Number of the cube's node or brick */
    int32_t x, y, z; /* Index of the voxel */
};

/* What the descents of a block's points share. */
struct umb__common {
    bool found;            /* True: `cube` is around all points; false: each descent begins at the
                              point's column */
    struct umb__cube cube; /* Cube at which the descent of each point begins */
    struct umb__cube last; /* Smallest mixed cube around all points of the latest block that had
                              one; level 0: none yet */
};

/* Settles a whole block. */
static inline void umb__fill_block(struct umb__block *block, uint32_t lit)
{
    for (uint32_t i = 0; i < UMB__BLOCK; i++) {
        block->lit[i] = lit;
    }
}

/* Returns the cube at which the descent of a block begins. In: a block whose points are all in one
 * cube of the columns' level; last: cube of an earlier block. If all points are in `last`, the
 * descent begins there. The result's `number` is the state of a uniform cube, or UMB__CELL_FIRST
 * plus the number of a node or
 * brick. */
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

/* Descends from cube to cube as long as one cube contains all points of the block. If a cube is
 * uniform, answers the block and returns true. Nodes are counted from the column on, wherever the
 * descent began, so that counts do not depend on how a batch is cut. */
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

/* Returns the address of a mixed cube's node or brick. For a uniform cube it returns a constant
 * node or brick of the cube's state. */
static inline const uint64_t *umb__target(const struct umb__query *q, bool brick, uint64_t mixed,
                                          uint64_t number, uint64_t lit)
{
    /* Addresses are computed as integers: a uniform cube may have any number, and there may be no
     * nodes at all. */
    const uintptr_t inner = brick ? (uintptr_t)q->bricks + (uintptr_t)(number * sizeof *q->bricks)
                                  : (uintptr_t)q->nodes + (uintptr_t)(number * sizeof *q->nodes);
    const uint64_t *const uniform = brick ? umb__uniform_bricks[lit] : umb__uniform_nodes + 2 * lit;
    return (const uint64_t *)umb__select(mixed, inner, (uintptr_t)uniform);
}

/* Finds, in the columns, the nodes or bricks of the heads of runs (kernel_runs.h). Returns the
 * heads that are not settled. */
UMB__INLINE uint64_t umb__enter_heads(const struct umb__query *q, const struct umb__block *heads,
                                      bool brick, const uint64_t *at[UMB__BLOCK])
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

/* Finds the children of `level` of the nodes of run heads (kernel_runs.h), as umb__enter_children
 * does for points. */
UMB__INLINE uint64_t umb__step_heads(const struct umb__query *q, const struct umb__block *heads,
                                     uint32_t level, bool brick, const uint64_t *at[UMB__BLOCK])
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
 * Finds the brick of every head. A head that is settled above the bricks gets a uniform brick.
 * Heads are few: all descend all levels, eight at a time. A settled head descends through a uniform
 * node, so that no branch depends on it.
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

/* Answers a block whose points share bricks. Only the heads of the block's runs descend. */
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

/* Answers a block and returns true; returns false if the block's points are scattered. common: all
 * zero before the first block, then passed from block to block. */
static inline bool umb__count_points(const struct umb__query *q, struct umb__block *block,
                                     struct umb__common *common, struct umb_query_stats *stats)
{
    struct umb__closeness close = UMB__COMPARE_POINTS(block);
    if (umb__descend_together(q, block, close.spread, common, stats)) {
        return true;
    }
    if (common->found && common->cube.level == UMB_LEVEL_BRICK) {
        UMB__READ_BRICK(block, q->bricks[common->cube.number]);
        stats->bricks++;
        return true;
    }
    uint64_t starts = umb__run_starts(block, close.changes);
    if (umb__count_bits(starts) > UMB__RUNS_MAX) {
        return false;
    }
    umb__count_runs(q, block, starts, close.spread, common, stats);
    return true;
}

/* Answers a block at once, or starts a descent that ends while later blocks are answered. In:
 * first: index in the batch of the block's first point. Answers are stored in the points' order. */
static inline void umb__answer_points(const struct umb__query *q, struct umb__block *block,
                                      size_t first, void *values, struct umb__common *common,
                                      struct umb__descents *descents, struct umb_query_stats *stats)
{
    if (!umb__count_points(q, block, common, stats)) {
        umb__descend(descents, block, first, stats);
        return;
    }
    if (descents->looking != &descents->none) {
        umb__end_descents(descents, stats);
    }
    umb__store_block(q, block, first, values);
}

#endif
