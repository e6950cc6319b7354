/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Counts one window, cell by cell. It is used for windows cut off by the frustum's edge, and for
 * frusta whose grid has bricks directly below it. The kernels answer all others, many at a time
 * (kernel_body.h).
 */
#include "query/query_parts.h"

/* Descends from the grid to level `target` (or to the level of the grid's cells if that is
 * lower). */
static struct umb__link descend(const struct umb__tree *tree, int32_t x, int32_t y, int32_t z,
                                uint32_t target, struct umb_query_stats *stats)
{
    uint32_t level = umb__tree_cell_level(tree);
    const uint32_t u = (uint32_t)x, v = (uint32_t)y, w = (uint32_t)z;
    struct umb__link link = umb__tree_cell(tree, u >> level, v >> level, w >> level);
    stats->nodes++;
    while (link.mixed && level > target) {
        level -= 2;
        link = umb__tree_child(tree, link.number, umb__child_at(level, u, v, w));
        stats->nodes++;
    }
    return link;
}

/* Returns the lit texels of the window within a brick, or a uniform cube of `side` voxels, that
 * begins at (x, y). */
static uint32_t count_leaf(const struct umb__tree *tree, struct umb__link link,
                           const struct umb__window *w, int32_t x, int32_t y, int32_t side,
                           struct umb_query_stats *stats)
{
    if (link.mixed) {
        const struct umb__rectangle window = {w->x0, w->x1, w->y0, w->y1};
        const uint64_t slice = tree->bricks[link.number][w->z & 7];
        stats->bricks++;
        return (uint32_t)__builtin_popcountll(slice & umb__slice_mask(x, y, &window));
    }
    const int32_t width = umb__min(w->x1, x + side - 1) - umb__max(w->x0, x) + 1;
    const int32_t height = umb__min(w->y1, y + side - 1) - umb__max(w->y0, y) + 1;
    return link.lit ? (uint32_t)(width * height) : 0;
}

/* Returns the lit texels of the window within the level-5 node at (cx, cy). */
static uint32_t count_node(const struct umb__tree *tree, uint32_t number,
                           const struct umb__window *w, int32_t cx, int32_t cy,
                           struct umb_query_stats *stats)
{
    const int32_t by_end = umb__min(w->y1, cy + 31), bx_end = umb__min(w->x1, cx + 31);
    uint32_t lit = 0;
    stats->nodes++;
    for (int32_t by = umb__max(w->y0, cy) & ~7; by <= by_end; by += 8) {
        for (int32_t bx = umb__max(w->x0, cx) & ~7; bx <= bx_end; bx += 8) {
            const unsigned child =
                umb__child_at(UMB_LEVEL_BRICK, (uint32_t)bx, (uint32_t)by, (uint32_t)w->z);
            lit += count_leaf(tree, umb__tree_child(tree, number, child), w, bx, by, 8, stats);
        }
    }
    return lit;
}

uint32_t umb__count_window(const struct umb__query *q, const struct umb__window *w,
                           struct umb_query_stats *stats)
{
    const struct umb__tree tree = umb__tree_of(q);
    const uint32_t level =
        umb__tree_cell_level(&tree) == UMB_LEVEL_BRICK ? UMB_LEVEL_BRICK : UMB_LEVEL_BRICK + 2;
    const int32_t side = (int32_t)1 << level;
    uint32_t lit = 0;
    for (int32_t cy = w->y0 & -side; cy <= w->y1; cy += side) {
        for (int32_t cx = w->x0 & -side; cx <= w->x1; cx += side) {
            const struct umb__link link = descend(&tree, cx, cy, w->z, level, stats);
            lit += link.mixed && level > UMB_LEVEL_BRICK
                       ? count_node(&tree, link.number, w, cx, cy, stats)
                       : count_leaf(&tree, link, w, cx, cy, side, stats);
        }
    }
    return lit;
}
