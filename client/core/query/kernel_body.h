/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a query kernel; included by kernel_base.c and kernel_avx2.c, which name the function
 * (UMB__KERNEL) and the stages that vector instructions are worth writing by hand for: placing
 * (UMB__PLACER, UMB__PLACER_INIT, UMB__PLACE), UMB__GRID, UMB__COMPARE_POINTS, UMB__TAKE_HEADS,
 * UMB__STEP_HEADS, UMB__READ_RUNS, UMB__READ_BRICK. No guard: each includes it once.
 *
 * Points go in blocks of 64, and a block goes stage by stage: place (voxel space, window), grid,
 * one stage for each level of wide nodes, bricks, store. Who is still to be looked up is one bit a
 * point; a stage visits the bits that are set and makes the next stage's word without branching on
 * data. So no branch is mispredicted, where a walk point by point mispredicts one or two, and each
 * stage prefetches what the next will read: a block waits for memory once a stage, where a walk
 * waits once a point and stage (docs/performance.md has what that gives). Points in one brick share
 * a look-up (kernel_runs.h).
 *
 * One tap is kernel_points.h. A window is found by the level-5 cells (32 voxels) it touches, four
 * at most: each is looked up once, all its bricks are taken from that one node ("share",
 * reference/core.md section 3). Within a brick the window is a rectangle of the slice at depth z:
 * one mask, one popcount (Sintorn et al. 2014, section 6.2). Cells and bricks that are lit or
 * shadowed throughout stand as constants in the place of nodes and bricks, so that a stage need not
 * tell them apart.
 */
#include "query/kernel_points.h"

/* Texels of a slice that lie in a window which begins at texel 0..7 of its first brick: of bricks 0
 * to 2 from there, by columns and by rows. */
struct window_masks {
    uint64_t columns[8][3], rows[8][3];
};

static void make_masks(int32_t taps, struct window_masks *masks)
{
    for (uint32_t at = 0; at < 8; at++) {
        uint32_t window = (((uint32_t)1 << taps) - 1) << at;
        for (uint32_t k = 0; k < 3; k++) {
            masks->columns[at][k] = (window >> 8 * k & 0xff) * UMB__EVERY_BYTE;
            masks->rows[at][k] = umb__spread(window >> 8 * k & 0xff);
        }
    }
}

/* Lists the level-5 cells that the windows touch. If some may share them, windows after one another
 * that begin in one cell do: its cells are written again for each, with those that any of them
 * touches. */
static inline __attribute__((always_inline)) uint32_t list_cells(const struct umb__query *q,
                                                                 const struct umb__block *block,
                                                                 bool share,
                                                                 struct umb__cells *cells)
{
    const int32_t reach = q->taps - 1;
    int32_t x = -1, y = -1, z = -1; /* the cell that the windows before began in */
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
        const uint64_t *const *corner = cells->node + 4 * cells->of[i];
        uint64_t mixed = 0, lit = 0, shadowed = 0;
        for (uint32_t c = 0; c < 4; c++) {
            const uint64_t *node = corner[(c & right) | (c & down)];
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

/* Finds all bricks that the windows touch, `side` each way; slot 16 * point + brick. */
static inline __attribute__((always_inline)) void find_bricks(const struct umb__query *q,
                                                              const struct umb__block *block,
                                                              const struct umb__cells *cells,
                                                              uint32_t side, const uint64_t **brick,
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

/* Adds up the windows of all runs from the slices of their bricks. */
static inline __attribute__((always_inline)) void
count_slices(const struct window_masks *masks, struct umb__block *block, uint64_t heads,
             const struct umb__runs *runs, uint32_t side, const uint64_t *const *brick)
{
    for (uint64_t rest = heads; rest; rest &= rest - 1) {
        uint32_t h = umb__first_bit(rest);
        const uint64_t *const *of_head = brick + 16 * h;
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i++) {
            const uint64_t *columns = masks->columns[block->x[i] & 7];
            const uint64_t *rows = masks->rows[block->y[i] & 7];
            uint32_t lit = 0, z = (uint32_t)block->z[i] & 7;
            for (uint32_t r = 0; r < side; r++) {
                for (uint32_t c = 0; c < side; c++) {
                    uint64_t slice = of_head[side * r + c][z];
                    lit += umb__count_bits(slice & columns[c] & rows[r]);
                }
            }
            block->lit[i] = lit;
        }
    }
}

/* Windows whose heads were settled answer as these. Eight are written at a time; what is too much
 * the runs behind write again, but for windows that needed no look-up. */
static void spread_settled(struct umb__block *block, const struct umb__block *heads,
                           uint64_t settled, const struct umb__runs *runs)
{
    const uint64_t placed = ~block->todo & UINT64_MAX >> (UMB__BLOCK - block->size);
    uint32_t kept[UMB__BLOCK];
    if (placed) {
        memcpy(kept, block->lit, sizeof kept);
    }
    for (uint64_t rest = settled; rest; rest &= rest - 1) {
        const uint32_t h = umb__first_bit(rest), lit = heads->lit[h];
        for (uint32_t i = runs->first[h]; i < runs->first[h + 1]; i += 8) {
            for (uint32_t k = 0; k < 8; k++) {
                block->lit[i + k] = lit;
            }
        }
    }
    for (uint64_t rest = placed; rest; rest &= rest - 1) {
        const uint32_t i = umb__first_bit(rest);
        block->lit[i] = kept[i];
    }
}

#define GRID_IDLE_BLOCKS  3U /* the grid is tried often: what it settles costs least */
#define SLABS_IDLE_BLOCKS 15U
#define WINDOW_RUNS_MAX   56U /* as UMB__RUNS_MAX; a window's way down costs more than a point's */

/* Blocks for which the two stages that settle windows early are left out, because they settled next
 * to nothing. */
struct idle_stages {
    uint32_t grid, slabs;
};

/* Whether a stage is to be tried on this block. */
static bool stage_is_due(uint32_t *idle)
{
    *idle -= *idle > 0;
    return *idle == 0;
}

/* For how many blocks a stage is left out: for `blocks` if it settled at most `few` windows. */
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

static void count_windows(const struct umb__query *q, const struct window_masks *masks,
                          struct umb__block *block, struct idle_stages *idle,
                          struct umb_query_stats *stats)
{
    struct umb__cells cells;
    struct umb__block own, *heads = block;
    struct umb__runs found;
    const struct umb__runs *runs = &each_alone;
    struct umb__closeness close = UMB__COMPARE_POINTS(block);
    uint64_t starts = umb__run_starts(block, close.changes);
    if (umb__count_bits(starts) <= WINDOW_RUNS_MAX) {
        UMB__TAKE_HEADS(q, block, starts, &own, &found);
        heads = &own;
        runs = &found;
    }
    uint64_t looked_up = heads->todo;
    if (stage_is_due(&idle->grid)) {
        UMB__GRID(q, heads);
        stats->nodes += umb__count_bits(looked_up & ~heads->todo);
        idle->grid = idle_after(looked_up, heads->todo, 0, GRID_IDLE_BLOCKS);
    }
    const uint32_t listed =
        heads == block ? list_cells(q, heads, false, &cells) : list_cells(q, heads, true, &cells);
    find_cells(q, heads, listed, &cells, stats);
    if (stage_is_due(&idle->slabs)) {
        uint64_t before = heads->todo;
        settle_slabs(q, heads, &cells);
        uint32_t few = umb__count_bits(before) / 8;
        idle->slabs = idle_after(before, heads->todo, few, SLABS_IDLE_BLOCKS);
    }
    if (heads != block) {
        spread_settled(block, heads, looked_up & ~heads->todo, runs);
    }
    const uint64_t *brick[16 * UMB__BLOCK];
    if (q->taps <= 9) {
        find_bricks(q, heads, &cells, 2, brick, stats);
        count_slices(masks, block, heads->todo, runs, 2, brick);
    } else {
        find_bricks(q, heads, &cells, 3, brick, stats);
        count_slices(masks, block, heads->todo, runs, 3, brick);
    }
}

static void answer_points(const struct umb__query *query, const struct UMB__PLACER *placer,
                          size_t first, size_t end, void *values, struct umb_query_stats *stats)
{
    struct umb__block block;
    struct umb__descents descents;
    struct umb__common common = {0};
    umb__begin_descents(query, values, &descents);
    for (; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__PLACE(placer, first, &block, stats);
        umb__answer_points(query, &block, first, values, &common, &descents, stats);
    }
    umb__end_descents(&descents, stats);
}

static void answer_windows(const struct umb__query *query, const struct UMB__PLACER *placer,
                           size_t first, size_t end, void *values, struct umb_query_stats *stats)
{
    struct umb__block block;
    struct window_masks masks;
    struct idle_stages idle = {0, 0};
    make_masks(query->taps, &masks);
    for (; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__PLACE(placer, first, &block, stats);
        count_windows(query, &masks, &block, &idle, stats);
        umb__store_block(query, &block, first, values);
    }
}

void UMB__KERNEL(const struct umb__query *query, const struct umb_points *points, size_t first,
                 size_t count, struct umb_answers *answers)
{
    struct umb_query_stats stats = {.points = count};
    struct UMB__PLACER placer;
    UMB__PLACER_INIT(query, points, &placer);
    (query->taps == 1 ? answer_points : answer_windows)(query, &placer, first, first + count,
                                                        answers->values, &stats);
    umb_query_stats_add(&answers->stats, &stats);
}
