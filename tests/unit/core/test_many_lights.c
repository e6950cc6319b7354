/* SPDX-License-Identifier: Apache-2.0 */
/* Several lights for each point in one call. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/query.h"

enum {
    LIGHTS = 5,
    POINTS = 3001
};

static int slopes(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    return z * 2 < 30 + (x * (frustum + 1) + y * 3) % 90;
}

static void one_call_gives_the_bits_of_one_run_for_each_light(void **state)
{
    (void)state;
    static double positions[POINTS][3];
    static float normals[POINTS][3], together[LIGHTS][POINTS], alone[POINTS];
    const double origin[3] = {50, -7, 1e6};
    struct voxels voxels = {slopes, NULL, 6, LIGHTS};
    struct bytes file = make_packed(&voxels, 0.5, origin);
    struct umb_asset *asset;
    struct umb_query queries[LIGHTS];
    struct umb_query_stats stats[LIGHTS];
    void *values[LIGHTS];
    uint64_t seed = 31;
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    for (size_t i = 0; i < POINTS; i++) {
        for (size_t k = 0; k < 3; k++) {
            positions[i][k] = random_unit(&seed) * 32;
            normals[i][k] = (float)(random_unit(&seed) - 0.7);
        }
    }
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .normals = normals, .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    memset(stats, 0, sizeof stats);
    memset(together, 0xff, sizeof together);
    for (uint32_t k = 0; k < LIGHTS; k++) {
        struct umb_query_settings settings = {.light = k, .taps = 2 * k + 1};
        assert_int_equal(umb_query_prepare(asset, &settings, &queries[k], NULL), UMB_OK);
        values[k] = together[k];
    }
    struct umb_light_answers answers = {.values = values, .stats = stats};
    umb_query_run_lights(queries, LIGHTS, &points, 0, 1000, &answers);
    umb_query_run_lights(queries, LIGHTS, &points, 1000, POINTS - 1000, &answers);
    for (uint32_t k = 0; k < LIGHTS; k++) {
        struct umb_answers one = {.values = alone};
        umb_query_run(&queries[k], &points, 0, POINTS, &one);
        assert_memory_equal(alone, together[k], sizeof alone);
        /* The number of reads depends on a point's neighbours in a run; the answers do not. */
        assert_memory_equal(&one.stats, &stats[k], offsetof(struct umb_query_stats, nodes));
        assert_true(stats[k].nodes > 0 && stats[k].bricks > 0);
    }
    assert_memory_not_equal(together[0], together[1], sizeof together[0]);
    umb_query_run_lights(queries, 0, &points, 0, POINTS, &answers); /* no light, no answer */
    umb_asset_close(asset);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_call_gives_the_bits_of_one_run_for_each_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
