/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The lowest columns of a square: bricks made from texels, and the nodes over 2 x 2 x 2 bricks.
 *
 * Most quads (16 x 16 texels) of a surface are a few nodes high. Their nodes come from a table of
 * bricks, without a walk along four columns; the nodes of other quads come from joining columns.
 */
#include <string.h>

#include "bake/build/brick_slices.h"
#include "bake/build/columns.h"
#include "base/try.h"

/* State of the building of a tile's bricks. */
struct walk {
    struct umb__pool *pool;
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
    return umb__pool_brick(walk->pool, visible, ref, error);
}

/* Returns the first brick at or after z, before `end`, that holds one of the values; else `end`. */
static uint32_t next_event(const struct umbb_slicer *slicer, const int32_t *values, uint32_t z,
                           uint32_t end)
{
    const uint32_t least = (uint32_t)slicer->least_from(values, (int32_t)(8 * z));
    return least >> UMB_LEVEL_BRICK < end ? least >> UMB_LEVEL_BRICK : end;
}

/* Returns the first brick after z that may differ from brick z; `end` if no brick before `end` may.
 * Brick z has an event if some value v of lit or end has v / 8 == z. Between two events all bricks
 * are equal, because every comparison of a value with a slice has the same result. */
static uint32_t next_brick(const struct walk *walk, const int32_t *const values[2], uint32_t z,
                           uint32_t end)
{
    if (end - z <= 2) { /* too few for a search */
        return z + 1;
    }
    uint32_t event = next_event(walk->slicer, values[0], z, end);
    event = values[1] == values[0] ? event : next_event(walk->slicer, values[1], z, event);
    return event > z + 1 ? event : z + 1;
}

/* Makes the bricks of one 8x8 square. */
static enum umb_status brick_column(void *user, size_t x, size_t y, struct umbb_column *column,
                                    struct umb_error *error)
{
    const struct walk *walk = user;
    const size_t block = (y << (walk->tile->log2_size - UMB_LEVEL_BRICK)) + x;
    const int32_t *const values[2] = {walk->tile->lit + block * 64, walk->tile->end + block * 64};
    uint32_t next;
    for (uint32_t z = column->mixed_first; z < column->mixed_end; z = next) {
        uint32_t ref;
        next = next_brick(walk, values, z, column->mixed_end);
        UMB__TRY(build_brick(walk, values, z, &ref, error));
        UMB__TRY(umbb_runs_push(walk->runs, column->run_first, next, ref, error));
    }
    column->run_count = walk->runs->count - column->run_first;
    return UMB_OK;
}

/* Prefetches the texels of the quad that the tree visits after quad (x, y). */
static void next_quad_ahead(const struct umbb_tile *tile, size_t x, size_t y)
{
    size_t bit = 1;
    while ((x & y & bit) != 0) { /* last of a quarter: the next one is in another quarter */
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

/* Computes the bounds of the four columns of bricks over a quad, without their runs. */
static void quad_bounds(const struct umbb_tile *tile, size_t x, size_t y,
                        struct umbb_column four[4])
{
    const size_t width = (size_t)tile->size >> UMB_LEVEL_BRICK;
    for (size_t q = 0; q < 4; q++) {
        const size_t at = (2 * y + (q >> 1)) * width + 2 * x + (q & 1);
        four[q] = umbb_column_bounds(UMB_LEVEL_BRICK, tile->max_lit[UMB_LEVEL_BRICK][at],
                                     tile->min_end[UMB_LEVEL_BRICK][at]);
    }
}

/* Most nodes that a low quad may have along the light. */
#define LOW_NODES 8U

/* All bricks of a low quad. */
struct low {
    uint32_t first;                    /* z of the bricks of row 0 */
    uint32_t bricks[2 * LOW_NODES][4]; /* [row][x + 2 * y]; two rows are a node's eight children */
};

/* Fills column q. */
static enum umb_status low_column(const struct walk *walk, size_t block,
                                  const struct umbb_column *column, size_t q, struct low *low,
                                  struct umb_error *error)
{
    const int32_t *const values[2] = {walk->tile->lit + block * 64, walk->tile->end + block * 64};
    uint32_t next;
    for (uint32_t z = column->mixed_first; z < column->mixed_end; z = next) {
        uint32_t ref;
        next = next_brick(walk, values, z, column->mixed_end);
        UMB__TRY(build_brick(walk, values, z, &ref, error));
        for (uint32_t i = z; i < next; i++) {
            low->bricks[i - low->first][q] = ref;
        }
    }
    return UMB_OK;
}

/* Makes the nodes of a low quad. In: four: the columns of its bricks. */
static enum umb_status low_quad(const struct walk *walk, const size_t place[2],
                                const struct umbb_column four[4], struct umbb_column *column,
                                struct umb_error *error)
{
    const size_t width = (size_t)walk->tile->size >> UMB_LEVEL_BRICK;
    const uint32_t nodes = column->mixed_end - column->mixed_first;
    struct low low;
    low.first = 2 * column->mixed_first;
    for (uint32_t i = 0; i < 2 * nodes; i++) {
        for (size_t q = 0; q < 4; q++) {
            low.bricks[i][q] =
                low.first + i < four[q].mixed_first ? UMB__REF_LIT : UMB__REF_SHADOWED;
        }
    }
    for (size_t q = 0; q < 4; q++) {
        const size_t block = (2 * place[1] + (q >> 1)) * width + 2 * place[0] + (q & 1);
        UMB__TRY(low_column(walk, block, &four[q], q, &low, error));
    }
    uint32_t ref = UMB__REF_LIT;
    for (uint32_t i = 0; i < nodes; i++) {
        if (i == 0 ||
            memcmp(low.bricks[2 * i - 2], low.bricks[2 * i], sizeof low.bricks[0] * 2) != 0) {
            UMB__TRY(
                umb__pool_node(walk->pool, UMB_LEVEL_BRICK + 1, low.bricks[2 * i], &ref, error));
        }
        UMB__TRY(
            umbb_runs_push(walk->runs, column->run_first, column->mixed_first + i + 1, ref, error));
    }
    column->run_count = walk->runs->count - column->run_first;
    return UMB_OK;
}

/* Makes nodes of level 4: joins the four columns of bricks in a 16x16 square. */
static enum umb_status quad_column(void *user, size_t x, size_t y, struct umbb_column *column,
                                   struct umb_error *error)
{
    const struct walk *walk = user;
    struct umbb_column four[4];
    next_quad_ahead(walk->tile, x, y);
    quad_bounds(walk->tile, x, y, four);
    if (column->mixed_end - column->mixed_first <= LOW_NODES) {
        const size_t place[2] = {x, y};
        return low_quad(walk, place, four, column, error);
    }
    for (size_t q = 0; q < 4; q++) {
        four[q].run_first = walk->runs->count;
        UMB__TRY(brick_column(user, 2 * x + (q & 1), 2 * y + (q >> 1), &four[q], error));
    }
    return umbb_column_join(walk->pool, UMB_LEVEL_BRICK + 1, four, walk->runs, column, error);
}

enum umb_status umbb_column_of_square(struct umb__pool *pool, const struct umbb_tile *tile,
                                      const struct umbb_square *square, struct umbb_runs *runs,
                                      struct umbb_column *column, struct umb_error *error)
{
    struct walk walk = {
        .pool = pool, .tile = tile, .runs = runs, .slicer = umbb_slicer(umbb_vectors_best())};
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
