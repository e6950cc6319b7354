/* SPDX-License-Identifier: Apache-2.0 */
/* Frusta of maps: points go to map space and back, gradients are right, and invalid frusta are
 * refused. */
#include "maps_fixture.h"
#include "maps/map_receiver.h"

static struct umb_map_frustum frustum_of_kind(int kind, uint64_t *seed)
{
    struct umb_map_frustum frustum;
    struct umb_map_spot spot = {.tangent = 0.3 + random_unit(seed), .near_m = 0.5, .far_m = 40.0};
    double to_light[3];
    for (int k = 0; k < 3; k++) {
        spot.position[k] = random_unit(seed) * 20.0 + 1e7; /* a national grid */
        spot.forward[k] = random_unit(seed) - 0.5;
        spot.up[k] = random_unit(seed) - 0.5;
        to_light[k] = random_unit(seed) - 0.5;
    }
    if (kind == 0) {
        const struct umb_box box = {{1e7, -5, 3}, {1e7 + 30, 40, 9}};
        assert_int_equal(umb_map_frustum_fit(to_light, &box, 300, 200, &frustum, NULL), UMB_OK);
        return frustum;
    }
    spot.projection = kind == 1 ? UMB_MAP_PERSPECTIVE : UMB_MAP_PARABOLOID;
    assert_int_equal(umb_map_frustum_spot(&spot, 300, 200, &frustum, NULL), UMB_OK);
    return frustum;
}

static void points_of_map_space_come_back_from_the_world(void **state)
{
    (void)state;
    uint64_t seed = 1994;
    for (int i = 0; i < case_count(30000); i++) {
        const struct umb_map_frustum frustum = frustum_of_kind(i % 3, &seed);
        const double at[3] = {50 + random_unit(&seed) * 200, 50 + random_unit(&seed) * 100,
                              random_unit(&seed)};
        double world[3];
        struct umb__map_point back;
        assert_int_equal(umb_map_frustum_point(&frustum, at[0], at[1], at[2], world), UMB_OK);
        assert_true(umb__frustum_map(&frustum, world, &back));
        for (int k = 0; k < 3; k++) {
            /* 1e7 m resolve 2e-9 m; a texel is at least 2 mm at the near plane. */
            if (!(fabs(back.at[k] - at[k]) < 1e-5)) {
                fail_msg("kind %d: coordinate %d is %.9g, not %.9g", i % 3, k, back.at[k], at[k]);
            }
        }
    }
}

static void gradients_equal_finite_differences(void **state)
{
    (void)state;
    uint64_t seed = 2002;
    for (int i = 0; i < case_count(3000); i++) {
        struct umb_map_frustum frustum = frustum_of_kind(i % 3, &seed);
        memset(frustum.origin, 0, sizeof frustum.origin); /* so that differences are fine */
        double world[3];
        assert_int_equal(umb_map_frustum_point(&frustum, 60 + random_unit(&seed) * 150,
                                               60 + random_unit(&seed) * 80,
                                               0.1 + 0.8 * random_unit(&seed), world),
                         UMB_OK);
        struct umb__map_point here, low, high;
        assert_true(umb__frustum_map(&frustum, world, &here));
        for (int axis = 0; axis < 3; axis++) {
            const double h = 1e-4;
            double a[3], b[3];
            memcpy(a, world, sizeof a);
            memcpy(b, world, sizeof b);
            a[axis] -= h;
            b[axis] += h;
            assert_true(umb__frustum_map(&frustum, a, &low));
            assert_true(umb__frustum_map(&frustum, b, &high));
            for (int k = 0; k < 3; k++) {
                const double slope = (high.at[k] - low.at[k]) / (2.0 * h);
                /* Central differences: h^2 times third derivatives, which near a light are large.
                 */
                assert_true(fabs(here.gradient[k][axis] - slope) < 1e-3 * (1.0 + fabs(slope)));
            }
        }
    }
}

static void light_along_an_axis_at_the_zenith_and_grazing_fits(void **state)
{
    static const double lights[][3] = {{0, 0, 1},  {0, 0, -1},       {1, 0, 0},
                                       {0, -1, 0}, {1, 0, 1.745e-4}, {0.6, 0.8, 1e-9}};
    const struct umb_box box = {{-3, 2, 0}, {5, 2, 0.5}}; /* flat in y */
    (void)state;
    for (size_t i = 0; i < sizeof lights / sizeof lights[0]; i++) {
        struct umb_map_frustum frustum;
        assert_int_equal(umb_map_frustum_fit(lights[i], &box, 64, 64, &frustum, NULL), UMB_OK);
        for (int corner = 0; corner < 8; corner++) {
            const double world[3] = {corner & 1 ? -3 : 5, 2, corner & 4 ? 0 : 0.5};
            struct umb__map_point at;
            assert_true(umb__frustum_map(&frustum, world, &at));
            assert_true(at.at[0] > 0 && at.at[0] < 64 && at.at[1] > 0 && at.at[1] < 64);
            assert_true(at.at[2] > 0 && at.at[2] < 1);
        }
    }
}

static void what_is_not_a_map_is_refused_by_name(void **state)
{
    (void)state;
    struct umb_map_frustum frustum = plain_frustum(4, 4);
    float depth[16] = {0};
    const struct umb_map_layer layer = {.depth = depth};
    struct umb_map *map = (struct umb_map *)(void *)depth;
    struct umb_error error;
    struct umb_map_settings settings = {0};
    const float bad[] = {NAN, INFINITY, -INFINITY, -1e-30F, 1.0000001F};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        depth[9] = bad[i];
        assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, &error),
                         UMB_E_ARGUMENT);
        assert_null(map);
        assert_non_null(strstr(error.message, "layer.depth[9]"));
    }
    depth[9] = -0.0F; /* a zero is a zero */
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, &error), UMB_OK);
    struct umb_map_query query;
    const struct umb_map_filter filters[] = {
        {.width = 2},     {.width = 65},    {.width = NAN},      {.bias_m = -1},
        {.reduction = 1}, {.contrast = -1}, {.light_size = 1.5}, {.bias_slope = INFINITY}};
    for (size_t i = 0; i < sizeof filters / sizeof filters[0]; i++) {
        assert_int_equal(umb_map_prepare(map, &filters[i], &query, &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "filter."));
    }
    umb_map_destroy(map);
    frustum.width = 0;
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, &error),
                     UMB_E_TOO_LARGE);
    frustum.width = 4;
    frustum.world_to_map[1][2] = NAN;
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, &error),
                     UMB_E_ARGUMENT);
    frustum = plain_frustum(4, 4);
    settings.technique = (enum umb_map_technique)99;
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, &error),
                     UMB_E_ARGUMENT);
}

/* Points of any bits must be answered safely, and points outside are lit. */
static void hostile_points_do_no_harm(void **state)
{
    (void)state;
    struct umb_map_frustum frustum = plain_frustum(8, 8);
    float depth[64];
    for (int i = 0; i < 64; i++) {
        depth[i] = 0.5F;
    }
    static const double odd[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324, -0.0, 0.0, 8.0};
    enum {
        N = sizeof odd / sizeof odd[0]
    };
    for (int technique = 0; technique < UMB_MAP_DEEP; technique++) {
        struct umb_map_settings settings = {
            .technique = (enum umb_map_technique)technique, .exponent = 40, .terms = 4};
        struct umb_map *map = map_of(&frustum, depth, &settings);
        const struct umb_map_query query = query_of(map, &(struct umb_map_filter){.width = 3});
        for (size_t i = 0; i < N * N * N; i++) {
            const double world[3] = {odd[i % N], odd[i / N % N], odd[i / N / N]};
            const float normal[3] = {(float)world[1], (float)world[2], (float)world[0]};
            const struct umb_points points = {
                .positions = world, .format = UMB_POINT_F64, .normals = normal, .count = 1};
            float value = -1.0F;
            umb_map_run(&query, &points, 0, 1, &value);
            assert_true(value >= 0.0F && value <= 1.0F);
        }
        umb_map_destroy(map);
    }
}

/* An allocator that fails the n-th time, counts what is out. */
struct failing {
    int calls, fail_at, out;
};

static void *failing_resize(void *user, void *block, size_t bytes)
{
    struct failing *f = user;
    if (bytes == 0) {
        f->out -= block != NULL;
        free(block);
        return NULL;
    }
    if (f->calls++ == f->fail_at) {
        return NULL;
    }
    f->out += block == NULL;
    return realloc(block, bytes);
}

static void short_memory_is_a_status_and_leaks_nothing(void **state)
{
    (void)state;
    const struct umb_map_frustum frustum = plain_frustum(16, 16);
    static float depth[256];
    const struct umb_map_layer layer = {.depth = depth};
    for (int technique = 0; technique < UMB_MAP_DEEP; technique++) {
        const struct umb_map_settings settings = {.technique = (enum umb_map_technique)technique,
                                                  .access = UMB_MAP_MIPS,
                                                  .exponent = 40,
                                                  .terms = 4,
                                                  .blur = 3};
        for (int n = 0;; n++) {
            struct failing failing = {.fail_at = n};
            const struct umb_alloc alloc = {failing_resize, &failing};
            struct umb_map *map;
            const enum umb_status status =
                umb_map_build(&frustum, &layer, &settings, &alloc, &map, NULL);
            assert_true(status == UMB_OK || status == UMB_E_NO_MEMORY);
            umb_map_destroy(map);
            assert_int_equal(failing.out, 0);
            if (status == UMB_OK) {
                assert_true(n > 1);
                break;
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_of_map_space_come_back_from_the_world),
        cmocka_unit_test(gradients_equal_finite_differences),
        cmocka_unit_test(light_along_an_axis_at_the_zenith_and_grazing_fits),
        cmocka_unit_test(what_is_not_a_map_is_refused_by_name),
        cmocka_unit_test(hostile_points_do_no_harm),
        cmocka_unit_test(short_memory_is_a_status_and_leaks_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
