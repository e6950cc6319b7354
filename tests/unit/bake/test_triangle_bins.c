/* SPDX-License-Identifier: Apache-2.0 */
/* Bins must list every texel that a triangle covers, list slivers along their length, and keep to
 * bounded memory. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "bake/depth/coverage.h"
#include "bake/depth/triangle_bins.h"
#include "bake_soups.h"
#include "make_asset.h"

static struct umbb_bins_input whole_map(const struct umbb_casters *casters, uint32_t cell_log2)
{
    return (struct umbb_bins_input){.casters = casters,
                                    .all = 1,
                                    .cell_log2 = cell_log2,
                                    .cells_x = (uint32_t)casters->size >> cell_log2,
                                    .max_bytes = SIZE_MAX};
}

static int is_listed(const struct umbb_bins *bins, size_t cell, uint32_t triangle)
{
    for (uint64_t i = bins->first[cell]; i < bins->first[cell + 1]; i++) {
        if (bins->entries[i] == triangle) {
            return 1;
        }
    }
    return 0;
}

static void every_covered_texel_has_its_triangle_in_its_cell(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= (uint64_t)short_count(3, 1); seed++) {
        struct soup soup;
        soup_init(&soup, 256, seed);
        soup_mixture(&soup);
        soup_random_open(&soup, 200);
        for (uint32_t cell_log2 = 3; cell_log2 <= 8; cell_log2++) {
            const struct umbb_casters casters = soup_casters(&soup, 1);
            const struct umbb_bins_input input = whole_map(&casters, cell_log2);
            struct umbb_bins bins = {0};
            struct umb_error error;
            assert_int_equal(umbb_bins_fill(&bins, &input, &error), UMB_OK);
            for (size_t i = 0; i < soup.count; i++) {
                struct umbb_coverage c;
                if (!umbb_coverage_prepare((const double(*)[3])soup.corners[i], soup.size, &c)) {
                    continue;
                }
                for (int32_t y = c.row_first; y <= c.row_last; y++) {
                    int32_t x, last;
                    umbb_coverage_row(&c, y, &x, &last);
                    for (; x <= last; x++) {
                        const size_t cell =
                            (size_t)(y >> cell_log2) * input.cells_x + (size_t)(x >> cell_log2);
                        assert_true(is_listed(&bins, cell, (uint32_t)i));
                    }
                }
            }
            for (size_t cell = 0; cell < (size_t)input.cells_x * input.cells_x; cell++) {
                for (uint64_t i = bins.first[cell]; i + 1 < bins.first[cell + 1]; i++) {
                    assert_true(bins.entries[i] < bins.entries[i + 1]);
                }
            }
            umbb_bins_finish(&bins);
        }
        soup_finish(&soup);
    }
}

static void a_sliver_is_listed_along_its_length_only(void **state)
{
    (void)state;
    struct soup soup;
    soup_init(&soup, 4096, 0);
    const double a[3] = {3, 5, 1}, b[3] = {4090, 4080, 2}, c[3] = {4091, 4080, 2};
    soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    const struct umbb_casters casters = soup_casters(&soup, 0);
    const struct umbb_bins_input input = whole_map(&casters, 6);
    struct umbb_bins bins = {0};
    struct umb_error error;
    assert_int_equal(umbb_bins_fill(&bins, &input, &error), UMB_OK);
    /* A map has 64 rows of cells. A diagonal meets two cells in each row, or three within a texel
     * of a corner. */
    assert_true(bins.first[64 * 64] >= 64 && bins.first[64 * 64] <= 3 * 64);
    umbb_bins_finish(&bins);
    soup_finish(&soup);
}

static void lists_over_their_share_of_memory_are_refused(void **state)
{
    (void)state;
    struct soup soup;
    struct umb_error error;
    soup_init(&soup, 1024, 9);
    for (int i = 0; i < 100; i++) { /* each over the whole map: 256 cells of 64 texels */
        const double a[3] = {-2000, -2000, i}, b[3] = {6000, -2000, i}, c[3] = {-2000, 6000, i};
        soup_add(&soup, a, b, c, UMBB_CASTER_OPEN);
    }
    const struct umbb_casters casters = soup_casters(&soup, 0);
    const size_t lists = 100 * 256 * 4, filling = 256 * 8 + 100 * 4;
    struct umbb_depth_options options = {
        .tile_log2 = 6, .threads = 1, .max_bytes = lists + filling};
    struct umbb_depth depth;
    assert_int_equal(umbb_depth_raster_create(&casters, &options, &depth, &error), UMB_OK);
    assert_int_equal(umbb_tile_lists_allow(depth.lists, SIZE_MAX), lists);
    depth.destroy(depth.state);
    options.max_bytes--;
    assert_int_equal(umbb_depth_raster_create(&casters, &options, &depth, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "--memory"));
    assert_non_null(strstr(error.message, "16 x 16"));
    soup_finish(&soup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_covered_texel_has_its_triangle_in_its_cell),
        cmocka_unit_test(a_sliver_is_listed_along_its_length_only),
        cmocka_unit_test(lists_over_their_share_of_memory_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
