/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Verification by rays, on assets made voxel by voxel from traced truth: a right asset must pass,
 * and each kind of wrong asset must be found.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/parts.h"
#include "gen.h"
#include "make_asset.h"
#include "rays/verify.h"
#include "rays/verify_squares.h"
#include "rays/verify_light_frame.h"

enum {
    LOG2_SIZE = 6,
    SIZE = 1 << LOG2_SIZE,
    POINTS = 60000,
};

/* Far from the origin, so that a step that loses the precision of doubles fails. */
static const double scene_origin[3] = {500000, 4200000, 120};
static const double sun[3] = {0.48, -0.6, -0.64};
static const double other_sun[3] = {-0.6, -0.48, -0.64};
static const double voxel_m = 0.5;

struct world {
    struct umbr_rays *rays;
    double (*corners)[3][3]; /* what the rays may look up again */
    uint8_t *closed;         /* [triangles] */
    size_t count;
};

/* How an asset is made, and how it is spoilt. */
struct recipe {
    const struct world *world;
    const struct umbr_light_frame *light_frame;
    double towards[3];
    int fill_inside;      /* random answers inside closed solids, as the closed rule allows */
    int planted;          /* wrong single voxels, one in each 16^3 block */
    const uint8_t *known; /* [SIZE^3] answers to use, by x + SIZE * (y + SIZE * z); NULL: trace */
};

static struct world world;

static uint32_t scatter(uint32_t x, uint32_t y, uint32_t z)
{
    uint32_t h = x * 0x9e3779b1U ^ y * 0x85ebca77U ^ z * 0xc2b2ae3dU;
    h = (h ^ h >> 15) * 0x2c1b3c6dU;
    return h ^ h >> 13;
}

static int voxel_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const struct recipe *recipe = user;
    const double voxel[3] = {x + 0.5, y + 0.5, z + 0.5};
    double point[3];
    int winding, crossings;
    (void)frustum;
    if (recipe->known != NULL) {
        return recipe->known[x + SIZE * (y + (size_t)SIZE * z)];
    }
    assert_true(umbr_light_frame_world(recipe->light_frame, voxel, point));
    int lit = !umbr_occluded(recipe->world->rays, point, recipe->towards, 0, INFINITY);
    if (recipe->fill_inside && !lit) {
        umbr_crossings(recipe->world->rays, point, recipe->towards, recipe->world->closed, &winding,
                       &crossings);
        lit = winding > 0 ? (int)(scatter(x, y, z) & 1) : lit;
    }
    return lit ^ (recipe->planted && x % 16 == 7 && y % 16 == 9 && z % 16 == 5);
}

/* Row i of the frustum's rotation: x, y across the light, z along it. */
static void frame_axes(const double direction[3], double axes[3][3])
{
    static const double up[3] = {0, 0, 1};
    double length = 0;
    for (int i = 0; i < 3; i++) {
        int a = (i + 1) % 3, b = (i + 2) % 3;
        axes[0][i] = up[a] * direction[b] - up[b] * direction[a];
        length += axes[0][i] * axes[0][i];
    }
    for (int i = 0; i < 3; i++) {
        axes[0][i] /= sqrt(length);
        axes[2][i] = direction[i];
    }
    for (int i = 0; i < 3; i++) {
        int a = (i + 1) % 3, b = (i + 2) % 3;
        axes[1][i] = axes[2][a] * axes[0][b] - axes[2][b] * axes[0][a];
    }
}

static void set_light(struct umb__content *content, const double direction[3], int closed)
{
    double axes[3][3];
    frame_axes(direction, axes);
    content->frusta[0].closed = closed;
    for (int i = 0; i < 3; i++) {
        content->lights[0].direction[i] = direction[i];
        for (int k = 0; k < 3; k++) {
            content->frusta[0].world_to_voxel[i][k] = axes[i][k] / voxel_m;
        }
        content->frusta[0].world_to_voxel[i][3] = SIZE / 2.0;
    }
}

static struct umb_asset *open_packed(const struct umb__content *content,
                                     const struct umb__octree *octree, struct bytes *bytes)
{
    struct umb_error error = {0};
    struct umb_asset *asset;
    uint8_t id[UMB_ID_BYTES];
    struct umb_sink sink = bytes_sink(bytes);
    if (umb__pack_write(content, octree, &test_digest, &sink, id, &error) != UMB_OK ||
        umb_asset_open_bytes(bytes->data, bytes->size, NULL, &asset, &error) != UMB_OK) {
        fail_msg("asset: %s", error.message);
        return NULL;
    }
    return asset;
}

/*
 * Makes an asset whose frustum says the light is `claimed`, with the shadows of `traced`. The frame
 * of a first, empty asset tells where its voxels are.
 */
static struct umb_asset *make(const double claimed[3], const double traced[3], struct recipe recipe,
                              int closed, struct bytes *bytes)
{
    struct voxels voxels = {voxel_lit, &recipe, LOG2_SIZE, 1};
    struct umb__content content;
    struct umb__octree octree = {0};
    struct umb__octree_root root = {UMB__NODE_LIT, LOG2_SIZE, 0};
    struct umbr_light_frame light_frame;
    struct bytes empty = {0};
    make_content(&voxels, voxel_m, scene_origin, &content);
    set_light(&content, claimed, closed);
    octree.root_count = 1;
    octree.roots = &root;
    struct umb_asset *asset = open_packed(&content, &octree, &empty);
    assert_int_equal(umbr_light_frame_init(&light_frame, asset, 0, NULL), UMB_OK);
    umb_asset_close(asset);
    bytes_finish(&empty);
    recipe.world = &world;
    recipe.light_frame = &light_frame;
    for (int i = 0; i < 3; i++) {
        recipe.towards[i] = -traced[i];
    }
    make_octree(&voxels, &octree);
    asset = open_packed(&content, &octree, bytes);
    umb__octree_finish(&octree);
    return asset;
}

static struct umbr_verify_result verify(const struct umb_asset *asset, const uint8_t *closed,
                                        unsigned threads, uint64_t seed)
{
    const struct umbr_verify_options options = {
        .points = POINTS, .seed = seed, .closed = closed, .threads = threads};
    struct umbr_verify_result result;
    struct umb_error error = {0};
    if (umbr_verify(asset, 0, world.rays, &options, &result, &error) != UMB_OK) {
        fail_msg("verify: %s", error.message);
    }
    return result;
}

/* A slab, a ball above it, a block that pierces it, and a wire thinner than any voxel. */
static int make_world(void **state)
{
    (void)state;
    struct gen_mesh mesh = {0};
    struct umbs_parts parts;
    struct gen_rng rng = {1};
    gen_box(&mesh, (const int32_t[3]){-8000, -8000, -1500}, (const int32_t[3]){8000, 8000, 0});
    gen_ball(&mesh, (const int32_t[3]){-1000, 500, 4500}, 2500, 12, &rng, 0);
    gen_box(&mesh, (const int32_t[3]){2000, -3000, -700}, (const int32_t[3]){4600, -1100, 3000});
    gen_bar(&mesh, (const int32_t[3]){-7000, -5000, 2000}, (const int32_t[3]){7000, -4000, 2500},
            5);
    world.count = mesh.triangle_count;
    double(*corners)[3][3] = calloc(world.count, sizeof *corners);
    assert_non_null(corners);
    for (size_t t = 0; t < world.count; t++) {
        for (size_t k = 0; k < 9; k++) {
            corners[t][k / 3][k % 3] =
                mesh.vertices[mesh.triangles[t][k / 3]][k % 3] / 1000.0 + scene_origin[k % 3];
        }
    }
    assert_int_equal(umbs_parts_find((const double(*)[3][3])corners, world.count, &parts, NULL),
                     UMB_OK);
    assert_int_equal(parts.closed_triangles, world.count);
    world.closed = calloc(world.count, 1);
    assert_non_null(world.closed);
    memcpy(world.closed, parts.closed, world.count);
    assert_int_equal(
        umbr_rays_build((const double(*)[3][3])corners, world.count, NULL, &world.rays, NULL),
        UMB_OK);
    umbs_parts_finish(&parts);
    gen_mesh_finish(&mesh);
    world.corners = corners;
    return 0;
}

static int drop_world(void **state)
{
    (void)state;
    umbr_rays_destroy(world.rays);
    free(world.corners);
    free(world.closed);
    return 0;
}

static void faithful_asset_has_nothing_outside_the_band(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct umb_asset *asset = make(sun, sun, (struct recipe){0}, 0, &bytes);
    struct umbr_verify_result result = verify(asset, NULL, 0, 42);
    print_message("points %llu near %llu in band %llu\n", (unsigned long long)result.points,
                  (unsigned long long)result.near_boundary, (unsigned long long)result.inside_band);
    assert_int_equal(result.points, POINTS);
    assert_true(result.near_boundary >= POINTS * 4 / 10);
    assert_int_equal(result.skipped_inside, 0);
    assert_int_equal(result.outside_band, 0);
    assert_int_equal(result.has_worst, 0);
    assert_true(result.inside_band > 0); /* half a metre a voxel cannot be exact */
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static void closed_asset_is_judged_outside_its_solids_only(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct umb_asset *asset = make(sun, sun, (struct recipe){.fill_inside = 1}, 1, &bytes);
    struct umbr_verify_result result = verify(asset, world.closed, 0, 43);
    assert_int_equal(result.points, POINTS);
    assert_true(result.skipped_inside > 100);
    assert_int_equal(result.outside_band, 0);
    /* Told that nothing is closed, verification must see the noise inside: only leaving out closed
     * solids lets it pass. */
    result = verify(asset, NULL, 0, 43);
    assert_int_equal(result.skipped_inside, 0);
    assert_true(result.outside_band > 0);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static void planted_wrong_voxels_are_outside_the_band(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    /* 64 single voxels of 262144: half of 60000 uniform points would meet seven of them, walks meet
     * more. */
    struct umb_asset *asset = make(sun, sun, (struct recipe){.planted = 1}, 0, &bytes);
    struct umbr_verify_result result = verify(asset, NULL, 0, 44);
    assert_true(result.outside_band > 0);
    assert_true(result.has_worst);
    /* The point it names lies in a planted voxel. */
    struct umbr_light_frame light_frame;
    struct umb_frustum_info info;
    assert_int_equal(umbr_light_frame_init(&light_frame, asset, 0, NULL), UMB_OK);
    assert_int_equal(umb_asset_get_frustum(asset, 0, &info), UMB_OK);
    static const int planted[3] = {7, 9, 5};
    for (int i = 0; i < 3; i++) {
        double v = info.world_to_voxel[i][3];
        for (int k = 0; k < 3; k++) {
            v += info.world_to_voxel[i][k] * (result.worst_point[k] - scene_origin[k]);
        }
        assert_int_equal((int)floor(v) % 16, planted[i]);
    }
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

/* Verifies the one square of an asset's frustum. */
static struct umbr_squares_result verify_square(const struct umb_asset *asset,
                                                const uint8_t *closed)
{
    static const struct umbr_square whole = {0, 0, 0};
    const struct umbr_verify_options options = {.closed = closed};
    struct umbr_squares_result result;
    struct umb_error error = {0};
    if (umbr_verify_squares(asset, 0, world.rays, &options, &whole, 1, &result, &error) != UMB_OK) {
        fail_msg("squares: %s", error.message);
    }
    assert_false(result.gave_up);
    return result;
}

static void a_faithful_square_has_nothing_outside_the_band(void **state)
{
    (void)state;
    for (int closed = 0; closed <= 1; closed++) {
        struct bytes bytes = {0};
        struct umb_asset *asset =
            make(sun, sun, (struct recipe){.fill_inside = closed}, closed, &bytes);
        const struct umbr_squares_result result =
            verify_square(asset, closed ? world.closed : NULL);
        assert_int_equal(result.found.records, SIZE * SIZE);
        assert_int_equal(result.found.outside_band, 0);
        umb_asset_close(asset);
        bytes_finish(&bytes);
    }
    /* The rays of another sun find it wrong. */
    struct bytes bytes = {0};
    struct umb_asset *asset = make(sun, other_sun, (struct recipe){0}, 0, &bytes);
    assert_true(verify_square(asset, NULL).found.outside_band > 0);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static uint8_t truth[SIZE * SIZE * SIZE];

static size_t voxel_at(uint32_t x, uint32_t y, uint32_t z)
{
    return x + SIZE * (y + (size_t)SIZE * z);
}

/* 1 if rays from everywhere within two voxels of a voxel's centre say the same. */
static int is_far_from_boundaries(const struct umbr_light_frame *light_frame, uint32_t x,
                                  uint32_t y, uint32_t z)
{
    const double towards[3] = {-sun[0], -sun[1], -sun[2]};
    for (int i = 0; i < 9 * 9 * 9; i++) {
        const double voxel[3] = {x + 0.5 + 0.5 * (i % 9 - 4), y + 0.5 + 0.5 * (i / 9 % 9 - 4),
                                 z + 0.5 + 0.5 * (i / 81 - 4)};
        double point[3];
        assert_true(umbr_light_frame_world(light_frame, voxel, point));
        const int is_dark = umbr_occluded(world.rays, point, towards, 0, INFINITY);
        if (is_dark == truth[voxel_at(x, y, z)]) {
            return 0;
        }
    }
    return 1;
}

/* The self-check of an edit stands on this: one wrong voxel of 262144, each time another. */
static void every_single_wrong_voxel_is_found(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct umbr_light_frame light_frame;
    struct umb_asset *asset = make(sun, sun, (struct recipe){0}, 0, &bytes);
    assert_int_equal(umbr_light_frame_init(&light_frame, asset, 0, NULL), UMB_OK);
    const struct recipe recipe = {
        .world = &world, .light_frame = &light_frame, .towards = {-sun[0], -sun[1], -sun[2]}};
    for (uint32_t i = 0; i < SIZE * SIZE * SIZE; i++) {
        truth[i] = (uint8_t)voxel_lit(&recipe, 0, i % SIZE, i / SIZE % SIZE, i / (SIZE * SIZE));
    }
    umb_asset_close(asset);
    bytes_finish(&bytes);
    int planted = 0, dark = 0;
    for (uint32_t n = 0; planted < 100; n++) {
        const uint32_t x = scatter(n, 1, 2) % SIZE, y = scatter(n, 3, 4) % SIZE;
        const uint32_t z = scatter(n, 5, 6) % SIZE;
        uint8_t *voxel = &truth[voxel_at(x, y, z)];
        if ((*voxel && dark * 2 < planted) || !is_far_from_boundaries(&light_frame, x, y, z)) {
            continue; /* half of them in shadow, of which there is less */
        }
        planted++;
        dark += !*voxel;
        *voxel ^= 1;
        asset = make(sun, sun, (struct recipe){.known = truth}, 0, &bytes);
        *voxel ^= 1;
        const struct umbr_verify_result found = verify_square(asset, NULL).found;
        assert_true(found.outside_band > 0);
        double local[3], at[3];
        for (int k = 0; k < 3; k++) {
            local[k] = found.worst_point[k] - light_frame.origin[k];
        }
        assert_true(umbr_light_frame_voxel(&light_frame, local, at));
        assert_true(floor(at[0]) == x && floor(at[1]) == y && floor(at[2]) == z);
        umb_asset_close(asset);
        bytes_finish(&bytes);
        bytes = (struct bytes){0};
    }
    assert_true(dark >= 40 && dark <= 60);
}

static struct umbr_verify_result verify_question(const struct umb_asset *asset,
                                                 enum umbr_verify_kind kind, const uint8_t *closed)
{
    const struct umbr_verify_options options = {
        .points = POINTS / 12, .kind = kind, .seed = 46, .closed = closed};
    struct umbr_verify_result result;
    struct umb_error error = {0};
    if (umbr_verify(asset, 0, world.rays, &options, &result, &error) != UMB_OK) {
        fail_msg("verify: %s", error.message);
    }
    return result;
}

static void segments_columns_and_boxes_are_held_against_rays(void **state)
{
    (void)state;
    struct bytes good_bytes = {0}, closed_bytes = {0}, bad_bytes = {0};
    struct umb_asset *good = make(sun, sun, (struct recipe){0}, 0, &good_bytes);
    struct umb_asset *closed = make(sun, sun, (struct recipe){.fill_inside = 1}, 1, &closed_bytes);
    struct umb_asset *bad = make(sun, sun, (struct recipe){.planted = 1}, 0, &bad_bytes);
    for (int q = UMBR_VERIFY_SEGMENTS; q <= UMBR_VERIFY_BOXES; q++) {
        const enum umbr_verify_kind kind = (enum umbr_verify_kind)q;
        struct umbr_verify_result result = verify_question(good, kind, NULL);
        print_message("%d: %llu asked, %llu compared, %llu in band\n", q,
                      (unsigned long long)result.records, (unsigned long long)result.points,
                      (unsigned long long)result.inside_band);
        assert_true(result.records >= POINTS / 12 * 9 / 10 && result.points >= result.records / 2);
        assert_int_equal(result.outside_band, 0);
        assert_true(verify_question(bad, kind, NULL).outside_band > 0);
        if (kind == UMBR_VERIFY_COLUMNS) {
            continue; /* a closed asset has none: tests/system/test_occluder_depth.sh */
        }
        result = verify_question(closed, kind, world.closed);
        assert_int_equal(result.outside_band, 0);
        assert_true(result.skipped_inside > 100);
        assert_true(verify_question(closed, kind, NULL).outside_band > 0);
    }
    umb_asset_close(good);
    umb_asset_close(closed);
    umb_asset_close(bad);
    bytes_finish(&good_bytes);
    bytes_finish(&closed_bytes);
    bytes_finish(&bad_bytes);
}

static void asset_of_another_light_is_found_out(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct umb_asset *asset = make(sun, other_sun, (struct recipe){0}, 0, &bytes);
    struct umbr_verify_result result = verify(asset, NULL, 0, 45);
    assert_true(result.outside_band > 100);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static void result_does_not_depend_on_threads_but_on_the_seed(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct recipe recipe = {.fill_inside = 1, .planted = 1};
    struct umb_asset *asset = make(sun, sun, recipe, 1, &bytes);
    struct umbr_verify_result one = verify(asset, world.closed, 1, 7);
    static const unsigned threads[3] = {2, 5, 300};
    for (int i = 0; i < 3; i++) {
        struct umbr_verify_result many = verify(asset, world.closed, threads[i], 7);
        assert_memory_equal(&one.points, &many.points, 5 * sizeof one.points);
        assert_int_equal(one.has_worst, many.has_worst);
        for (int k = 0; k < 3; k++) {
            assert_true(one.worst_point[k] == many.worst_point[k]);
        }
    }
    struct umbr_verify_result other = verify(asset, world.closed, 2, 8);
    assert_true(one.skipped_inside != other.skipped_inside || one.inside_band != other.inside_band);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static void asset_without_any_shadow_boundary_still_gets_its_points(void **state)
{
    (void)state;
    struct umb__content content;
    struct bytes bytes = {0};
    struct voxels voxels = {voxel_lit, NULL, LOG2_SIZE, 1};
    struct umb__octree_root root = {UMB__NODE_LIT, LOG2_SIZE, 0};
    struct umb__octree octree = {.root_count = 1, .roots = &root};
    make_content(&voxels, voxel_m, scene_origin, &content);
    set_light(&content, sun, 0);
    struct umb_asset *asset = open_packed(&content, &octree, &bytes);
    struct umbr_verify_result result = verify(asset, NULL, 2, 1);
    assert_int_equal(result.points, POINTS);
    /* The asset is lit everywhere, so a point near a boundary is near a surface that rays found. */
    assert_true(result.near_boundary > 0);
    assert_true(result.outside_band > 0); /* it is lit where the slab's shadow should be */
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

/* A sheet that claims to be closed must not make its shadow undefined. */
static void open_sheet_marked_closed_excuses_nothing(void **state)
{
    (void)state;
    static const double corner[4][2] = {{-6, -6}, {6, -6}, {6, 6}, {-6, 6}};
    static const uint8_t closed[2] = {1, 1};
    double corners[2][3][3];
    for (int t = 0; t < 2; t++) {
        for (int k = 0; k < 3; k++) {
            const double *at = corner[k == 0 ? 0 : k + t];
            corners[t][k][0] = at[0] + scene_origin[0];
            corners[t][k][1] = at[1] + scene_origin[1];
            corners[t][k][2] = scene_origin[2];
        }
    }
    struct umbr_rays *sheet;
    assert_int_equal(umbr_rays_build((const double(*)[3][3])corners, 2, NULL, &sheet, NULL),
                     UMB_OK);
    struct umb__content content;
    struct bytes bytes = {0};
    struct voxels voxels = {voxel_lit, NULL, LOG2_SIZE, 1};
    struct umb__octree_root root = {UMB__NODE_LIT, LOG2_SIZE, 0};
    struct umb__octree octree = {.root_count = 1, .roots = &root};
    make_content(&voxels, voxel_m, scene_origin, &content);
    set_light(&content, sun, 1);
    struct umb_asset *asset = open_packed(&content, &octree, &bytes);
    const struct umbr_verify_options options = {.points = 5000, .closed = closed};
    struct umbr_verify_result result;
    assert_int_equal(umbr_verify(asset, 0, sheet, &options, &result, NULL), UMB_OK);
    assert_true(result.outside_band > 100);
    umb_asset_close(asset);
    bytes_finish(&bytes);
    umbr_rays_destroy(sheet);
}

static void solid_that_fills_the_box_is_given_up_soon(void **state)
{
    (void)state;
    struct gen_mesh mesh = {0};
    uint8_t closed[12];
    double corners[12][3][3];
    gen_box(&mesh, (const int32_t[3]){-90000, -90000, -90000},
            (const int32_t[3]){90000, 90000, 90000});
    assert_int_equal(mesh.triangle_count, 12);
    for (size_t t = 0; t < 12; t++) {
        closed[t] = 1;
        for (size_t k = 0; k < 9; k++) {
            corners[t][k / 3][k % 3] =
                scene_origin[k % 3] + 0.001 * mesh.vertices[mesh.triangles[t][k / 3]][k % 3];
        }
    }
    struct umbr_rays *solid;
    assert_int_equal(umbr_rays_build((const double(*)[3][3])corners, 12, NULL, &solid, NULL),
                     UMB_OK);
    struct umb__content content;
    struct bytes bytes = {0};
    struct voxels voxels = {voxel_lit, NULL, LOG2_SIZE, 1};
    struct umb__octree_root root = {UMB__NODE_LIT, LOG2_SIZE, 0};
    struct umb__octree octree = {.root_count = 1, .roots = &root};
    make_content(&voxels, voxel_m, scene_origin, &content);
    set_light(&content, sun, 1);
    struct umb_asset *asset = open_packed(&content, &octree, &bytes);
    const struct umbr_verify_options options = {.points = 5000, .closed = closed};
    struct umbr_verify_result result;
    assert_int_equal(umbr_verify(asset, 0, solid, &options, &result, NULL), UMB_OK);
    assert_int_equal(result.points, 0);
    assert_in_range(result.skipped_inside, 5000, 5 * 5000);
    umb_asset_close(asset);
    bytes_finish(&bytes);
    umbr_rays_destroy(solid);
    gen_mesh_finish(&mesh);
}

struct told {
    uint64_t points;
    unsigned calls;
};

static void note_progress(void *user, uint64_t points)
{
    struct told *told = user;
    assert_true(points >= told->points);
    told->points = points;
    told->calls++;
}

static void progress_rises_to_the_points_compared(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct told told = {0};
    struct umb_asset *asset = make(sun, sun, (struct recipe){0}, 0, &bytes);
    const struct umbr_verify_options options = {
        .points = POINTS, .threads = 3, .progress = note_progress, .progress_user = &told};
    struct umbr_verify_result result;
    assert_int_equal(umbr_verify(asset, 0, world.rays, &options, &result, NULL), UMB_OK);
    assert_true(told.calls > 1);
    assert_int_equal(told.points, result.points);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static int always(void)
{
    return 1;
}

static void cancelled_verification_says_so(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct umb_asset *asset = make(sun, sun, (struct recipe){0}, 0, &bytes);
    const struct umbr_verify_options options = {.points = POINTS, .cancelled = always};
    struct umbr_verify_result result;
    struct umb_error error = {0};
    assert_int_equal(umbr_verify(asset, 0, world.rays, &options, &result, &error), UMB_E_CANCELLED);
    assert_int_equal(result.points, 0);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

static void unknown_light_is_refused(void **state)
{
    (void)state;
    struct bytes bytes = {0};
    struct umb_asset *asset = make(sun, sun, (struct recipe){0}, 0, &bytes);
    struct umbr_verify_result result;
    struct umb_error error = {0};
    assert_int_equal(umbr_verify(asset, 1, world.rays, NULL, &result, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "light 1"));
    assert_int_equal(result.points, 0);
    umb_asset_close(asset);
    bytes_finish(&bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faithful_asset_has_nothing_outside_the_band),
        cmocka_unit_test(closed_asset_is_judged_outside_its_solids_only),
        cmocka_unit_test(planted_wrong_voxels_are_outside_the_band),
        cmocka_unit_test(a_faithful_square_has_nothing_outside_the_band),
        cmocka_unit_test(every_single_wrong_voxel_is_found),
        cmocka_unit_test(segments_columns_and_boxes_are_held_against_rays),
        cmocka_unit_test(asset_of_another_light_is_found_out),
        cmocka_unit_test(result_does_not_depend_on_threads_but_on_the_seed),
        cmocka_unit_test(asset_without_any_shadow_boundary_still_gets_its_points),
        cmocka_unit_test(open_sheet_marked_closed_excuses_nothing),
        cmocka_unit_test(solid_that_fills_the_box_is_given_up_soon),
        cmocka_unit_test(progress_rises_to_the_points_compared),
        cmocka_unit_test(cancelled_verification_says_so),
        cmocka_unit_test(unknown_light_is_refused),
    };
    return cmocka_run_group_tests(tests, make_world, drop_world);
}
