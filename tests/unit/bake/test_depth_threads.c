/* SPDX-License-Identifier: Apache-2.0 */
/* Several threads must prepare the same triangles for a tile as one thread. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "tool/threads.h"
#include "bake/depth/depth.h"
#include "bake/depth/proven_squares.h"
#include "bake/depth/triangle_bins.h"
#include "bake_soups.h"

enum {
    SIZE = 1024,
    TILE_LOG2 = 9,
    BOXES = 1700, /* more triangles than one thread takes at a time */
    THREADS = 4
};

/* Makes boxes of all sizes, one upon the other and side by side, some inside out, none at the far
 * sides. */
static void soup_town(struct soup *soup)
{
    soup_init(soup, SIZE, 7);
    for (int i = 0; i < BOXES; i++) {
        const double x = 8 + i * 37 % 640, y = 8 + i * 101 % 760, z = 20 + i * 13 % 900;
        const double low[3] = {x, y, z};
        const double high[3] = {x + 3 + i % 40, y + 5 + i % 29, z + 10 + i % 50};
        soup_box(soup, low, high, i % 5 == 0);
    }
}

struct threads {
    struct umbu_threads *jobs;
    struct umb_workers workers;
};

static void threads_start(struct threads *threads)
{
    struct umb_error error;
    assert_int_equal(umbu_threads_create(THREADS, &threads->jobs, &error), UMB_OK);
    threads->workers = umbu_threads_workers(threads->jobs);
}

static void borders_are_the_same_for_all_numbers_of_threads(void **state)
{
    (void)state;
    struct soup soup;
    struct threads threads;
    struct umb_error error;
    uint8_t *one, *many;
    soup_town(&soup);
    threads_start(&threads);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    assert_int_equal(umbb_front_marks_make(&casters, UMBB_PROVE_ALWAYS, NULL, &one, &error),
                     UMB_OK);
    size_t borders = 0;
    for (size_t i = 0; i < soup.count; i++) {
        borders += (one[i] & UMBB_MARK_BORDER) != 0;
    }
    assert_true(borders > BOXES);
    for (int round = 0; round < 5; round++) {
        assert_int_equal(
            umbb_front_marks_make(&casters, UMBB_PROVE_ALWAYS, &threads.workers, &many, &error),
            UMB_OK);
        assert_memory_equal(one, many, soup.count);
        free(many);
    }
    free(one);
    umbu_threads_destroy(threads.jobs);
    soup_finish(&soup);
}

/* Houses of equal height in a row share the edges of the walls between them, with three front faces
 * at each. With threads the order of these faces is random, and it must not show in the result. */
static void borders_do_not_depend_on_the_order_of_casters(void **state)
{
    (void)state;
    struct soup soup, reversed;
    struct umb_error error;
    uint8_t *marks, *others;
    soup_init(&soup, SIZE, 8);
    soup_init(&reversed, SIZE, 8);
    for (int i = 0; i < 8; i++) {
        double v[8][3];
        for (int k = 0; k < 8; k++) { /* sheared, so that no wall is parallel to the light */
            const double z = k & 4 ? 400 : 200;
            v[k][0] = 100 + 50 * (i + (k & 1)) + 0.25 * z;
            v[k][1] = (k & 2 ? 300 : 200) + 0.125 * z;
            v[k][2] = z;
        }
        soup_hexahedron(&soup, v, 0);
    }
    for (size_t i = soup.count; i-- > 0;) {
        const double(*v)[3] = (const double(*)[3])soup.corners[i];
        soup_add(&reversed, v[0], v[1], v[2], UMBB_CASTER_CLOSED);
    }
    const struct umbb_casters casters = soup_casters(&soup, 1), back = soup_casters(&reversed, 1);
    assert_int_equal(umbb_front_marks_make(&casters, UMBB_PROVE_ALWAYS, NULL, &marks, &error),
                     UMB_OK);
    assert_int_equal(umbb_front_marks_make(&back, UMBB_PROVE_ALWAYS, NULL, &others, &error),
                     UMB_OK);
    for (size_t i = 0; i < soup.count; i++) {
        assert_int_equal(marks[i], others[soup.count - 1 - i]);
    }
    free(marks);
    free(others);
    soup_finish(&soup);
    soup_finish(&reversed);
}

static void lists_are_the_same_for_all_numbers_of_threads(void **state)
{
    (void)state;
    struct soup soup;
    struct threads threads;
    struct umb_error error;
    soup_town(&soup);
    threads_start(&threads);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    for (uint32_t cell_log2 = 4; cell_log2 <= 10; cell_log2++) {
        struct umbb_bins one = {0}, many = {0};
        struct umbb_bins_input input = {.casters = &casters,
                                        .all = 1,
                                        .cell_log2 = cell_log2,
                                        .cells_x = (uint32_t)SIZE >> cell_log2,
                                        .max_bytes = SIZE_MAX};
        assert_int_equal(umbb_bins_fill(&one, &input, &error), UMB_OK);
        input.workers = &threads.workers;
        assert_int_equal(umbb_bins_fill(&many, &input, &error), UMB_OK);
        const size_t cells = (size_t)input.cells_x * input.cells_x;
        assert_memory_equal(one.first, many.first, (cells + 1) * sizeof *one.first);
        assert_true(one.first[cells] >= BOXES);
        assert_memory_equal(one.entries, many.entries, one.first[cells] * sizeof *one.entries);
        umbb_bins_finish(&one);
        umbb_bins_finish(&many);
    }
    umbu_threads_destroy(threads.jobs);
    soup_finish(&soup);
}

/* A tile of which only begin was called. */
static void tile_begin(const struct umbb_casters *casters, unsigned threads, int32_t x0, int32_t y0,
                       struct umbb_tile *tile)
{
    const struct umbb_depth_options options = {
        .tile_log2 = TILE_LOG2, .threads = threads, .prove = UMBB_PROVE_ALWAYS};
    struct umbb_depth depth;
    struct umb_error error;
    assert_int_equal(umbb_depth_raster_create(casters, &options, &depth, &error), UMB_OK);
    assert_int_equal(umbb_tile_init(tile, TILE_LOG2, 1, &error), UMB_OK);
    tile->x0 = x0;
    tile->y0 = y0;
    assert_int_equal(depth.begin(depth.state, 0, tile, &error), UMB_OK);
    depth.destroy(depth.state);
}

static void squares_are_proven_by_any_number_of_threads(void **state)
{
    (void)state;
    struct soup soup;
    size_t proven = 0, others = 0;
    soup_town(&soup);
    const struct umbb_casters casters = soup_casters(&soup, 1);
    const size_t squares = (size_t)1 << (2 * (TILE_LOG2 - UMBB_SQUARE_LOG2));
    for (int32_t place = 0; place < 4; place++) {
        struct umbb_tile one, many;
        const int32_t x0 = (place & 1) << TILE_LOG2, y0 = (place >> 1) << TILE_LOG2;
        tile_begin(&casters, 1, x0, y0, &one);
        tile_begin(&casters, THREADS - (unsigned)place % 2, x0, y0, &many);
        assert_memory_equal(one.proven, many.proven, squares);
        for (size_t i = 0; i < squares; i++) {
            proven += one.proven[i];
            others += one.proven[i] == 0;
            if (one.proven[i]) {
                assert_int_equal(one.max_lit[UMBB_SQUARE_LOG2][i],
                                 many.max_lit[UMBB_SQUARE_LOG2][i]);
                assert_int_equal(one.min_end[UMBB_SQUARE_LOG2][i],
                                 many.min_end[UMBB_SQUARE_LOG2][i]);
            }
        }
        umbb_tile_finish(&one);
        umbb_tile_finish(&many);
    }
    assert_true(others > 0);
    assert_true(proven > 0);
    soup_finish(&soup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(borders_are_the_same_for_all_numbers_of_threads),
        cmocka_unit_test(borders_do_not_depend_on_the_order_of_casters),
        cmocka_unit_test(lists_are_the_same_for_all_numbers_of_threads),
        cmocka_unit_test(squares_are_proven_by_any_number_of_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
