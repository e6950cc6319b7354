/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Queries of point lights: six faces whose voxels say exactly what a plane shadows. Expected
 * answers are computed in world space, so that an error at a border between faces shows.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lamp_fixture.h"

enum {
    POINTS = 400
};

/* A plane across several faces: its foot lies near an edge or a corner of the cube. */
static struct plane random_plane(uint64_t *seed)
{
    struct plane plane = {.distance = 2 + 3 * random_unit(seed)};
    double square = 0;
    for (int k = 0; k < 3; k++) {
        plane.normal[k] = random_unit(seed) * 2 - 1;
        square += plane.normal[k] * plane.normal[k];
    }
    for (int k = 0; k < 3; k++) {
        plane.normal[k] /= sqrt(square);
    }
    return plane;
}

/* A point of the plane within 6 metres of its foot, `off` metres before it; relative to origin. */
static void plane_point(const struct plane *plane, double off, uint64_t *seed, double point[3])
{
    double across[3], along = 0;
    for (int k = 0; k < 3; k++) {
        across[k] = (random_unit(seed) * 2 - 1) * 6;
        along += across[k] * plane->normal[k];
    }
    for (int k = 0; k < 3; k++) {
        point[k] =
            eye[k] - origin[k] + across[k] + (plane->distance - off - along) * plane->normal[k];
    }
}

static double storage[POINTS][3];
static float normals[POINTS][3];

static struct umb_points batch(int with_normals)
{
    struct umb_points points = {.positions = storage,
                                .format = UMB_POINT_F64,
                                .normals = with_normals ? normals : NULL,
                                .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    return points;
}

static void run(const struct umb_asset *asset, const struct umb_query_settings *settings,
                const struct umb_points *points, struct umb_answers *answers)
{
    struct umb_query query;
    struct umb_error error;
    assert_int_equal(umb_query_prepare(asset, settings, &query, &error), UMB_OK);
    umb_query_run(&query, points, 0, points->count, answers);
}

/* The automatic bias promises that a plane never shadows itself, for every window. */
static void a_plane_never_shadows_itself_across_faces(void **state)
{
    (void)state;
    uint64_t seed = 77;
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int n = 0; n < 3; n++) {
        const struct plane plane = random_plane(&seed);
        struct umb_asset *asset = make_asset(&plane);
        for (size_t i = 0; i < POINTS; i++) {
            plane_point(&plane, 0, &seed, storage[i]);
            for (int k = 0; k < 3; k++) {
                normals[i][k] = (float)-plane.normal[k];
            }
        }
        for (uint32_t taps = 1; taps <= 17; taps += 8) {
            float values[POINTS];
            struct umb_answers answers = {.values = values};
            const struct umb_points points = batch(1);
            run(asset, &(struct umb_query_settings){.taps = taps}, &points, &answers);
            assert_int_equal(answers.stats.points, POINTS);
            for (size_t i = 0; i < POINTS; i++) {
                if (values[i] != 1.0F) {
                    fail_msg("plane %d, %u taps, point %zu: %g", n, taps, i, (double)values[i]);
                }
            }
        }
        for (double side = 0.25; side <= 4; side *= 2) {
            float values[POINTS];
            struct umb_answers answers = {.values = values};
            const struct umb_points points = batch(1);
            run(asset,
                &(struct umb_query_settings){.filter = UMB_FILTER_FOOTPRINT, .footprint_m = side},
                &points, &answers);
            for (size_t i = 0; i < POINTS; i++) {
                if (values[i] != 1.0F) {
                    fail_msg("plane %d, %g m, point %zu: %g", n, side, i, (double)values[i]);
                }
            }
        }
        umb_asset_close(asset);
    }
}

/* If a point is farther from the plane than a voxel's diagonal, one tap must give its side. If the
 * whole window lies on one side, all taps must give that side, whichever faces the window
 * touches. */
static void sides_of_a_plane_are_told_apart_in_every_face(void **state)
{
    (void)state;
    uint64_t seed = 5;
    print_message("seed %llu\n", (unsigned long long)seed);
    /* Half a window of 17 texels at W below 10, and half a slice. */
    const double reach = 10.0 * 2.0 * tangent / SIZE * 9.0 * 1.5 + (far_w - near_w) / SIZE;
    for (int n = 0; n < 2; n++) {
        const struct plane plane = random_plane(&seed);
        struct umb_asset *asset = make_asset(&plane);
        for (size_t i = 0; i < POINTS; i++) {
            const double off = i % 2 ? -reach : reach;
            plane_point(&plane, off, &seed, storage[i]);
        }
        for (uint32_t taps = 1; taps <= 17; taps += 16) {
            uint8_t values[POINTS];
            struct umb_answers answers = {.values = values};
            const struct umb_points points = batch(0);
            const struct umb_query_settings settings = {
                .taps = taps, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
            run(asset, &settings, &points, &answers);
            for (size_t i = 0; i < POINTS; i++) {
                if (values[i] != (i % 2 ? 0 : 255)) {
                    fail_msg("plane %d, %u taps, point %zu: %u", n, taps, i, values[i]);
                }
            }
        }
        umb_asset_close(asset);
    }
}

static void splits_formats_and_explanations_agree(void **state)
{
    (void)state;
    uint64_t seed = 9;
    print_message("seed %llu\n", (unsigned long long)seed);
    const struct plane plane = random_plane(&seed);
    struct umb_asset *asset = make_asset(&plane);
    for (size_t i = 0; i < POINTS; i++) {
        for (int k = 0; k < 3; k++) {
            storage[i][k] = (random_unit(&seed) * 2 - 1) * 12;
            normals[i][k] = (float)(random_unit(&seed) * 2 - 1);
        }
        memset(normals[i], i % 5 == 0 ? 0 : -1, i % 5 == 0 ? sizeof normals[i] : 0);
    }
    static float whole[POINTS], parts[POINTS];
    static uint8_t bits[(POINTS + 7) / 8];
    struct umb_answers first = {.values = whole}, second = {.values = parts};
    struct umb_query_settings settings = {.taps = 9};
    const struct umb_points points = batch(1);
    struct umb_query query;
    run(asset, &settings, &points, &first);
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    for (size_t at = 0; at < POINTS; at += 37) {
        umb_query_run(&query, &points, at, POINTS - at < 37 ? POINTS - at : 37, &second);
    }
    assert_memory_equal(whole, parts, sizeof whole);
    assert_memory_equal(&first.stats, &second.stats, sizeof first.stats);
    assert_true(first.stats.facing_away > 0);
    struct umb_answers third = {.values = bits};
    settings.format = UMB_ANSWER_BIT;
    run(asset, &settings, &points, &third);
    uint32_t used = 0;
    for (size_t i = 0; i < POINTS; i++) {
        struct umb_explanation e;
        umb_query_explain(&query, &points, i, &e);
        assert_int_equal(bits[i / 8] >> (i % 8) & 1, whole[i] >= 0.5F);
        assert_true((float)e.lit_taps / 81.0F == whole[i]);
        used |= 1U << e.frustum;
        assert_int_equal(e.has_normal, i % 5 != 0);
        assert_true(e.has_normal ? e.facing_away == !(e.cosine > 0) : e.cosine == 0);
        assert_true(e.cosine >= -1.001 && e.cosine <= 1.001 && e.bias_mode == UMB_BIAS_AUTO);
        if (!e.facing_away && !e.outside) {
            assert_true(e.voxel[0] >= 0 && e.voxel[0] < SIZE && e.voxel[1] >= 0);
        }
    }
    assert_int_equal(used, 63); /* every face answered */
    umb_asset_close(asset);
}

/* Weight of a texel on one axis, as the header gives it. */
static double weight_of(enum umb_filter filter, int32_t distance, int32_t taps)
{
    const double sigma = taps / 6.0;
    return filter == UMB_FILTER_TENT ? (taps + 1) / 2 - distance
                                     : exp(-distance * distance / (2 * sigma * sigma));
}

/* The explanation must show the texels of the box around the same place. */
static double weigh_rows(const struct umb_explanation *e, enum umb_filter filter)
{
    const int32_t taps = (int32_t)e->taps;
    double lit = 0, all = 0;
    for (int32_t j = 0; j < taps; j++) {
        for (int32_t i = 0; i < taps; i++) {
            const double weight = weight_of(filter, abs(i - taps / 2), taps) *
                                  weight_of(filter, abs(j - taps / 2), taps);
            lit += (e->rows[j] >> i & 1) * weight;
            all += weight;
        }
    }
    return e->facing_away ? 0 : lit / all;
}

static void tents_and_gaussians_weigh_the_texels_of_a_lamp(void **state)
{
    (void)state;
    uint64_t seed = 20261123;
    static float values[POINTS];
    struct umb_answers answers = {.values = values};
    const struct umb_points points = batch(1);
    const struct plane plane = random_plane(&seed);
    struct umb_asset *asset = make_asset(&plane);
    size_t partly = 0;
    for (size_t i = 0; i < POINTS; i++) {
        plane_point(&plane, random_unit(&seed) * 0.4 - 0.2, &seed, storage[i]);
        for (int k = 0; k < 3; k++) {
            normals[i][k] = (float)(random_unit(&seed) * 2 - 1);
        }
    }
    for (uint32_t taps = 3; taps <= UMB_TAPS_MAX; taps += 6) {
        struct umb_query box;
        const struct umb_query_settings settings = {.taps = taps};
        assert_int_equal(umb_query_prepare(asset, &settings, &box, NULL), UMB_OK);
        for (int tent = 0; tent < 2; tent++) {
            struct umb_query_settings weighted = settings;
            weighted.filter = tent ? UMB_FILTER_TENT : UMB_FILTER_GAUSSIAN;
            run(asset, &weighted, &points, &answers);
            for (size_t i = 0; i < POINTS; i++) {
                struct umb_explanation e;
                umb_query_explain(&box, &points, i, &e);
                /* A Gaussian is cut off and rounded: the header's bound. */
                const double want = weigh_rows(&e, weighted.filter);
                assert_true(fabs((double)values[i] - want) <= (tent ? 1e-6 : 0.006));
                partly += want > 0.01 && want < 0.99;
            }
        }
    }
    assert_true(partly > POINTS);
    umb_asset_close(asset);
}

static void wild_points_do_no_harm(void **state)
{
    (void)state;
    const struct plane plane = {.normal = {1, 0, 0}, .distance = 3};
    struct umb_asset *asset = make_asset(&plane);
    static const double wild[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 0, 1e-320};
    for (size_t i = 0; i < POINTS; i++) {
        for (size_t k = 0; k < 3; k++) {
            storage[i][k] = wild[(i / (k == 0 ? 1 : k == 1 ? 7 : 49)) % 7];
            normals[i][k] = (float)wild[(i + k) % 7];
        }
    }
    memset(storage[0], 0, sizeof storage[0]);
    for (int k = 0; k < 3; k++) { /* the light itself */
        storage[1][k] = eye[k] - origin[k];
    }
    float values[POINTS];
    struct umb_answers answers = {.values = values};
    for (int with = 0; with < 2; with++) {
        const struct umb_points points = batch(with);
        for (int mode = UMB_BIAS_AUTO; mode <= UMB_BIAS_NONE; mode++) {
            const struct umb_query_settings settings = {
                .taps = 3, .bias_mode = (enum umb_bias_mode)mode, .bias = 1e6};
            run(asset, &settings, &points, &answers);
            for (size_t i = 0; i < POINTS; i++) {
                assert_true(values[i] >= 0 && values[i] <= 1);
            }
        }
    }
    umb_asset_close(asset);
}

/* Queries must stay inside the asset and answer, for every matrix with which a file can be
 * opened. */
static void hostile_matrices_are_refused_or_harmless(void **state)
{
    (void)state;
    static const double wild[] = {0, -0.0, 1e-320, 1e-160, -1e-9, 1, -1, 1e9, 1e160, -1e300};
    const struct plane plane = {.normal = {0, 0, 1}, .distance = 4};
    const struct voxels voxels = {before_plane, &plane, LOG2, FACES};
    struct umb__octree octree;
    uint64_t seed = 4242;
    int opened = 0;
    print_message("seed %llu\n", (unsigned long long)seed);
    make_octree(&voxels, &octree);
    for (size_t i = 0; i < POINTS; i++) {
        plane_point(&plane, 0.5, &seed, storage[i]);
        for (int k = 0; k < 3; k++) {
            normals[i][k] = (float)(random_unit(&seed) * 2 - 1);
        }
    }
    for (int n = 0; n < 80; n++) {
        struct bytes bytes = {0};
        struct umb__content content;
        struct umb_asset *asset = NULL;
        uint8_t id[UMB_ID_BYTES];
        make_content(&voxels, 1, origin, &content);
        set_content(&content);
        for (uint32_t face = 0; face < FACES; face++) {
            double *m = &content.frusta[face].world_to_voxel[0][0];
            const uint64_t what = next_random(&seed);
            const double factor = wild[what % 10];
            for (size_t k = 0; k < 16; k++) { /* one number, or a row as a whole */
                const int chosen = n % 2 == 0 ? k == what / 16 % 16 : k / 4 == what / 16 % 4;
                m[k] = !chosen ? m[k] : n % 3 == 0 ? m[k] * factor : factor;
            }
        }
        content.lights[0].position[n % 3] += n % 5 == 0 ? 1e300 : 0;
        struct umb_sink sink = bytes_sink(&bytes);
        if (umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL) == UMB_OK) {
            assert_int_equal(umb_asset_open_bytes(bytes.data, bytes.size, NULL, &asset, NULL),
                             UMB_OK);
            float values[POINTS];
            struct umb_answers answers = {.values = values};
            const struct umb_points points = batch(n % 2);
            run(asset, &(struct umb_query_settings){.taps = 5}, &points, &answers);
            for (size_t i = 0; i < POINTS; i++) {
                assert_true(values[i] >= 0 && values[i] <= 1);
            }
            opened++;
        }
        umb_asset_close(asset);
        bytes_finish(&bytes);
    }
    assert_true(opened > 3 && opened < 77);
    umb__octree_finish(&octree);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plane_never_shadows_itself_across_faces),
        cmocka_unit_test(sides_of_a_plane_are_told_apart_in_every_face),
        cmocka_unit_test(splits_formats_and_explanations_agree),
        cmocka_unit_test(tents_and_gaussians_weigh_the_texels_of_a_lamp),
        cmocka_unit_test(wild_points_do_no_harm),
        cmocka_unit_test(hostile_matrices_are_refused_or_harmless),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
