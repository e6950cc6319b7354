/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_COLUMNS_H
#define UMBRAGE_SERVER_BAKE_BUILD_COLUMNS_H
/*
 * From texels to nodes, one column of the octree at a time.
 *
 * A column is all nodes of a level over one square of texels, listed along the light as runs of
 * equal nodes. Let M be the greatest `lit` and m the least `end` (depth/tile.h) of the square. A
 * node over voxels [z0, z1) is shadowed if z0 >= M (nothing in it is lit), else lit if z1 <= m
 * (nothing in it is shadow), else mixed. A wholly undefined node is shadowed, or equal to its
 * parent (Sintorn et al. 2014, section 6.1). A mixed node holds a lit and a shadowed voxel by
 * construction, so none ever turns out uniform.
 *
 * Runs make long shadow walls cheap: a node that contains no value of lit or end equals its
 * neighbour along z, and is built once. The work is proportional to the number of different nodes
 * of a column, not to its length.
 *
 * The nodes depend on lit and end only: not on tiles, their order, or threads.
 */
#include "format/node_pool.h"
#include "bake/depth/tile.h"

/* A run of equal nodes `ref`, from the end of the previous run up to node z_end - 1. */
struct umbb_column_run {
    uint32_t z_end;
    uint32_t ref;
};

/* A column: lit before `mixed_first`, runs in [mixed_first, mixed_end), shadowed from there on. */
struct umbb_column {
    uint32_t mixed_first, mixed_end; /* equal: no mixed node */
    size_t run_first, run_count;     /* Range in the stack's runs */
};

/* Working memory: runs of the columns being built. Start zeroed. */
struct umbb_runs {
    struct umbb_column_run *items;
    size_t count, capacity;
};

void umbb_runs_finish(struct umbb_runs *runs);

/* Appends a column's runs, which lie in `from`, to `to`; the column then refers to the copies. */
UMB_CHECKED enum umb_status umbb_runs_keep(struct umbb_runs *to, const struct umbb_runs *from,
                                           struct umbb_column *column, struct umb_error *error);

/* Appends nodes up to z_end to the column whose runs start at column_first. Equal nodes lengthen
 * the column's last run. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_runs_push(struct umbb_runs *runs, size_t column_first,
                                           uint32_t z_end, uint32_t ref, struct umb_error *error);

/* The bounds of a column's mixed range from the pyramid's values. */
static inline struct umbb_column umbb_column_bounds(uint32_t level, int32_t max_lit,
                                                    int32_t min_end)
{
    const uint32_t step = (uint32_t)1 << level;
    const uint32_t first = (uint32_t)min_end >> level;
    const uint32_t end = ((uint32_t)max_lit + step - 1) >> level;
    /* If first > end, no node is mixed: shadowed from `end` on, undefined up to `first`. */
    return (struct umbb_column){.mixed_first = first < end ? first : end, .mixed_end = end};
}

/* A quadtree of squares, with a function for the columns over its leaves. */
struct umbb_column_tree {
    struct umb__pool *pool;
    struct umbb_runs *runs;
    uint32_t log2_size; /* size of the whole square */
    uint32_t leaf_level;
    int32_t *const *max_lit; /* [level][y * width + x]: levels leaf_level .. log2_size */
    int32_t *const *min_end;
    /*
     * Makes the column over square (x, y) of leaf_level. On entry the column's bounds are set and
     * not empty. The column's runs are appended to the tree's.
     */
    enum umb_status (*leaf)(void *user, size_t x, size_t y, struct umbb_column *column,
                            struct umb_error *error);
    void *user;
};

/*
 * Builds the column over square (x, y) of a level by joining the columns of its leaves.
 *
 * Out:   column: its runs are appended to the tree's.
 * Fails: the errors of umb__pool_brick and of `leaf`.
 */
UMB_CHECKED enum umb_status umbb_column_of_tree(const struct umbb_column_tree *tree, uint32_t level,
                                                const size_t place[2], struct umbb_column *column,
                                                struct umb_error *error);

/* A square of a tile: its level, and its indices in x and y. */
struct umbb_square {
    uint32_t level;
    size_t place[2];
};

/*
 * Builds the column over a square of a tile.
 *
 * In:    tile: texels and pyramid filled. square: a square of level 3 .. tile->log2_size.
 * Out:   column: its runs are appended to `runs`.
 * Fails: the errors of umb__pool_brick.
 */
UMB_CHECKED enum umb_status
umbb_column_of_square(struct umb__pool *pool, const struct umbb_tile *tile,
                      const struct umbb_square *square, struct umbb_runs *runs,
                      struct umbb_column *column, struct umb_error *error);

/*
 * Joins four columns (x + 2 * y) of level - 1 into one.
 *
 * In:    column: with its bounds. four: their runs are the last ones in `runs`.
 * Out:   column: its runs replace the four's.
 */
UMB_CHECKED enum umb_status umbb_column_join(struct umb__pool *pool, uint32_t level,
                                             const struct umbb_column four[4],
                                             struct umbb_runs *runs, struct umbb_column *column,
                                             struct umb_error *error);

#endif
