/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_PARTS_H
#define UMBRAGE_CORE_QUERY_KERNEL_PARTS_H
/* Data that the stages of a kernel share, and the steps that several of them take. */
#include "query/query_parts.h"

#define UMB__BLOCK       64 /* Points of a block: a bit of a word each */
#define UMB__BEHIND      16 /* Lanes behind them, since eight may be read from any point on */
#define UMB__SHARE_LEVEL 5  /* a window's bricks are taken from cells of this level */
#define UMB__EVERY_BYTE  UINT64_C(0x0101010101010101)

/* A block of points, as it passes through the stages. */
struct umb__block {
    uint32_t size; /* Number of points */
    uint64_t todo; /* Bit i: point i still needs its look-up */
    /* First texel of the window, which lies in the frustum; 0, 0, 0 for points without a look-up.
     * Arrays begin at cache lines. */
    _Alignas(64) int32_t x[UMB__BLOCK + UMB__BEHIND];
    int32_t y[UMB__BLOCK + UMB__BEHIND];
    int32_t z[UMB__BLOCK + UMB__BEHIND];
    /* Lit texels of the window; final where todo's bit is 0. */
    uint32_t lit[UMB__BLOCK + UMB__BEHIND];
};

/* The level-5 cells that a block's windows touch. The cells of a point's window have the slots 4 *
 * of[point] + right + 2 * down, where right and down are 0 or 1. */
struct umb__cells {
    uint8_t of[UMB__BLOCK];               /* For each window: number of the window whose slots it
                                             uses: itself, or an earlier window in the same cell */
    uint16_t slot[4 * UMB__BLOCK];        /* List of the slots whose cells are not found yet */
    const uint64_t *node[4 * UMB__BLOCK]; /* By slot: node reached, or a uniform one */
    uint8_t steps[4 * UMB__BLOCK];        /* By slot: number of nodes visited */
};

#define UMB__PREFETCH(address) __builtin_prefetch(address)

struct umb__voxel {
    int32_t x, y, z;
};

/* Nodes without mixed children, all shadowed and all lit. */
static const uint64_t umb__uniform_nodes[4] = {0, 0, 0, UINT64_MAX};

static inline size_t umb__grid_index(int32_t x, int32_t y, int32_t z, uint32_t level, uint32_t g)
{
    return ((size_t)x >> level) + (((size_t)y >> level) << g) + (((size_t)z >> level) << (2 * g));
}

/* Does what umb__column_piece does, from a column's eight bytes and without branches. */
static inline uint32_t umb__piece_of(uint64_t column, uint32_t z)
{
    uint32_t first = (uint32_t)column, low = (uint32_t)(column >> 32) & 0xffff;
    uint32_t high = (uint32_t)(column >> 48);
    uint32_t at = z < high ? z : high;
    return first + (at > low ? at : low) - low;
}

static inline uint32_t umb__first_bit(uint64_t bits)
{
    return (uint32_t)__builtin_ctzll(bits);
}

static inline uint32_t umb__count_bits(uint64_t bits)
{
    return (uint32_t)__builtin_popcountll(bits);
}

/* Returns the bit, in a wide node's masks, of the child of `level` that contains a voxel. */
static inline unsigned umb__child_bit(int32_t x, int32_t y, int32_t z, uint32_t level)
{
    return ((uint32_t)x >> level & 3) | ((uint32_t)y >> level & 3) << 2 |
           ((uint32_t)z >> level & 3) << 4;
}

/* Returns a if `which` is 1, b if it is 0. Uses arithmetic instead of a condition: compilers turn
 * conditions into branches, which are slow on unpredictable data. */
static inline uint64_t umb__select(uint64_t which, uint64_t a, uint64_t b)
{
    return b ^ ((a ^ b) & (0 - which));
}

/* Returns the address of the child number at `bit` of a node. A child that is not mixed has no
 * number; the result is then the node's first word, which is safe to read. */
static inline const uint32_t *umb__child_place(const uint64_t *node, unsigned bit)
{
    uint64_t below = ((uint64_t)1 << bit) - 1;
    uint64_t rank = (uint64_t)__builtin_popcountll(node[0] & below);
    return (const uint32_t *)(const void *)node + ((4 + rank) & (0 - (node[0] >> bit & 1)));
}

static inline uint32_t umb__least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static inline struct umb__voxel umb__cell_corner(const struct umb__block *block, uint32_t slot)
{
    uint32_t i = slot / 4;
    int32_t right = (int32_t)(slot & 1), down = (int32_t)(slot >> 1 & 1);
    return (struct umb__voxel){
        ((block->x[i] >> UMB__SHARE_LEVEL) + right) << UMB__SHARE_LEVEL,
        ((block->y[i] >> UMB__SHARE_LEVEL) + down) << UMB__SHARE_LEVEL,
        block->z[i],
    };
}

/* Returns the bricks on an axis that the texels first .. first + reach touch. Bit k is brick k of
 * two cells side by side. */
static inline uint32_t umb__brick_range(uint32_t first, uint32_t reach)
{
    uint32_t low = first >> 3 & 3, high = ((first + reach) >> 3) - (first >> 3) + low;
    return (2U << high) - (1U << low);
}

/* Masks of a 4x4 square of bits: for each value of four bits, the rows whose bit is set. */
static const uint16_t umb__rows_of_four[16] = {
    0x0000, 0x000f, 0x00f0, 0x00ff, 0x0f00, 0x0f0f, 0x0ff0, 0x0fff,
    0xf000, 0xf00f, 0xf0f0, 0xf0ff, 0xff00, 0xff0f, 0xfff0, 0xffff,
};

/* Returns a word whose byte k is 0xff where bit k of eight is 1. */
static inline uint64_t umb__spread(uint32_t bits)
{
    uint64_t each = (bits * UMB__EVERY_BYTE) & UINT64_C(0x8040201008040201);
    uint64_t high = (each + UINT64_C(0x7f7f7f7f7f7f7f7f)) | each;
    return (high >> 7 & UMB__EVERY_BYTE) * 0xff;
}

/* Returns whether the stages of kernel_body.h can answer whole windows of this query. */
static inline bool umb__stages_fit(const struct umb__query *q)
{
    return q->taps == 1 || q->log2_size - q->grid_log2 >= UMB__SHARE_LEVEL;
}

/* Computes the voxel of one point. A point that needs no look-up, or whose look-up no stage
 * supports, gets its answer at once. */
static inline void umb__place_point(const struct umb__query *q, const struct umb_points *points,
                                    size_t index, struct umb__block *block, uint32_t i,
                                    struct umb_query_stats *stats)
{
    double v[3];
    block->lit[i] = 0;
    block->x[i] = block->y[i] = block->z[i] = 0;
    if (!umb__voxel_at(q, points, index, v)) {
        stats->facing_away++;
        return;
    }
    struct umb__window window = umb__window_at(q, v, stats);
    if (window.all_lit) {
        block->lit[i] = q->total;
    } else if (window.outside == 0 && umb__stages_fit(q)) {
        block->x[i] = window.x0;
        block->y[i] = window.y0;
        block->z[i] = window.z;
        block->todo |= (uint64_t)1 << i;
    } else if (q->filter == UMB_FILTER_TENT) {
        block->lit[i] = umb__weigh_tent(q, v, &window, stats);
    } else {
        block->lit[i] = window.outside + umb__count_window(q, &window, stats);
    }
}

/* Sets the lanes without a point among a block's last eight to voxel 0, 0, 0, since stages take
 * eight lanes at a time. */
static inline void umb__pad_block(struct umb__block *block)
{
    for (uint32_t i = block->size; i % 8 != 0; i++) {
        block->x[i] = block->y[i] = block->z[i] = 0;
        block->lit[i] = 0;
    }
}

/* Function that places the points of a batch. */
struct umb__placer {
    const struct umb__query *query;
    const struct umb_points *points;
};

static inline void umb__placer_init(const struct umb__query *q, const struct umb_points *points,
                                    struct umb__placer *placer)
{
    placer->query = q;
    placer->points = points;
}

/* Places the points from number `index` on in the lanes low .. high - 1, whose bits in `todo` are
 * still 0. */
static inline void umb__place_points(const struct umb__placer *placer, size_t index,
                                     struct umb__block *block, uint32_t low, uint32_t high,
                                     struct umb_query_stats *stats)
{
    for (uint32_t i = low; i < high; i++) {
        umb__place_point(placer->query, placer->points, index + (i - low), block, i, stats);
    }
}

/* Places the points first .. first + block->size - 1. */
static inline void umb__place_block(const struct umb__placer *placer, size_t first,
                                    struct umb__block *block, struct umb_query_stats *stats)
{
    block->todo = 0;
    umb__place_points(placer, first, block, 0, block->size, stats);
    umb__pad_block(block);
}

/*
 * The grid stage: settles windows whose cells are all lit or all shadowed, and removes them from
 * todo.
 */
static inline void umb__grid_block(const struct umb__query *q, struct umb__block *block)
{
    uint32_t level = q->log2_size - q->grid_log2, g = q->grid_log2;
    uint32_t total = q->total;
    int32_t reach = q->taps - 1;
    uint64_t mixed = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        UMB__PREFETCH(q->grid + umb__grid_index(block->x[i], block->y[i], block->z[i], level, g));
    }
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        int32_t x = block->x[i], y = block->y[i];
        const uint32_t *cell = q->grid + umb__grid_index(x, y, block->z[i], level, g);
        size_t right = (size_t)((x + reach) >> level) - (size_t)(x >> level);
        size_t down = ((size_t)((y + reach) >> level) - (size_t)(y >> level)) << g;
        uint32_t differ =
            (cell[0] ^ cell[right]) | (cell[0] ^ cell[down]) | (cell[0] ^ cell[right + down]);
        block->lit[i] = (cell[0] & 1) * total;
        mixed |= (uint64_t)((cell[0] >= UMB__CELL_FIRST) | (differ != 0)) << i;
    }
    block->todo = mixed;
}

/* Stores answers as floats. Where callers can, they pass constants: the length of a whole block,
 * and a total of 1, for which the compiler leaves out the division. */
UMB__INLINE void umb__store_floats(const struct umb__block *block, uint32_t count, float total,
                                   uint8_t *to)
{
    for (uint32_t i = 0; i < count; i++) {
        const float value = (float)(int32_t)block->lit[i] / total;
        memcpy(to + i * sizeof value, &value, sizeof value);
    }
}

static inline void umb__store_block(const struct umb__query *q, const struct umb__block *block,
                                    size_t first, void *values)
{
    uint32_t total = q->total;
    if (q->format == UMB_ANSWER_F32) {
        uint8_t *to = (uint8_t *)values + first * sizeof(float);
        const bool whole = block->size == UMB__BLOCK;
        if (total == 1 && whole) {
            umb__store_floats(block, UMB__BLOCK, 1, to);
        } else if (whole) {
            umb__store_floats(block, UMB__BLOCK, (float)(int32_t)total, to);
        } else {
            umb__store_floats(block, block->size, (float)(int32_t)total, to);
        }
        return;
    }
    for (uint32_t i = 0; i < block->size; i++) {
        umb__store_answer(values, q->format, first + i, block->lit[i], total);
    }
}

#endif
