/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_DESCENT_H
#define UMBRAGE_CORE_QUERY_KERNEL_DESCENT_H
/*
 * Looks up one tap of scattered points: the points of a block descend from their columns to their
 * bricks, level by level.
 *
 * A list holds the points that are not settled yet, and a stage overwrites it with the next stage's
 * list. The stage writes every point at the list's end and advances the end only if the point goes
 * on, so no branch depends on data. Values that depend on a point's position are computed for the
 * whole block first, in loops that compilers vectorise.
 *
 * A level takes two stages: "look" reads the nodes to find the places of the children's numbers,
 * and "ask" prefetches the nodes that these numbers name. "Look" computes and "ask" waits, since a
 * core has some ten outstanding cache misses at most. So two blocks descend at a time: while one
 * asks, point by point, the other looks.
 */
#include "query/kernel_parts.h"

/* A block during its descent. */
struct umb__descent {
    struct umb__block block;
    size_t first;                      /* Index in the batch of its first point */
    uint32_t level;                    /* Level of the nodes or bricks that its points have
                                          reached */
    uint32_t count;                    /* Number of points that are not settled */
    uint8_t slot[UMB__BLOCK];          /* List of these points, as indices in the block */
    const uint32_t *child[UMB__BLOCK]; /* By list: address of the number of the node or brick */
    uint32_t number[UMB__BLOCK];       /* By list: that number, once it is read */
};

/* The two blocks whose points descend at a time. */
struct umb__descents {
    const struct umb__query *query;
    void *values;                 /* Answers of the batch */
    struct umb__descent *free;    /* Place where the next block is copied to */
    struct umb__descent *looking; /* Block that has finished "look" and not begun "ask"; or NULL */
    struct umb__descent both[2];  /* Storage of the blocks */
    struct umb__descent none;     /* Block without points, which stands for an absent one */
};

static inline void umb__begin_descents(const struct umb__query *q, void *values,
                                       struct umb__descents *descents)
{
    descents->query = q;
    descents->values = values;
    descents->free = &descents->both[0];
    descents->looking = &descents->none;
    descents->none.block.size = 0;
    descents->none.count = 0;
    descents->none.level = UMB_LEVEL_BRICK;
}

/* Returns a block's number of points, rounded up to whole vectors, which all stages fill. */
static inline uint32_t umb__padded(const struct umb__block *block)
{
    return (block->size + 7) & ~7U;
}

/* Enters the piece of its column (format/view.h) that point i has reached. A uniform piece settles
 * the point; the node or brick of a mixed piece is prefetched at once. A loop of prefetches alone
 * would be slower: a core has some ten outstanding misses at most, and can compute the next points
 * while it waits. */
static inline void umb__enter_piece(const struct umb__query *q, uint32_t i, uint32_t value,
                                    struct umb__descent *points)
{
    const uint32_t mixed = value >= UMB__CELL_FIRST, number = value - UMB__CELL_FIRST;
    const uint64_t asked = umb__select(mixed, number, 0);
    points->block.lit[i] = value & 1;
    points->slot[points->count] = (uint8_t)i;
    points->number[points->count] = number;
    points->count += mixed;
    UMB__PREFETCH(q->column_level > UMB_LEVEL_BRICK ? q->nodes + asked : q->bricks[asked]);
}

/* Finds the piece of each point in the point's column, and the node or brick that the piece names.
 * Points without a look-up are at voxel 0, 0, 0 and go with the others; their reads are
 * discarded. */
static inline void umb__enter_columns(const struct umb__query *q, struct umb__descent *points)
{
    const struct umb__block *block = &points->block;
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
    points->level = c;
    if (umb__count_bits(block->todo) == UMB__BLOCK) {
        for (uint32_t i = 0; i < UMB__BLOCK; i++) {
            umb__enter_piece(q, i, value[i], points);
        }
    } else {
        for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
            uint32_t i = umb__first_bit(rest);
            umb__enter_piece(q, i, value[i], points);
        }
    }
}

/*
 * Looks in the node of point k of the list for the child that contains the point. Returns the
 * list's new end. The masks are shifted until the child's bit is the highest one. That bit is then
 * the child's state, and the number of bits left in `mixed` gives the place of the child's number
 * in the node. For a child that is not mixed the read stays within the node and is discarded.
 * above: number of children behind the point's child, 63 - bit.
 */
static inline uint32_t umb__look(const struct umb__query *q, struct umb__descent *points,
                                 const uint32_t above[UMB__BLOCK], uint32_t k, uint32_t left)
{
    const uint32_t i = points->slot[k];
    const uint64_t *node = q->nodes + points->number[k];
    const uint64_t mixed = node[0] << above[i], lit = node[1] << above[i];
    const uint32_t *numbers = (const uint32_t *)(const void *)node + 3; /* counted from 1 */
    points->block.lit[i] = (uint32_t)(lit >> 63);
    points->slot[left] = (uint8_t)i;
    points->child[left] = numbers + umb__count_bits(mixed);
    UMB__PREFETCH(points->child[left]);
    return left + (uint32_t)(mixed >> 63);
}

/* Reads the number of the node or brick below point k of the list, and prefetches it. */
static inline void umb__ask(const struct umb__query *q, struct umb__descent *points, uint32_t k)
{
    const uint32_t number = points->number[k] = *points->child[k];
    UMB__PREFETCH(points->level > UMB_LEVEL_BRICK ? q->nodes + number : q->bricks[number]);
}

/* Advances two blocks by one stage. Block `asks` reads the numbers of its next nodes and prefetches
 * these nodes; block `looks` finds its children on the level below. */
static inline void umb__step_both(const struct umb__query *q, struct umb__descent *asks,
                                  struct umb__descent *looks, struct umb_query_stats *stats)
{
    const struct umb__block *block = &looks->block;
    const uint32_t both = umb__least(asks->count, looks->count), count = looks->count;
    uint32_t above[UMB__BLOCK], left = 0;
    stats->nodes += count;
    looks->level -= 2;
    for (uint32_t i = 0; i < umb__padded(block); i++) {
        above[i] = umb__child_bit(block->x[i], block->y[i], block->z[i], looks->level) ^ 63;
    }
    for (uint32_t k = 0; k < both; k++) {
        left = umb__look(q, looks, above, k, left);
        umb__ask(q, asks, k);
    }
    for (uint32_t k = both; k < count; k++) {
        left = umb__look(q, looks, above, k, left);
    }
    for (uint32_t k = both; k < asks->count; k++) {
        umb__ask(q, asks, k);
    }
    looks->count = left;
}

static inline void umb__read_bricks(const struct umb__query *q, struct umb__descent *points)
{
    struct umb__block *block = &points->block;
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

/* Answers a block whose bricks are prefetched. */
static inline void umb__arrive(const struct umb__descents *descents, struct umb__descent *points,
                               struct umb_query_stats *stats)
{
    stats->bricks += points->count;
    umb__read_bricks(descents->query, points);
    umb__store_block(descents->query, &points->block, points->first, descents->values);
}

/* Copies a block lane by lane, in vectors. Compilers would copy the structure word by word. */
static inline void umb__copy_block(const struct umb__block *from, struct umb__block *to)
{
    to->size = from->size;
    to->todo = from->todo;
    for (uint32_t i = 0; i < UMB__BLOCK; i++) {
        to->x[i] = from->x[i];
        to->y[i] = from->y[i];
        to->z[i] = from->z[i];
        to->lit[i] = from->lit[i];
    }
}

/* Copies a block and starts the copy's descent; finishes the descent of the block before. In:
 * first: index in the batch of the block's first point. This function and the next are not inlined,
 * and the block is copied, because the loop over blocks whose points share their descent is then
 * faster. */
static __attribute__((noinline)) void umb__descend(struct umb__descents *descents,
                                                   const struct umb__block *block, size_t first,
                                                   struct umb_query_stats *stats)
{
    const struct umb__query *q = descents->query;
    struct umb__descent *asks = descents->looking, *looks = descents->free;
    umb__copy_block(block, &looks->block);
    looks->first = first;
    stats->nodes += umb__count_bits(looks->block.todo);
    umb__enter_columns(q, looks);
    if (looks->level == UMB_LEVEL_BRICK) {
        umb__arrive(descents, looks, stats);
        return;
    }
    umb__step_both(q, asks, looks, stats);
    while (asks->level > UMB_LEVEL_BRICK) {
        struct umb__descent *asked = asks;
        asks = looks;
        looks = asked;
        umb__step_both(q, asks, looks, stats);
    }
    descents->looking = looks;
    if (asks == &descents->none) {
        descents->free = &descents->both[looks == &descents->both[0]];
    } else {
        umb__arrive(descents, asks, stats);
        descents->free = asks;
    }
}

/* Finishes the descent of the last block. */
static __attribute__((noinline)) void umb__end_descents(struct umb__descents *descents,
                                                        struct umb_query_stats *stats)
{
    struct umb__descent *last = descents->looking, *none = &descents->none;
    if (last == none) {
        return;
    }
    umb__step_both(descents->query, last, none, stats);
    while (last->level > UMB_LEVEL_BRICK) {
        umb__step_both(descents->query, none, last, stats);
        umb__step_both(descents->query, last, none, stats);
    }
    umb__arrive(descents, last, stats);
    none->level = UMB_LEVEL_BRICK;
    descents->looking = none;
}

#endif
