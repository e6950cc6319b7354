/* SPDX-License-Identifier: Apache-2.0 */
/* Faces of spot and point lights: cutting, fitting, and depth by both paths. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "bake/analysis/eye_clip.h"
#include "bake/analysis/perspective_frame.h"
#include "bake/depth/depth_perspective.h"
#include "bake_soups.h"

enum {
    WORLD = 64,
    LOG2 = 7,
    SIZE = 1 << LOG2
};

static const struct umbb_pyramid pyramid = {.low = {-1, -0.5}, .high = {1, 0.5}, .near = 0.25};

static void random_corner(struct soup *soup, double corner[3])
{
    for (int k = 0; k < 3; k++) {
        corner[k] = 4 * soup_unit(soup) - 1.5;
    }
}

/* Finds the corners of a polygon that lie on an edge's line, by comparing their bits with another
 * polygon's. */
static size_t shared_corners(const struct umbb_polygon *a, const struct umbb_polygon *b)
{
    size_t shared = 0;
    for (size_t i = 0; i < a->count; i++) {
        for (size_t k = 0; k < b->count; k++) {
            shared += memcmp(a->corners[i], b->corners[k], sizeof a->corners[i]) == 0;
        }
    }
    return shared;
}

static void triangles_cut_shared_edges_at_equal_points(void **state)
{
    (void)state;
    struct soup soup;
    uint64_t met = 0;
    soup_init(&soup, WORLD, 71);
    for (int n = 0; n < 20000; n++) {
        double one[3][3], two[3][3];
        struct umbb_polygon a, b;
        for (int k = 0; k < 3; k++) {
            random_corner(&soup, one[k]);
        }
        memcpy(two, one, sizeof two); /* the edge 0-1, run through the other way */
        memcpy(two[0], one[1], sizeof two[0]);
        memcpy(two[1], one[0], sizeof two[1]);
        random_corner(&soup, two[2]);
        umbb_eye_clip(&pyramid, (const double(*)[3])one, &a);
        umbb_eye_clip(&pyramid, (const double(*)[3])two, &b);
        assert_true(a.count == 0 || (a.count >= 3 && a.count <= UMBB_CLIP_CORNERS_MAX));
        for (size_t i = 0; i < a.count; i++) { /* inside but for rounding */
            const double *p = a.corners[i];
            assert_true(p[2] >= 0.25 - 1e-12 && fabs(p[0]) <= p[2] + 1e-12 &&
                        fabs(p[1]) <= 0.5 * p[2] + 1e-12);
        }
        /* The rest of the edge has two ends, and both polygons must have them. */
        double ends[3][3];
        struct umbb_polygon edge;
        memcpy(ends[0], one[0], sizeof ends[0]);
        memcpy(ends[1], one[1], sizeof ends[1]);
        memcpy(ends[2], one[1], sizeof ends[2]);
        umbb_eye_clip(&pyramid, (const double(*)[3])ends, &edge);
        if (edge.count > 0) {
            met++;
            assert_true(shared_corners(&a, &b) >= 2);
        }
    }
    assert_true(met > 1000);
    soup_finish(&soup);
}

static struct umbb_eye eye_at(double x, double y, double z, double tangent)
{
    return (struct umbb_eye){.position = {x, y, z},
                             .axes = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                             .tangent = tangent,
                             .reach = 2 * WORLD};
}

/* Projects casters for an eye at eye_at. */
static enum umb_status project(const struct umbb_casters *world,
                               const struct umb_frustum_info *frustum, const double origin[3],
                               size_t max_bytes, struct umbb_projected *seen)
{
    const struct umbb_eye_view view = {frustum, origin, 2 * WORLD, max_bytes};
    return umbb_perspective_project(world, &view, seen, NULL);
}

static void boxes_make(struct soup *soup)
{
    for (int i = 0; i < 30; i++) {
        double low[3], high[3];
        for (int k = 0; k < 3; k++) {
            low[k] = soup_unit(soup) * (WORLD - 10);
            high[k] = low[k] + 1 + 8 * soup_unit(soup);
        }
        soup_box(soup, low, high, i % 2);
    }
    const double a[3] = {0, 0, 60}, b[3] = {64, 5, 50}, c[3] = {-9, 70, 45};
    soup_add(soup, a, b, c, UMBB_CASTER_OPEN);
}

static void a_fitted_face_holds_what_it_sees_and_no_more(void **state)
{
    (void)state;
    static const double origin[3] = {3, -2, 1};
    struct soup soup;
    soup_init(&soup, WORLD, 72);
    boxes_make(&soup);
    const struct umbb_casters world = {
        .corners = (const double(*)[3][3])soup.corners, .kinds = soup.kinds, .count = soup.count};
    const struct umbb_fit fit = {world.corners, world.count, origin, LOG2, 1};
    for (int n = 0; n < 20; n++) {
        double random[4]; /* one after the other: the order of arguments is the compiler's */
        for (int k = 0; k < 4; k++) {
            random[k] = soup_unit(&soup);
        }
        const struct umbb_eye eye =
            eye_at(60 * random[0], 60 * random[1], 20 * random[2] - 10, 0.2 + random[3]);
        struct umb_frustum_info frustum;
        struct umbb_projected seen;
        double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
        assert_int_equal(umbb_perspective_fit(&fit, &eye, &frustum), 1);
        assert_int_equal(project(&world, &frustum, origin, 1 << 24, &seen), UMB_OK);
        for (size_t i = 0; i < seen.count; i++) {
            for (int k = 0; k < 3; k++) {
                const double *p = seen.corners[i][k];
                const double z = seen.depth_scale / p[2] + seen.depth_offset;
                assert_true(p[0] > -1.001 && p[0] < SIZE + 1.001 && p[2] > 0 && p[2] < 1.001);
                /* Corners deeper than the last voxel may be in the margin only, which the fit
                 * ignores. */
                assert_true(z < SIZE ||
                            !(p[0] > 1 && p[0] < SIZE - 1 && p[1] > 1 && p[1] < SIZE - 1));
                for (int axis = 0; axis < 2; axis++) {
                    low[axis] = fmin(low[axis], p[axis]);
                    high[axis] = fmax(high[axis], p[axis]);
                }
            }
        }
        for (int axis = 0; axis < 2; axis++) { /* a voxel of margin, no more */
            assert_true(low[axis] < 1.001 && high[axis] > SIZE - 1.001);
        }
        umbb_projected_finish(&seen);
        assert_int_equal(project(&world, &frustum, origin, 100, &seen), UMB_E_LIMIT);
        umbb_projected_finish(&seen);
    }
    const struct umbb_eye past = eye_at(10, 10, 500, 1);
    struct umb_frustum_info frustum;
    assert_int_equal(umbb_perspective_fit(&fit, &past, &frustum), 0);
    soup_finish(&soup);
}

/* Reads all texels of a frustum of one tile. */
static void read_depth(const struct umbb_casters *casters, int by_embree, struct umbb_tile *tile)
{
    const struct umbb_depth_options options = {
        .tile_log2 = LOG2, .threads = 1, .prove = UMBB_PROVE_NEVER};
    struct umbb_depth depth;
    assert_int_equal(umbb_tile_init(tile, LOG2, casters->closed_rule, NULL), UMB_OK);
    assert_int_equal(by_embree ? umbb_depth_embree_create(casters, &options, &depth, NULL)
                               : umbb_depth_raster_create(casters, &options, &depth, NULL),
                     UMB_OK);
    for (size_t i = 0; i < (size_t)SIZE * SIZE; i++) {
        tile->lit[i] = tile->end[i] = SIZE; /* empty cells are not written */
    }
    assert_int_equal(depth.begin(depth.state, 0, tile, NULL), UMB_OK);
    depth.block(depth.state, 0, 0, tile, 0, 0);
    depth.destroy(depth.state);
}

static void both_depth_paths_agree_under_perspective(void **state)
{
    (void)state;
    static const double origin[3] = {0, 0, 0};
    struct soup soup;
    soup_init(&soup, WORLD, 73);
    boxes_make(&soup);
    const struct umbb_casters world = {
        .corners = (const double(*)[3][3])soup.corners, .kinds = soup.kinds, .count = soup.count};
    const struct umbb_fit fit = {world.corners, world.count, origin, LOG2, 1};
    for (int n = 0; n < 6; n++) {
        const struct umbb_eye eye =
            eye_at(30 + n, 32 - 2 * n, 10 * soup_unit(&soup), 0.3 + 0.2 * n);
        struct umb_frustum_info frustum;
        struct umbb_projected seen;
        struct umbb_tile raster, embree;
        (void)umbb_perspective_fit(&fit, &eye, &frustum);
        assert_int_equal(project(&world, &frustum, origin, 1 << 24, &seen), UMB_OK);
        const struct umbb_casters casters = {.corners = (const double(*)[3][3])seen.corners,
                                             .kinds = seen.kinds,
                                             .count = seen.count,
                                             .size = SIZE,
                                             .closed_rule = n % 2,
                                             .depth_scale = seen.depth_scale,
                                             .depth_offset = seen.depth_offset};
        read_depth(&casters, 0, &raster);
        read_depth(&casters, 1, &embree);
        const size_t bytes = (size_t)SIZE * SIZE * sizeof *raster.lit;
        assert_memory_equal(raster.lit, embree.lit, bytes);
        assert_memory_equal(raster.end, embree.end, bytes);
        umbb_tile_finish(&raster);
        umbb_tile_finish(&embree);
        umbb_projected_finish(&seen);
    }
    soup_finish(&soup);
}

/* A cut may leave a triangle in which two corners differ by rounding only: it is as long as the
 * frustum and runs through the centres of all texels of its diagonal. */
static void slivers_are_as_deep_as_their_longest_edge(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, SIZE, 74);
    int drawn = 0;
    for (int n = 0; n < 2000; n++) {
        double corners[1][3][3] = {{{-1, -1, 1.0 / 100}, {-1, -1, 1.0 / 100}, {0, 0, 0}}};
        const double far = 1.0 / (100 + SIZE * soup_unit(&soup));
        corners[0][2][0] = corners[0][2][1] = SIZE + 1;
        corners[0][2][2] = far;
        for (int i = 0; i < 9; i++) { /* some units in the last place */
            corners[0][i / 3][i % 3] *= 1 + 0x1p-52 * (double)(soup_bits(&soup) % 9);
        }
        const struct umbb_casters casters = {.corners = (const double(*)[3][3])corners,
                                             .count = 1,
                                             .size = SIZE,
                                             .depth_scale = 1,
                                             .depth_offset = -100};
        struct umbb_coverage coverage;
        if (!umbb_perspective_prepare(&casters, 0, &coverage)) {
            continue;
        }
        for (int32_t row = coverage.row_first; row <= coverage.row_last && row < SIZE; row++) {
            int32_t first, last;
            (void)umbb_coverage_row(&coverage, row, &first, &last);
            if (row < 0 || first > row || last < row) {
                continue;
            }
            const double share = (row + 1.5) / (SIZE + 2);
            const double z = 1 / (0.01 + share * (far - 0.01)) - 100;
            const double row_z = umbb_coverage_row_z(&coverage, row);
            const struct umbb_rays rays = umbb_rays_of(&casters);
            const int32_t lit = umbb_rays_lit(&rays, &coverage, row_z, row);
            assert_true(fabs(lit - z) < 0.6);
            drawn++;
        }
    }
    print_message("%d texels\n", drawn);
    assert_true(drawn > 1000);
    soup_finish(&soup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slivers_are_as_deep_as_their_longest_edge),
        cmocka_unit_test(triangles_cut_shared_edges_at_equal_points),
        cmocka_unit_test(a_fitted_face_holds_what_it_sees_and_no_more),
        cmocka_unit_test(both_depth_paths_agree_under_perspective),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
