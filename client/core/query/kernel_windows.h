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
#include "query/kernel_tent_steps.h"
#include "query/kernel_window_steps.h"

/* Lists the level-5 cells that the windows touch. With `share`, consecutive windows that begin in
 * the same cell share slots; the slots then have all cells that any of these windows touches. */
UMB__INLINE uint32_t list_cells(const struct umb__query *q, const struct umb__block *block,
                                bool share, struct umb__cells *cells)
{
    const int32_t reach = q->taps - 1;
    int32_t x = -1, y = -1, z = -1; /* Cell in which the windows before began */
    uint32_t count = 0, first = 0, slot = 0, right = 0, down = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        const uint32_t i = umb__first_bit(rest);
        const int32_t cx = block->x[i] >> UMB__SHARE_LEVEL, cy = block->y[i] >> UMB__SHARE_LEVEL;
        const int32_t cz = block->z[i] >> UMB__SHARE_LEVEL;
        const uint32_t same = share && ((cx ^ x) | (cy ^ y) | (cz ^ z)) == 0;
        first = (uint32_t)umb__select(same, first, count);
        slot = (uint32_t)umb__select(same, slot, 4 * i);
        right &= 0 - same;
        down &= 0 - same;
        right |= (uint32_t)(((block->x[i] + reach) >> UMB__SHARE_LEVEL) - cx);
        down |= (uint32_t)(((block->y[i] + reach) >> UMB__SHARE_LEVEL) - cy);
        cells->of[i] = (uint8_t)(slot / 4);
        cells->slot[first] = (uint16_t)slot;
        count = first + 1;
        cells->slot[count] = (uint16_t)(slot + 1);
        count += right;
        cells->slot[count] = (uint16_t)(slot + 2);
        count += down;
        cells->slot[count] = (uint16_t)(slot + 3);
        count += right & down;
        x = cx;
        y = cy;
        z = cz;
    }
    return count;
}

/* Finds the node of every listed cell. A uniform cell gets the constant node of its state. */
static void find_cells(const struct umb__query *q, const struct umb__block *block, uint32_t count,
                       struct umb__cells *cells, struct umb_query_stats *stats)
{
    const uint64_t *const nodes[2] = {umb__uniform_nodes, q->nodes};
    const uint32_t *child[4 * UMB__BLOCK];
    uint32_t level = q->column_level, row = q->log2_size - level, left = 0;
    uint8_t steps = 1;
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
        cells->steps[slot] = steps;
        UMB__PREFETCH(cells->node[slot]);
        cells->slot[left] = (uint16_t)slot;
        left += mixed;
    }
    while (level > UMB__SHARE_LEVEL) {
        level -= 2;
        count = left;
        left = 0;
        steps++;
        stats->nodes += count;
        for (uint32_t k = 0; k < count; k++) {
            uint32_t slot = cells->slot[k];
            struct umb__voxel v = umb__cell_corner(block, slot);
            const uint64_t *node = cells->node[slot];
            unsigned bit = umb__child_bit(v.x, v.y, v.z, level);
            cells->node[slot] = umb__uniform_nodes + 2 * (node[1] >> bit & 1);
            cells->steps[slot] = steps;
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
    for (uint32_t k = 0; k < left; k++) {
        cells->steps[cells->slot[k]] = (uint8_t)(steps + 1);
    }
    stats->nodes += left;
}

#define KNOWN_LOG2  8U
#define KNOWN_CELLS (1U << KNOWN_LOG2)

/* A cache of the nodes of cells that were found for earlier blocks. A hash of the cell's key gives
 * its place; key 0 marks an empty place. `steps` is the number of nodes that the search read, which
 * also count when the cache answers. */
struct known_cells {
    uint64_t key[KNOWN_CELLS];
    const uint64_t *node[KNOWN_CELLS];
    uint8_t steps[KNOWN_CELLS];
};

static inline void forget_cells(struct known_cells *known)
{
    memset(known->key, 0, sizeof known->key);
}

/* A number a cell, not 0. */
static inline uint64_t cell_key(struct umb__voxel corner)
{
    const uint64_t x = (uint32_t)corner.x >> UMB__SHARE_LEVEL;
    const uint64_t y = (uint32_t)corner.y >> UMB__SHARE_LEVEL;
    const uint64_t z = (uint32_t)corner.z >> UMB__SHARE_LEVEL;
    return (uint64_t)1 << 63 | z << 40 | y << 20 | x;
}

/* Returns a key's place in the cache: the highest bits of its product with 2^64 over the golden
 * ratio. */
static inline uint32_t known_place(uint64_t key)
{
    return (uint32_t)(key * UINT64_C(0x9e3779b97f4a7c15) >> (64 - KNOWN_LOG2));
}

/* Finds the nodes of listed cells as find_cells does, but first in the cache. For pictures, in
 * which neighbouring blocks need many of the same cells. */
static void find_new_cells(const struct umb__query *q, const struct umb__block *block,
                           uint32_t count, struct umb__cells *cells, struct known_cells *known,
                           struct umb_query_stats *stats)
{
    uint16_t missing[4 * UMB__BLOCK];
    uint32_t left = 0;
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t slot = cells->slot[k];
        const uint64_t key = cell_key(umb__cell_corner(block, slot));
        const uint32_t place = known_place(key);
        const uint64_t hit = known->key[place] == key;
        cells->node[slot] = known->node[place];
        stats->nodes += known->steps[place] & (0 - hit);
        missing[left] = (uint16_t)slot;
        left += (uint32_t)(1 - hit);
    }
    if (left == 0) {
        return;
    }
    memcpy(cells->slot, missing, left * sizeof *missing);
    find_cells(q, block, left, cells, stats);
    for (uint32_t k = 0; k < left; k++) {
        const uint32_t slot = missing[k];
        const uint64_t key = cell_key(umb__cell_corner(block, slot));
        const uint32_t place = known_place(key);
        known->key[place] = key;
        known->node[place] = cells->node[slot];
        known->steps[place] = cells->steps[slot];
    }
}

/* Settles windows whose bricks are all lit or all shadowed. The other windows stay in `todo`. */
static void settle_slabs(const struct umb__query *q, const struct umb__window_masks *masks,
                         struct umb__block *block, const struct umb__cells *cells)
{
    uint32_t total = q->total, reach = (uint32_t)q->taps - 1;
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

#define GRID_IDLE_BLOCKS  3U /* The grid stage is tried often: windows that it settles cost least */
#define SLABS_IDLE_BLOCKS 15U
#define WINDOW_RUNS_MAX   56U /* UMB__RUNS_MAX for windows. Their descents cost more than points' */

/* Number of further blocks for which a stage is skipped because it settled almost no window. There
 * are two such stages, which settle windows early. */
struct idle_stages {
    uint32_t grid, slabs;
};

/* Returns whether a stage is to be tried on this block. */
static bool stage_is_due(uint32_t *idle)
{
    *idle -= *idle > 0;
    return *idle == 0;
}

/* Returns the number of blocks for which a stage is to be skipped; 0 if it settled more than `few`
 * windows in this block. */
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

/* Answers a block of windows. In: tent: the weights of a tent; NULL: all texels weigh the same. */
UMB__INLINE void count_windows(const struct umb__query *q, const struct umb__window_masks *masks,
                               const struct umb__tent *tent, struct umb__block *block,
                               struct idle_stages *idle, struct known_cells *known,
                               struct umb_query_stats *stats)
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
    const bool narrow = q->taps <= 9;
    if (narrow) {
        find_bricks(q, heads, &cells, 2, brick, stats);
    } else {
        find_bricks(q, heads, &cells, 3, brick, stats);
    }
    if (tent != NULL && narrow) {
        UMB__WEIGH_WINDOWS(UMB__WEIGH_ONE, tent, block, heads->todo, runs, 2, brick);
    } else if (tent != NULL) {
        UMB__WEIGH_WINDOWS(UMB__WEIGH_ONE, tent, block, heads->todo, runs, 3, brick);
    } else if (narrow) {
        UMB__COUNT_WINDOWS(masks, block, heads->todo, runs, 2, brick);
    } else {
        UMB__COUNT_WINDOWS(masks, block, heads->todo, runs, 3, brick);
    }
}

#endif
