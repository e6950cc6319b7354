/* SPDX-License-Identifier: Apache-2.0 */
/* Footprints under spot, point and area lights, and behind translucent casters: the mean of single
 * look-ups over a square of the surface, with the same bits by every kernel. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "transmittance_fixture.h"

#include "footprint_kernels.h"
#include "lamp_fixture.h"
#include "umbrage/query.h"

enum {
    POINTS = 600,
    SAMPLES = 32
};

struct batch {
    double positions[POINTS][3];
    float normals[POINTS][3];
    float footprints[POINTS];
    double origin[3];
};

/* Cubes of eight voxels, a quarter of them shadowed. */
static int cubes(const void *user, uint32_t face, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    return (7 * (x >> 3) + 13 * (y >> 3) + 29 * (z >> 3) + 5 * face) % 4 != 0;
}

/* Draws points in all faces, on their edges, and around the light; every fifth has no normal. */
static void draw_lamp_batch(uint64_t seed, double widest_m, struct batch *batch)
{
    memcpy(batch->origin, origin, sizeof batch->origin);
    for (size_t i = 0; i < POINTS; i++) {
        const double reach = i % 40 == 0 ? 0.1 : 18;
        for (unsigned k = 0; k < 3; k++) {
            const double offset = (random_unit(&seed) - 0.5) * 2 * reach;
            batch->positions[i][k] = eye[k] - origin[k] + offset;
            batch->normals[i][k] = i % 5 == 0 ? 0 : (float)(random_unit(&seed) - 0.5);
        }
        batch->footprints[i] = (float)(random_unit(&seed) * widest_m);
    }
}

static struct umb_points points_of(const struct batch *batch)
{
    struct umb_points points = {.positions = batch->positions,
                                .format = UMB_POINT_F64,
                                .normals = batch->normals,
                                .count = POINTS,
                                .footprints = batch->footprints};
    memcpy(points.origin, batch->origin, sizeof points.origin);
    return points;
}

static void ask(const struct umb_asset *asset, const struct umb_query_settings *settings,
                const struct umb_points *points, float *values)
{
    struct umb_query query;
    struct umb_answers answers = {.values = values};
    assert_int_equal(umb_query_prepare(asset, settings, &query, NULL), UMB_OK);
    umb_query_run(&query, points, 0, points->count, &answers);
    assert_int_equal(answers.stats.points, points->count);
}

/* Returns the mean of single look-ups over a square of the plane through point i, as the header
 * defines it. In: to: unit vector in which the light travels there. */
static double plain_level(const struct umb_asset *asset, const struct umb_query_settings *settings,
                          const struct batch *batch, size_t i, const double to[3], double side)
{
    static double places[SAMPLES][3];
    static float normals[SAMPLES][3], values[SAMPLES];
    double n[3], a[3], b[3], sum = 0, length = 0, size = 0;
    unsigned least = 0;
    for (unsigned k = 0; k < 3; k++) {
        n[k] = (double)batch->normals[i][k];
        length += n[k] * n[k];
    }
    for (unsigned k = 0; k < 3; k++) {
        n[k] = length > 0 ? n[k] / sqrt(length) : -to[k];
        least = fabs(n[k]) < fabs(n[least]) ? k : least;
    }
    for (unsigned k = 0; k < 3; k++) {
        a[k] = (k == least) - n[least] * n[k];
        size += a[k] * a[k];
    }
    for (unsigned k = 0; k < 3; k++) {
        a[k] /= sqrt(size);
    }
    for (unsigned k = 0; k < 3; k++) {
        b[k] = n[(k + 1) % 3] * a[(k + 2) % 3] - n[(k + 2) % 3] * a[(k + 1) % 3];
    }
    for (unsigned s = 0; s < SAMPLES; s++) {
        const double u = ((s + 0.5) / SAMPLES - 0.5) * side;
        const double v = ((s * 25 % SAMPLES + 0.5) / SAMPLES - 0.5) * side;
        for (unsigned k = 0; k < 3; k++) {
            places[s][k] = batch->positions[i][k] + u * a[k] + v * b[k] - side / 2 * to[k];
            normals[s][k] = batch->normals[i][k];
        }
    }
    struct umb_points points = {
        .positions = places, .format = UMB_POINT_F64, .normals = normals, .count = SAMPLES};
    memcpy(points.origin, batch->origin, sizeof points.origin);
    ask(asset, settings, &points, values);
    for (unsigned s = 0; s < SAMPLES; s++) {
        sum += (double)values[s];
    }
    return sum / SAMPLES;
}

/* Returns W of the face that a point belongs to. In: from: from the light to the point. */
static double depth_of(const double from[3])
{
    return fmax(fabs(from[0]), fmax(fabs(from[1]), fabs(from[2])));
}

/* Returns whether a direction points along a surface's normal, which therefore faces away. */
static int faces_away(const float normal[3], const double to[3])
{
    const double along =
        (double)normal[0] * to[0] + (double)normal[1] * to[1] + (double)normal[2] * to[2];
    return along >= 0 && (normal[0] != 0 || normal[1] != 0 || normal[2] != 0);
}

/* Rounding may put a sample on the other side of a voxel's face: only at few points, and one sample
 * at each. Points nearer to the light than half a square have a shorter lift, and are left out. */
static void lamps_answer_means_over_squares_of_the_surface(void **state)
{
    (void)state;
    static struct batch batch;
    static float values[POINTS];
    const struct lamp_model model = {cubes, NULL, NULL};
    struct umb_error error = {0};
    struct umb_asset *asset = try_lamp(&model, &error);
    assert_non_null(asset);
    unsigned differ = 0, between = 0, compared = 0;
    draw_lamp_batch(81, 1, &batch);
    for (uint32_t taps = 1; taps <= 3; taps += 2) {
        for (unsigned level = 1; level <= 4; level++) {
            for (size_t i = 0; i < POINTS; i++) {
                double to[3];
                for (unsigned k = 0; k < 3; k++) {
                    to[k] = batch.positions[i][k] - (eye[k] - origin[k]);
                }
                const double texel = depth_of(to) * 2 * tangent / SIZE;
                batch.footprints[i] = (float)(texel * taps * (1U << level) * 1.5);
            }
            const struct umb_points points = points_of(&batch);
            ask(asset, &(struct umb_query_settings){.filter = UMB_FILTER_FOOTPRINT, .taps = taps},
                &points, values);
            for (size_t i = 0; i < POINTS; i++) {
                double to[3], reach = 0;
                for (unsigned k = 0; k < 3; k++) {
                    to[k] = batch.positions[i][k] - (eye[k] - origin[k]);
                    reach += to[k] * to[k];
                }
                const double width = (double)batch.footprints[i] / 1.5;
                for (unsigned k = 0; k < 3; k++) {
                    to[k] /= sqrt(reach);
                }
                if (faces_away(batch.normals[i], to)) {
                    assert_true(values[i] == 0);
                    continue;
                }
                if (sqrt(reach) < 3 * width) {
                    continue;
                }
                const struct umb_query_settings one = {.taps = 1};
                const double want = (plain_level(asset, &one, &batch, i, to, width) +
                                     plain_level(asset, &one, &batch, i, to, 2 * width)) /
                                    2;
                const double apart = fabs((double)values[i] - want);
                assert_true(apart < 1.5 / SAMPLES);
                differ += apart > 1e-6;
                between += want > 0.1 && want < 0.9;
                compared++;
            }
        }
    }
    assert_true(compared > 2 * POINTS);
    assert_true(differ < compared / 50);
    assert_true(between > compared / 4);
    umb_asset_close(asset);
}

/* Computes answers with every kernel; the counts must be the same, too. */
static void compare_kernels(const struct umb_asset *asset,
                            const struct umb_query_settings *settings,
                            const struct umb_points *points)
{
    static float values[3][POINTS];
    struct umb__kernels kernels[3];
    struct umb_query_stats first = {0};
    for (size_t k = 0, count = list_kernels(kernels); k < count; k++) {
        struct umb_query query;
        struct umb_answers answers = {.values = values[k]};
        assert_int_equal(umb_query_prepare(asset, settings, &query, NULL), UMB_OK);
        use_kernels(&query, &kernels[k]);
        umb_query_run(&query, points, 0, points->count, &answers);
        first = k == 0 ? answers.stats : first;
        assert_memory_equal(values[k], values[0], sizeof values[0]);
        assert_memory_equal(&answers.stats, &first, sizeof first);
    }
}

static void every_kernel_gives_the_same_bits_under_lamps(void **state)
{
    (void)state;
    static struct batch batch;
    static const double wild[] = {0, 1e3, -1e7, 1e12, -1e30, 1e300};
    static const struct umb_light_info lights[] = {
        {.kind = UMB_LIGHT_POINT},
        {.kind = UMB_LIGHT_DISC, .extent = 0.4, .direction = {0, 0.6, -0.8}},
        {.kind = UMB_LIGHT_RECTANGLE, .extent = 0.3, .direction = {0, 0, -1}, .side = {0.5, 0, 0}}};
    for (size_t l = 0; l < sizeof lights / sizeof lights[0]; l++) {
        const struct lamp_model model = {cubes, NULL, &lights[l]};
        struct umb_error error = {0};
        struct umb_asset *asset = try_lamp(&model, &error);
        if (asset == NULL) {
            fail_msg("%s", error.message);
        }
        for (unsigned turn = 0; turn < 24; turn++) {
            struct umb_query_settings settings = {.taps = 1 + 2 * (turn % 3),
                                                  .bias_mode = (enum umb_bias_mode)(turn % 4),
                                                  .bias = 1.5,
                                                  .filter = UMB_FILTER_FOOTPRINT};
            draw_lamp_batch(9000 + turn, 0.05 * (1U << turn % 12), &batch);
            for (size_t i = 0; i < POINTS && turn % 5 == 0; i += 7) {
                batch.positions[i][i % 3] += wild[i % 6];
            }
            struct umb_points points = points_of(&batch);
            compare_kernels(asset, &settings, &points);
            points.footprints = points.normals = NULL;
            memcpy(settings.eye, origin, sizeof settings.eye);
            settings.pixel_rad = 0.01 * (1U << turn % 7);
            compare_kernels(asset, &settings, &points);
        }
        umb_asset_close(asset);
    }
}

/* Behind translucent casters each sample is weighed as a point is. */
static void translucent_casters_weigh_each_sample(void **state)
{
    (void)state;
    static struct batch batch;
    static float values[POINTS];
    struct tf_asset f;
    struct umb_light_info light;
    uint64_t seed = 91;
    unsigned differ = 0, dimmed = 0;
    tf_open(&f, 7, 6);
    memcpy(batch.origin, fixture_origin, sizeof batch.origin);
    for (uint32_t number = 0; number < TF_LIGHTS; number++) {
        assert_int_equal(umb_asset_get_light(f.asset, number, &light), UMB_OK);
        for (size_t i = 0; i < POINTS; i++) {
            for (unsigned k = 0; k < 3; k++) {
                batch.positions[i][k] = (random_unit(&seed) * 1.1 - 0.05) * TF_SIZE * TF_VOXEL_M;
                batch.normals[i][k] = i % 5 == 0 ? 0 : (float)(random_unit(&seed) - 0.5);
            }
        }
        struct umb_points points = points_of(&batch);
        points.footprints = NULL;
        for (unsigned level = 1; level <= 4; level++) {
            const double width = TF_VOXEL_M * (1U << level);
            const struct umb_query_settings settings = {
                .light = number, .filter = UMB_FILTER_FOOTPRINT, .footprint_m = 1.5 * width};
            const struct umb_query_settings one = {.light = number, .taps = 1};
            ask(f.asset, &settings, &points, values);
            for (size_t i = 0; i < POINTS; i++) {
                if (faces_away(batch.normals[i], light.direction)) {
                    continue;
                }
                const double *to = light.direction;
                const double want = (plain_level(f.asset, &one, &batch, i, to, width) +
                                     plain_level(f.asset, &one, &batch, i, to, 2 * width)) /
                                    2;
                const double apart = fabs((double)values[i] - want);
                assert_true(apart < 1.5 / SAMPLES);
                differ += apart > 1e-6;
                dimmed += fmod(want * 2 * SAMPLES, 1) != 0;
            }
            points.footprints = batch.footprints;
            for (size_t i = 0; i < POINTS; i++) {
                batch.footprints[i] = (float)(random_unit(&seed) * 8 * width);
            }
            compare_kernels(f.asset, &settings, &points);
            points.footprints = NULL;
        }
    }
    assert_true(dimmed > POINTS);
    assert_true(differ < POINTS / 10); /* Of 8 times as many */
    tf_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lamps_answer_means_over_squares_of_the_surface),
        cmocka_unit_test(every_kernel_gives_the_same_bits_under_lamps),
        cmocka_unit_test(translucent_casters_weigh_each_sample),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
