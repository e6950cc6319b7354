/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Builds the mapped layout of an octree. An octree node of odd level 5, 7, ... becomes one wide
 * node, into which the nodes of even levels dissolve. Levels above the grid dissolve into the
 * grid's cells.
 */
#include "format/mapped.h"

#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/node_places.h"

#define GRID_LOG2_TOP 6U /* Finest grid: finer ones gain nothing beside columns */

struct builder {
    const struct umb__octree *octree;
    const struct umb__content *content;
    struct umb__mapped *mapped;
    struct umb_error *error;
    uint32_t level_highest;               /* Highest level of the cells of all grids */
    uint32_t *word_of[UMB_LEVEL_MAX + 1]; /* First word of the wide node of each octree node */
};

/* The 64 grandchildren of an octree node: their masks, and the numbers of the mixed ones. */
struct wide {
    uint64_t mixed, lit;
    uint32_t numbers[64]; /* Octree numbers of the mixed ones, in bit order */
};

static void widen(const struct umb__octree *octree, uint32_t level, uint32_t index,
                  struct wide *wide)
{
    const struct umb__octree_level *upper = &octree->level[level];
    const struct umb__octree_level *lower = &octree->level[level - 1];
    const uint32_t *child = upper->children + upper->first[index];
    uint32_t number_at[64];
    wide->mixed = 0;
    wide->lit = 0;
    for (unsigned c = 0; c < 8; c++) {
        enum umb__node_state state = umb__mask_state(upper->masks[index], c);
        uint32_t node = state == UMB__NODE_MIXED ? *child++ : 0;
        const uint32_t *grandchild =
            state == UMB__NODE_MIXED ? lower->children + lower->first[node] : NULL;
        for (unsigned g = 0; g < 8; g++) {
            enum umb__node_state inner =
                grandchild ? umb__mask_state(lower->masks[node], g) : state;
            unsigned bit = umb__wide_bit(c, g);
            if (inner == UMB__NODE_MIXED) {
                wide->mixed |= (uint64_t)1 << bit;
                number_at[bit] = *grandchild++;
            } else {
                wide->lit |= (uint64_t)(inner == UMB__NODE_LIT) << bit;
            }
        }
    }
    unsigned count = 0;
    for (uint64_t rest = wide->mixed; rest; rest &= rest - 1) {
        wide->numbers[count++] = number_at[__builtin_ctzll(rest)];
    }
}

static enum umb_status no_memory(const struct builder *b)
{
    return umb_fail(b->error, UMB_E_NO_MEMORY, "expanding: out of memory");
}

/* Returns the length in 8-byte words of the wide node that an octree node becomes. It has one
 * number for each mixed grandchild. */
static uint64_t words_of(const struct umb__octree *octree, uint32_t level, uint32_t index)
{
    const struct umb__octree_level *upper = &octree->level[level];
    const struct umb__octree_level *lower = &octree->level[level - 1];
    uint64_t mixed = 0;
    for (uint32_t c = upper->first[index]; c < upper->first[index + 1]; c++) {
        mixed += lower->first[upper->children[c] + 1] - lower->first[upper->children[c]];
    }
    return umb__wide_words(mixed);
}

/* Returns the bytes of all wide nodes and bricks. The grids' budget is a share of them. */
static uint64_t content_bytes(const struct umb__octree *octree)
{
    uint64_t bytes = (uint64_t)octree->brick_count * 64;
    for (uint32_t level = UMB__WIDE_FIRST; level <= UMB_LEVEL_MAX; level += 2) {
        for (uint32_t node = 0; node < octree->level[level].count; node++) {
            bytes += words_of(octree, level, node) * 8;
        }
    }
    return bytes;
}

/* Places every wide node: level 5 first, in the order of the octree. Levels above the cells of
 * every grid dissolve into the grids and get no nodes. */
static enum umb_status place_nodes(struct builder *b)
{
    struct umb__view *view = &b->mapped->view;
    uint64_t words = 0;
    for (uint32_t i = 0; i < UMB__WIDE_COUNT; i++) {
        uint32_t level = UMB__WIDE_FIRST + 2 * i;
        uint32_t count = level <= b->level_highest ? b->octree->level[level].count : 0;
        struct umb__node_places places = {.end = words};
        view->level_begin[i] = words;
        b->word_of[level] = umb__alloc(b->mapped->alloc, count, sizeof(uint32_t));
        if (!b->word_of[level]) {
            return no_memory(b);
        }
        for (uint32_t node = 0; node < count; node++) {
            if (places.end > UINT32_MAX - 64) {
                return umb_fail(b->error, UMB_E_TOO_LARGE, "expanding: more than 32 GiB of nodes");
            }
            b->word_of[level][node] =
                (uint32_t)umb__place_node(&places, words_of(b->octree, level, node));
        }
        words = places.end;
    }
    view->level_begin[UMB__WIDE_COUNT] = words;
    view->node_words = words;
    return UMB_OK;
}

static uint32_t number_of(const struct builder *b, uint32_t level, uint32_t index)
{
    return level == UMB_LEVEL_BRICK ? index : b->word_of[level][index];
}

static void write_node(const struct builder *b, uint32_t level, uint32_t index)
{
    uint64_t *words = b->mapped->nodes + b->word_of[level][index];
    struct wide wide;
    widen(b->octree, level, index, &wide);
    words[0] = wide.mixed;
    words[1] = wide.lit;
    unsigned count = (unsigned)__builtin_popcountll(wide.mixed);
    for (unsigned i = 0; i < count; i += 2) {
        uint64_t low = number_of(b, level - 2, wide.numbers[i]);
        uint64_t high = i + 1 < count ? number_of(b, level - 2, wide.numbers[i + 1]) : 0;
        words[2 + i / 2] = low | high << 32;
    }
}

static void write_nodes(const struct builder *b)
{
    memset(b->mapped->nodes, 0, (size_t)b->mapped->view.node_words * sizeof *b->mapped->nodes);
    for (uint32_t level = UMB__WIDE_FIRST; level <= b->level_highest; level += 2) {
        for (uint32_t node = 0; node < b->octree->level[level].count; node++) {
            write_node(b, level, node);
        }
    }
}

/* Sizes the grid of a frustum of 2^n voxels a side within a budget of bytes: see mapped.h. */
static uint32_t choose_grid(uint32_t n, uint64_t budget)
{
    uint32_t smallest = n % 2 == 1 ? 0 : 1, grid = smallest;
    for (uint32_t g = smallest; g <= GRID_LOG2_TOP && g + UMB_LEVEL_BRICK <= n; g += 2) {
        if ((uint64_t)4 << (3 * g) <= budget) {
            grid = g;
        }
    }
    return grid;
}

/* A cube of grid cells. */
struct cube {
    uint32_t level;   /* Level of the node that fills the cube */
    uint32_t x, y, z; /* First cell */
};

/* Fills the cells of a cube from the octree node, or the uniform state, that covers the cube. */
static void fill_cells(const struct builder *b, uint32_t frustum, struct cube cube,
                       enum umb__node_state state, uint32_t index)
{
    const struct umb__top *top = &b->mapped->tops[frustum];
    uint32_t g = top->grid_log2;
    uint32_t cell_level = b->content->frusta[frustum].log2_size - g;
    uint32_t *grid = b->mapped->grid + top->first_cell;
    if (cube.level == cell_level || state != UMB__NODE_MIXED) {
        uint32_t value = state == UMB__NODE_MIXED
                             ? number_of(b, cube.level, index) + UMB__CELL_FIRST
                             : (uint32_t)state;
        uint32_t side = 1U << (cube.level - cell_level);
        for (uint32_t z = cube.z; z < cube.z + side; z++) {
            for (uint32_t y = cube.y; y < cube.y + side; y++) {
                for (uint32_t x = cube.x; x < cube.x + side; x++) {
                    grid[x + (y << g) + ((size_t)z << (2 * g))] = value;
                }
            }
        }
        return;
    }
    const struct umb__octree_level *level = &b->octree->level[cube.level];
    const uint32_t *child = level->children + level->first[index];
    uint32_t half = 1U << (cube.level - 1 - cell_level);
    for (unsigned c = 0; c < 8; c++) {
        enum umb__node_state inner = umb__mask_state(level->masks[index], c);
        struct cube part = {cube.level - 1, cube.x + (c & 1) * half, cube.y + (c >> 1 & 1) * half,
                            cube.z + (c >> 2) * half};
        fill_cells(b, frustum, part, inner, inner == UMB__NODE_MIXED ? *child++ : 0);
    }
}

/* Sizes the grids and determines the highest level of wide nodes. */
static enum umb_status size_grids(struct builder *b)
{
    struct umb__mapped *mapped = b->mapped;
    uint32_t count = b->content->frustum_count;
    uint64_t budget = content_bytes(b->octree) / 8 / count;
    uint64_t cells = 0;
    mapped->tops = umb__alloc_zeroed(mapped->alloc, count, sizeof *mapped->tops);
    if (!mapped->tops) {
        return no_memory(b);
    }
    for (uint32_t i = 0; i < count; i++) {
        uint32_t n = b->content->frusta[i].log2_size;
        uint32_t g = choose_grid(n, budget);
        mapped->tops[i].grid_log2 = g;
        mapped->tops[i].first_cell = cells;
        cells += (uint64_t)1 << (3 * g);
        b->level_highest = n - g > b->level_highest ? n - g : b->level_highest;
    }
    mapped->view.grid_count = cells;
    mapped->view.brick_count = b->octree->brick_count;
    return UMB_OK;
}

static void fill_grids(const struct builder *b)
{
    for (uint32_t i = 0; i < b->content->frustum_count; i++) {
        struct cube cube = {b->octree->roots[i].level, 0, 0, 0};
        fill_cells(b, i, cube, b->octree->roots[i].state, b->octree->roots[i].index);
    }
}

/* Refuses an octree and mapped layout that exceed the memory limit together. */
static enum umb_status check_memory(const struct builder *b, uint64_t max_memory_bytes)
{
    const struct umb__octree *octree = b->octree;
    const struct umb__view *view = &b->mapped->view;
    uint64_t bytes =
        (uint64_t)octree->brick_count * 64 + view->node_words * 8 +
        view->grid_count * sizeof(uint32_t) + umb__columns_bytes_max(b->content, b->mapped) +
        (uint64_t)octree->root_count * (sizeof(struct umb__octree_root) + sizeof(struct umb__top));
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        const struct umb__octree_level *level = &octree->level[l];
        if (level->count == 0) {
            continue;
        }
        bytes += (uint64_t)level->count * (sizeof *level->masks + sizeof *level->first) +
                 sizeof *level->first + (uint64_t)level->first[level->count] * 4;
        bytes += l <= b->level_highest ? (uint64_t)level->count * sizeof(uint32_t) : 0;
    }
    return bytes <= max_memory_bytes
               ? UMB_OK
               : umb_fail(b->error, UMB_E_TOO_LARGE,
                          "asset: laying it out takes %llu bytes, the limit is %llu",
                          (unsigned long long)bytes, (unsigned long long)max_memory_bytes);
}

/* Builds everything but the bricks. */
static enum umb_status build(struct builder *b, uint64_t max_memory_bytes)
{
    struct umb__mapped *mapped = b->mapped;
    struct umb__view *view = &mapped->view;
    UMB__TRY(size_grids(b));
    UMB__TRY(place_nodes(b));
    UMB__TRY(check_memory(b, max_memory_bytes));
    mapped->grid = umb__alloc_large(mapped->alloc, (size_t)view->grid_count, sizeof *mapped->grid);
    mapped->nodes =
        umb__alloc_large(mapped->alloc, (size_t)view->node_words, sizeof *mapped->nodes);
    if (!mapped->grid || !mapped->nodes) {
        return no_memory(b);
    }
    write_nodes(b);
    fill_grids(b);
    view->tops = mapped->tops;
    view->grid = mapped->grid;
    view->nodes = mapped->nodes;
    return umb__columns_build(b->content, mapped, b->error);
}

enum umb_status umb__mapped_build(struct umb__octree *octree, const struct umb__content *content,
                                  uint64_t max_memory_bytes, struct umb__mapped *mapped,
                                  struct umb_error *error)
{
    memset(mapped, 0, sizeof *mapped);
    mapped->alloc = octree->alloc;
    struct builder b = {.octree = octree, .content = content, .mapped = mapped, .error = error};
    const enum umb_status status = build(&b, max_memory_bytes);
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(mapped->alloc, b.word_of[level]);
    }
    if (status != UMB_OK) {
        umb__mapped_finish(mapped);
        return status;
    }
    mapped->bricks = octree->bricks;
    octree->bricks = NULL;
    octree->brick_count = 0;
    mapped->view.bricks = (const uint64_t(*)[8])mapped->bricks;
    return UMB_OK;
}

void umb__mapped_finish(struct umb__mapped *mapped)
{
    umb__free(mapped->alloc, mapped->tops);
    umb__free(mapped->alloc, mapped->grid);
    umb__free(mapped->alloc, mapped->nodes);
    umb__free(mapped->alloc, mapped->bricks);
    umb__free(mapped->alloc, mapped->columns);
    umb__free(mapped->alloc, mapped->pieces);
    memset(mapped, 0, sizeof *mapped);
}
