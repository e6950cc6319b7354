/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bakes that keep and find tiles: the octree must be the same as without, and after an edit only
 * tiles that the edit reaches may be baked.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "bake/tiles/tile_folder.h"
#include "bake_soups.h"
#include "tile_folders.h"

/* What happened to the tiles in a bake with a tile cache. */
struct kept_bake {
    struct umbb_bake_figures figures;
    uint64_t damaged;
    enum umb_status status;
    struct umb_error error;
};

/* Bakes a soup with a folder of tiles. In: only_end: 0 = all, and an octree. occluder_depth: may
 * be NULL. */
static struct kept_bake kept_occluder_depth(const struct soup *soup, int closed_rule,
                                            uint32_t tile_log2, enum umbb_tile_folder_mode mode,
                                            const char *folder, uint32_t only_end,
                                            struct umb__occluder_depth *occluder_depth,
                                            struct umb__octree *octree)
{
    struct kept_bake bake = {.damaged = 0};
    struct umb_error *error = &bake.error;
    const struct umbb_casters casters = soup_casters(soup, closed_rule);
    const struct umbb_depth_options depth_options = {
        .tile_log2 = tile_log2,
        .threads = 2,
        .prove = occluder_depth != NULL ? UMBB_PROVE_NEVER : UMBB_PROVE_ALWAYS};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, error), UMB_OK);
    struct umbb_tile_folder tile_folder;
    assert_int_equal(umbb_tile_folder_open(&tile_folder, mode, folder, UINT64_MAX, 2, error),
                     UMB_OK);
    const struct umbb_tile_shape shape = {
        .log2_size = soup_log2(soup), .tile_log2 = tile_log2, .occluder_depth = occluder_depth};
    umbb_tile_folder_frustum(&tile_folder, 0, &shape, &depth);
    const struct umbb_cached_tiles cached_tiles = umbb_tile_folder_cached_tiles(&tile_folder);
    const struct umbb_bake_options options = {
        .log2_size = shape.log2_size,
        .tile_log2 = tile_log2,
        .threads = 2,
        .closed_rule = closed_rule,
        .octree_max_bytes = (size_t)1 << 30,
        .only_end = only_end,
        .cached_tiles = &cached_tiles,
        .occluder_depth = occluder_depth,
    };
    struct umb__pool pool;
    uint32_t root = UMB__REF_LIT;
    umb__pool_init(&pool, NULL, options.octree_max_bytes);
    bake.status = umbb_bake_into(&depth, &options, &pool, &root, &bake.figures, error);
    umbb_tile_folder_frustum_end(&tile_folder);
    bake.damaged = tile_folder.cache.damaged;
    if (octree != NULL) {
        memset(octree, 0, sizeof *octree);
        if (bake.status == UMB_OK && only_end == 0) {
            assert_int_equal(umb__pool_take(&pool, &root, &options.log2_size, 1, octree, error),
                             UMB_OK);
        }
    }
    umb__pool_finish(&pool);
    umbb_tile_folder_close(&tile_folder);
    depth.destroy(depth.state);
    return bake;
}

static struct kept_bake kept(const struct soup *soup, int closed_rule, uint32_t tile_log2,
                             enum umbb_tile_folder_mode mode, const char *folder, uint32_t only_end,
                             struct umb__octree *octree)
{
    return kept_occluder_depth(soup, closed_rule, tile_log2, mode, folder, only_end, NULL, octree);
}

static void plain(const struct soup *soup, int closed_rule, uint32_t tile_log2,
                  struct umb__octree *octree)
{
    struct umb_error error;
    const struct umbb_casters casters = soup_casters(soup, closed_rule);
    const struct umbb_depth_options depth_options = {
        .tile_log2 = tile_log2, .threads = 1, .prove = UMBB_PROVE_ALWAYS};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &error), UMB_OK);
    const struct umbb_bake_options options = {
        .log2_size = soup_log2(soup),
        .tile_log2 = tile_log2,
        .threads = 1,
        .closed_rule = closed_rule,
        .octree_max_bytes = (size_t)1 << 30,
    };
    assert_int_equal(bake_frustum(&depth, &options, octree, NULL, &error), UMB_OK);
    depth.destroy(depth.state);
}

/* Both octrees are merged into canonical form, so equal voxels and counts mean equal trees. */
static void assert_same(const struct umb__octree *a, const struct umb__octree *b, int32_t size)
{
    assert_int_equal(a->brick_count, b->brick_count);
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        assert_int_equal(a->level[level].count, b->level[level].count);
    }
    for (uint32_t i = 0; i < (uint32_t)size * (uint32_t)size; i++) {
        const uint32_t x = i % (uint32_t)size, y = i / (uint32_t)size;
        for (uint32_t z = (x + y) % 3; z < (uint32_t)size; z += 3) {
            if (octree_voxel(a, x, y, z) != octree_voxel(b, x, y, z)) {
                fail_msg("voxel %u %u %u differs", x, y, z);
            }
        }
    }
}

static void bakes_that_keep_or_find_tiles_equal_plain_ones(void **state)
{
    (void)state;
    for (int closed_rule = 0; closed_rule <= 1; closed_rule++) {
        struct soup soup;
        soup_init(&soup, 128, 701);
        soup_mixture(&soup);
        struct umb__octree reference, octree;
        plain(&soup, closed_rule, 7, &reference);
        for (uint32_t tile_log2 = 6; tile_log2 <= 7; tile_log2++) {
            char folder[64];
            folder_make(folder);
            const uint64_t tiles = (uint64_t)1 << (2 * (7 - tile_log2));
            for (int round = 0; round < 2; round++) {
                const struct kept_bake bake =
                    kept(&soup, closed_rule, tile_log2, UMBB_TILE_FOLDER_CACHE, folder, 0, &octree);
                assert_int_equal(bake.status, UMB_OK);
                assert_int_equal(bake.figures.tiles, tiles);
                assert_int_equal(bake.figures.tiles_found, round == 0 ? 0 : tiles);
                assert_int_equal(bake.figures.texels, round == 0 ? 128 * 128 : 0);
                assert_same(&reference, &octree, soup.size);
                umb__octree_finish(&octree);
            }
            assert_int_equal(folder_each(folder, NULL), tiles);
            folder_remove(folder);
        }
        umb__octree_finish(&reference);
        soup_finish(&soup);
    }
}

static void an_edit_bakes_only_the_tiles_that_it_reaches(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 512, 702);
    for (int i = 0; i < 6; i++) {
        soup_random_ball(&soup);
    }
    const size_t before = soup.count;
    const double low[3] = {70.0, 74.0, 90.0}, high[3] = {90.0, 94.0, 130.0};
    soup_box(&soup, low, high, 0);
    char folder[64];
    folder_make(folder);
    assert_int_equal(kept(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE, folder, 0, NULL).status, UMB_OK);
    for (size_t i = before; i < soup.count; i++) {
        for (int k = 0; k < 3; k++) {
            soup.corners[i][k][0] += 200.0; /* from tile (1, 1) to tile (4, 1) */
        }
    }
    struct umb__octree octree, reference;
    const struct kept_bake bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE, folder, 0, &octree);
    assert_int_equal(bake.status, UMB_OK);
    assert_int_equal(bake.figures.tiles, 64);
    assert_int_equal(bake.figures.tiles_found, 62);
    plain(&soup, 1, 9, &reference);
    assert_int_equal(octree.brick_count, reference.brick_count);
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= 9; level++) {
        assert_int_equal(octree.level[level].count, reference.level[level].count);
    }
    for (uint64_t i = 0; i < 300000; i++) {
        const uint64_t bits = soup_bits(&soup);
        const uint32_t x = bits % 512, y = (bits >> 16) % 512, z = (bits >> 32) % 512;
        assert_int_equal(octree_voxel(&octree, x, y, z), octree_voxel(&reference, x, y, z));
    }
    umb__octree_finish(&octree);
    umb__octree_finish(&reference);
    folder_remove(folder);
    soup_finish(&soup);
}

static void damaged_results_are_removed_and_baked_again(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 128, 703);
    soup_mixture(&soup);
    char folder[64];
    folder_make(folder);
    struct umb__octree reference, octree;
    assert_int_equal(kept(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE, folder, 0, &reference).status,
                     UMB_OK);
    folder_each(folder, folder_damage);
    struct kept_bake bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE, folder, 0, &octree);
    assert_int_equal(bake.status, UMB_OK);
    assert_int_equal(bake.damaged, 4);
    assert_int_equal(bake.figures.tiles_found, 0);
    assert_same(&reference, &octree, soup.size);
    umb__octree_finish(&octree);
    bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE, folder, 0, &octree);
    assert_int_equal(bake.figures.tiles_found, 4);
    umb__octree_finish(&octree);
    umb__octree_finish(&reference);
    folder_remove(folder);
    soup_finish(&soup);
}

static void tiles_baked_apart_merge_to_the_plain_octree(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 128, 704);
    soup_mixture(&soup);
    char folder[64];
    folder_make(folder);
    struct umb__octree reference, octree;
    plain(&soup, 1, 7, &reference);
    struct kept_bake bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_TILE, folder, 3, &octree);
    assert_int_equal(bake.status, UMB_OK);
    assert_int_equal(bake.figures.tiles, 3);
    bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_MERGE, folder, 0, &octree);
    assert_int_equal(bake.status, UMB_E_BUSY);
    assert_non_null(strstr(bake.error.message, "tile 3 "));
    bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_TILE, folder, 4, &octree);
    assert_int_equal(bake.figures.tiles_found, 3);
    bake = kept(&soup, 1, 6, UMBB_TILE_FOLDER_MERGE, folder, 0, &octree);
    assert_int_equal(bake.status, UMB_OK);
    assert_same(&reference, &octree, soup.size);
    umb__octree_finish(&octree);
    umb__octree_finish(&reference);
    folder_remove(folder);
    soup_finish(&soup);
}

/* The words of an occluder depth map in its canonical order; the occluder depth map is finished. */
static uint32_t *joined(struct umb__occluder_depth *occluder_depth, uint64_t *count)
{
    uint32_t *words;
    struct umb_error error;
    assert_int_equal(umb__occluder_depth_join(occluder_depth, 1, &words, count, &error), UMB_OK);
    umb__occluder_depth_finish(occluder_depth);
    return words;
}

static void first_occluders_come_from_kept_tiles_as_from_drawn_ones(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 256, 705);
    soup_mixture(&soup);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    char folder[64];
    folder_make(folder);
    struct umb_error error;
    struct umb__octree octree;
    uint32_t *words[3];
    uint64_t counts[3];
    /* 0: drawn, as one tile without a tile cache; 1: drawn and kept; 2: found */
    for (int round = 0; round < 3; round++) {
        struct umb__occluder_depth occluder_depth;
        assert_int_equal(umb__occluder_depth_init(&occluder_depth, NULL, 8, 1U << 26, &error),
                         UMB_OK);
        if (round == 0) {
            const struct umbb_depth_options options = {
                .tile_log2 = 8, .threads = 1, .prove = UMBB_PROVE_NEVER};
            const struct umbb_bake_options bake = {.log2_size = 8,
                                                   .tile_log2 = 8,
                                                   .threads = 1,
                                                   .closed_rule = 1,
                                                   .octree_max_bytes = (size_t)1 << 30,
                                                   .occluder_depth = &occluder_depth};
            struct umbb_depth depth;
            assert_int_equal(umbb_depth_raster_create(&casters, &options, &depth, &error), UMB_OK);
            assert_int_equal(bake_frustum(&depth, &bake, &octree, NULL, &error), UMB_OK);
            depth.destroy(depth.state);
        } else {
            const struct kept_bake bake = kept_occluder_depth(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE,
                                                              folder, 0, &occluder_depth, &octree);
            assert_int_equal(bake.status, UMB_OK);
            assert_int_equal(bake.figures.tiles_found, round == 1 ? 0 : 16);
        }
        words[round] = joined(&occluder_depth, &counts[round]);
        umb__octree_finish(&octree);
        assert_int_equal(counts[round], counts[0]);
        assert_memory_equal(words[round], words[0], counts[0] * sizeof *words[0]);
    }
    assert_true(counts[0] > 100); /* or nothing was compared */
    for (int round = 0; round < 3; round++) {
        umb__occluder_depth_words_free(NULL, words[round]);
    }
    /* A bake that keeps no first occluders must find no tile that has them, and must damage
     * none. */
    const struct kept_bake other = kept(&soup, 1, 6, UMBB_TILE_FOLDER_CACHE, folder, 0, NULL);
    assert_int_equal(other.figures.tiles_found, 0);
    assert_int_equal(other.damaged, 0);
    assert_int_equal(folder_each(folder, NULL), 32);
    folder_remove(folder);
    soup_finish(&soup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bakes_that_keep_or_find_tiles_equal_plain_ones),
        cmocka_unit_test(an_edit_bakes_only_the_tiles_that_it_reaches),
        cmocka_unit_test(damaged_results_are_removed_and_baked_again),
        cmocka_unit_test(tiles_baked_apart_merge_to_the_plain_octree),
        cmocka_unit_test(first_occluders_come_from_kept_tiles_as_from_drawn_ones),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
