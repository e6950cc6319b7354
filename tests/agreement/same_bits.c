/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Prints a digest of the answers of each integer technique to the same made-up input, a line for
 * each technique. `make same-bits` builds it by gcc and clang without and with optimisation, and
 * compares the digests. The program itself compares the plain kernels with those for AVX2; exit
 * code 1: they differ.
 *
 *     same_bits [--plain]     --plain: nothing for AVX2, as on a machine without it
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "../unit/bake/bake_soups.h"
#include "../unit/maps/maps_fixture.h"
#include "bake/analysis/light_frame.h"
#include "bake/analysis/sun_position.h"
#include "query/query_parts.h"
#include "umbrage/curve.h"

enum {
    LOG2 = 8,
    SIZE = 1 << LOG2,
    POINTS = 20000,
    MAP_SIDE = 96
};

static const double voxel_m = 0.07;
static const double origin[3] = {123456.7, -9876.5, 43.21};
static double places[POINTS][3];
static float normals[POINTS][3];
static float values[POINTS];
static int failures;

static void tell(const char *what, unsigned number, const void *bytes, size_t size)
{
    printf("%s-%u %016llx\n", what, number, (unsigned long long)XXH3_64bits(bytes, size));
}

static int ground(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 90 + (x * 7 + y * 3) % 23 + (x / 32 * 5 + y / 32 * 11) % 40;
}

static void make_points(void)
{
    uint64_t seed = 20261121;
    for (size_t i = 0; i < (size_t)POINTS * 3; i++) {
        places[i / 3][i % 3] = (random_unit(&seed) * 1.2 - 0.1) * SIZE * voxel_m;
        normals[i / 3][i % 3] = (float)(random_unit(&seed) * 2 - 1.5);
    }
}

/* Answers by the kernel that the machine chooses, and by the plain one. */
static void ask_dag(const struct umb_asset *asset, const char *what, unsigned number,
                    const struct umb_query_settings *settings, int plain_only, umb__kernel_fn plain)
{
    const struct umb_points points = {.positions = places,
                                      .format = UMB_POINT_F64,
                                      .normals = normals,
                                      .count = POINTS,
                                      .origin = {origin[0], origin[1], origin[2]}};
    struct umb_answers answers = {.values = values};
    struct umb_query query;
    if (umb_query_prepare(asset, settings, &query, NULL) != UMB_OK) {
        abort();
    }
    const struct umb__query *q = (const struct umb__query *)(const void *)query.opaque;
    (plain != NULL ? plain : q->kernel)(q, &points, 0, POINTS, &answers);
    const uint64_t digest = XXH3_64bits(values, sizeof values);
    tell(what, number, values, sizeof values);
    if (!plain_only && plain != NULL) {
        q->kernel(q, &points, 0, POINTS, &answers);
        failures += XXH3_64bits(values, sizeof values) != digest;
    }
}

static void dag(int plain_only)
{
    const struct voxels voxels = {ground, NULL, LOG2, 1};
    struct bytes packed = make_packed(&voxels, voxel_m, origin);
    struct bytes mapped = make_mapped(&packed);
    struct umb_asset *asset;
    tell("packed", 0, packed.data, packed.size);
    tell("mapped", 0, mapped.data, mapped.size);
    if (umb_asset_open_bytes(packed.data, packed.size, NULL, &asset, NULL) != UMB_OK) {
        abort();
    }
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        ask_dag(asset, "dag", taps, &(struct umb_query_settings){.taps = taps}, plain_only,
                umb__kernel_base);
        ask_dag(asset, "tent", taps,
                &(struct umb_query_settings){.taps = taps, .filter = UMB_FILTER_TENT}, plain_only,
                NULL);
        ask_dag(asset, "gaussian", taps,
                &(struct umb_query_settings){.taps = taps, .filter = UMB_FILTER_GAUSSIAN},
                plain_only, NULL);
    }
    for (uint32_t level = 3; level <= umb_level_max(LOG2); level += 2) {
        ask_dag(asset, "level", level, &(struct umb_query_settings){.level = level}, plain_only,
                umb__kernel_coarse);
    }
    ask_dag(asset, "penumbra", 0,
            &(struct umb_query_settings){.filter = UMB_FILTER_PENUMBRA, .light_extent = 0.3},
            plain_only, NULL);
    umb_asset_close(asset);
    bytes_finish(&mapped);
    bytes_finish(&packed);
}

static void ask_map(const struct umb_map *map, const char *what)
{
    static double at[POINTS][3];
    uint64_t seed = 7;
    for (size_t i = 0; i < (size_t)POINTS * 3; i++) {
        at[i / 3][i % 3] = random_unit(&seed) * (i % 3 == 2 ? 1 : MAP_SIDE);
    }
    for (unsigned taps = 1; taps <= 9; taps += 2) {
        const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = taps});
        ask(&query, (const double(*)[3])at, POINTS, values);
        tell(what, taps, values, sizeof values);
    }
}

static void maps(void)
{
    static const enum umb_map_format formats[] = {UMB_MAP_F32, UMB_MAP_U24, UMB_MAP_U16};
    static const char *const names[] = {"pcf-f32", "pcf-u24", "pcf-u16"};
    static float depth[MAP_SIDE * MAP_SIDE];
    const struct umb_map_frustum frustum = plain_frustum(MAP_SIDE, MAP_SIDE);
    uint64_t seed = 8;
    for (size_t i = 0; i < (size_t)MAP_SIDE * MAP_SIDE; i++) {
        depth[i] = (float)random_unit(&seed);
    }
    for (int i = 0; i < 3; i++) {
        struct umb_map *map =
            map_of(&frustum, depth, &(struct umb_map_settings){.format = formats[i]});
        ask_map(map, names[i]);
        umb_map_destroy(map);
    }
}

static void deep(void)
{
    static const char *const names[] = {"", "deep-search", "deep-links", "deep-stream"};
    static uint64_t first[MAP_SIDE * MAP_SIDE + 1];
    static struct umb_map_fragment fragments[8 * MAP_SIDE * MAP_SIDE];
    const struct umb_map_frustum frustum = plain_frustum(MAP_SIDE, MAP_SIDE);
    const struct umb_map_fragments in = {first, fragments};
    uint64_t seed = 9;
    for (size_t i = 0; i < (size_t)MAP_SIDE * MAP_SIDE; i++) {
        first[i + 1] = first[i] + next_random(&seed) % 8;
        for (uint64_t k = first[i]; k < first[i + 1]; k++) {
            fragments[k].depth = (float)random_unit(&seed);
            fragments[k].alpha = (float)random_unit(&seed);
        }
    }
    for (int way = UMB_MAP_DEEP_SEARCH; way <= UMB_MAP_DEEP_STREAM; way++) {
        struct umb_map *map;
        if (umb_map_build_deep(&frustum, &in,
                               &(struct umb_map_deep_settings){.way = (enum umb_map_deep_way)way},
                               NULL, &map, NULL) != UMB_OK) {
            abort();
        }
        ask_map(map, names[way]);
        umb_map_destroy(map);
    }
    /* These computations are not in integers, but they call no function of libm except sqrt. */
    static const char *const moments[] = {"moments-4", "moments-6", "moments-8"};
    for (uint32_t i = 0; i < 3; i++) {
        const struct umb_map_settings settings = {.technique = UMB_MAP_MOMENTS, .terms = 4 + 2 * i};
        struct umb_map *map;
        if (umb_map_build_translucent(&frustum, &in, &settings, NULL, &map, NULL) != UMB_OK) {
            abort();
        }
        ask_map(map, moments[i]);
        umb_map_destroy(map);
    }
}

static uint64_t octree_digest(const struct umb__octree *octree)
{
    uint64_t digest = XXH3_64bits(octree->bricks, octree->brick_count * sizeof octree->bricks[0]);
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        const struct umb__octree_level *of = &octree->level[level];
        const size_t children = of->count > 0 ? of->first[of->count] : 0;
        digest = XXH3_64bits_withSeed(of->masks, of->count * sizeof of->masks[0], digest);
        digest = XXH3_64bits_withSeed(of->children, children * sizeof of->children[0], digest);
    }
    return digest;
}

/* Bakes with the fastest way of drawing, or with the plain one. */
static uint64_t bake(const struct soup *soup, int closed_rule, int plain)
{
    const struct umbb_casters casters = soup_casters(soup, closed_rule);
    const struct umbb_depth_options how = {.tile_log2 = 6, .threads = 1, .plain = plain};
    const struct umbb_bake_options options = {.log2_size = LOG2,
                                              .tile_log2 = 6,
                                              .threads = 1,
                                              .closed_rule = closed_rule,
                                              .octree_max_bytes = (size_t)1 << 30};
    struct umbb_depth depth;
    struct umb__octree octree;
    if (umbb_depth_raster_create(&casters, &how, &depth, NULL) != UMB_OK ||
        bake_frustum(&depth, &options, &octree, NULL, NULL) != UMB_OK) {
        abort();
    }
    const uint64_t digest = octree_digest(&octree);
    depth.destroy(depth.state);
    umb__octree_finish(&octree);
    return digest;
}

static void bakes(int plain_only)
{
    for (unsigned number = 0; number < 6; number++) { /* the last two before a lamp */
        struct soup soup = {.size = SIZE, .random_state = 100 + number};
        for (int i = 0; i < 12; i++) {
            soup_random_box(&soup);
        }
        soup_random_open(&soup, 400);
        if (number >= 4) {
            soup_before_lamp(&soup, 50.0);
        }
        const uint64_t digest = bake(&soup, number % 2, 1);
        tell("bake", number, &digest, sizeof digest);
        failures += !plain_only && bake(&soup, number % 2, 0) != digest;
        soup_finish(&soup);
    }
}

static void frames(void)
{
    double directions[2000][3], axes[2000][3][3];
    for (int i = 0; i < 2000; i++) {
        if (i % 2) {
            umbb_sun_direction(0.37 * i, 0.045 * i, 1, directions[i]);
        } else {
            umbb_sun_towards(9000.0 + 0.13 * i, 0.04 * i - 40, 0.1 * i, directions[i]);
        }
        umbb_light_axes(directions[i], axes[i]);
    }
    tell("suns", 0, directions, sizeof directions);
    tell("axes", 0, axes, sizeof axes);
}

int main(int argc, char **argv)
{
    const int plain_only = argc > 1 && strcmp(argv[1], "--plain") == 0;
    make_points();
    dag(plain_only);
    maps();
    deep();
    bakes(plain_only);
    frames();
    if (failures > 0) {
        printf("%d techniques differ between kernels\n", failures);
    }
    return failures > 0;
}
