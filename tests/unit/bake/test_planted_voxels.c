/* SPDX-License-Identifier: Apache-2.0 */
/* One wrong voxel, planted into the octree after an edit: the self-check that inherits finds it in
 * every tile that was baked again, and a comparison of all squares in every tile that was kept. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "bake/write/octree_part.h"
#include "planted_scene.h"
#include "rays/rays.h"
#include "rays/verify_squares.h"

#define PLANTS 30 /* under each rule, with and without a base */
#define WAYS   4  /* rules, without and with a base */

/* Prepares the scene. In: way: bit 0: under the closed rule; bit 1: with a base. */
static void begin(struct planted *p, int way)
{
    planted_init(p, way & 1);
    p->with_base = way >> 1;
}

/* Bakes and publishes the scene before the edit, so that the cache has its tiles, records and
 * base. */
static void bake_before(struct planted *p)
{
    struct planted_bake bake;
    planted_bake(p, &p->before, &bake);
    bake.keeps = 1;
    assert_int_equal(planted_publish(p, &p->before, &bake), UMB_OK);
    assert_true(bake.publish.checked.sampled);
    assert_int_equal(umbb_publish_commit(&bake.publish, &bake.error), UMB_OK);
    assert_int_equal(umbb_proofs_keep(&bake.proofs, &bake.error), UMB_OK);
    planted_bake_finish(&bake);
}

/* Compares every third column of a part with the octree. */
static void compare_part(const struct umb__octree *octree, const struct umb__octree *part,
                         const struct umbb_frustum_proofs *proofs)
{
    const uint32_t size = 1U << proofs->log2_size, across = size >> proofs->tile_log2;
    for (uint32_t y = 0; y < size; y += 3) {
        for (uint32_t x = 0; x < size; x += 3) {
            const uint32_t tx = x >> proofs->tile_log2, ty = y >> proofs->tile_log2;
            int wanted = 0;
            for (uint32_t t = 0; t < across * across; t++) {
                wanted |= !proofs->inherited[t] && t % across + 1 >= tx && t % across <= tx + 1 &&
                          t / across + 1 >= ty && t / across <= ty + 1;
            }
            for (uint32_t z = 0; z < size && wanted; z++) {
                assert_int_equal(octree_voxel(part, x, y, z), octree_voxel(octree, x, y, z));
            }
        }
    }
}

static void the_part_has_the_voxels_of_changed_tiles_and_those_around_them(void **state)
{
    (void)state;
    struct planted p;
    struct soup random;
    planted_init(&p, 0);
    soup_init(&random, 1, 802);
    for (int round = 0; round < 6; round++) {
        uint8_t inherited[256];
        struct umbb_frustum_proofs one = {.log2_size = PLANTED_LOG2,
                                          .tile_log2 = 4 + (uint32_t)round % 2,
                                          .inherited = inherited};
        const struct umbb_proofs proofs = {.frusta = &one, .frustum_count = 1};
        struct umb__octree part;
        struct umb_error error;
        one.tile_count = (size_t)1 << 2 * (PLANTED_LOG2 - one.tile_log2);
        memset(inherited, 1, sizeof inherited);
        assert_true(umbb_octree_part_pays(&proofs));
        for (int i = 0; i < round; i++) {
            inherited[soup_bits(&random) % one.tile_count] = 0;
        }
        assert_int_equal(umbb_octree_part(&p.after.truth, &proofs, &part, &error), UMB_OK);
        compare_part(&p.after.truth, &part, &one);
        assert_true(part.brick_count < p.after.truth.brick_count);
        umb__octree_finish(&part);
        memset(inherited, 0, sizeof inherited);
        assert_false(umbb_octree_part_pays(&proofs));
    }
    planted_finish(&p);
}

static void it_finds_a_wrong_voxel_in_a_tile_that_was_baked_again(void **state)
{
    (void)state;
    for (int way = 0; way < WAYS; way++) {
        struct planted p;
        struct soup random;
        int found = 0;
        begin(&p, way);
        soup_init(&random, 1, 801);
        bake_before(&p);
        for (int i = 0; i < PLANTS; i++) {
            struct planted_bake bake;
            uint32_t at[3];
            planted_bake(&p, &p.after, &bake);
            assert_int_equal(bake.base.is_loaded, p.with_base);
            planted_draw(&p, &p.after, &bake, 0, &random, at);
            planted_plant(&bake, at);
            found += planted_publish(&p, &p.after, &bake) == UMB_E_INTERNAL &&
                     strstr(bake.error.message, "disagree with traced rays") != NULL;
            assert_false(bake.publish.checked.sampled);
            assert_true(bake.publish.checked.tiles_inherited > 0);
            umbb_proofs_refuse(&bake.proofs); /* so that the next bake does not find the tile */
            planted_bake_finish(&bake);
        }
        print_message("way %d: %d of %d found\n", way, found, PLANTS);
        assert_int_equal(found, PLANTS);
        planted_finish(&p);
    }
}

/* Compares every voxel of the written file with rays, as `umbrage verify --every-voxel` does.
 * Returns the number of voxels that disagree outside the band. */
static uint64_t compare_all(const struct planted *p, const struct planted_scene *scene,
                            const char *file)
{
    struct umbr_verify_result result;
    struct umbr_rays *rays;
    struct umb_asset *asset;
    struct umb_error error;
    const struct umbr_rays_options quick = {.quick = 1, .threads = 1};
    const struct umbr_verify_options options = {
        .closed = p->closed_rule ? scene->world.kinds : NULL, .threads = 1};
    assert_int_equal(umb_asset_open_file(file, NULL, &asset, &error), UMB_OK);
    assert_int_equal(umbr_rays_build((const double(*)[3][3])scene->world.corners,
                                     scene->world.count, &quick, &rays, &error),
                     UMB_OK);
    assert_int_equal(umbr_verify_voxels(asset, 0, rays, &options, &result, &error), UMB_OK);
    assert_int_equal(result.records > 0, 1);
    umbr_rays_destroy(rays);
    umb_asset_close(asset);
    return result.outside_band;
}

static void a_wrong_voxel_in_a_kept_tile_is_inherited_and_found_by_comparing_all(void **state)
{
    (void)state;
    for (int way = 0; way < WAYS; way++) {
        struct planted p;
        struct soup random;
        int inherited = 0, found = 0;
        begin(&p, way);
        soup_init(&random, 1, 802);
        bake_before(&p);
        for (int i = 0; i < PLANTS; i++) {
            struct planted_bake bake;
            uint32_t at[3];
            planted_bake(&p, &p.after, &bake);
            planted_draw(&p, &p.after, &bake, 1, &random, at);
            planted_plant(&bake, at);
            inherited += planted_publish(&p, &p.after, &bake) == UMB_OK;
            found += compare_all(&p, &p.after, bake.publish.file.temporary) > 0;
            planted_bake_finish(&bake);
        }
        print_message("way %d: %d inherited, %d of %d found\n", way, inherited, found, PLANTS);
        assert_int_equal(inherited, PLANTS);
        assert_int_equal(found, PLANTS);
        planted_finish(&p);
    }
}

/* Without a planted voxel both comparisons agree: what they found was the voxel. */
static void without_one_both_agree(void **state)
{
    (void)state;
    for (int way = 0; way < WAYS; way++) {
        struct planted p;
        struct planted_bake bake;
        begin(&p, way);
        bake_before(&p);
        planted_bake(&p, &p.after, &bake);
        assert_int_equal(planted_publish(&p, &p.after, &bake), UMB_OK);
        assert_true(bake.publish.checked.squares > 0);
        assert_int_equal(compare_all(&p, &p.after, bake.publish.file.temporary), 0);
        planted_bake_finish(&bake);
        planted_finish(&p);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_part_has_the_voxels_of_changed_tiles_and_those_around_them),
        cmocka_unit_test(it_finds_a_wrong_voxel_in_a_tile_that_was_baked_again),
        cmocka_unit_test(a_wrong_voxel_in_a_kept_tile_is_inherited_and_found_by_comparing_all),
        cmocka_unit_test(without_one_both_agree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
