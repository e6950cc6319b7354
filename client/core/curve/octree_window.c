/* SPDX-License-Identifier: Apache-2.0 */
/* See octree_window.h. */
#include "curve/octree_window.h"

#include <stdbool.h>

#include "umbrage/curve.h"

/* A node or uniform cube during the descent. */
struct cube {
    enum umb__node_state state;
    uint32_t level, index;
    int32_t x, y, z; /* first voxel */
};

struct range {
    int32_t low, high; /* inclusive */
};

static int32_t larger(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

static int32_t smaller(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

/* Part of [low, high] in the cube's side that begins at `first`. */
static struct range cut(int32_t low, int32_t high, int32_t first, uint32_t level)
{
    return (struct range){larger(low, first), smaller(high, first + ((int32_t)1 << level) - 1)};
}

static struct cube child_of(const struct umb__octree *octree, const struct cube *cube, unsigned c)
{
    const struct umb__octree_level *level = &octree->level[cube->level];
    const uint16_t mask = level->masks[cube->index];
    const unsigned before = umb__mask_mixed_count((uint16_t)(mask & ((1U << (2 * c)) - 1U)));
    const int32_t half = (int32_t)1 << (cube->level - 1);
    struct cube child = {.state = umb__mask_state(mask, c),
                         .level = cube->level - 1,
                         .x = cube->x + (c & 1 ? half : 0),
                         .y = cube->y + (c & 2 ? half : 0),
                         .z = cube->z + (c & 4 ? half : 0)};
    if (child.state == UMB__NODE_MIXED) {
        child.index = level->children[level->first[cube->index] + before];
    }
    return child;
}

static uint32_t count_brick(const struct umb__octree_window *w, const struct cube *cube,
                            struct range x, struct range y)
{
    const uint64_t slice = w->octree->bricks[cube->index][w->z & 7];
    uint64_t mask = 0;
    for (int32_t row = y.low; row <= y.high; row++) {
        mask |= (((uint64_t)2 << (x.high - x.low)) - 1)
                << ((x.low - cube->x) + 8 * (row - cube->y));
    }
    return (uint32_t)__builtin_popcountll(slice & mask);
}

/* Counts a cache line for the grid's cell (by the caller), one for each wide node below it that is
 * read, and one for each brick. */
static bool costs_line(const struct umb__octree_window *w, const struct cube *cube)
{
    const uint32_t cells = umb_level_max(w->octree->roots[w->root].level);
    return cube->level % 2 == 1 && cube->level <= cells && cube->level > w->level;
}

static uint32_t count_cube(struct umb__octree_window *w, struct cube cube)
{
    const struct range x = cut(w->x0, w->x1, cube.x, cube.level);
    const struct range y = cut(w->y0, w->y1, cube.y, cube.level);
    if (x.low > x.high || y.low > y.high) {
        return 0;
    }
    if (cube.state != UMB__NODE_MIXED) {
        const uint32_t texels = (uint32_t)((x.high - x.low + 1) * (y.high - y.low + 1));
        const uint32_t each = w->level > 0 ? 2 : 1;
        return cube.state == UMB__NODE_LIT ? each * texels : 0;
    }
    if (cube.level <= w->level) {
        return 1; /* half of a coarse cell */
    }
    w->lines += costs_line(w, &cube);
    if (cube.level == UMB_LEVEL_BRICK) {
        return count_brick(w, &cube, x, y);
    }
    w->nodes++;
    uint32_t lit = 0;
    const unsigned deep = w->z - cube.z >= (int32_t)1 << (cube.level - 1) ? 4 : 0;
    for (unsigned c = deep; c < deep + 4; c++) {
        lit += count_cube(w, child_of(w->octree, &cube, c)); /* Levels descend: recursion is at most
                                                                17 deep */
    }
    return lit;
}

uint32_t umb__octree_window_count(struct umb__octree_window *window)
{
    const struct umb__octree_root *root = &window->octree->roots[window->root];
    window->lines++;
    return count_cube(window, (struct cube){root->state, root->level, root->index, 0, 0, 0});
}
