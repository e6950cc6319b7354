/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Depth paths: rasteriser and ray caster must give the same integers for every tiling, and these
 * must be what a slow loop over all triangles gives.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>

#include "bake/depth/coverage.h"
#include "bake_soups.h"

typedef enum umb_status (*create_fn)(const struct umbb_casters *, const struct umbb_depth_options *,
                                     struct umbb_depth *, struct umb_error *);

/* Computes lit and end of the whole map, row by row. */
struct map {
    int32_t *lit, *end;
};

static struct map map_get(create_fn create, const struct umbb_casters *casters, uint32_t tile_log2,
                          int plain)
{
    struct umb_error error;
    const size_t n = (size_t)casters->size;
    struct map map = {malloc(n * n * sizeof(int32_t)), malloc(n * n * sizeof(int32_t))};
    assert_non_null(map.lit);
    assert_non_null(map.end);
    const struct umbb_depth_options options = {
        .tile_log2 = tile_log2, .threads = 1, .plain = plain};
    struct umbb_depth depth;
    assert_int_equal(create(casters, &options, &depth, &error), UMB_OK);
    struct umbb_tile tile;
    assert_int_equal(umbb_tile_init(&tile, tile_log2, casters->closed_rule, &error), UMB_OK);
    const int32_t blocks = tile.size / umbb_tile_block(&tile);
    for (tile.y0 = 0; tile.y0 < casters->size; tile.y0 += tile.size) {
        for (tile.x0 = 0; tile.x0 < casters->size; tile.x0 += tile.size) {
            for (size_t i = 0; i < (size_t)tile.size * (size_t)tile.size; i++) {
                tile.lit[i] = tile.end[i] = casters->size; /* empty blocks are not written */
            }
            assert_int_equal(depth.begin(depth.state, 0, &tile, &error), UMB_OK);
            for (int32_t b = 0; b < blocks * blocks; b++) {
                depth.block(depth.state, 0, 0, &tile, b % blocks, b / blocks);
            }
            umbb_tile_pyramid(&tile);
            int32_t most = -1, least = INT32_MAX;
            for (int32_t y = 0; y < tile.size; y++) {
                for (int32_t x = 0; x < tile.size; x++) {
                    const size_t to = (size_t)(tile.y0 + y) * n + (size_t)(tile.x0 + x);
                    map.lit[to] = tile.lit[umbb_tile_index(&tile, x, y)];
                    map.end[to] = tile.end[umbb_tile_index(&tile, x, y)];
                    most = map.lit[to] > most ? map.lit[to] : most;
                    least = map.end[to] < least ? map.end[to] : least;
                }
            }
            assert_int_equal(tile.max_lit[tile_log2][0], most);
            assert_int_equal(tile.min_end[tile_log2][0], least);
        }
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
    return map;
}

static void map_free(struct map *map)
{
    free(map->lit);
    free(map->end);
}

static void assert_maps_equal(const struct map *a, const struct map *b, int32_t size)
{
    for (size_t i = 0; i < (size_t)size * (size_t)size; i++) {
        if (a->lit[i] != b->lit[i] || a->end[i] != b->end[i]) {
            fail_msg("texel %zu: lit %d end %d against lit %d end %d", i, (int)a->lit[i],
                     (int)a->end[i], (int)b->lit[i], (int)b->end[i]);
        }
    }
}

static void compare_paths(struct soup *soup)
{
    for (int closed_rule = 0; closed_rule <= 1; closed_rule++) {
        const struct umbb_casters casters = soup_casters(soup, closed_rule);
        const uint32_t whole = soup_log2(soup);
        struct map reference = map_get(umbb_depth_raster_create, &casters, whole, 1);
        for (uint32_t tile_log2 = 6; tile_log2 <= whole; tile_log2++) {
            struct map other = map_get(umbb_depth_raster_create, &casters, tile_log2, 0);
            assert_maps_equal(&other, &reference, soup->size);
            map_free(&other);
        }
        struct map traced = map_get(umbb_depth_embree_create, &casters, 6, 0);
        assert_maps_equal(&traced, &reference, soup->size);
        map_free(&traced);
        map_free(&reference);
    }
}

static void raster_and_embree_agree_on_mixtures(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 4; seed++) {
        struct soup soup;
        soup_init(&soup, 128, seed);
        soup_mixture(&soup);
        compare_paths(&soup);
        soup_finish(&soup);
    }
}

static void raster_and_embree_agree_on_many_slivers_and_shared_edges(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 256, 21);
    soup_random_open(&soup, 150);
    /* Makes a height field on texel centres: every edge is shared, and every corner is on a
     * centre. */
    for (int y = 0; y < 20; y++) {
        for (int x = 0; x < 20; x++) {
            const double a[3] = {100.5 + 7 * x, 90.5 + 5 * y, 40.0 + (x * y) % 7};
            const double b[3] = {107.5 + 7 * x, 90.5 + 5 * y, 40.0 + ((x + 1) * y) % 7};
            const double c[3] = {100.5 + 7 * x, 95.5 + 5 * y, 40.0 + (x * (y + 1)) % 7};
            const double d[3] = {107.5 + 7 * x, 95.5 + 5 * y, 40.0 + ((x + 1) * (y + 1)) % 7};
            soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
            soup_add(&soup, c, b, d, UMBB_CASTER_OPEN);
        }
    }
    compare_paths(&soup);
    soup_finish(&soup);
}

static void raster_and_embree_agree_on_boxes_whose_edges_lie_on_texel_centres(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 1);
    for (int i = 0; i < 20; i++) {
        const double low[3] = {1.5 + 2 * (i % 5), 1.5 + 3 * (i / 5), 1.5 + i};
        const double high[3] = {low[0] + 9.0, low[1] + 11.0, low[2] + 12.0};
        soup_box(&soup, low, high, i % 2);
    }
    compare_paths(&soup);
    soup_finish(&soup);
}

/* One crossing of a texel's centre line. */
struct crossing {
    int32_t lit;
    int closed, front;
};

/* Prepares all triangles; those that cover nothing get no rows. */
static struct umbb_coverage *prepare_all(const struct soup *soup)
{
    struct umbb_coverage *all = calloc(soup->count, sizeof *all);
    assert_non_null(all);
    for (size_t i = 0; i < soup->count; i++) {
        if (!umbb_coverage_prepare((const double(*)[3])soup->corners[i], soup->size, &all[i])) {
            all[i].row_first = 1;
            all[i].row_last = 0;
        }
    }
    return all;
}

static size_t crossings_of(const struct soup *soup, const struct umbb_coverage *all, int32_t x,
                           int32_t y, struct crossing *list)
{
    size_t count = 0;
    for (size_t i = 0; i < soup->count; i++) {
        const struct umbb_coverage *c = &all[i];
        int32_t first, last;
        if (y < c->row_first || y > c->row_last) {
            continue;
        }
        const int front = umbb_coverage_row(c, y, &first, &last);
        if (x >= first && x <= last) {
            list[count++] = (struct crossing){
                .lit = umbb_coverage_lit(c, umbb_coverage_row_z(c, y), x),
                .closed = soup->kinds[i] != UMBB_CASTER_OPEN,
                .front = front != (soup->kinds[i] == UMBB_CASTER_CLOSED_FLIPPED),
            };
        }
    }
    return count;
}

/* Counts the solids in which a voxel lies: those entered minus those left before it. */
static int solids_at(const struct crossing *list, size_t count, int32_t z)
{
    int inside = 0;
    for (size_t i = 0; i < count; i++) {
        if (list[i].closed && list[i].lit <= z) {
            inside += list[i].front ? 1 : -1;
        }
    }
    return inside;
}

/* Returns the number of undefined voxels. */
static uint64_t check_against_crossings(const struct soup *soup)
{
    const struct umbb_casters closed = soup_casters(soup, 1), open = soup_casters(soup, 0);
    struct map with = map_get(umbb_depth_raster_create, &closed, 6, 0);
    struct map without = map_get(umbb_depth_raster_create, &open, 6, 0);
    struct crossing *list = malloc(soup->count * sizeof *list);
    assert_non_null(list);
    struct umbb_coverage *all = prepare_all(soup);
    uint64_t undefined = 0;
    for (int32_t y = 0; y < soup->size; y++) {
        for (int32_t x = 0; x < soup->size; x++) {
            const size_t at = (size_t)y * (size_t)soup->size + (size_t)x;
            const size_t count = crossings_of(soup, all, x, y, list);
            int32_t first = soup->size;
            for (size_t i = 0; i < count; i++) {
                first = list[i].lit < first ? list[i].lit : first;
            }
            assert_int_equal(without.lit[at], first);
            assert_int_equal(without.end[at], first);
            assert_int_equal(with.lit[at], first);
            assert_true(with.end[at] >= first && with.end[at] <= soup->size);
            if (first == soup->size) {
                assert_int_equal(with.end[at], soup->size);
            }
            for (int32_t z = first; z < with.end[at]; z++) {
                /* Undefined voxels must lie within a solid. */
                assert_true(solids_at(list, count, z) > 0);
                undefined++;
            }
        }
    }
    free(list);
    free(all);
    map_free(&with);
    map_free(&without);
    return undefined;
}

static void undefined_voxels_lie_inside_solids(void **state)
{
    (void)state;
    uint64_t undefined = 0;
    for (uint64_t seed = 31; seed <= 34; seed++) {
        struct soup soup;
        soup_init(&soup, 64, seed);
        soup_mixture(&soup);
        undefined += check_against_crossings(&soup);
        soup_finish(&soup);
    }
    assert_true(undefined > 10000); /* the rule did something */
}

static void nested_touching_and_intersecting_solids_stay_right(void **state)
{
    (void)state;
    static const double boxes[][6] = {
        {4, 4, 10, 40, 40, 50},            /* a big one */
        {10, 10, 20, 20, 20, 30},          /* inside it */
        {40, 4, 10, 60, 40, 50},           /* touches its side */
        {4, 4, 50, 40, 40, 60},            /* stands on its back */
        {30, 30, 5, 50, 50, 20},           /* cuts two of them */
        {20.5, 2.5, 2.5, 24.5, 61.5, 9.5}, /* in front, edges on centres */
        {4, 4, 10, 40, 40, 50},            /* the first once more */
    };
    struct soup soup;
    soup_init(&soup, 64, 0);
    for (size_t i = 0; i < sizeof boxes / sizeof boxes[0]; i++) {
        soup_box(&soup, boxes[i], boxes[i] + 3, (int)(i % 2));
        assert_true(check_against_crossings(&soup) > 0);
    }
    soup_finish(&soup);
}

static void an_open_face_in_front_leaves_nothing_undefined(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 0);
    const double low[3] = {10, 10, 20}, high[3] = {50, 50, 40};
    soup_box(&soup, low, high, 0);
    const double a[3] = {5, 5, 8}, b[3] = {5, 100, 8}, c[3] = {100, 5, 8};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    assert_int_equal(check_against_crossings(&soup), 0);
    soup_finish(&soup);
}

static void an_open_face_at_the_same_voxel_does_not_end_the_solid(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 0);
    const double low[3] = {10, 10, 20}, high[3] = {50, 50, 40};
    soup_box(&soup, low, high, 0);
    const uint64_t alone = check_against_crossings(&soup);
    const double a[3] = {10, 10, 20}, b[3] = {10, 50, 20}, c[3] = {50, 10, 20};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    assert_int_equal(check_against_crossings(&soup), alone);
    assert_int_equal(alone, 40 * 40 * 20);
    soup_finish(&soup);
}

static void an_empty_map_is_background(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 0);
    const double a[3] = {1, 1, 1}, b[3] = {2, 2, 2}, c[3] = {3, 3, 3};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    assert_int_equal(check_against_crossings(&soup), 0);
    compare_paths(&soup);
    soup_finish(&soup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(raster_and_embree_agree_on_mixtures),
        cmocka_unit_test(raster_and_embree_agree_on_many_slivers_and_shared_edges),
        cmocka_unit_test(raster_and_embree_agree_on_boxes_whose_edges_lie_on_texel_centres),
        cmocka_unit_test(undefined_voxels_lie_inside_solids),
        cmocka_unit_test(nested_touching_and_intersecting_solids_stay_right),
        cmocka_unit_test(an_open_face_in_front_leaves_nothing_undefined),
        cmocka_unit_test(an_open_face_at_the_same_voxel_does_not_end_the_solid),
        cmocka_unit_test(an_empty_map_is_background),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
