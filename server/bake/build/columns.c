/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Top-down over the squares, columns joined on the way back.
 *
 * Squares without a mixed node are not entered: their texels are not read (and may be unset).
 * Recursion is as deep as there are levels above the leaves, at most 15.
 */
#include "bake/build/columns.h"

#include <stdlib.h>
#include <string.h>

#include "bake/build/brick_slices.h"

void umbb_runs_finish(struct umbb_runs *runs)
{
    free(runs->items);
    memset(runs, 0, sizeof *runs);
}

/* Makes room for more runs. */
static enum umb_status reserve(struct umbb_runs *runs, size_t more, struct umb_error *error)
{
    if (runs->capacity - runs->count >= more) {
        return UMB_OK;
    }
    size_t capacity = runs->capacity == 0 ? 1024 : runs->capacity;
    while (capacity - runs->count < more) {
        capacity *= 2;
    }
    struct umbb_run *items = realloc(runs->items, capacity * sizeof *items);
    if (items == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "column runs: %zu bytes refused",
                        capacity * sizeof *items);
    }
    runs->items = items;
    runs->capacity = capacity;
    return UMB_OK;
}

enum umb_status umbb_runs_keep(struct umbb_runs *to, const struct umbb_runs *from,
                               struct umbb_column *column, struct umb_error *error)
{
    const enum umb_status status = reserve(to, column->run_count, error);
    if (status != UMB_OK) {
        return status;
    }
    if (column->run_count > 0) {
        memcpy(to->items + to->count, from->items + column->run_first,
               column->run_count * sizeof *to->items);
    }
    column->run_first = to->count;
    to->count += column->run_count;
    return UMB_OK;
}

enum umb_status umbb_runs_push(struct umbb_runs *runs, size_t column_first, uint32_t z_end,
                               uint32_t ref, struct umb_error *error)
{
    if (runs->count > column_first && runs->items[runs->count - 1].ref == ref) {
        runs->items[runs->count - 1].z_end = z_end;
        return UMB_OK;
    }
    const enum umb_status status = reserve(runs, 1, error);
    if (status != UMB_OK) {
        return status;
    }
    runs->items[runs->count++] = (struct umbb_run){z_end, ref};
    return UMB_OK;
}

struct umbb_column umbb_column_bounds(uint32_t level, int32_t max_lit, int32_t min_end)
{
    const uint32_t step = (uint32_t)1 << level;
    const uint32_t first = (uint32_t)min_end >> level;
    const uint32_t end = ((uint32_t)max_lit + step - 1) >> level;
    /* first > end: everything between is undefined, and shadowed from `end` on. */
    return (struct umbb_column){.mixed_first = first < end ? first : end, .mixed_end = end};
}

/* A column being walked along z. */
struct cursor {
    const struct umbb_column *column;
    size_t run; /* the run that z is in, if z is in the mixed range */
};

/* Node at z, which never decreases from call to call; *end: first node after it that may differ. */
static uint32_t cursor_read(struct cursor *cursor, const struct umbb_runs *runs, uint32_t z,
                            uint32_t *end)
{
    const struct umbb_column *column = cursor->column;
    if (z < column->mixed_first) {
        *end = column->mixed_first;
        return UMB_REF_LIT;
    }
    if (z >= column->mixed_end) {
        *end = UINT32_MAX;
        return UMB_REF_SHADOWED;
    }
    while (runs->items[cursor->run].z_end <= z) {
        cursor->run++;
    }
    *end = runs->items[cursor->run].z_end;
    return runs->items[cursor->run].ref;
}

/*
 * Reads the eight children of node z; returns the first z after it whose children may differ.
 */
static uint32_t read_children(struct cursor cursors[4], const struct umbb_runs *runs, uint32_t z,
                              uint32_t children[8])
{
    uint32_t same_until = UINT32_MAX; /* in nodes of the children's level */
    for (unsigned q = 0; q < 4; q++) {
        uint32_t end;
        const uint32_t near = cursor_read(&cursors[q], runs, 2 * z, &end);
        uint32_t far = near;
        if (end <= 2 * z + 1) {
            far = cursor_read(&cursors[q], runs, 2 * z + 1, &end);
            end = near == far ? end : 0;
        }
        children[q] = near;
        children[q + 4] = far;
        same_until = end < same_until ? end : same_until;
    }
    const uint32_t next = same_until / 2;
    return next > z + 1 ? next : z + 1;
}

enum umb_status umbb_column_join(struct umb_pool *pool, uint32_t level,
                                 const struct umbb_column four[4], size_t runs_mark,
                                 struct umbb_runs *runs, struct umbb_column *column,
                                 struct umb_error *error)
{
    struct cursor cursors[4];
    for (unsigned q = 0; q < 4; q++) {
        cursors[q] = (struct cursor){&four[q], four[q].run_first};
    }
    const size_t first = runs->count;
    uint32_t z = column->mixed_first;
    while (z < column->mixed_end) {
        uint32_t children[8], ref;
        uint32_t next = read_children(cursors, runs, z, children);
        next = next < column->mixed_end ? next : column->mixed_end;
        enum umb_status status = umb_pool_node(pool, level, children, &ref, error);
        if (status == UMB_OK) {
            status = umbb_runs_push(runs, first, next, ref, error);
        }
        if (status != UMB_OK) {
            return status;
        }
        z = next;
    }
    /* The four's runs are done with: the new ones move down over them. */
    column->run_first = runs_mark;
    column->run_count = runs->count - first;
    if (column->run_count > 0) {
        memmove(runs->items + runs_mark, runs->items + first,
                column->run_count * sizeof *runs->items);
    }
    runs->count = runs_mark + column->run_count;
    return UMB_OK;
}

enum umb_status umbb_column_of_tree(const struct umbb_column_tree *tree, uint32_t level,
                                    const size_t place[2], struct umbb_column *column,
                                    struct umb_error *error)
{
    const size_t at = (place[1] << (tree->log2_size - level)) + place[0];
    *column = umbb_column_bounds(level, tree->max_lit[level][at], tree->min_end[level][at]);
    column->run_first = tree->runs->count;
    if (column->mixed_first == column->mixed_end) {
        return UMB_OK;
    }
    if (level == tree->leaf_level) {
        return tree->leaf(tree->user, place[0], place[1], column, error);
    }
    const size_t mark = tree->runs->count;
    struct umbb_column four[4];
    for (size_t q = 0; q < 4; q++) {
        const size_t quarter[2] = {2 * place[0] + (q & 1), 2 * place[1] + (q >> 1)};
        const enum umb_status status =
            umbb_column_of_tree(tree, level - 1, quarter, &four[q], error);
        if (status != UMB_OK) {
            return status;
        }
    }
    return umbb_column_join(tree->pool, level, four, mark, tree->runs, column, error);
}

/* What the bricks of a tile are built with. */
struct walk {
    struct umb_pool *pool;
    const struct umbb_tile *tile;
    struct umbb_runs *runs;
    const struct umbb_slicer *slicer;
};

static enum umb_status build_brick(const struct walk *walk, const int32_t *const values[2],
                                   uint32_t z, uint32_t *ref, struct umb_error *error)
{
    const int32_t *lit = values[0], *end = values[1];
    uint64_t visible[8];
    walk->slicer->above(lit, (int32_t)(8 * z), visible);
    if (end != lit) {
        uint64_t allowed[8];
        walk->slicer->above(end, (int32_t)(8 * z), allowed);
        umbb_slices_fill(visible, allowed, visible);
    }
    return umb_pool_brick(walk->pool, visible, ref, error);
}

/* The first brick at or after z into which some value falls; `end` if none before it. */
static uint32_t next_event(const struct umbb_slicer *slicer, const int32_t *values, uint32_t z,
                           uint32_t end)
{
    const uint32_t least = (uint32_t)slicer->least_from(values, (int32_t)(8 * z));
    return least >> UMB_LEVEL_BRICK < end ? least >> UMB_LEVEL_BRICK : end;
}

/*
 * Bricks of one 8x8 square. Brick z has an event if some lit or end v has v / 8 == z. Between two
 * events all bricks are equal: every comparison with every slice comes out the same.
 */
static enum umb_status brick_column(void *user, size_t x, size_t y, struct umbb_column *column,
                                    struct umb_error *error)
{
    const struct walk *walk = user;
    const size_t block = (y << (walk->tile->log2_size - UMB_LEVEL_BRICK)) + x;
    const int32_t *lit = walk->tile->lit + block * 64;
    const int32_t *end = walk->tile->end + block * 64;
    const int32_t *const values[2] = {lit, end};
    uint32_t next;
    for (uint32_t z = column->mixed_first; z < column->mixed_end; z = next) {
        next = z + 1;
        if (column->mixed_end - z > 2) { /* shorter ones are not worth the search */
            uint32_t event = next_event(walk->slicer, lit, z, column->mixed_end);
            event = end == lit ? event : next_event(walk->slicer, end, z, event);
            next = event > next ? event : next;
        }
        uint32_t ref;
        enum umb_status status = build_brick(walk, values, z, &ref, error);
        if (status == UMB_OK) {
            status = umbb_runs_push(walk->runs, column->run_first, next, ref, error);
        }
        if (status != UMB_OK) {
            return status;
        }
    }
    column->run_count = walk->runs->count - column->run_first;
    return UMB_OK;
}

/* Asks for the texels of the square of 16x16 that the tree comes to after (x, y). */
static void next_quad_ahead(const struct umbb_tile *tile, size_t x, size_t y)
{
    size_t bit = 1;
    while ((x & y & bit) != 0) { /* the last of a quarter: on in the quarter around it */
        x ^= bit;
        y ^= bit;
        bit <<= 1;
    }
    y ^= (x & bit) != 0 ? bit : 0;
    x ^= bit;
    const size_t width = (size_t)tile->size >> UMB_LEVEL_BRICK;
    if (2 * y >= width) {
        return;
    }
    for (size_t row = 0; row < 2; row++) {
        const size_t block = (2 * y + row) * width + 2 * x;
        for (size_t texel = 0; texel < 128; texel += 16) {
            __builtin_prefetch(tile->lit + block * 64 + texel);
        }
    }
}

/* Nodes of level 4: the four columns of bricks in a 16x16 square, joined. */
static enum umb_status quad_column(void *user, size_t x, size_t y, struct umbb_column *column,
                                   struct umb_error *error)
{
    const struct walk *walk = user;
    const struct umbb_tile *tile = walk->tile;
    const size_t width = (size_t)tile->size >> UMB_LEVEL_BRICK, mark = walk->runs->count;
    struct umbb_column four[4];
    next_quad_ahead(tile, x, y);
    for (size_t q = 0; q < 4; q++) {
        const size_t bx = 2 * x + (q & 1), by = 2 * y + (q >> 1);
        four[q] =
            umbb_column_bounds(UMB_LEVEL_BRICK, tile->max_lit[UMB_LEVEL_BRICK][by * width + bx],
                               tile->min_end[UMB_LEVEL_BRICK][by * width + bx]);
        four[q].run_first = walk->runs->count;
        const enum umb_status status = brick_column(user, bx, by, &four[q], error);
        if (status != UMB_OK) {
            return status;
        }
    }
    return umbb_column_join(walk->pool, UMB_LEVEL_BRICK + 1, four, mark, walk->runs, column, error);
}

enum umb_status umbb_column_of_square(struct umb_pool *pool, const struct umbb_tile *tile,
                                      const struct umbb_square *square, struct umbb_runs *runs,
                                      struct umbb_column *column, struct umb_error *error)
{
    struct walk walk = {.pool = pool, .tile = tile, .runs = runs, .slicer = umbb_slicer_best()};
    const int one_brick = square->level == UMB_LEVEL_BRICK;
    const struct umbb_column_tree tree = {
        .pool = pool,
        .runs = runs,
        .log2_size = tile->log2_size,
        .leaf_level = one_brick ? UMB_LEVEL_BRICK : UMB_LEVEL_BRICK + 1,
        .max_lit = tile->max_lit,
        .min_end = tile->min_end,
        .leaf = one_brick ? brick_column : quad_column,
        .user = &walk,
    };
    return umbb_column_of_tree(&tree, square->level, square->place, column, error);
}
