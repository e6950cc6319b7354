/* SPDX-License-Identifier: Apache-2.0 */
/* Casters with holes: every depth path must keep the same texels of them, those that a slow loop
 * over all triangles keeps. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <fenv.h>
#include <math.h>

#include "bake/depth/cut_out.h"
#include "bake/depth/depth_perspective.h"
#include "bake/depth/depth.h"
#include "bake/tiles/tile_folder.h"
#include "cut_scene.h"
#include "make_asset.h"

enum {
    SIZE = 128,
};

/* Makes the casters of a scene whose world is voxel space, or their image as seen from an eye. */
struct fixture {
    struct cut_scene scene;
    struct umbs_cuts table;
    struct umbb_cut_plane planes[CUT_TRIANGLES_MAX];
    double corners[CUT_TRIANGLES_MAX][3][3];
    uint8_t kinds[CUT_TRIANGLES_MAX];
    struct umbb_cuts cuts;
    struct umbb_casters casters;
};

/* With `eye` each corner has a distance of its own, and stores q = 1 / W in place of z. */
static void fixture_init(struct fixture *f, uint64_t seed, int eye)
{
    memset(f, 0, sizeof *f);
    cut_scene_init(&f->scene, seed);
    f->scene.texture.wrap_s = (uint32_t)(seed % 3);
    f->scene.texture.wrap_t = (uint32_t)(seed / 3 % 3);
    f->scene.texture.nearest = (uint32_t)(seed % 2);
    for (uint32_t i = 0; i < 60; i++) {
        cut_scene_add_random(&f->scene, SIZE, i % 4 == 0 ? 0 : 1);
    }
    const size_t count = f->scene.view.mesh_count;
    assert_int_equal(umbs_cuts_find(&f->scene.view, &f->table, NULL), UMB_OK);
    for (size_t i = 0; i < count; i++) {
        double plane[3][3];
        for (int k = 0; k < 3; k++) {
            const double *p = f->scene.positions[3 * i + (size_t)k];
            const double w = eye ? 1.0 + p[2] / 32.0 : 1.0;
            f->corners[i][k][0] = p[0];
            f->corners[i][k][1] = p[1];
            f->corners[i][k][2] = eye ? 1.0 / w : p[2];
            plane[k][0] = p[0] * w;
            plane[k][1] = p[1] * w;
            plane[k][2] = w;
        }
        if (f->table.of[i] == UMBS_CUT_GONE) { /* the bake drops such: here it is whole */
            f->table.of[i] = UMBS_CUT_NONE;
        }
        if (f->table.of[i] != UMBS_CUT_NONE) {
            umbb_cut_plane_find((const double(*)[3])plane, &f->planes[f->table.of[i]]);
        }
    }
    f->cuts = (struct umbb_cuts){f->table.of, f->planes, &f->table};
    f->casters = (struct umbb_casters){
        .corners = (const double(*)[3][3])f->corners,
        .kinds = f->kinds,
        .count = count,
        .size = SIZE,
        .depth_scale = eye ? 32.0 : 0.0,
        .depth_offset = eye ? -32.0 : 0.0,
        .cuts = &f->cuts,
    };
    assert_true(f->table.count > 10);
}

static void fixture_finish(struct fixture *f)
{
    umbs_cuts_finish(&f->table);
}

typedef enum umb_status (*create_fn)(const struct umbb_casters *, const struct umbb_depth_options *,
                                     struct umbb_depth *, struct umb_error *);

static void map_get(create_fn create, const struct fixture *f, uint32_t tile_log2, int plain,
                    int32_t lit[SIZE][SIZE])
{
    const struct umbb_depth_options options = {
        .tile_log2 = tile_log2, .threads = 1, .plain = plain};
    struct umbb_depth depth;
    struct umbb_tile tile;
    assert_int_equal(create(&f->casters, &options, &depth, NULL), UMB_OK);
    assert_int_equal(umbb_tile_init(&tile, tile_log2, 0, NULL), UMB_OK);
    for (tile.y0 = 0; tile.y0 < SIZE; tile.y0 += tile.size) {
        for (tile.x0 = 0; tile.x0 < SIZE; tile.x0 += tile.size) {
            assert_int_equal(depth.begin(depth.state, 0, &tile, NULL), UMB_OK);
            depth.block(depth.state, 0, 0, &tile, 0, 0);
            for (int32_t y = 0; y < tile.size; y++) {
                for (int32_t x = 0; x < tile.size; x++) {
                    lit[tile.y0 + y][tile.x0 + x] = tile.lit[umbb_tile_index(&tile, x, y)];
                }
            }
        }
    }
    umbb_tile_finish(&tile);
    depth.destroy(depth.state);
}

/* Computes, by weights in long double, how far a triangle's alpha at a texel is from the cut-off.
 * Below 0 the triangle leaves the texel out. */
static long double slow_margin(const struct fixture *f, size_t i, int32_t x, int32_t y)
{
    const double(*v)[3] = f->casters.corners[i];
    const int eye = f->casters.depth_scale > 0.0;
    long double weight[3], sum = 0.0L, at[2] = {0.0L, 0.0L};
    for (int k = 0; k < 3; k++) {
        const double *a = v[(k + 1) % 3], *b = v[(k + 2) % 3];
        weight[k] = ((long double)a[0] - (x + 0.5L)) * ((long double)b[1] - (y + 0.5L)) -
                    ((long double)b[0] - (x + 0.5L)) * ((long double)a[1] - (y + 0.5L));
        weight[k] *= eye ? (long double)v[k][2] : 1.0L; /* perspective: by 1 / W */
        sum += weight[k];
    }
    for (int k = 0; k < 3; k++) {
        at[0] += weight[k] / sum * (long double)f->scene.uvs[3 * i + (size_t)k][0];
        at[1] += weight[k] / sum * (long double)f->scene.uvs[3 * i + (size_t)k][1];
    }
    return cut_slow_alpha(&f->scene, (double)at[0], (double)at[1]) - 127.5L;
}

/* Finds the least `lit` of all triangles that cover a texel and keep it. Returns 0 where rounding
 * may decide. */
static int slow_lit(const struct fixture *f, int32_t x, int32_t y, int32_t *lit)
{
    *lit = SIZE;
    for (size_t i = 0; i < f->casters.count; i++) {
        struct umbb_coverage c;
        int32_t first, last;
        if (!umbb_coverage_prepare(f->casters.corners[i], SIZE, &c) || y < c.row_first ||
            y > c.row_last) {
            continue;
        }
        (void)umbb_coverage_row(&c, y, &first, &last);
        if (x < first || x > last) {
            continue;
        }
        const double row_z = umbb_coverage_row_z(&c, y);
        const struct umbb_rays rays = umbb_rays_of(&f->casters);
        const int32_t one = umbb_rays_lit(&rays, &c, row_z, x);
        if (f->table.of[i] != UMBS_CUT_NONE) {
            const long double margin = slow_margin(f, i, x, y);
            if (fabsl(margin) < 1e-6L || f->scene.texture.nearest) {
                if (one < *lit) {
                    return 0;
                }
                continue;
            }
            if (margin < 0.0L) {
                continue;
            }
        }
        *lit = one < *lit ? one : *lit;
    }
    return 1;
}

static void compare(struct fixture *f, create_fn create)
{
    static int32_t reference[SIZE][SIZE], other[SIZE][SIZE];
    size_t asked = 0, kept = 0;
    map_get(create, f, 7, 1, reference);
    for (uint32_t tile_log2 = 6; tile_log2 <= 7; tile_log2++) {
        map_get(create, f, tile_log2, 0, other);
        assert_memory_equal(other, reference, sizeof other);
        map_get(umbb_depth_embree_create, f, tile_log2, 0, other);
        assert_memory_equal(other, reference, sizeof other);
    }
    for (int32_t y = 0; y < SIZE; y++) {
        for (int32_t x = 0; x < SIZE; x++) {
            int32_t lit;
            kept += reference[y][x] < SIZE;
            if (slow_lit(f, x, y, &lit)) {
                asked++;
                assert_int_equal(reference[y][x], lit);
            }
        }
    }
    print_message("%zu texels shadowed, %zu compared\n", kept, asked);
    assert_true(kept > 1000 && asked > 1000);
}

static void all_paths_keep_the_same_texels_under_a_sun(void **state)
{
    (void)state;
    static struct fixture f;
    for (uint64_t seed = 1; seed <= (uint64_t)short_count(9, 3); seed++) {
        fixture_init(&f, seed, 0);
        compare(&f, umbb_depth_raster_create);
        fixture_finish(&f);
    }
}

static void all_paths_keep_the_same_texels_before_an_eye(void **state)
{
    (void)state;
    static struct fixture f;
    for (uint64_t seed = 11; seed < 11 + (uint64_t)short_count(6, 2); seed++) {
        fixture_init(&f, seed, 1);
        compare(&f, umbb_depth_raster_create);
        fixture_finish(&f);
    }
}

static void triangles_seen_edge_on_take_some_texel_of_their_own(void **state)
{
    (void)state;
    static struct fixture f;
    fixture_init(&f, 1, 0);
    static const double corners[3][3] = {{3, 3, 1}, {9, 9, 1}, {6, 6, 1}};
    struct umbb_cut_plane plane;
    umbb_cut_plane_find(corners, &plane);
    f.cuts.planes = &plane;
    for (int32_t x = -5; x < 20; x++) {
        const int casts = umbb_cut_casts(&f.cuts, 0, x, x);
        assert_true(casts == 0 || casts == 1); /* and no sanitizer has a word to say */
    }
    fixture_finish(&f);
}

static void the_name_of_a_tile_depends_on_the_texture(void **state)
{
    (void)state;
    static struct fixture f;
    uint8_t keys[6][UMB_ID_BYTES];
    fixture_init(&f, 4, 0);
    for (int i = 0; i < 6; i++) {
        const struct umbb_depth_options options = {.tile_log2 = 7, .threads = 1};
        const struct umbb_tile_place place = {0};
        const struct umbb_tile_shape shape = {.log2_size = 7, .tile_log2 = 7};
        struct umbb_depth depth;
        f.scene.materials[1].alpha_cutoff = i == 1 ? 0.4F : 0.5F;
        f.table.digests[0][5] ^= i == 2 || i == 3;
        f.table.cuts[3].uv[1][0] += i == 4 ? 0.25F : 0.0F;
        assert_int_equal(umbb_depth_raster_create(&f.casters, &options, &depth, NULL), UMB_OK);
        umbb_tile_key(&depth, &shape, &place, keys[i]);
        depth.destroy(depth.state);
    }
    for (int i = 1; i < 6; i++) {
        assert_int_equal(memcmp(keys[0], keys[i], UMB_ID_BYTES) == 0, i == 3);
    }
    fixture_finish(&f);
}

/* A corner in the plane of a spot's eye has no image. It must not be used as the anchor, and
 * nothing may be divided by its distance of 0. */
static void a_corner_beside_the_eye_is_no_anchor(void **state)
{
    (void)state;
    for (int far = 0; far < 3; far++) {
        const double corners[3][3] = {{3.0, 4.0,
                                       far == 2   ? -1.0
                                       : far == 1 ? 1e-320
                                                  : 0.0},
                                      {5.0, 1.0, 2.0},
                                      {1.0, 7.0, 4.0}};
        struct umbb_cut_plane plane;
        assert_int_equal(feclearexcept(FE_DIVBYZERO), 0);
        umbb_cut_plane_find(corners, &plane);
        assert_int_equal(fetestexcept(FE_DIVBYZERO), 0);
        for (int axis = 0; axis < 2; axis++) {
            assert_true(plane.anchor[axis] == 0.0);
        }
        for (int k = 0; k < 3; k++) {
            assert_true(isfinite(plane.edge[k][0]) && isfinite(plane.edge[k][2]));
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_paths_keep_the_same_texels_under_a_sun),
        cmocka_unit_test(all_paths_keep_the_same_texels_before_an_eye),
        cmocka_unit_test(triangles_seen_edge_on_take_some_texel_of_their_own),
        cmocka_unit_test(a_corner_beside_the_eye_is_no_anchor),
        cmocka_unit_test(the_name_of_a_tile_depends_on_the_texture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
