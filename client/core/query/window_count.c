/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One window, cell by cell: for windows cut off by the frustum's edge and frusta whose grid leads
 * straight to bricks. The kernels answer all others, many at a time (kernel_body.h).
 */
#include "query/query_parts.h"

/* A node, or a uniform state. */
struct cell {
    bool mixed;
    bool lit;        /* if not mixed */
    uint32_t number; /* if mixed: word or brick */
};

/* Descends from the grid to level `target` (or to the grid's own level if that is lower). */
static inline struct cell descend(const struct umb__query *q, int32_t x, int32_t y, int32_t z,
                                  uint32_t target, struct umb_query_stats *stats)
{
    uint32_t g = q->grid_log2, level = q->log2_size - g;
    size_t index =
        ((size_t)x >> level) + (((size_t)y >> level) << g) + (((size_t)z >> level) << (2 * g));
    uint32_t value = q->grid[index];
    stats->nodes++;
    if (value < UMB__CELL_FIRST) {
        return (struct cell){false, value == UMB__CELL_LIT, 0};
    }
    uint32_t number = value - UMB__CELL_FIRST;
    while (level > target) {
        const uint64_t *node = q->nodes + number;
        level -= 2;
        unsigned child = ((uint32_t)x >> level & 3) | ((uint32_t)y >> level & 3) << 2 |
                         ((uint32_t)z >> level & 3) << 4;
        stats->nodes++;
        if (!(node[0] >> child & 1)) {
            return (struct cell){false, node[1] >> child & 1, 0};
        }
        number = umb__wide_child(node, child);
    }
    return (struct cell){true, false, number};
}

/* Returns the bits of an 8x8 slice inside a rectangle given in voxels, clipped to the slice. */
static inline uint64_t rectangle_mask(int32_t x0, int32_t x1, int32_t y0, int32_t y1)
{
    uint64_t row = (0xffU >> (7 - (x1 - x0))) << x0;
    uint64_t rows = row * 0x0101010101010101U;
    return rows & (UINT64_MAX << (8 * y0)) & (UINT64_MAX >> (8 * (7 - y1)));
}

static inline int32_t least(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

static inline int32_t most(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

/* Returns the lit texels of the window's part in the brick at (bx, by), in voxels. */
static inline uint32_t count_brick(const struct umb__query *q, uint32_t number,
                                   const struct umb__window *w, int32_t bx, int32_t by,
                                   struct umb_query_stats *stats)
{
    uint64_t mask = rectangle_mask(most(w->x0 - bx, 0), least(w->x1 - bx, 7), most(w->y0 - by, 0),
                                   least(w->y1 - by, 7));
    stats->bricks++;
    return (uint32_t)__builtin_popcountll(q->bricks[number][w->z & 7] & mask);
}

static inline uint32_t area(const struct umb__window *w, int32_t cx, int32_t cy, int32_t side)
{
    int32_t width = least(w->x1, cx + side - 1) - most(w->x0, cx) + 1;
    int32_t height = least(w->y1, cy + side - 1) - most(w->y0, cy) + 1;
    return (uint32_t)(width * height);
}

/* Returns the lit texels of the window's part in the level-5 node at (cx, cy). */
static inline uint32_t count_node(const struct umb__query *q, uint32_t number,
                                  const struct umb__window *w, int32_t cx, int32_t cy,
                                  struct umb_query_stats *stats)
{
    const uint64_t *node = q->nodes + number;
    int32_t by_end = least(w->y1, cy + 31), bx_end = least(w->x1, cx + 31);
    uint32_t lit = 0;
    stats->nodes++;
    for (int32_t by = most(w->y0, cy) & ~7; by <= by_end; by += 8) {
        for (int32_t bx = most(w->x0, cx) & ~7; bx <= bx_end; bx += 8) {
            unsigned child = ((uint32_t)bx >> 3 & 3) | ((uint32_t)by >> 3 & 3) << 2 |
                             ((uint32_t)w->z >> 3 & 3) << 4;
            if (node[0] >> child & 1) {
                lit += count_brick(q, umb__wide_child(node, child), w, bx, by, stats);
            } else if (node[1] >> child & 1) {
                lit += area(w, bx, by, 8);
            }
        }
    }
    return lit;
}

uint32_t umb__count_window(const struct umb__query *q, const struct umb__window *w,
                           struct umb_query_stats *stats)
{
    uint32_t level = q->log2_size - q->grid_log2 == UMB_LEVEL_BRICK ? UMB_LEVEL_BRICK : 5;
    int32_t side = (int32_t)1 << level;
    uint32_t lit = 0;
    for (int32_t cy = w->y0 & -side; cy <= w->y1; cy += side) {
        for (int32_t cx = w->x0 & -side; cx <= w->x1; cx += side) {
            struct cell cell = descend(q, cx, cy, w->z, level, stats);
            if (!cell.mixed) {
                lit += cell.lit ? area(w, cx, cy, side) : 0;
            } else if (level == UMB_LEVEL_BRICK) {
                lit += count_brick(q, cell.number, w, cx, cy, stats);
            } else {
                lit += count_node(q, cell.number, w, cx, cy, stats);
            }
        }
    }
    return lit;
}
