/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Verification of lamps next to a surface, where voxels are smaller than the resolution of floats:
 * right voxels must never be judged wrong, and wrong ones must be found.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "make_asset.h"
#include "rays/verify.h"

enum {
    LOG2_SIZE = 6,
    SIZE = 1 << LOG2_SIZE,
    POINTS = 20000,
};

/* National coordinates; the floor's height is no float. */
static const double origin[3] = {2600000, 1200000, 400};
static const double floor_z = 400.37;

/* A lamp above the floor, and what its voxels say. */
struct lamp {
    double height; /* metres */
    double depth;  /* metres, of a voxel */
    int deeper;    /* voxels by which the floor is drawn too deep */
    int planted;   /* a wrong voxel in each block of 16^3 */
    int missing;   /* the face that sees the floor is not there: one that looks up is */
};

static int voxel_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const struct lamp *lamp = user;
    (void)frustum;
    const int lit = lamp->missing || (int)z < SIZE / 2 + lamp->deeper;
    return lit ^ (lamp->planted && x % 16 == 7 && y % 16 == 9 && z % 16 == 5);
}

/* The face that looks down, 90 degrees wide; the floor is the border of its middle voxels. */
static void set_light(struct umb__content *content, const struct lamp *lamp)
{
    const double up = lamp->missing ? -1 : 1;
    const double axes[3][3] = {{1, 0, 0}, {0, -up, 0}, {0, 0, -up}};
    const double eye[3] = {0.3, 0.2, floor_z - origin[2] + lamp->height};
    struct umb_frustum_info *frustum = &content->frusta[0];
    /* Of a point light, the other faces would be missing too. */
    content->lights[0].kind = lamp->missing ? UMB_LIGHT_POINT : UMB_LIGHT_SPOT;
    memset(content->lights[0].direction, 0, sizeof content->lights[0].direction);
    content->lights[0].direction[2] = lamp->missing ? 0 : -1;
    content->bounds = (struct umb_box){{origin[0] - 10, origin[1] - 10, floor_z - 5},
                                       {origin[0] + 10, origin[1] + 10, floor_z + 9}};
    for (int i = 0; i < 3; i++) {
        content->lights[0].position[i] = origin[i] + eye[i];
        const double scale = i < 2 ? SIZE / 2.0 : 1 / lamp->depth;
        const double offset = i < 2 ? SIZE / 2.0 : SIZE / 2.0 - lamp->height / lamp->depth;
        double *row = frustum->world_to_voxel[i];
        row[3] = i < 2 ? 0 : offset;
        for (int k = 0; k < 3; k++) {
            row[k] = axes[i][k] * scale + (i < 2 ? axes[2][k] * offset : 0);
            row[3] -= row[k] * eye[k];
            frustum->voxel_step[i][k] = axes[i][k] / scale;
        }
    }
    memcpy(frustum->world_to_voxel[3], axes[2], sizeof axes[2]);
    frustum->world_to_voxel[3][3] = up * eye[2];
}

static struct umbr_verify_result verify(const struct lamp *lamp)
{
    const struct voxels voxels = {voxel_lit, lamp, LOG2_SIZE, 1};
    static double floor[4][3][3]; /* and the tip of a post: the scene's middle is not the floor */
    static const double corner[4][2] = {{-10, -10}, {10, -10}, {10, 10}, {-10, 10}};
    struct umb__content content;
    struct umb__octree octree = {0};
    struct bytes bytes = {0};
    struct umb_sink sink = bytes_sink(&bytes);
    struct umb_asset *asset;
    struct umb_error error = {0};
    struct umbr_rays *rays;
    struct umbr_verify_result result = {0};
    uint8_t id[UMB_ID_BYTES];
    for (int t = 0; t < 2; t++) {
        for (int k = 0; k < 3; k++) {
            const double *at = corner[k == 0 ? 0 : k + t];
            const double p[3] = {origin[0] + at[0], origin[1] + at[1], floor_z};
            memcpy(floor[t][k], p, sizeof p);
            const double q[3] = {origin[0] + 9 + 0.01 * k, origin[1] + 9 + 0.01 * t,
                                 floor_z + (k == 1 ? 9 : -5)};
            memcpy(floor[2 + t][k], q, sizeof q);
        }
    }
    make_content(&voxels, 1, origin, &content);
    set_light(&content, lamp);
    make_octree(&voxels, &octree);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, &error), UMB_OK);
    if (umb_asset_open_bytes(bytes.data, bytes.size, NULL, &asset, &error) != UMB_OK) {
        fail_msg("asset: %s", error.message);
        return result;
    }
    assert_int_equal(umbr_rays_build((const double(*)[3][3])floor, 4, NULL, &rays, NULL), UMB_OK);
    const struct umbr_verify_options options = {.points = POINTS, .seed = 9, .threads = 2};
    assert_int_equal(umbr_verify(asset, 0, rays, &options, &result, &error), UMB_OK);
    umbr_rays_destroy(rays);
    umb_asset_close(asset);
    umb__octree_finish(&octree);
    bytes_finish(&bytes);
    return result;
}

static const struct {
    double height, depth;
} places[] = {{1, 1e-2}, {0.3, 1e-6}, {0.01, 1e-8}, {1e-3, 1e-8}, {1e-6, 1e-9}};

static void right_voxels_next_to_a_lamp_are_right(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        const struct lamp lamp = {.height = places[i].height, .depth = places[i].depth};
        const struct umbr_verify_result result = verify(&lamp);
        print_message("%g m: %llu points, %llu near, %llu in band\n", lamp.height,
                      (unsigned long long)result.points, (unsigned long long)result.near_boundary,
                      (unsigned long long)result.inside_band);
        assert_int_equal(result.outside_band, 0);
        assert_int_equal(result.points, POINTS);
        assert_true(result.near_boundary > POINTS / 10);
    }
}

static void wrong_voxels_next_to_a_lamp_are_found(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        const struct lamp deeper = {places[i].height, places[i].depth, .deeper = 2};
        const struct lamp higher = {places[i].height, places[i].depth, .deeper = -2};
        const struct lamp planted = {places[i].height, places[i].depth, .planted = 1};
        /* Of the points near the floor, within 4 voxels, an eighth lies in wrong voxels outside the
         * band. Rays in floats would put them into the band. */
        assert_true(verify(&deeper).outside_band > POINTS / 2 / 10);
        assert_true(verify(&higher).outside_band > POINTS / 2 / 10);
        const struct umbr_verify_result result = verify(&planted);
        assert_true(result.outside_band > 0 && result.has_worst);
        /* The point it names is in the world, not relative to the asset's origin. */
        assert_true(fabs(result.worst_point[2] - floor_z) < 2);
    }
}

/* A missing face has no voxels: the light below the floor must be found all the same. */
static void a_missing_face_is_found(void **state)
{
    (void)state;
    const struct lamp lamp = {.height = 1e-3, .depth = 1e-8, .missing = 1};
    assert_true(verify(&lamp).outside_band > 100);
}

/* A wire of a nanometre through the centres of a row of voxels, under a sun. */
static int wire_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    (void)y;
    return !(x == 20 && z >= SIZE / 2);
}

static void what_only_doubles_see_is_looked_at_again(void **state)
{
    (void)state;
    static const double voxel_m = 0.25;
    const struct voxels voxels = {wire_lit, NULL, LOG2_SIZE, 1};
    double wire[3][3][3]; /* and a triangle beside the frustum, away from which floats are coarse */
    struct umb__content content;
    struct umb__octree octree = {0};
    struct bytes bytes = {0};
    struct umb_sink sink = bytes_sink(&bytes);
    struct umb_asset *asset;
    struct umb_error error = {0};
    struct umbr_rays *rays;
    struct umbr_verify_result result;
    uint8_t id[UMB_ID_BYTES];
    for (int i = 0; i < 6; i++) {
        const int corner = i < 3 ? i : i == 3 ? 0 : i - 2; /* 0 1 2, 0 2 3: a ring of four */
        wire[i / 3][i % 3][0] = origin[0] + 20.5 * voxel_m + (corner % 3 == 0 ? -1 : 1) * 0x1p-31;
        wire[i / 3][i % 3][1] = origin[1] + (corner < 2 ? -1 : SIZE + 1) * voxel_m;
        wire[i / 3][i % 3][2] = origin[2] + SIZE / 2 * voxel_m;
    }
    for (int i = 0; i < 9; i++) {
        wire[2][i / 3][i % 3] = origin[i % 3] - (i % 4 == 0 ? 31 : 30);
    }
    make_content(&voxels, voxel_m, origin, &content);
    make_octree(&voxels, &octree);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, &error), UMB_OK);
    assert_int_equal(umb_asset_open_bytes(bytes.data, bytes.size, NULL, &asset, &error), UMB_OK);
    assert_int_equal(umbr_rays_build((const double(*)[3][3])wire, 3, NULL, &rays, NULL), UMB_OK);
    assert_true(umbr_rays_error_m(rays) < voxel_m); /* floats are taken to begin with */
    const struct umbr_verify_options options = {.points = POINTS, .seed = 10, .threads = 2};
    assert_int_equal(umbr_verify(asset, 0, rays, &options, &result, &error), UMB_OK);
    assert_int_equal(result.outside_band, 0);
    assert_true(result.inside_band > 100);
    umbr_rays_destroy(rays);
    umb_asset_close(asset);
    umb__octree_finish(&octree);
    bytes_finish(&bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(right_voxels_next_to_a_lamp_are_right),
        cmocka_unit_test(wrong_voxels_next_to_a_lamp_are_found),
        cmocka_unit_test(a_missing_face_is_found),
        cmocka_unit_test(what_only_doubles_see_is_looked_at_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
