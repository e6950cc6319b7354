/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Columns of the mapped layout (format/view.h), from its grids and nodes.
 *
 * A walk over the grid and below it meets the cubes of every column in order of depth, since z is
 * the highest part of a cell's and of a child's index. There are two walks: the first measures the
 * list of each column, the second fills the lists. Column widths are tried from wide to narrow; a
 * walk that costs more than its columns could save is stopped.
 */
#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "format/mapped.h"

/* Divisor of the layout's bytes that gives the columns' budget. Narrower columns need fewer
 * instructions but more cache lines, and in measurements the lines weigh more. */
#define BUDGET_SHARE     32U
#define UPDATES_PER_BYTE 2U /* Updates of columns a byte before a walk is stopped */

struct walk {
    const struct umb__view *view;
    const struct umb__top *top;
    uint32_t n, level;           /* Levels of the frustum, and of the columns' pieces */
    struct umb__column *columns; /* Columns of the frustum */
    uint32_t *pieces;            /* The frustum's pieces; NULL: lists are measured */
    uint64_t updates_left;       /* Updates of columns before the walk is stopped */
};

/* Adds pieces z0 .. z1 - 1 of one column, which all have one value. The value is lit or shadowed; a
 * run of one piece may also have the reference of a mixed node or brick. While the first walk
 * measures the column's list, column->first holds the value of the last piece; high < low then
 * means that all pieces so far are equal. */
static void take_run(const struct walk *w, struct umb__column *column, uint32_t z0, uint32_t z1,
                     uint32_t value)
{
    if (w->pieces) {
        uint32_t end = z1 <= column->high ? z1 : column->high + 1U;
        for (uint32_t z = z0 > column->low ? z0 : column->low; z < end; z++) {
            w->pieces[column->first + z - column->low] = value;
        }
        return;
    }
    bool uniform = value < UMB__CELL_FIRST;
    if (z0 == 0) {
        column->low = (uint16_t)(uniform ? z1 : 0); /* Above high, as nothing differs yet */
        column->high = 0;
    } else if (!uniform || value != column->first) {
        column->low = (uint16_t)(column->high < column->low ? column->low - 1 : column->low);
        column->high = (uint16_t)z0;
    } else if (column->high < column->low) {
        column->low = (uint16_t)z1;
    }
    column->first = value;
}

/* Sets the pieces that lie in a cube of one value, in all columns that cross the cube. In: at:
 * position of the cube, in cubes of its level. Returns false if the walk must stop. */
static bool take_cube(struct walk *w, uint32_t level, const uint32_t at[3], uint32_t value)
{
    uint32_t shift = level - w->level, row = w->n - w->level, side = 1U << shift;
    uint64_t updates = (uint64_t)side * side;
    if (updates > w->updates_left) {
        return false;
    }
    w->updates_left -= updates;
    for (uint32_t y = at[1] << shift; y < (at[1] + 1) << shift; y++) {
        for (uint32_t x = at[0] << shift; x < (at[0] + 1) << shift; x++) {
            take_run(w, &w->columns[x + ((size_t)y << row)], at[2] << shift, (at[2] + 1) << shift,
                     value);
        }
    }
    return true;
}

/* Visits a cell of the grid, or a node's child, by its value. Returns false if the walk must stop.
 * The recursion ends because each child is of a lower level. */
static bool walk_cube(struct walk *w, uint32_t level, const uint32_t at[3], uint32_t value)
{
    if (value < UMB__CELL_FIRST || level == w->level) {
        return take_cube(w, level, at, value);
    }
    const uint64_t *node = w->view->nodes + (value - UMB__CELL_FIRST);
    for (unsigned c = 0; c < 64; c++) {
        bool mixed = node[0] >> c & 1;
        const uint32_t child[3] = {4 * at[0] + (c & 3), 4 * at[1] + (c >> 2 & 3),
                                   4 * at[2] + (c >> 4)};
        uint32_t inner =
            mixed ? umb__wide_child(node, c) + UMB__CELL_FIRST : (uint32_t)(node[1] >> c & 1);
        if (!walk_cube(w, level - 2, child, inner)) {
            return false;
        }
    }
    return true;
}

static bool walk_frustum(struct walk *w)
{
    uint32_t g = w->top->grid_log2, side = 1U << g;
    const uint32_t *cell = w->view->grid + w->top->first_cell;
    for (uint32_t z = 0; z < side; z++) {
        for (uint32_t y = 0; y < side; y++) {
            for (uint32_t x = 0; x < side; x++) {
                const uint32_t at[3] = {x, y, z};
                if (!walk_cube(w, w->n - g, at, *cell++)) {
                    return false;
                }
            }
        }
    }
    return true;
}

/* Assigns each measured list its place among the frustum's pieces. Returns the number of pieces. */
static uint64_t place_lists(struct umb__column *columns, uint64_t count)
{
    uint64_t pieces = 2;
    for (uint64_t i = 0; i < count; i++) {
        struct umb__column *column = &columns[i];
        if (column->high < column->low) {
            column->low = 0; /* All equal: piece 0 or 1 */
            continue;
        }
        column->first = (uint32_t)pieces;
        pieces += (uint64_t)column->high - column->low + 1;
    }
    return pieces;
}

/* The measured columns of one frustum. */
struct measured {
    struct umb__column *columns;
    uint64_t count, pieces;
    uint32_t level;
};

/* Measures the lists of columns at w->level. If the lists take more than `bytes`, there are no
 * columns of this level. */
static enum umb_status measure(struct walk *w, const struct umb_alloc *alloc, uint64_t bytes,
                               struct measured *m)
{
    const uint64_t count = (uint64_t)1 << (2 * (w->n - w->level));
    const uint64_t all = count * sizeof *w->columns;
    *m = (struct measured){.count = count, .level = w->level};
    if (all > bytes) {
        return UMB_OK;
    }
    w->columns = umb__alloc(alloc, (size_t)count, sizeof *w->columns);
    if (!w->columns) {
        return UMB_E_NO_MEMORY;
    }
    w->updates_left = bytes < UINT64_MAX / UPDATES_PER_BYTE ? bytes * UPDATES_PER_BYTE : UINT64_MAX;
    if (walk_frustum(w)) {
        m->pieces = place_lists(w->columns, count);
        if (all + m->pieces * sizeof *w->pieces <= bytes) {
            m->columns = w->columns;
            return UMB_OK;
        }
    }
    umb__free(alloc, w->columns);
    return UMB_OK;
}

/* Finds the narrowest columns of a frustum that fit into `bytes`. If none fit, the frustum gets
 * columns as wide as the grid's cells. */
static enum umb_status choose_level(struct walk *w, const struct umb_alloc *alloc, uint64_t bytes,
                                    struct measured *best)
{
    struct measured next;
    w->level = w->n - w->top->grid_log2;
    enum umb_status status = measure(w, alloc, UINT64_MAX, best);
    while (status == UMB_OK && w->level > UMB__WIDE_FIRST) {
        w->level -= 2;
        status = measure(w, alloc, bytes, &next);
        if (!next.columns) {
            break;
        }
        umb__free(alloc, best->columns);
        *best = next;
    }
    return status;
}

/* Joins the measured columns of all frusta, and fills their lists. */
static enum umb_status join(const struct umb__content *content, const struct measured *measured,
                            struct umb__mapped *mapped)
{
    struct umb__view *view = &mapped->view;
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        mapped->tops[i].column_level = measured[i].level;
        mapped->tops[i].first_column = view->column_count;
        mapped->tops[i].first_piece = view->piece_count;
        view->column_count += measured[i].count;
        view->piece_count += measured[i].pieces;
    }
    mapped->columns =
        umb__alloc_large(mapped->alloc, (size_t)view->column_count, sizeof *mapped->columns);
    mapped->pieces =
        umb__alloc_large(mapped->alloc, (size_t)view->piece_count, sizeof *mapped->pieces);
    if (!mapped->columns || !mapped->pieces) {
        return UMB_E_NO_MEMORY;
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb__top *top = &mapped->tops[i];
        struct walk w = {.view = view,
                         .top = top,
                         .n = content->frusta[i].log2_size,
                         .level = top->column_level,
                         .columns = mapped->columns + top->first_column,
                         .pieces = mapped->pieces + top->first_piece,
                         .updates_left = UINT64_MAX};
        memcpy(w.columns, measured[i].columns, (size_t)measured[i].count * sizeof *w.columns);
        w.pieces[0] = UMB__CELL_SHADOWED;
        w.pieces[1] = UMB__CELL_LIT;
        (void)walk_frustum(&w); /* No limit can stop this walk */
    }
    view->columns = mapped->columns;
    view->pieces = mapped->pieces;
    return UMB_OK;
}

/* Returns the budget in bytes of the columns of one frustum. Columns as wide as the grid's cells
 * need no budget. Numbers of pieces fit 32 bits: a thirty-second of the bytes of 2^32 bricks and
 * words holds fewer than 2^32 pieces. */
static uint64_t budget_of(const struct umb__content *content, const struct umb__view *view)
{
    const uint64_t bytes = view->grid_count * 4 + view->node_words * 8 + view->brick_count * 64;
    return bytes / BUDGET_SHARE / content->frustum_count;
}

uint64_t umb__columns_bytes_max(const struct umb__content *content,
                                const struct umb__mapped *mapped)
{
    const uint64_t budget = budget_of(content, &mapped->view);
    uint64_t bytes = budget; /* Columns of the level that is being tried */
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const uint32_t g = mapped->tops[i].grid_log2;
        const uint64_t columns = ((uint64_t)1 << (2 * g)) * sizeof(struct umb__column);
        const uint64_t all = columns + (((uint64_t)1 << (3 * g)) + 2) * sizeof(uint32_t);
        /* Columns as measured, then columns and pieces as joined. */
        bytes += sizeof(struct measured) + (columns > budget ? columns : budget) +
                 (all > budget ? all : budget);
    }
    return bytes;
}

enum umb_status umb__columns_build(const struct umb__content *content, struct umb__mapped *mapped,
                                   struct umb_error *error)
{
    const struct umb__view *view = &mapped->view;
    const uint32_t count = content->frustum_count;
    const uint64_t bytes = budget_of(content, view);
    struct measured *measured = umb__alloc_zeroed(mapped->alloc, count, sizeof *measured);
    enum umb_status status = measured ? UMB_OK : UMB_E_NO_MEMORY;
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        struct walk w = {.view = view, .top = &mapped->tops[i], .n = content->frusta[i].log2_size};
        status = choose_level(&w, mapped->alloc, bytes, &measured[i]);
    }
    if (status == UMB_OK) {
        status = join(content, measured, mapped);
    }
    for (uint32_t i = 0; i < count && measured; i++) {
        umb__free(mapped->alloc, measured[i].columns);
    }
    umb__free(mapped->alloc, measured);
    return status == UMB_OK ? UMB_OK : umb_fail(error, status, "expanding: out of memory");
}
