/* SPDX-License-Identifier: Apache-2.0 */
/* Partial assets of a spot light, whose cubes grow with the distance from the light: the bounds of
 * their answers. */
#include "partial_fixture.h"
#include "spot_asset.h"

enum {
    POINTS = 20000,
};

/* The longest edge of the cube of a level at depth z, from the frustum's shape alone. */
static double edge_of(uint32_t level, double z)
{
    const double count = (double)(1U << level), end = (floor(z / count) + 1) * count;
    const double w = spot_near_w + (spot_far_w - spot_near_w) * end / SPOT_SIZE;
    return count * fmax(2 * spot_tangent * w / SPOT_SIZE, (spot_far_w - spot_near_w) / SPOT_SIZE);
}

static double points[3 * POINTS], depths[POINTS];
static float values[POINTS], low[POINTS], high[POINTS], error_m[POINTS], truth[POINTS];

static void make_points(void)
{
    uint64_t seed = 41;
    for (size_t i = 0; i < POINTS; i++) {
        const double w = spot_near_w + (spot_far_w - spot_near_w) * 0.99 * random_unit(&seed);
        depths[i] = (w - spot_near_w) / (spot_far_w - spot_near_w) * SPOT_SIZE;
        points[3 * i + 2] = spot_eye[2] + w - fixture_origin[2];
        for (unsigned k = 0; k < 2; k++) {
            const double u = (2 * random_unit(&seed) - 1) * 0.98 * spot_tangent * w;
            points[3 * i + k] = spot_eye[k] + u - fixture_origin[k];
        }
    }
}

/* Returns how many points are not known. */
static size_t check_bounds(struct umb_partial *partial)
{
    const struct umb_query_settings one = {.taps = 1, .bias_mode = UMB_BIAS_METRES};
    const struct umb_points batch = {
        .positions = points,
        .format = UMB_POINT_F64,
        .origin = {fixture_origin[0], fixture_origin[1], fixture_origin[2]},
        .count = POINTS};
    struct umb_partial_answers answers = {
        .values = values, .low = low, .high = high, .error_m = error_m};
    struct umb_error error = {0};
    size_t unknown = 0;
    if (umb_partial_query(partial, &one, &batch, 0, &answers, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    for (size_t i = 0; i < POINTS; i++) {
        bool found = low[i] >= high[i];
        assert_true(low[i] <= truth[i] && truth[i] <= high[i]);
        for (uint32_t level = 3; level <= SPOT_LOG2 && !found; level++) {
            found =
                fabs((double)error_m[i] - edge_of(level, depths[i])) < 1e-5 * (double)error_m[i];
        }
        if (!found) {
            fail_msg("point %zu at depth %g: %g m is no cube's edge there", i, depths[i],
                     (double)error_m[i]);
        }
        unknown += low[i] < high[i];
    }
    return unknown;
}

static void a_missing_cube_is_as_wide_as_its_far_side(void **state)
{
    struct bytes file = spot_file();
    struct umb_error error = {0};
    struct umb_asset *whole;
    struct umb_query query;
    const struct umb_query_settings one = {.taps = 1, .bias_mode = UMB_BIAS_METRES};
    struct umb_answers answers = {.values = truth};
    struct umb_partial *partial = partial_open(&file, 0);
    struct umb_partial_stats stats;
    (void)state;
    make_points();
    const struct umb_points batch = {
        .positions = points,
        .format = UMB_POINT_F64,
        .origin = {fixture_origin[0], fixture_origin[1], fixture_origin[2]},
        .count = POINTS};
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &whole, &error), UMB_OK);
    assert_int_equal(umb_query_prepare(whole, &one, &query, &error), UMB_OK);
    umb_query_run(&query, &batch, 0, POINTS, &answers);
    umb_partial_get_stats(partial, &stats);
    assert_true(stats.page_count > 20);
    size_t before = POINTS;
    for (uint32_t page = 0; page <= stats.page_count; page += 1 + stats.page_count / 8) {
        for (uint32_t k = page; k < page + 1 + stats.page_count / 8 && k < stats.page_count; k++) {
            uint64_t offset;
            uint32_t length;
            (void)umb_partial_locate(partial, k, &offset, &length);
            assert_int_equal(umb_partial_add(partial, k, file.data + offset, length, &error),
                             UMB_OK);
        }
        assert_int_equal(umb_partial_build(partial, &error), UMB_OK);
        const size_t unknown = check_bounds(partial);
        assert_true(unknown <= before);
        before = unknown;
    }
    assert_int_equal(before, 0);
    umb_asset_close(whole);
    umb_partial_close(partial);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_missing_cube_is_as_wide_as_its_far_side),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
