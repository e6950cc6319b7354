/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The shaders' placement under spot, point and area lights, compiled as C: the core's voxel in the
 * core's face, but for positions nearer to a border than the stated bound, or between two faces.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>

#include "lamp_fixture.h"
#include "query/perspective.h"
#include "umbrage/gpu.h"
#include "umbrage.cuh"

enum {
    POINTS = 60000
};

static const double shift[3] = {0.75, -2.5, 1.25}; /* Of the shader's 0 from the lamp */

struct lamp {
    struct umb_asset *asset;
    struct umb_query query;
    struct umb__query q;
    UmbragePlacement faces[FACES];
    struct umb_gpu_precision precision;
    double origin[3]; /* World position of the shader's 0 */
};

static void open_lamp(struct lamp *lamp, const struct umb_light_info *light,
                      const struct umb_query_settings *s)
{
    static const struct plane plane = {{0.6, 0, 0.8}, 3};
    const struct lamp_model model = {before_plane, &plane, light};
    struct umb_error error = {0};
    lamp->asset = try_lamp(&model, &error);
    if (lamp->asset == NULL || umb_query_prepare(lamp->asset, s, &lamp->query, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    memcpy(&lamp->q, lamp->query.opaque, sizeof lamp->q);
    for (unsigned k = 0; k < 3; k++) {
        lamp->origin[k] = eye[k] + shift[k];
    }
    for (uint32_t face = 0; face < FACES; face++) {
        struct umb_gpu_view view = {.face = face, .bias_mode = s->bias_mode, .bias = s->bias};
        struct umb_gpu_placement bytes;
        memcpy(view.origin, lamp->origin, sizeof view.origin);
        if (umb_gpu_place(lamp->asset, &view, &bytes, &lamp->precision, &error) != UMB_OK) {
            fail_msg("%s", error.message);
        }
        memcpy(&lamp->faces[face], &bytes, sizeof bytes);
    }
}

/* Returns true if two faces have nearly the same W at a place relative to the lamp. */
static bool is_between_faces(const double from_lamp[3])
{
    double sorted[3] = {fabs(from_lamp[0]), fabs(from_lamp[1]), fabs(from_lamp[2])};
    for (unsigned i = 0; i < 2; i++) {
        for (unsigned k = 0; k < 2; k++) {
            if (sorted[k] > sorted[k + 1]) {
                const double other = sorted[k];
                sorted[k] = sorted[k + 1];
                sorted[k + 1] = other;
            }
        }
    }
    return sorted[2] - sorted[1] < 1e-5 * sorted[2];
}

/* Compares one position. Returns 1 if the voxels differ. */
static int compare(const struct lamp *lamp, float3 position, float3 normal, int taps)
{
    const float at[3] = {position.x, position.y, position.z};
    const float n[3] = {normal.x, normal.y, normal.z};
    const struct umb_points points = {.positions = at,
                                      .origin = {lamp->origin[0], lamp->origin[1], lamp->origin[2]},
                                      .normals = n,
                                      .count = 1};
    const double from_lamp[3] = {(double)position.x + shift[0], (double)position.y + shift[1],
                                 (double)position.z + shift[2]};
    const double steps = lamp->q.level > 0 ? umb__coarse_steps(&lamp->q) : 1;
    struct umb__sighting s;
    double moved[3];
    umb__perspective_map(&lamp->q, &points, 0, &s);
    const int4 got =
        umbrage_place_lamp(lamp->faces, FACES, position, normal, (float)taps, (float)steps);
    umb__subtract(s.moved, lamp->q.position, moved);
    const double w = fmax(fabs(moved[0]), fmax(fabs(moved[1]), fabs(moved[2])));
    if (fabs(s.cosine) < 1e-5 && s.has_normal) {
        return 0;
    }
    if ((got.w == 2) != (s.facing_away != 0)) {
        fail_msg("facing away: %d, not %d", got.w, s.facing_away);
    }
    if (s.facing_away || is_between_faces(from_lamp) || is_between_faces(moved) || w < near_w / 4 ||
        w > lamp->precision.range_m / 2) {
        return 0;
    }
    if ((got.w & 3) != 0) {
        fail_msg("at %g %g %g, moved to %g %g %g by %g: state %d, voxel %g %g %g", from_lamp[0],
                 from_lamp[1], from_lamp[2], moved[0], moved[1], moved[2], s.bias_m, got.w,
                 s.voxel[0], s.voxel[1], s.voxel[2]);
    }
    assert_int_equal(got.w >> 2, s.face);
    const int32_t voxel[3] = {got.x, got.y, got.z};
    int differ = 0;
    for (unsigned k = 0; k < 3; k++) {
        const double bound = k < 2 ? lamp->precision.across * far_w / w : lamp->precision.depth;
        if ((double)voxel[k] != floor(s.voxel[k])) {
            differ = 1;
            if (fabs(s.voxel[k] - nearbyint(s.voxel[k])) > bound) {
                fail_msg("axis %u: voxel %d for %.9g, bound %g, W %g", k, voxel[k], s.voxel[k],
                         bound, w);
            }
        }
    }
    return differ;
}

static float random_float(uint64_t *seed, double reach)
{
    return (float)((random_unit(seed) * 2 - 1) * reach);
}

static void check_lamp(const struct umb_light_info *light, const struct umb_query_settings *s)
{
    struct lamp lamp;
    uint64_t seed = round_seed(17);
    const int count = case_count(POINTS) / 6;
    int differ = 0;
    open_lamp(&lamp, light, s);
    print_message("bounds %g and %g\n", lamp.precision.across, lamp.precision.depth);
    assert_true(lamp.precision.across < 0x1p-12 && lamp.precision.depth < 0x1p-10);
    for (int i = 0; i < count; i++) {
        const double reach = i % 4 == 0 ? 2 : 13;
        const float3 position = make_float3(random_float(&seed, reach), random_float(&seed, reach),
                                            random_float(&seed, reach));
        const float size = i % 3 == 0 ? 0.0F : i % 3 == 1 ? 1.0F : 30.0F;
        const float3 normal =
            make_float3(size * random_float(&seed, 1), size * random_float(&seed, 1),
                        size * random_float(&seed, 1));
        differ += compare(&lamp, position, normal, lamp.q.taps);
    }
    print_message("%d of %d points differ at a border\n", differ, count);
    assert_in_range(differ, 0, count / 100);
    umb_asset_close(lamp.asset);
}

static void test_point_light(void **state)
{
    (void)state;
    for (uint32_t taps = 1; taps <= 17; taps += 8) {
        check_lamp(NULL, &(struct umb_query_settings){.taps = taps});
    }
    check_lamp(NULL,
               &(struct umb_query_settings){.taps = 3, .bias_mode = UMB_BIAS_VOXELS, .bias = 1.5});
    check_lamp(NULL, &(struct umb_query_settings){.level = 3});
}

static void test_area_light(void **state)
{
    const struct umb_light_info light = {
        .kind = UMB_LIGHT_DISC, .direction = {0, 0.6, 0.8}, .extent = 0.2};
    (void)state;
    check_lamp(&light, &(struct umb_query_settings){.taps = 5});
}

/* Answers are the core's, but near borders. */
static void test_answers(void **state)
{
    struct lamp lamp;
    struct umb_gpu_layout layout;
    struct umb_error error = {0};
    const struct umb_query_settings s = {.taps = 9};
    uint64_t seed = round_seed(3);
    int wrong = 0;
    (void)state;
    open_lamp(&lamp, NULL, &s);
    assert_int_equal(umb_gpu_layout_make(lamp.asset, 0, &layout, &error), UMB_OK);
    uint4 *entries = calloc(layout.entries, sizeof *entries);
    umb_gpu_write(lamp.asset, NULL, &layout, 0, layout.entries, &entries->x);
    for (int i = 0; i < POINTS / 6; i++) {
        const float at[3] = {random_float(&seed, 9), random_float(&seed, 9),
                             random_float(&seed, 9)};
        const struct umb_points points = {
            .positions = at,
            .origin = {lamp.origin[0], lamp.origin[1], lamp.origin[2]},
            .count = 1};
        float value;
        struct umb_answers answers = {.values = &value};
        umb_query_run(&lamp.query, &points, 0, 1, &answers);
        const float2 got = umbrage_lamp_box(
            entries, lamp.faces, FACES, make_float3(at[0], at[1], at[2]), make_float3(0, 0, 0), 9);
        wrong += memcmp(&got.x, &value, 4) != 0 || memcmp(&got.y, &value, 4) != 0;
    }
    print_message("%d answers differ at a border\n", wrong);
    assert_in_range(wrong, 0, POINTS / 6 / 200);
    free(entries);
    umb_asset_close(lamp.asset);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_point_light),
        cmocka_unit_test(test_area_light),
        cmocka_unit_test(test_answers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
