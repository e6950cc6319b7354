/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Grids and columns of the lower and the upper asset. A column lists all cells above its square, so
 * that grids and columns have the same cells and sizes that never change. They are filled again
 * when nodes of the cells' level or above have come or gone: few pages have such nodes.
 */
#include <string.h>

#include "base/memory.h"
#include "partial/partial_parts.h"

#define GRID_LOG2_MOST 6U /* Finest grid */
#define CELL_LEVEL_LOW                                                                             \
    9U                    /* Lowest level of the cells of a grid that could be coarser: most pages
                              have no node of this level, and leave the cells as they are */
#define CELL_BYTES    16U /* Bytes of a cell: in two grids and two lists of pieces */
#define BUDGET_SHARE  16U /* Divisor of the memory budget that limits grids and columns */
#define CONTENT_SHARE 8U  /* Divisor of the asset's bytes that does */

/* Sizes the grid of a frustum of 2^n voxels a side within a budget of bytes. Cells are of an odd
 * level, at least 5. */
static uint32_t choose_grid(uint32_t n, uint64_t budget)
{
    uint32_t grid = n % 2 == 1 ? 0 : 1;
    for (uint32_t g = grid + 2; g <= GRID_LOG2_MOST && g + CELL_LEVEL_LOW <= n; g += 2) {
        if ((uint64_t)CELL_BYTES << (3 * g) <= budget) {
            grid = g;
        }
    }
    return grid;
}

/* Returns the bytes that grids and columns of a frustum may take. */
static uint64_t budget_of(const struct umb_partial *p)
{
    uint64_t bytes = 64 * p->canonical.counts[UMB_LEVEL_BRICK];
    for (uint32_t l = UMB__WIDE_FIRST; l <= UMB_LEVEL_MAX; l += 2) {
        bytes += 2 * 32 * p->canonical.counts[l];
    }
    const uint64_t share = bytes / CONTENT_SHARE, limit = p->meter.limit / BUDGET_SHARE;
    return (share < limit ? share : limit) / p->canonical.content.frustum_count;
}

static void size_tops(struct umb_partial *p)
{
    const struct umb__content *content = &p->canonical.content;
    const uint64_t budget = budget_of(p);
    p->grid_count = p->column_count = p->piece_count = 0;
    p->level_highest = 0;
    p->level_lowest = UMB_LEVEL_MAX;
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const uint32_t n = content->frusta[i].log2_size, g = choose_grid(n, budget);
        p->tops[i] = (struct umb__top){.grid_log2 = g,
                                       .column_level = n - g,
                                       .first_cell = p->grid_count,
                                       .first_column = p->column_count,
                                       .first_piece = p->piece_count};
        p->grid_count += (uint64_t)1 << (3 * g);
        p->column_count += (uint64_t)1 << (2 * g);
        p->piece_count += ((uint64_t)1 << (3 * g)) + 2;
        p->level_highest = n - g > p->level_highest ? n - g : p->level_highest;
        p->level_lowest = n - g < p->level_lowest ? n - g : p->level_lowest;
    }
}

/* Sets the columns of all frusta: each has all pieces of its square. */
static void set_columns(struct umb_partial *p)
{
    struct umb__column *column = p->columns;
    for (uint32_t i = 0; i < p->canonical.content.frustum_count; i++) {
        const uint32_t g = p->tops[i].grid_log2;
        for (uint32_t k = 0; k < 1U << (2 * g); k++) {
            *column++ =
                (struct umb__column){.first = 2 + (k << g), .high = (uint16_t)((1U << g) - 1)};
        }
    }
}

enum umb_status umb__tops_make(struct umb_partial *p, struct umb_error *error)
{
    p->tops = umb__alloc(&p->alloc, p->canonical.content.frustum_count, sizeof *p->tops);
    bool made = p->tops != NULL;
    if (made) {
        size_tops(p);
        p->columns = umb__alloc(&p->alloc, (size_t)p->column_count, sizeof *p->columns);
        made = p->columns != NULL;
    }
    for (size_t i = 0; i < 2 && made; i++) {
        p->grids[i] = umb__alloc(&p->alloc, (size_t)p->grid_count, sizeof *p->grids[i]);
        p->pieces[i] = umb__alloc(&p->alloc, (size_t)p->piece_count, sizeof *p->pieces[i]);
        made = p->grids[i] && p->pieces[i];
    }
    if (!made) {
        umb__tops_finish(p);
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "partial asset: grids and columns do not fit the memory budget");
    }
    set_columns(p);
    p->tops_stale = true;
    return UMB_OK;
}

void umb__tops_finish(struct umb_partial *p)
{
    for (size_t i = 0; i < 2; i++) {
        umb__free(&p->alloc, p->grids[i]);
        umb__free(&p->alloc, p->pieces[i]);
        p->grids[i] = p->pieces[i] = NULL;
    }
    umb__free(&p->alloc, p->tops);
    umb__free(&p->alloc, p->columns);
    p->tops = NULL;
    p->columns = NULL;
}

/* --- filling ---------------------------------------------------------------------------------- */

/* The grids and lists of one frustum. */
struct filling {
    const struct umb_partial *p;
    uint32_t g, cell_level;
    uint32_t *grid[2], *pieces[2];
};

/* A cube of cells. */
struct cube {
    uint32_t level;
    uint32_t x, y, z; /* First cell */
};

/* Gives the cells of a cube a value in the lower and in the upper asset. */
static void fill_cube(const struct filling *f, const struct cube *cube, uint32_t lower,
                      uint32_t upper)
{
    const uint32_t side = 1U << (cube->level - f->cell_level), g = f->g;
    for (size_t i = 0; i < 2; i++) {
        const uint32_t value = i == 0 ? lower : upper;
        for (uint32_t y = cube->y; y < cube->y + side; y++) {
            for (uint32_t x = cube->x; x < cube->x + side; x++) {
                uint32_t *cell = f->grid[i] + x + (y << g);
                uint32_t *piece = f->pieces[i] + ((x + (y << g)) << g);
                for (uint32_t z = cube->z; z < cube->z + side; z++) {
                    cell[(size_t)z << (2 * g)] = value;
                    piece[z] = value;
                }
            }
        }
    }
}

/* Fills a cube from its node. Recursion ends at the cells' level: no more cubes are visited than
 * the grid has cells, and a seventh. */
static void fill_node(const struct filling *f, const struct cube *cube, struct umb__node_place at)
{
    const struct umb__laid *laid = f->p->pages[at.page].laid;
    if (!laid) {
        fill_cube(f, cube, UMB__CELL_SHADOWED, UMB__CELL_LIT);
        return;
    }
    if (cube->level == f->cell_level) {
        const uint32_t value = UMB__CELL_FIRST + laid->words[cube->level][at.position];
        fill_cube(f, cube, value, value);
        return;
    }
    const struct umb__expanded_level *from = &laid->nodes->level[cube->level];
    const uint32_t *child = from->children + from->first[at.position];
    const uint32_t half = 1U << (cube->level - 1 - f->cell_level);
    for (unsigned c = 0; c < 8; c++) {
        const enum umb__node_state state = umb__mask_state(from->masks[at.position], c);
        const struct cube part = {cube->level - 1, cube->x + (c & 1) * half,
                                  cube->y + (c >> 1 & 1) * half, cube->z + (c >> 2) * half};
        if (state == UMB__NODE_MIXED) {
            fill_node(f, &part, umb__expanded_child(laid->nodes, at.page, cube->level, *child++));
        } else {
            fill_cube(f, &part, (uint32_t)state, (uint32_t)state);
        }
    }
}

void umb__tops_fill(struct umb_partial *p)
{
    for (uint32_t i = 0; i < p->canonical.content.frustum_count; i++) {
        const struct umb__top *top = &p->tops[i];
        const struct umb__packed_root *root = &p->canonical.roots[i];
        struct filling f = {.p = p, .g = top->grid_log2, .cell_level = top->column_level};
        for (size_t k = 0; k < 2; k++) {
            uint32_t *pieces = p->pieces[k] + top->first_piece;
            pieces[0] = UMB__CELL_SHADOWED;
            pieces[1] = UMB__CELL_LIT;
            f.grid[k] = p->grids[k] + top->first_cell;
            f.pieces[k] = pieces + 2;
        }
        const struct cube whole = {p->canonical.content.frusta[i].log2_size, 0, 0, 0};
        if (root->state == UMB__NODE_MIXED) {
            fill_node(&f, &whole, (struct umb__node_place){root->page, root->position});
        } else {
            fill_cube(&f, &whole, root->state, root->state);
        }
    }
    p->tops_stale = false;
    umb__changes_note_tops(p);
}
