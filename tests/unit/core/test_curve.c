/* SPDX-License-Identifier: Apache-2.0 */
/* Accuracy curves: windows are counted, rows go through a file and back, and the dial chooses from
 * them. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "curve/curve_measure.h"
#include "make_asset.h"

enum {
    POINTS = 600
};

static const double origin[3] = {1000.5, -5, 12};
static const double voxel_m = 0.25;

static int stepped(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const uint32_t size = 1U << *(const uint32_t *)user;
    const uint32_t noise = ((x / 3) * 2654435761U ^ (y / 3) * 40503U) >> 7;
    return z < size / 3 + noise % 9 + (x / 32 * 13 + y / 16 * 5) % (size / 2) + frustum;
}

struct fixture {
    uint32_t log2_size;
    struct voxels voxels;
    struct umb__octree octree;
    struct umb__content content;
    struct umb__curve_record records[2 * UMB_CURVE_ROWS_MAX];
    struct bytes packed;
    struct umb_asset *asset;
};

static double positions[POINTS][3];
static float normals[POINTS][3];

/* Points on the steps, seen by the light. */
static struct umb_points draw_points(uint32_t log2_size)
{
    uint64_t seed = 77;
    const double size = (double)(1U << log2_size);
    for (size_t i = 0; i < POINTS; i++) {
        const double x = random_unit(&seed) * size, y = random_unit(&seed) * size;
        uint32_t z = 0;
        while (z < size && stepped(&log2_size, 0, (uint32_t)x, (uint32_t)y, z)) {
            z++;
        }
        positions[i][0] = x * voxel_m;
        positions[i][1] = y * voxel_m;
        positions[i][2] = z * voxel_m;
        normals[i][0] = (float)random_unit(&seed) - 0.5F;
        normals[i][1] = (float)random_unit(&seed) - 0.5F;
        normals[i][2] = -1;
    }
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .normals = normals, .count = POINTS};
    memcpy(points.origin, origin, sizeof origin);
    return points;
}

static struct bytes pack(const struct fixture *f)
{
    struct bytes bytes = {0};
    struct umb_sink sink = bytes_sink(&bytes);
    uint8_t id[UMB_ID_BYTES];
    assert_int_equal(umb__pack_write(&f->content, &f->octree, &test_digest, &sink, id, NULL),
                     UMB_OK);
    return bytes;
}

/* An asset of two lights with the curve of both. */
static void fixture_open(struct fixture *f, uint32_t log2_size)
{
    memset(f, 0, sizeof *f);
    f->log2_size = log2_size;
    f->voxels = (struct voxels){stepped, &f->log2_size, log2_size, 2};
    make_octree(&f->voxels, &f->octree);
    make_content(&f->voxels, voxel_m, origin, &f->content);
    const struct umb_points points = draw_points(log2_size);
    f->content.curve = f->records;
    for (uint32_t light = 0; light < 2; light++) {
        uint32_t rows;
        assert_int_equal(umb__curve_measure(&f->content, &f->octree, light, &points, NULL,
                                            f->records + f->content.curve_count, &rows, NULL),
                         UMB_OK);
        f->content.curve_count += rows;
    }
    f->packed = pack(f);
    assert_int_equal(umb_asset_open_bytes(f->packed.data, f->packed.size, NULL, &f->asset, NULL),
                     UMB_OK);
}

static void fixture_close(struct fixture *f)
{
    umb_asset_close(f->asset);
    bytes_finish(&f->packed);
    umb__octree_finish(&f->octree);
}

static void windows_are_counted_as_voxel_by_voxel(void **state)
{
    (void)state;
    struct fixture f;
    uint64_t seed = 4;
    fixture_open(&f, 7);
    for (int i = 0; i < short_count(3000, 500); i++) {
        const int32_t width = 1 + (int32_t)(next_random(&seed) % 17);
        struct umb__octree_window w = {.octree = &f.octree, .root = 1};
        w.x0 = (int32_t)(next_random(&seed) % (uint64_t)(129 - width));
        w.y0 = (int32_t)(next_random(&seed) % (uint64_t)(129 - width));
        w.x1 = w.x0 + width - 1;
        w.y1 = w.y0 + width - 1;
        w.z = (int32_t)(next_random(&seed) % 128);
        uint32_t lit = 0;
        for (int32_t k = 0; k < width * width; k++) {
            lit += (uint32_t)stepped(&f.log2_size, 1, (uint32_t)(w.x0 + k % width),
                                     (uint32_t)(w.y0 + k / width), (uint32_t)w.z);
        }
        assert_int_equal(umb__octree_window_count(&w), lit);
        assert_true(w.lines >= 1 && w.nodes <= 4 * 9);
        if (lit != 0 && lit != (uint32_t)(width * width)) {
            assert_true(w.nodes >= 1 && w.lines >= 1);
        }
    }
    fixture_close(&f);
}

/* The sums must be made of the answers that queries give. */
static void curves_measure_the_answers_of_queries(void **state)
{
    (void)state;
    struct fixture f;
    fixture_open(&f, 7);
    const struct umb_points points = draw_points(7);
    for (uint32_t i = 0; i < f.content.curve_count; i++) {
        const struct umb__curve_record *record = &f.records[i];
        struct umb_query_settings settings = {
            .light = record->light, .taps = record->taps, .level = record->level};
        struct umb_query query;
        float values[POINTS];
        struct umb_answers answers = {.values = values};
        assert_int_equal(umb_query_prepare(f.asset, &settings, &query, NULL), UMB_OK);
        umb_query_run(&query, &points, 0, POINTS, &answers);
        assert_int_equal(record->points, POINTS - answers.stats.facing_away);
        if (record->level > 0) {
            assert_true(record->lines < 3 * (uint64_t)record->points); /* no brick */
        } else if (record->taps == 1) {
            /* As many bricks must be read as by queries, since the voxels are the same. */
            assert_true(record->lines >= record->points + answers.stats.bricks);
        }
    }
    fixture_close(&f);
}

static void curves_survive_packing_and_mapping(void **state)
{
    (void)state;
    struct fixture f;
    fixture_open(&f, 7);
    struct bytes mapped = make_mapped(&f.packed);
    struct umb_asset *asset;
    struct umb__octree octree;
    struct umb__content content;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX], again[UMB_CURVE_ROWS_MAX];
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL), UMB_OK);
    for (uint32_t light = 0; light < 2; light++) {
        size_t count, count_again;
        assert_int_equal(umb_asset_get_curve(f.asset, light, rows, &count), UMB_OK);
        assert_int_equal(count, 10); /* nine filters and level 3 */
        assert_int_equal(umb_asset_get_curve(asset, light, again, &count_again), UMB_OK);
        assert_int_equal(count_again, count);
        assert_memory_equal(rows, again, count * sizeof *rows);
    }
    size_t none = 1;
    assert_int_equal(umb_asset_get_curve(asset, 2, rows, &none), UMB_E_NOT_FOUND);
    assert_int_equal(none, 0);
    assert_int_equal(umb__asset_export(asset, &octree, &content, NULL), UMB_OK);
    struct fixture exported = {.octree = octree, .content = content};
    struct bytes packed = pack(&exported);
    assert_int_equal(packed.size, f.packed.size);
    assert_memory_equal(packed.data, f.packed.data, packed.size);
    bytes_finish(&packed);
    umb__octree_finish(&octree);
    umb_asset_close(asset);
    bytes_finish(&mapped);
    fixture_close(&f);
}

static void curves_out_of_order_or_range_are_refused(void **state)
{
    (void)state;
    struct fixture f;
    fixture_open(&f, 7);
    static const struct {
        uint32_t field; /* of struct umb__curve_record, in 32-bit words */
        uint32_t value;
    } bad[] = {{0, 2}, {1, 2},       {1, 5}, {1, 3}, {2, 2}, {2, 19},
               {3, 0}, {3, 2000000}, {5, 1}, {7, 1}, {9, 1}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        const struct umb__curve_record kept = f.records[1];
        uint32_t words[10];
        struct bytes bytes = {0};
        struct umb_sink sink = bytes_sink(&bytes);
        struct umb_error error;
        uint8_t id[UMB_ID_BYTES];
        assert_int_equal(sizeof words, sizeof kept);
        memcpy(words, &kept, sizeof words);
        words[bad[i].field] = bad[i].value;
        memcpy(&f.records[1], words, sizeof words);
        assert_int_not_equal(
            umb__pack_write(&f.content, &f.octree, &test_digest, &sink, id, &error), UMB_OK);
        assert_non_null(strstr(error.message, "curve["));
        f.records[1] = kept;
        bytes_finish(&bytes);
    }
    fixture_close(&f);
}

static int wins(const struct fixture *f, struct umb_dial dial,
                const struct umb_calibration *calibration, struct umb_curve_row *row)
{
    struct umb_query_settings settings = {.light = 1};
    struct umb_error error;
    const enum umb_status status =
        umb_dial_choose(f->asset, &dial, calibration, &settings, row, &error);
    if (status == UMB_OK) {
        assert_int_equal(settings.level, row->level);
        assert_int_equal(settings.taps, row->taps);
        struct umb_query query;
        assert_int_equal(umb_query_prepare(f->asset, &settings, &query, NULL), UMB_OK);
        assert_float_equal(umb_query_bound_m(f->asset, &settings), row->bound_m, 1e-12);
    } else {
        assert_int_equal(status, UMB_E_ARGUMENT);
        assert_non_null(strchr(error.message, ':'));
    }
    return status == UMB_OK;
}

static void halving_an_error_never_widens_the_bound_nor_lowers_the_cost(void **state)
{
    (void)state;
    for (uint32_t log2_size = 7; log2_size <= 8; log2_size++) {
        struct fixture f;
        fixture_open(&f, log2_size);
        for (int by_visibility = 0; by_visibility < 2; by_visibility++) {
            struct umb_curve_row row, last = {.bound_m = INFINITY, .visibility_error = INFINITY};
            double wanted = by_visibility ? 1 : 64;
            int found = 0;
            for (; wanted > 1e-4; wanted /= 2) {
                struct umb_dial dial = {0};
                *(by_visibility ? &dial.max_visibility : &dial.max_error_m) = wanted;
                if (!wins(&f, dial, NULL, &row)) {
                    break;
                }
                found++;
                assert_true(row.lines >= last.lines);
                if (by_visibility) {
                    assert_true(row.visibility_error <= last.visibility_error);
                    assert_true(row.visibility_error <= wanted);
                } else {
                    assert_true(row.bound_m <= last.bound_m && row.bound_m <= wanted);
                }
                last = row;
            }
            assert_true(found >= 2 && wanted > 1e-4); /* it ends in a refusal, not in a lie */
        }
        fixture_close(&f);
    }
}

static double ticks;

/* A clock that adds more time at each reading than at the one before. */
static double slow_clock(void)
{
    ticks += 1e-3 + ticks * 1e-3;
    return ticks;
}

static void a_budget_buys_the_least_error_that_costs_no_more(void **state)
{
    (void)state;
    struct fixture f;
    struct umb_calibration calibration;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX], row;
    fixture_open(&f, 7);
    ticks = 0;
    assert_int_equal(umb_calibrate(f.asset, 1, slow_clock, &calibration, NULL), UMB_OK);
    size_t count;
    assert_int_equal(umb_asset_get_curve(f.asset, 1, rows, &count), UMB_OK);
    assert_int_equal(calibration.count, count);
    double cheapest = INFINITY;
    for (size_t i = 0; i < count; i++) {
        cheapest = fmin(cheapest, calibration.ns[i]);
        for (size_t k = 0; k < count; k++) {
            assert_true(rows[k].lines > rows[i].lines || calibration.ns[k] <= calibration.ns[i]);
        }
    }
    for (size_t i = 0; i < count; i++) {
        const struct umb_dial dial = {.budget_ns = calibration.ns[i]};
        assert_true(wins(&f, dial, &calibration, &row));
        for (size_t k = 0; k < count; k++) {
            assert_true(calibration.ns[k] > dial.budget_ns ||
                        rows[k].visibility_error >= row.visibility_error);
        }
        const struct umb_dial both = {.budget_ns = calibration.ns[i], .max_error_m = 1e6};
        assert_true(wins(&f, both, &calibration, &row));
    }
    assert_false(wins(&f, (struct umb_dial){.budget_ns = cheapest / 2}, &calibration, &row));
    assert_false(
        wins(&f, (struct umb_dial){.budget_ns = 1e9, .max_error_m = 1e-6}, &calibration, &row));
    fixture_close(&f);
}

/* A clock that stands still between pairs of readings, and advances by random lengths within a
 * pair. */
static uint64_t clock_seed;
static int clock_looks;

static double dice_clock(void)
{
    ticks += clock_looks++ % 2 ? 1e-3 * (0.5 + random_unit(&clock_seed)) : 0;
    return ticks;
}

static double even_clock(void)
{
    ticks += clock_looks++ % 2 ? 1e-3 : 0;
    return ticks;
}

static void calibrations_on_points_time_every_row_on_them(void **state)
{
    (void)state;
    struct fixture f;
    struct umb_calibration calibration;
    fixture_open(&f, 7);
    struct umb_points points = draw_points(7);
    ticks = clock_looks = 0;
    assert_int_equal(umb_calibrate_points(f.asset, 1, &points, even_clock, &calibration, NULL),
                     UMB_OK);
    assert_true(calibration.count > 0);
    for (size_t i = 0; i < calibration.count; i++) { /* 600 points, again until there are 8192 */
        assert_float_equal(calibration.ns[i], 1e6 / (14 * POINTS), 1e-6);
    }
    points.count = 1;
    assert_int_equal(umb_calibrate_points(f.asset, 1, &points, even_clock, &calibration, NULL),
                     UMB_OK);
    assert_float_equal(calibration.ns[0], 1e6 / 64, 1e-6);
    fixture_close(&f);
}

static void costs_rise_with_the_lines_and_keep_their_mean_whatever_the_clock_says(void **state)
{
    (void)state;
    struct fixture f;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX], row;
    fixture_open(&f, 7);
    const struct umb_points points = draw_points(7);
    size_t count;
    assert_int_equal(umb_asset_get_curve(f.asset, 1, rows, &count), UMB_OK);
    clock_seed = 5;
    for (int round = 0; round < short_count(50, 10); round++) {
        struct umb_calibration calibration;
        ticks = clock_looks = 0;
        assert_int_equal(umb_calibrate_points(f.asset, 1, &points, dice_clock, &calibration, NULL),
                         UMB_OK);
        double sum = 0;
        for (size_t i = 0; i < count; i++) {
            sum += calibration.ns[i];
            for (size_t k = 0; k < count; k++) {
                assert_true(rows[k].lines > rows[i].lines ||
                            calibration.ns[k] <= calibration.ns[i]);
            }
        }
        assert_in_range((int)(sum / (double)count), 60, 240); /* dice of 0.5 .. 1.5 ms / 8400 */
        double last_error = 0, last_cost = INFINITY;
        for (double budget = 1000; budget > 1; budget /= 1.1) { /* less buys no more */
            const struct umb_dial dial = {.budget_ns = budget};
            if (!wins(&f, dial, &calibration, &row)) {
                break;
            }
            double cost = 0;
            for (size_t i = 0; i < count; i++) {
                cost = rows[i].level == row.level && rows[i].taps == row.taps ? calibration.ns[i]
                                                                              : cost;
            }
            assert_true(row.visibility_error >= last_error && cost <= last_cost && cost <= budget);
            last_error = row.visibility_error;
            last_cost = cost;
        }
        assert_true(last_cost < INFINITY);
    }
    fixture_close(&f);
}

static void dials_refuse_what_they_cannot_honour(void **state)
{
    (void)state;
    struct fixture f;
    struct umb_error error;
    struct umb_calibration calibration;
    fixture_open(&f, 7);
    static const struct umb_dial bad[] = {
        {0}, {.max_error_m = -1}, {.max_error_m = NAN}, {.max_visibility = INFINITY}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct umb_query_settings settings = {.light = 0};
        assert_int_equal(umb_dial_choose(f.asset, &bad[i], NULL, &settings, NULL, &error),
                         UMB_E_ARGUMENT);
    }
    const struct umb_dial metre = {.max_error_m = 1}, budget = {.budget_ns = 100};
    struct umb_query_settings wide = {.taps = 3}, other = {.light = 2}, plain = {0};
    assert_int_equal(umb_dial_choose(f.asset, &metre, NULL, &wide, NULL, &error), UMB_E_ARGUMENT);
    assert_int_equal(umb_dial_choose(f.asset, &metre, NULL, &other, NULL, &error), UMB_E_NOT_FOUND);
    assert_int_equal(umb_dial_choose(f.asset, &budget, NULL, &plain, NULL, &error),
                     UMB_E_UNSUPPORTED);
    f.content.curve_count = 0; /* an asset without a curve */
    struct bytes bytes = pack(&f);
    struct umb_asset *bare;
    assert_int_equal(umb_asset_open_bytes(bytes.data, bytes.size, NULL, &bare, NULL), UMB_OK);
    assert_int_equal(umb_dial_choose(bare, &metre, NULL, &plain, NULL, &error), UMB_E_UNSUPPORTED);
    assert_int_equal(umb_calibrate(bare, 0, slow_clock, &calibration, &error), UMB_E_UNSUPPORTED);
    struct umb_points points = draw_points(7);
    assert_int_equal(umb_calibrate_points(bare, 0, &points, slow_clock, &calibration, &error),
                     UMB_E_UNSUPPORTED);
    assert_int_equal(umb_calibrate_points(f.asset, 9, &points, slow_clock, &calibration, &error),
                     UMB_E_NOT_FOUND);
    points.count = 0;
    assert_int_equal(umb_calibrate_points(f.asset, 0, &points, slow_clock, &calibration, &error),
                     UMB_E_ARGUMENT);
    assert_int_equal(umb_calibrate(bare, 9, slow_clock, &calibration, &error), UMB_E_NOT_FOUND);
    umb_asset_close(bare);
    bytes_finish(&bytes);
    fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(windows_are_counted_as_voxel_by_voxel),
        cmocka_unit_test(curves_measure_the_answers_of_queries),
        cmocka_unit_test(curves_survive_packing_and_mapping),
        cmocka_unit_test(curves_out_of_order_or_range_are_refused),
        cmocka_unit_test(halving_an_error_never_widens_the_bound_nor_lowers_the_cost),
        cmocka_unit_test(a_budget_buys_the_least_error_that_costs_no_more),
        cmocka_unit_test(calibrations_on_points_time_every_row_on_them),
        cmocka_unit_test(costs_rise_with_the_lines_and_keep_their_mean_whatever_the_clock_says),
        cmocka_unit_test(dials_refuse_what_they_cannot_honour),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
