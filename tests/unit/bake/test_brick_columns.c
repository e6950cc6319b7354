/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the column over one square of 16x16 texels, voxel by voxel, with the texels. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "bake/build/columns.h"

#define TILE_LOG2  4
#define BACKGROUND 2048

static uint32_t seed = 1;

static uint32_t draw(uint32_t end)
{
    seed = seed * 1664525U + 1013904223U;
    return (uint32_t)((uint64_t)seed * end >> 32);
}

/* Draws texels within `spread` of one another. In: gap: most that a texel's `end` lies behind its
 * `lit`. */
static void fill(struct umbb_tile *tile, uint32_t spread, uint32_t gap)
{
    const uint32_t base = 16 + draw(100);
    for (size_t block = 0; block < 4; block++) {
        const uint32_t low = draw(spread), range = 1 + draw(spread - low);
        for (size_t i = 0; i < 64; i++) {
            tile->lit[64 * block + i] = (int32_t)(base + low + draw(range));
            if (gap > 0) {
                tile->end[64 * block + i] = tile->lit[64 * block + i] + (int32_t)draw(gap);
            }
        }
    }
    tile->background = BACKGROUND;
    umbb_tile_reduce(tile, 0, 0, tile->size >> UMB_LEVEL_BRICK);
    umbb_tile_pyramid(tile);
}

/* 1 if voxel (x, y, z) is lit. */
static int voxel_is_lit(const struct umb__pool *pool, const struct umbb_runs *runs,
                        const struct umbb_column *column, uint32_t x, uint32_t y, uint32_t z)
{
    if (z / 16 < column->mixed_first || z / 16 >= column->mixed_end) {
        return z / 16 < column->mixed_first;
    }
    size_t run = column->run_first;
    while (runs->items[run].z_end <= z / 16) {
        run++;
    }
    assert_true(run < column->run_first + column->run_count);
    const struct umb__pool_level *level = &pool->level[UMB_LEVEL_BRICK + 1];
    const uint32_t node = runs->items[run].ref, c = x / 8 + 2 * (y / 8) + 4 * (z / 8 % 2);
    assert_true(node < level->count);
    uint32_t before = 0; /* mixed children */
    for (uint32_t i = 0; i < c; i++) {
        before += (level->masks[node] >> (2 * i) & 3) == UMB__NODE_MIXED;
    }
    const unsigned state = level->masks[node] >> (2 * c) & 3;
    if (state != UMB__NODE_MIXED) {
        return state == UMB__NODE_LIT;
    }
    const uint32_t brick = level->children[level->first[node] + before];
    return (int)(pool->bricks[brick][z % 8] >> (x % 8 + 8 * (y % 8)) & 1);
}

static void check_column(const struct umbb_tile *tile, const struct umb__pool *pool,
                         const struct umbb_runs *runs, const struct umbb_column *column)
{
    for (uint32_t texel = 0; texel < 256; texel++) {
        const uint32_t x = texel % 16, y = texel / 16;
        const size_t at = 64 * (x / 8 + 2 * (y / 8)) + x % 8 + 8 * (y % 8);
        for (uint32_t z = 0; z < 1024; z++) {
            const int is_lit = voxel_is_lit(pool, runs, column, x, y, z);
            if ((int32_t)z < tile->lit[at] ? !is_lit : (int32_t)z >= tile->end[at] && is_lit) {
                fail_msg("texel %u, %u: voxel %u of lit %d, end %d is %s", x, y, z, tile->lit[at],
                         tile->end[at], is_lit ? "lit" : "shadowed");
            }
        }
    }
}

static void check_columns(int is_loose, int closed_rule)
{
    for (uint32_t spread = 1; spread < 600; spread += 1 + spread / 6) {
        struct umbb_tile tile;
        struct umb__pool pool;
        struct umbb_runs runs = {0};
        struct umbb_column column;
        const struct umbb_square square = {TILE_LOG2, {0, 0}};
        assert_int_equal(umbb_tile_init(&tile, TILE_LOG2, closed_rule, NULL), UMB_OK);
        if (is_loose) {
            umb__pool_init_loose(&pool, NULL, SIZE_MAX);
        } else {
            umb__pool_init(&pool, NULL, SIZE_MAX);
        }
        fill(&tile, spread, closed_rule ? 1 + spread / 2 : 0);
        assert_int_equal(umbb_column_of_square(&pool, &tile, &square, &runs, &column, NULL),
                         UMB_OK);
        check_column(&tile, &pool, &runs, &column);
        umbb_runs_finish(&runs);
        umb__pool_finish(&pool);
        umbb_tile_finish(&tile);
    }
}

static void every_voxel_of_a_quad_is_right_however_high(void **state)
{
    (void)state;
    check_columns(0, 0);
    check_columns(1, 0);
}

static void every_defined_voxel_of_a_quad_is_right_however_high(void **state)
{
    (void)state;
    check_columns(0, 1);
    check_columns(1, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_voxel_of_a_quad_is_right_however_high),
        cmocka_unit_test(every_defined_voxel_of_a_quad_is_right_however_high),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
