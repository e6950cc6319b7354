/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_UNIT_BAKE_PLANTED_SCENE_H
#define UMBRAGE_TESTS_UNIT_BAKE_PLANTED_SCENE_H
/*
 * A scene before and after an edit, baked with a folder of tiles, records of the self-check and, if
 * wanted, a base; and octrees with one wrong voxel. Include after cmocka.h.
 *
 * Twelve boxes stand on a floor of 20 m under a slanted sun; the edit moves one box by half a
 * metre. Voxels are planted where the truth is known without rays: the neighbourhood is uniform in
 * a bake under the open rule, which leaves no voxel undefined. Under the closed rule, shadowed
 * voxels must also lie behind all boxes.
 */
#include <unistd.h>

#include "bake/analysis/light_frame.h"
#include "bake/build/tile_loop.h"
#include "bake/tiles/base_octree.h"
#include "bake/tiles/tile_folder.h"
#include "bake/write/publish.h"
#include "bake_soups.h"
#include "format/node_pool.h"
#include "tile_folders.h"

/* Voxels and tile of the scene; a test may define others before it includes this file. */
#ifndef PLANTED_LOG2
#define PLANTED_LOG2      8
#define PLANTED_TILE_LOG2 7
#endif

enum {
    PLANTED_POINTS = 100000,
    PLANTED_REACH = 2, /* voxels around a planted one that have its true state */
};

struct planted_scene {
    struct soup world;        /* world metres */
    struct soup voxels;       /* The same in voxel space */
    struct umb__octree truth; /* under the open rule */
    double deepest;           /* depth in voxels behind which no box reaches */
};

/* The two scenes and what their bakes share. */
struct planted {
    int closed_rule;
    int with_base; /* 1: the cache also keeps the merged octree */
    struct planted_scene before, after;
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    char cache[64], output[96];
};

/* One bake under way. */
struct planted_bake {
    struct umbb_analysis analysis;
    struct umbb_tile_folder folder;
    struct umbb_proofs proofs;
    struct umbb_base base;
    int keeps;             /* 1: the bake writes its base */
    struct umb__pool pool; /* until the octree is taken */
    uint32_t root;
    int is_planted;
    struct umb__octree octree;
    struct umbb_publish publish;
    struct umb_error error;
};

static inline void planted_box(struct soup *soup, int number, double shift)
{
    const double x = -8.0 + 4.5 * (number % 4) + shift, y = -7.0 + 5.0 * (double)(number / 4);
    const double low[3] = {x, y, 0.5}, high[3] = {x + 1.7, y + 2.1, 1.5 + 0.2 * number};
    soup_box(soup, low, high, 0);
}

static inline void planted_world(struct soup *soup, double shift)
{
    const double floor[4][3] = {{-10, -10, 0}, {10, -10, 0}, {10, 10, 0}, {-10, 10, 0}};
    soup_init(soup, 1 << PLANTED_LOG2, 0);
    for (int i = 0; i < 12; i++) {
        planted_box(soup, i, i == 5 ? shift : 0.0);
    }
    soup_add(soup, floor[0], floor[1], floor[2], UMBB_CASTER_OPEN);
    soup_add(soup, floor[0], floor[2], floor[3], UMBB_CASTER_OPEN);
}

static inline void planted_place(const struct planted *p, struct planted_scene *scene, double shift)
{
    const double origin[3] = {0, 0, 0};
    planted_world(&scene->world, shift);
    planted_world(&scene->voxels, shift);
    umbb_light_frame_apply(&p->frustum, origin, scene->voxels.corners, scene->voxels.count);
    for (size_t i = 0; i + 2 < scene->voxels.count; i++) {
        for (int c = 0; c < 3; c++) {
            scene->deepest = fmax(scene->deepest, scene->voxels.corners[i][c][2]);
        }
    }
    soup_bake(&scene->voxels, 0, PLANTED_TILE_LOG2, 1, &scene->truth);
}

static inline void planted_init(struct planted *p, int closed_rule)
{
    const double origin[3] = {0, 0, 0};
    struct umb_error error;
    struct soup world;
    memset(p, 0, sizeof *p);
    p->closed_rule = closed_rule;
    memcpy(p->light.name, "sun", 4);
    p->light.frustum_count = 1;
    umbb_sun_direction(135.0, 60.0, 1, p->light.direction);
    planted_world(&world, 0);
    const struct umbb_fit fit = {(const double(*)[3][3])world.corners, world.count, origin,
                                 PLANTED_LOG2, 1};
    assert_int_equal(umbb_light_frame_fit(&fit, p->light.direction, &p->frustum, &error), UMB_OK);
    soup_finish(&world);
    p->frustum.closed = closed_rule;
    planted_place(p, &p->before, 0.0);
    planted_place(p, &p->after, 0.5);
    folder_make(p->cache);
    snprintf(p->output, sizeof p->output, "%s.umb", p->cache);
}

static inline void planted_finish(struct planted *p)
{
    (void)unlink(p->output);
    folder_remove(p->cache);
    struct planted_scene *scenes[] = {&p->before, &p->after};
    for (int i = 0; i < 2; i++) {
        soup_finish(&scenes[i]->world);
        soup_finish(&scenes[i]->voxels);
        umb__octree_finish(&scenes[i]->truth);
    }
}

/* Takes the octree of a bake, and leaves out nodes that no root reaches. */
static inline void planted_take(struct planted_bake *bake)
{
    const uint32_t level = PLANTED_LOG2;
    struct umb__octree_map map = {.alloc = NULL};
    assert_int_equal(
        umb__pool_take(&bake->pool, &bake->root, &level, 1, &bake->octree, &bake->error), UMB_OK);
    if (bake->base.is_loaded) {
        assert_int_equal(umbb_base_compact(&bake->base, &bake->octree, &bake->error), UMB_OK);
    } else if (bake->is_planted) {
        assert_int_equal(umb__octree_compact(&bake->octree, &map, &bake->error), UMB_OK);
        umb__octree_map_finish(&map);
    }
}

/* Bakes a scene with the folder of tiles, and the base if there is one, up to its octree. */
static inline void planted_bake(struct planted *p, const struct planted_scene *scene,
                                struct planted_bake *bake)
{
    memset(bake, 0, sizeof *bake);
    bake->analysis = (struct umbb_analysis){
        .choice = {.lights = &p->light, .count = 1}, .frusta = &p->frustum, .frustum_count = 1};
    assert_int_equal(umbb_tile_folder_open(&bake->folder, UMBB_TILE_FOLDER_CACHE, p->cache,
                                           UINT64_MAX, 1, &bake->error),
                     UMB_OK);
    const struct umbb_proofs_job job = {.analysis = &bake->analysis,
                                        .tile_log2 = PLANTED_TILE_LOG2,
                                        .points = PLANTED_POINTS,
                                        .max_bytes = (size_t)1 << 24,
                                        .cache = &bake->folder.cache};
    assert_int_equal(umbb_proofs_open(&bake->proofs, &job, &bake->error), UMB_OK);
    assert_non_null(bake->proofs.frusta);
    bake->folder.proofs = &bake->proofs;
    if (p->with_base) {
        bake->folder.base = &bake->base;
        assert_int_equal(umbb_base_open(&bake->base, &bake->proofs, &bake->folder.cache,
                                        (size_t)1 << 28, &bake->error),
                         UMB_OK);
    }
    const struct umbb_casters casters = soup_casters(&scene->voxels, p->closed_rule);
    const struct umbb_depth_options depth_options = {.tile_log2 = PLANTED_TILE_LOG2, .threads = 1};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &depth_options, &depth, &bake->error),
                     UMB_OK);
    const struct umbb_tile_shape shape = {.log2_size = PLANTED_LOG2,
                                          .tile_log2 = PLANTED_TILE_LOG2};
    umbb_tile_folder_frustum(&bake->folder, 0, &shape, &depth);
    const struct umbb_cached_tiles tiles = umbb_tile_folder_cached_tiles(&bake->folder);
    const struct umbb_bake_options options = {.log2_size = PLANTED_LOG2,
                                              .tile_log2 = PLANTED_TILE_LOG2,
                                              .threads = 1,
                                              .closed_rule = p->closed_rule,
                                              .octree_max_bytes = (size_t)1 << 30,
                                              .cached_tiles = &tiles};
    umb__pool_init(&bake->pool, NULL, options.octree_max_bytes);
    bake->root = UMB__REF_LIT;
    if (p->with_base) {
        umbb_base_load(&bake->base, &bake->pool);
    }
    assert_int_equal(umbb_bake_into(&depth, &options, &bake->pool, &bake->root, NULL, &bake->error),
                     UMB_OK);
    umbb_tile_folder_frustum_end(&bake->folder);
    depth.destroy(depth.state);
}

static inline void planted_bake_finish(struct planted_bake *bake)
{
    umbb_publish_abandon(&bake->publish);
    umbb_base_close(&bake->base);
    umbb_proofs_close(&bake->proofs);
    umbb_tile_folder_close(&bake->folder);
    umb__pool_finish(&bake->pool);
    umb__octree_finish(&bake->octree);
}

/* Keeps the octree that was written for the next bake. */
static inline void planted_keep(void *user, const struct umb__pack_cuts *cuts,
                                const struct umb__kept_page *pages, uint32_t page_count)
{
    struct planted_bake *bake = user;
    assert_int_equal(umbb_base_keep(&bake->base, cuts, pages, page_count, &bake->error), UMB_OK);
}

/* Takes and writes a bake's octree, and checks the file. Fails as the writer or the
 * check. */
static inline enum umb_status planted_publish(struct planted *p, const struct planted_scene *scene,
                                              struct planted_bake *bake)
{
    static char plan[] = "", settings[] = "resolution=256\n", notes[] = "";
    const struct umbs_cuts no_cuts = {.count = 0};
    const struct umb__content content = {.light_count = 1,
                                         .frustum_count = 1,
                                         .lights = &p->light,
                                         .frusta = &p->frustum,
                                         .bounds = {{-10, -10, 0}, {10, 10, 5}},
                                         .plan = plan,
                                         .settings = settings,
                                         .notes = notes};
    const struct umbb_check check = {.corners = (const double(*)[3][3])scene->world.corners,
                                     .closed = p->closed_rule ? scene->world.kinds : NULL,
                                     .cuts = &no_cuts,
                                     .count = scene->world.count,
                                     .points = PLANTED_POINTS,
                                     .threads = 1,
                                     .quiet = 1,
                                     .proofs = &bake->proofs};
    planted_take(bake);
    assert_int_equal(umbb_publish_begin(&bake->publish, p->output, &bake->error), UMB_OK);
    if (bake->folder.base != NULL) {
        bake->publish.kept = &bake->base.kept;
        bake->publish.made = bake->keeps ? planted_keep : NULL;
        bake->publish.made_user = bake;
    }
    const enum umb_status status =
        umbb_publish_write(&bake->publish, &content, &bake->octree, &bake->error);
    if (status != UMB_OK) {
        return status;
    }
    return umbb_publish_check(&bake->publish, &bake->octree, &check, &bake->error);
}

/* 1 if a voxel and its neighbourhood have one state, which the rays must find, too. */
static inline int planted_is_sure(const struct planted *p, const struct planted_scene *scene,
                                  const uint32_t at[3])
{
    const uint32_t last = (1U << PLANTED_LOG2) - 1, reach = PLANTED_REACH;
    for (int k = 0; k < 3; k++) {
        if (at[k] < reach || at[k] > last - reach) {
            return 0;
        }
    }
    const int lit = octree_voxel(&scene->truth, at[0], at[1], at[2]);
    if (p->closed_rule && !lit && at[2] <= scene->deepest + reach) {
        return 0;
    }
    for (uint32_t y = at[1] - reach; y <= at[1] + reach; y++) {
        for (uint32_t x = at[0] - reach; x <= at[0] + reach; x++) {
            for (uint32_t z = at[2] - reach; z <= at[2] + reach; z++) {
                if (octree_voxel(&scene->truth, x, y, z) != lit) {
                    return 0;
                }
            }
        }
    }
    return 1;
}

/* Draws a sure voxel of a tile that the bake inherited, or of one that it did not. */
static inline void planted_draw(const struct planted *p, const struct planted_scene *scene,
                                const struct planted_bake *bake, int inherited, struct soup *random,
                                uint32_t at[3])
{
    const uint8_t *tiles = bake->proofs.frusta[0].inherited;
    const uint32_t mask = (1U << PLANTED_LOG2) - 1, across = PLANTED_LOG2 - PLANTED_TILE_LOG2;
    for (int tries = 0; tries < 1000000; tries++) {
        const uint64_t bits = soup_bits(random);
        for (int k = 0; k < 3; k++) {
            at[k] = (uint32_t)(bits >> 16 * k) & mask;
        }
        const uint32_t tile = (at[1] >> PLANTED_TILE_LOG2 << across) + (at[0] >> PLANTED_TILE_LOG2);
        if (tiles[tile] == inherited && planted_is_sure(p, scene, at)) {
            return;
        }
    }
    fail_msg("no voxel to plant");
}

/* Returns a brick or node on the way to the voxel, made anew with the voxel turned around. Nodes
 * keep their numbers. */
static inline uint32_t planting(struct umb__pool *pool, uint32_t level, uint32_t ref,
                                const uint32_t at[3])
{
    const enum umb__node_state state = umb__ref_state(ref);
    const uint32_t bit = level - 1;
    const unsigned towards = (at[0] >> bit & 1) + 2 * (at[1] >> bit & 1) + 4 * (at[2] >> bit & 1);
    uint64_t slices[8];
    uint32_t children[8], made = 0, mixed = 0;
    struct umb_error error;
    if (level == UMB_LEVEL_BRICK) {
        for (int z = 0; z < 8; z++) {
            slices[z] = state == UMB__NODE_MIXED ? pool->bricks[ref][z]
                        : state == UMB__NODE_LIT ? UINT64_MAX
                                                 : 0;
        }
        slices[at[2] & 7] ^= (uint64_t)1 << ((at[0] & 7) + 8 * (at[1] & 7));
        assert_int_equal(umb__pool_brick(pool, slices, &made, &error), UMB_OK);
        return made;
    }
    const struct umb__pool_level *nodes = &pool->level[level];
    for (unsigned c = 0; c < 8; c++) {
        const enum umb__node_state inner =
            state == UMB__NODE_MIXED ? umb__mask_state(nodes->masks[ref], c) : state;
        children[c] = inner == UMB__NODE_MIXED ? nodes->children[nodes->first[ref] + mixed++]
                      : inner == UMB__NODE_LIT ? UMB__REF_LIT
                                               : UMB__REF_SHADOWED;
    }
    children[towards] = planting(pool, level - 1, children[towards], at);
    assert_int_equal(umb__pool_node(pool, level, children, &made, &error), UMB_OK);
    return made;
}

/* Turns one voxel of a bake around, before its octree is taken. */
static inline void planted_plant(struct planted_bake *bake, const uint32_t at[3])
{
    bake->root = planting(&bake->pool, PLANTED_LOG2, bake->root, at);
    bake->is_planted = 1;
}

#endif
