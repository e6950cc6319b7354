/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Squares of a tile, built by jobs: texels below a proven square must not be read, and the tile's
 * column must be that of the whole tile built at once.
 */
#define _DEFAULT_SOURCE
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bake/build/tile_squares.h"

#define TILE_LOG2  7 /* squares of 32 texels, four to a square that may be proven */
#define BACKGROUND 4096

/* Copies an array so that its first half cannot be read: it lies on a page without access. */
struct half_array {
    char *mapping;
    size_t bytes; /* of the mapping */
    int32_t *items;
};

static struct half_array half_array_of(const int32_t *items, size_t count)
{
    const size_t page = (size_t)sysconf(_SC_PAGESIZE), half = count / 2 * sizeof *items;
    const size_t closed = (half + page - 1) / page * page;
    struct half_array array = {.bytes = 2 * closed};
    array.mapping =
        mmap(NULL, array.bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_true(array.mapping != MAP_FAILED);
    memcpy(array.mapping + closed, items + count / 2, half);
    assert_int_equal(mprotect(array.mapping, closed, PROT_NONE), 0);
    array.items = (int32_t *)(void *)(array.mapping + closed - half);
    return array;
}

/* Texels of a rough surface; the upper half of the tile is lit to one depth. */
static void fill(struct umbb_tile *tile)
{
    uint32_t seed = 12345;
    const size_t texels = (size_t)tile->size * (size_t)tile->size;
    for (size_t i = 0; i < texels; i++) {
        seed = seed * 1664525U + 1013904223U;
        const int is_flat = i < texels / 2;
        tile->lit[i] = is_flat ? BACKGROUND / 2 : (int32_t)(1000 + i / 64 % 97 + (seed >> 30));
        tile->end[i] = tile->lit[i] + (is_flat ? 0 : (int32_t)(seed >> 27 & 7));
    }
    tile->background = BACKGROUND;
    umbb_tile_reduce(tile, 0, 0, tile->size >> UMB_LEVEL_BRICK);
    umbb_tile_pyramid(tile);
}

/* The same tile with its upper half proven: reads of texels and pyramid below a proven square cause
 * a fault. */
static struct umbb_tile proven_above(const struct umbb_tile *tile, struct half_array *arrays,
                                     size_t *count)
{
    struct umbb_tile half = *tile;
    const size_t texels = (size_t)tile->size * (size_t)tile->size;
    half.lit = (arrays[(*count)++] = half_array_of(tile->lit, texels)).items;
    half.end = (arrays[(*count)++] = half_array_of(tile->end, texels)).items;
    for (uint32_t level = UMB_LEVEL_BRICK; level < UMBB_SQUARE_LOG2; level++) {
        const size_t squares = texels >> (2 * level);
        half.max_lit[level] =
            (arrays[(*count)++] = half_array_of(tile->max_lit[level], squares)).items;
        half.min_end[level] =
            (arrays[(*count)++] = half_array_of(tile->min_end[level], squares)).items;
    }
    memset(half.proven, 1, 2); /* of two rows of two squares */
    return half;
}

static void run_square(void *user, uint32_t job, unsigned thread)
{
    (void)thread;
    umbb_squares_job(user, job);
}

static void squares_read_nothing_below_a_proven_one(void **state)
{
    (void)state;
    struct umb_error error;
    struct umbb_tile tile;
    assert_int_equal(umbb_tile_init(&tile, TILE_LOG2, 1, &error), UMB_OK);
    fill(&tile);
    struct half_array arrays[2 + 2 * UMBB_SQUARE_LOG2];
    size_t array_count = 0;
    const struct umbb_tile half = proven_above(&tile, arrays, &array_count);

    struct umb__pool pools[2];
    struct umbb_runs runs[2] = {{.count = 0}, {.count = 0}};
    struct umbb_column columns[2];
    umb__pool_init(&pools[0], NULL, SIZE_MAX);
    umb__pool_init(&pools[1], NULL, SIZE_MAX);
    const struct umbb_square whole = {TILE_LOG2, {0, 0}};
    assert_int_equal(umbb_column_of_square(&pools[0], &tile, &whole, &runs[0], &columns[0], &error),
                     UMB_OK);

    struct umbb_squares *squares;
    struct umbu_threads *jobs;
    assert_int_equal(umbb_squares_create(TILE_LOG2, &squares, &error), UMB_OK);
    assert_int_equal(umbu_threads_create(1, &jobs, &error), UMB_OK);
    umbb_squares_begin(squares, &half);
    umbu_threads_start(jobs, run_square, squares, UMBB_SQUARE_COUNT);
    assert_int_equal(umbb_squares_column(squares, jobs, &pools[1], &runs[1], &columns[1], &error),
                     UMB_OK);
    umbu_threads_wait(jobs, NULL, NULL);

    assert_true(columns[0].run_count > 1);
    assert_memory_equal(&columns[0], &columns[1], sizeof columns[0]);
    assert_int_equal(pools[0].level[UMB_LEVEL_BRICK].count, pools[1].level[UMB_LEVEL_BRICK].count);
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= TILE_LOG2; level++) {
        assert_int_equal(pools[0].level[level].count, pools[1].level[level].count);
    }
    umbu_threads_destroy(jobs);
    umbb_squares_destroy(squares);
    for (size_t i = 0; i < 2; i++) {
        umb__pool_finish(&pools[i]);
        umbb_runs_finish(&runs[i]);
    }
    for (size_t i = 0; i < array_count; i++) {
        assert_int_equal(munmap(arrays[i].mapping, arrays[i].bytes), 0);
    }
    umbb_tile_finish(&tile);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(squares_read_nothing_below_a_proven_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
