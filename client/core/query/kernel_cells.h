/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_CELLS_H
#define UMBRAGE_CORE_QUERY_KERNEL_CELLS_H
/* The level-5 cells (32 voxels) of a block's windows, and their nodes. */
#include "query/kernel_parts.h"

/* Lists the level-5 cells that the windows touch. With `share`, consecutive windows that begin in
 * one cell use the same slot, which then lists all cells that any of these windows touches. */
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

/* A cache of the nodes of cells found for earlier blocks; a hash of the key gives the place. Key 0
 * marks an empty place. steps: nodes that the search read, which also count when the cache
 * answers. */
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

#endif
