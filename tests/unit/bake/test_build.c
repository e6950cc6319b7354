/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The build: every defined voxel of the octree must agree with lit and end of its texel. Every tile
 * size and number of threads must give the same canonical tree.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>

#include "bake/build/brick_slices.h"
#include "bake/depth/coverage.h"
#include "bake_soups.h"

/* A triangle prepared once, and its layer: open, front, back. */
struct slow_triangle {
    struct umbb_coverage coverage;
    int layer_front, layer_back;
};

static struct slow_triangle *slow_prepare(const struct soup *soup, int closed_rule, size_t *count)
{
    struct slow_triangle *list = malloc((soup->count + 1) * sizeof *list);
    assert_non_null(list);
    *count = 0;
    for (size_t i = 0; i < soup->count; i++) {
        struct slow_triangle *t = &list[*count];
        if (umbb_coverage_prepare((const double(*)[3])soup->corners[i], soup->size, &t->coverage)) {
            const int flipped = soup->kinds[i] == UMBB_CASTER_CLOSED_FLIPPED;
            const int open = !closed_rule || soup->kinds[i] == UMBB_CASTER_OPEN;
            t->layer_front = open ? 0 : flipped ? 2 : 1;
            t->layer_back = open ? 0 : flipped ? 1 : 2;
            ++*count;
        }
    }
    return list;
}

/* Computes lit and end of a texel from all triangles, without tiles, bins or spans. */
static void slow_texel(const struct slow_triangle *list, size_t count, int32_t size, int32_t x,
                       int32_t y, int32_t *lit, int32_t *end)
{
    int32_t near[3] = {size, size, size};
    for (size_t i = 0; i < count; i++) {
        const struct umbb_coverage *c = &list[i].coverage;
        int32_t first, last;
        if (y < c->row_first || y > c->row_last) {
            continue;
        }
        const int front = umbb_coverage_row(c, y, &first, &last);
        if (x >= first && x <= last) {
            const int32_t depth = umbb_coverage_lit(c, umbb_coverage_row_z(c, y), x);
            int32_t *layer = &near[front ? list[i].layer_front : list[i].layer_back];
            *layer = depth < *layer ? depth : *layer;
        }
    }
    *lit = near[0] < near[1] ? near[0] : near[1];
    *lit = near[2] < *lit ? near[2] : *lit;
    *end = *lit == near[1] && near[2] < size ? near[2] : *lit;
}

static void check_every_voxel(const struct soup *soup, int closed_rule,
                              const struct umb__octree *octree)
{
    size_t count;
    struct slow_triangle *list = slow_prepare(soup, closed_rule, &count);
    for (int32_t y = 0; y < soup->size; y++) {
        for (int32_t x = 0; x < soup->size; x++) {
            int32_t lit, end;
            slow_texel(list, count, soup->size, x, y, &lit, &end);
            for (int32_t z = 0; z < soup->size; z++) {
                if (z >= lit && z < end) {
                    continue; /* undefined */
                }
                if (octree_voxel(octree, (uint32_t)x, (uint32_t)y, (uint32_t)z) != (z < lit)) {
                    fail_msg("voxel %d %d %d: lit %d end %d, octree says %d", (int)x, (int)y,
                             (int)z, (int)lit, (int)end, z >= lit);
                }
            }
        }
    }
    free(list);
}

static void every_defined_voxel_of_mixtures_is_right(void **state)
{
    (void)state;
    for (uint64_t seed = 101; seed <= 104; seed++) {
        struct soup soup;
        soup_init(&soup, seed % 2 ? 64 : 128, seed);
        soup_mixture(&soup);
        for (int closed_rule = 0; closed_rule <= 1; closed_rule++) {
            struct umb__octree octree;
            soup_bake(&soup, closed_rule, 6, 1, &octree);
            check_every_voxel(&soup, closed_rule, &octree);
            umb__octree_finish(&octree);
        }
        soup_finish(&soup);
    }
}

static void every_defined_voxel_of_closed_solids_is_right(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 128, 201);
    for (int i = 0; i < 8; i++) {
        soup_random_box(&soup);
        soup_random_ball(&soup);
    }
    struct umb__octree octree;
    soup_bake(&soup, 1, 7, 2, &octree);
    check_every_voxel(&soup, 1, &octree);
    umb__octree_finish(&octree);
    soup_finish(&soup);
}

/* Returns 1 if two nodes of two trees are equal, down to the bricks. */
static int same_tree(const struct umb__octree *a, const struct umb__octree *b, uint32_t level,
                     uint32_t i, uint32_t k, uint32_t *const seen[])
{
    if (level == UMB_LEVEL_BRICK) {
        return memcmp(a->bricks[i], b->bricks[k], sizeof a->bricks[i]) == 0;
    }
    if (seen[level][i] != UINT32_MAX) {
        return seen[level][i] == k; /* numbering is one to one in canonical trees */
    }
    const struct umb__octree_level *la = &a->level[level], *lb = &b->level[level];
    if (la->masks[i] != lb->masks[k]) {
        return 0;
    }
    for (unsigned c = 0; c < umb__mask_mixed_count(la->masks[i]); c++) {
        if (!same_tree(a, b, level - 1, la->children[la->first[i] + c],
                       lb->children[lb->first[k] + c], seen)) {
            return 0;
        }
    }
    seen[level][i] = k;
    return 1;
}

static void assert_same_octree(const struct umb__octree *a, const struct umb__octree *b)
{
    assert_int_equal(a->brick_count, b->brick_count);
    assert_int_equal(a->roots[0].state, b->roots[0].state);
    assert_int_equal(a->roots[0].level, b->roots[0].level);
    uint32_t *seen[UMB_LEVEL_MAX + 1] = {0};
    for (uint32_t level = 4; level <= a->roots[0].level; level++) {
        assert_int_equal(a->level[level].count, b->level[level].count);
        seen[level] = malloc((a->level[level].count + 1) * sizeof *seen[level]);
        assert_non_null(seen[level]);
        memset(seen[level], 0xff, (a->level[level].count + 1) * sizeof *seen[level]);
    }
    if (a->roots[0].state == UMB__NODE_MIXED) {
        assert_true(same_tree(a, b, a->roots[0].level, a->roots[0].index, b->roots[0].index, seen));
        for (uint32_t level = 4; level <= a->roots[0].level; level++) {
            for (uint32_t i = 0; i < a->level[level].count; i++) {
                assert_true(seen[level][i] != UINT32_MAX); /* every node is reached */
            }
        }
    }
    for (uint32_t level = 4; level <= a->roots[0].level; level++) {
        free(seen[level]);
    }
}

static void assert_canonical(const struct umb__octree *octree)
{
    for (uint32_t i = 0; i < octree->brick_count; i++) {
        int ones = 1, zeros = 1;
        for (int z = 0; z < 8; z++) {
            ones = ones && octree->bricks[i][z] == UINT64_MAX;
            zeros = zeros && octree->bricks[i][z] == 0;
        }
        assert_false(ones || zeros);
        for (uint32_t k = 0; k < i; k++) {
            assert_memory_not_equal(octree->bricks[i], octree->bricks[k], 64);
        }
    }
    for (uint32_t level = 4; level <= octree->roots[0].level; level++) {
        const struct umb__octree_level *l = &octree->level[level];
        for (uint32_t i = 0; i < l->count; i++) {
            assert_true(l->masks[i] != 0 && l->masks[i] != 0x5555);
            assert_int_equal(l->first[i + 1] - l->first[i], umb__mask_mixed_count(l->masks[i]));
            for (uint32_t k = 0; k < i; k++) {
                assert_false(l->masks[i] == l->masks[k] &&
                             memcmp(l->children + l->first[i], l->children + l->first[k],
                                    (l->first[i + 1] - l->first[i]) * sizeof(uint32_t)) == 0);
            }
        }
    }
}

static void tile_sizes_and_threads_give_the_same_canonical_octree(void **state)
{
    (void)state;
    for (uint64_t seed = 301; seed <= 303; seed++) {
        struct soup soup;
        soup_init(&soup, 512, seed);
        soup_mixture(&soup);
        for (int closed_rule = 0; closed_rule <= 1; closed_rule++) {
            struct umb__octree reference;
            soup_bake(&soup, closed_rule, 9, 1, &reference);
            if (seed == 301) {
                assert_canonical(&reference);
            }
            for (uint32_t tile_log2 = 6; tile_log2 <= 9; tile_log2++) {
                struct umb__octree other;
                soup_bake(&soup, closed_rule, tile_log2, tile_log2 % 2 ? 1 : 3, &other);
                assert_same_octree(&other, &reference);
                umb__octree_finish(&other);
            }
            umb__octree_finish(&reference);
        }
        soup_finish(&soup);
    }
}

static void order_of_triangles_does_not_matter(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 256, 401);
    soup_mixture(&soup);
    struct umb__octree one, two;
    soup_bake(&soup, 1, 8, 1, &one);
    for (size_t i = 0; i < soup.count / 2; i++) {
        double swap[3][3];
        const size_t k = soup.count - 1 - i;
        memcpy(swap, soup.corners[i], sizeof swap);
        memcpy(soup.corners[i], soup.corners[k], sizeof swap);
        memcpy(soup.corners[k], swap, sizeof swap);
        const uint8_t kind = soup.kinds[i];
        soup.kinds[i] = soup.kinds[k];
        soup.kinds[k] = kind;
    }
    soup_bake(&soup, 1, 7, 2, &two);
    assert_same_octree(&one, &two);
    umb__octree_finish(&one);
    umb__octree_finish(&two);
    soup_finish(&soup);
}

static void the_closed_rule_makes_the_octree_smaller(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 512, 501);
    for (int i = 0; i < 12; i++) {
        soup_random_ball(&soup);
    }
    struct umb__octree closed, open;
    soup_bake(&soup, 1, 8, 1, &closed);
    soup_bake(&soup, 0, 8, 1, &open);
    assert_true(closed.brick_count * 2 < open.brick_count);
    umb__octree_finish(&closed);
    umb__octree_finish(&open);
    soup_finish(&soup);
}

static void an_empty_scene_is_one_lit_root(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 256, 0);
    const double a[3] = {1, 1, 1}, b[3] = {2, 2, 2}, c[3] = {3, 3, 3};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    struct umb__octree octree;
    soup_bake(&soup, 0, 6, 1, &octree);
    assert_int_equal(octree.root_count, 1);
    assert_int_equal(octree.roots[0].state, UMB__NODE_LIT);
    assert_int_equal(octree.brick_count, 0);
    umb__octree_finish(&octree);
    soup_finish(&soup);
}

static void a_lid_over_everything_leaves_a_lit_slab_before_it(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 0);
    const double a[3] = {-100, -100, 32}, b[3] = {-100, 300, 32}, c[3] = {300, -100, 32};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    struct umb__octree octree;
    soup_bake(&soup, 0, 6, 1, &octree);
    assert_int_equal(octree.roots[0].state, UMB__NODE_MIXED);
    assert_int_equal(octree.level[6].count, 1);
    assert_int_equal(octree.level[6].masks[0], 0x0055); /* four lit in front, four shadowed */
    assert_int_equal(octree.level[5].count, 0);
    umb__octree_finish(&octree);
    soup_finish(&soup);
}

static void memory_limit_stops_the_build_with_a_reason(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 512, 601);
    soup_mixture(&soup);
    struct umb_error error;
    const struct umbb_casters casters = soup_casters(&soup, 0);
    const struct umbb_depth_options depth_options = {.tile_log2 = 7, .threads = 2};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), UMB_OK);
    const struct umbb_bake_options options = {
        .log2_size = 9, .tile_log2 = 7, .threads = 2, .octree_max_bytes = 150000};
    struct umb__octree octree;
    assert_int_equal(bake_frustum(&depth, &options, &octree, NULL, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "memory: the shadow octree"));
    assert_null(octree.bricks);
    depth.destroy(depth.state);
    soup_finish(&soup);
}

static void the_shared_limit_counts_columns_and_lists_too(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 512, 601);
    soup_mixture(&soup);
    struct umb_error error;
    const struct umbb_casters casters = soup_casters(&soup, 0);
    const struct umbb_depth_options depth_options = {.tile_log2 = 6, .threads = 2};
    static const size_t limits[] = {300, 60000, 400000};
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        struct umbb_depth depth;
        assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error),
                         UMB_OK);
        const struct umbb_bake_options options = {.log2_size = 9,
                                                  .tile_log2 = 6,
                                                  .threads = 2,
                                                  .octree_max_bytes = SIZE_MAX,
                                                  .shared_max_bytes = limits[i]};
        struct umb__octree octree;
        assert_int_equal(bake_frustum(&depth, &options, &octree, NULL, &error), UMB_E_LIMIT);
        assert_non_null(strstr(error.message, "memory"));
        assert_null(octree.bricks);
        depth.destroy(depth.state);
    }
    soup_finish(&soup);
}

/* Squares that do not fit into their tile's share of the memory that is left are built in another
 * way. */
static void octrees_do_not_depend_on_the_memory_that_is_left(void **state)
{
    (void)state;
    static const size_t limits[] = {(size_t)4 << 20, (size_t)24 << 20, 0}; /* none, some, all fit */
    struct soup soup;
    soup_init(&soup, 512, 601);
    soup_mixture(&soup);
    const struct umbb_casters casters = soup_casters(&soup, 0);
    const struct umbb_depth_options depth_options = {.tile_log2 = 8, .threads = 2};
    struct umb__octree reference;
    soup_bake(&soup, 0, 9, 1, &reference);
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        struct umbb_depth depth;
        struct umb_error error;
        struct umb__octree octree;
        assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error),
                         UMB_OK);
        const struct umbb_bake_options options = {.log2_size = 9,
                                                  .tile_log2 = 8,
                                                  .threads = 2,
                                                  .octree_max_bytes = SIZE_MAX,
                                                  .shared_max_bytes = limits[i]};
        assert_int_equal(bake_frustum(&depth, &options, &octree, NULL, &error), UMB_OK);
        assert_same_octree(&octree, &reference);
        umb__octree_finish(&octree);
        depth.destroy(depth.state);
    }
    umb__octree_finish(&reference);
    soup_finish(&soup);
}

static int always(void)
{
    return 1;
}

static void a_cancelled_bake_ends_cleanly(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 256, 701);
    soup_mixture(&soup);
    struct umb_error error;
    const struct umbb_casters casters = soup_casters(&soup, 0);
    const struct umbb_depth_options depth_options = {.tile_log2 = 6, .threads = 2};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), UMB_OK);
    const struct umbb_bake_options options = {.log2_size = 8,
                                              .tile_log2 = 6,
                                              .threads = 2,
                                              .octree_max_bytes = 1 << 30,
                                              .cancelled = always};
    struct umb__octree octree;
    assert_int_equal(bake_frustum(&depth, &options, &octree, NULL, &error), UMB_E_CANCELLED);
    depth.destroy(depth.state);
    soup_finish(&soup);
}

/* The least of the values that are at least z0. */
static int32_t slow_least(const int32_t values[64], int32_t z0)
{
    int32_t least = INT32_MAX;
    for (int i = 0; i < 64; i++) {
        least = values[i] >= z0 && values[i] < least ? values[i] : least;
    }
    return least;
}

static void check_slicer(const struct umbb_slicer *slicer, const int32_t values[64], int32_t z0)
{
    uint64_t slices[8];
    slicer->above(values, z0, slices);
    for (int i = 0; i < 64; i++) {
        for (int z = 0; z < 8; z++) {
            assert_int_equal(slices[z] >> i & 1, values[i] > z0 + z);
        }
    }
    assert_int_equal(slicer->least_from(values, z0), slow_least(values, z0));
}

static void slices_of_every_width_compare_every_depth(void **state)
{
    const struct umbb_slicer *const slicers[] = {&umbb_slicer_plain, umbb_slicer(UMBB_VECTORS_NONE),
                                                 umbb_slicer(UMBB_VECTORS_AVX2),
                                                 umbb_slicer(UMBB_VECTORS_AVX512)};
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 801);
    for (int round = 0; round < 2000; round++) {
        int32_t values[64];
        const int32_t z0 = (int32_t)(soup_bits(&soup) % 32768) * 8;
        for (int i = 0; i < 64; i++) {
            values[i] = round % 2 ? (int32_t)(soup_bits(&soup) % 262145)
                                  : z0 + (int32_t)(soup_bits(&soup) % 11) - 1;
            values[i] = values[i] < 0 ? 0 : values[i];
        }
        for (size_t i = 0; i < sizeof slicers / sizeof slicers[0]; i++) {
            if (slicers[i] != NULL) {
                check_slicer(slicers[i], values, z0);
            }
        }
    }
    soup_finish(&soup);
}

static void filling_keeps_what_is_defined_and_makes_runs(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 64, 802);
    for (int round = 0; round < 2000; round++) {
        uint64_t visible[8], allowed[8], filled[8];
        for (int z = 0; z < 8; z++) {
            visible[z] = soup_bits(&soup) & soup_bits(&soup) & soup_bits(&soup);
            allowed[z] = visible[z] | soup_bits(&soup) | soup_bits(&soup);
        }
        umbb_slices_fill(visible, allowed, filled);
        for (int z = 0; z < 8; z++) {
            assert_int_equal(visible[z] & ~filled[z], 0);
            assert_int_equal(filled[z] & ~allowed[z], 0);
        }
        umbb_slices_fill(visible, allowed, visible); /* in place */
        assert_memory_equal(visible, filled, sizeof filled);
    }
    const uint64_t low[8] = {7, 3, 1, 0, 0, 0, 0, 0};
    const uint64_t high[8] = {UINT64_MAX, 15, 15, 15, 15, 15, 8, 8};
    uint64_t filled[8];
    umbb_slices_fill(low, high, filled);
    const uint64_t expected[8] = {7, 7, 7, 7, 7, 7, 0, 0};
    assert_memory_equal(filled, expected, sizeof filled);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_defined_voxel_of_mixtures_is_right),
        cmocka_unit_test(every_defined_voxel_of_closed_solids_is_right),
        cmocka_unit_test(tile_sizes_and_threads_give_the_same_canonical_octree),
        cmocka_unit_test(order_of_triangles_does_not_matter),
        cmocka_unit_test(the_closed_rule_makes_the_octree_smaller),
        cmocka_unit_test(an_empty_scene_is_one_lit_root),
        cmocka_unit_test(a_lid_over_everything_leaves_a_lit_slab_before_it),
        cmocka_unit_test(memory_limit_stops_the_build_with_a_reason),
        cmocka_unit_test(the_shared_limit_counts_columns_and_lists_too),
        cmocka_unit_test(octrees_do_not_depend_on_the_memory_that_is_left),
        cmocka_unit_test(a_cancelled_bake_ends_cleanly),
        cmocka_unit_test(slices_of_every_width_compare_every_depth),
        cmocka_unit_test(filling_keeps_what_is_defined_and_makes_runs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
