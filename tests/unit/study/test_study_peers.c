/* SPDX-License-Identifier: Apache-2.0 */
/* The study's peers, a shadow map and a sparse volume, compared with windows counted texel by
 * texel. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "study/nanovdb_peer.h"
#include "study/shadow_map16.h"

#define LOG2   7
#define SIDE   (1 << LOG2)
#define POINTS 3001 /* not a multiple of any block */

static const int widths[] = {1, 3, 5, 9, 17};
static const double identity[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

static int32_t lit[SIDE][SIDE]; /* [y][x]: voxels before the first occluder */
static float points[POINTS][3];

static uint32_t random_next(uint32_t *state)
{
    *state = *state * 1664525U + 1013904223U;
    return *state >> 8;
}

/* Steps of height, ragged ones, and columns that nothing blocks; points also outside. */
static void scene_make(void)
{
    uint32_t state = 7;
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++) {
            const int32_t ragged = (int32_t)(random_next(&state) % SIDE);
            lit[y][x] = x < SIDE / 3 ? 40 + y / 16 : x < 2 * SIDE / 3 ? ragged : SIDE;
        }
    }
    for (size_t i = 0; i < POINTS; i++) {
        for (int k = 0; k < 3; k++) {
            points[i][k] = (float)(random_next(&state) % (2 * SIDE)) * 0.75F - 30.0F + 0.3F;
        }
    }
}

static double naive(const float point[3], int taps)
{
    const int cx = (int)floorf(point[0]), cy = (int)floorf(point[1]);
    const int floored = (int)floorf(point[2]), z = floored < SIDE ? floored : SIDE - 1;
    int count = 0;
    for (int y = cy - taps / 2; y <= cy + taps / 2; y++) {
        for (int x = cx - taps / 2; x <= cx + taps / 2; x++) {
            const int inside = x >= 0 && y >= 0 && x < SIDE && y < SIDE;
            count += !inside || lit[y][x] > z;
        }
    }
    return (double)count / (taps * taps);
}

static void answers_check(const float answers[POINTS], int taps)
{
    for (size_t i = 0; i < POINTS; i++) {
        assert_true(fabs((double)answers[i] - naive(points[i], taps)) < 1e-6);
    }
}

static void map_fill(struct umbt_map16 *map)
{
    struct umb_error error;
    assert_int_equal(umbt_map16_init(map, LOG2, identity, &error), UMB_OK);
    for (uint32_t y = 0; y < SIDE; y += 8) {
        for (uint32_t x = 0; x < SIDE; x += 8) {
            int32_t block[64];
            for (uint32_t i = 0; i < 64; i++) {
                block[i] = lit[y + i / 8][x + i % 8];
            }
            umbt_map16_put(map, x, y, block);
        }
    }
}

static void the_map_counts_every_window_by_every_way(void **state)
{
    static float answers[POINTS];
    struct umbt_map16 map;
    (void)state;
    if (!umbt_map16_supported()) {
        skip();
    }
    scene_make();
    map_fill(&map);
    const uint64_t both = umbt_map16_bytes(&map);
    for (size_t t = 0; t < sizeof widths / sizeof widths[0]; t++) {
        for (int way = 0; way < UMBT_MAP16_WAYS; way++) {
            struct umbt_map16_query query = {.map = &map,
                                             .points = points[0],
                                             .count = POINTS,
                                             .taps = widths[t],
                                             .answers = answers};
            (void)umbt_map16_tune(&query, (enum umbt_map16_way)way);
            assert_int_equal(query.way, way);
            umbt_map16_run(&query);
            answers_check(answers, widths[t]);
        }
    }
    umbt_map16_drop(&map, 1);
    assert_int_equal(umbt_map16_bytes(&map), both / 2);
    umbt_map16_finish(&map);
}

static int block_state(const void *user, uint32_t x, uint32_t y, uint32_t z, uint64_t slices[8])
{
    int any_lit = 0, any_shadowed = 0;
    (void)user;
    for (uint32_t slice = 0; slice < 8; slice++) {
        slices[slice] = 0;
        for (uint32_t i = 0; i < 64; i++) {
            const int is_lit = lit[8 * y + i / 8][8 * x + i % 8] > (int32_t)(8 * z + slice);
            slices[slice] |= (uint64_t)is_lit << i;
            any_lit |= is_lit;
            any_shadowed |= !is_lit;
        }
    }
    return any_lit && any_shadowed ? 2 : any_lit;
}

static void the_volume_counts_every_window_by_every_way(void **state)
{
    static float answers[POINTS];
    (void)state;
    if (!umbt_nanovdb_is_built() || !umbt_map16_supported()) {
        skip();
    }
    scene_make();
    for (size_t i = 0; i < POINTS; i++) {
        points[i][2] = fabsf(points[i][2]); /* it has no voxels before the first */
    }
    struct umbt_nanovdb *volume = umbt_nanovdb_make(LOG2, identity, block_state, NULL);
    assert_non_null(volume);
    assert_true(umbt_nanovdb_bytes(volume) > 0);
    for (size_t t = 0; t < sizeof widths / sizeof widths[0]; t++) {
        for (int way = 0; way < UMBT_NANOVDB_WAYS; way++) {
            struct umbt_nanovdb_query query = {.peer = volume,
                                               .points = points[0],
                                               .count = POINTS,
                                               .taps = widths[t],
                                               .way = (enum umbt_nanovdb_way)way,
                                               .answers = answers};
            umbt_nanovdb_run(&query);
            answers_check(answers, widths[t]);
        }
    }
    umbt_nanovdb_destroy(volume);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_map_counts_every_window_by_every_way),
        cmocka_unit_test(the_volume_counts_every_window_by_every_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
