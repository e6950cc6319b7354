/* SPDX-License-Identifier: Apache-2.0 */
/* Assets of few nodes that represent huge trees: the pages of a view are found in few steps. */
#include "partial_fixture.h"

#include "deep_asset.h"
#include "partial/partial_parts.h"

#define SIDE_M 1000.0

static const struct umb_partial_view views[] = {
    {.light = UINT32_MAX},
    {.light = UINT32_MAX, .has_box = 1, .box = {{10, 10, 10}, {900, 900, 900}}},
    {.light = 0, .has_box = 1, .box = {{0, 400, 0}, {1000, 400.5, 1000}}, .taps = 1},
    {.light = 0,
     .has_camera = 1,
     .camera.eye = {1, 1.7, 1},
     .camera.forward = {99, 0.5, 8},
     .camera.up = {0, 1, 0},
     .camera.fov_y = 1,
     .camera.aspect = 1.8},
    {.light = 0,
     .has_camera = 1,
     .camera.eye = {500, 500, 500},
     .camera.forward = {1, 1, 1},
     .camera.up = {0, 1, 0},
     .camera.fov_y = 1,
     .camera.aspect = 1.8,
     .camera.far_m = 300,
     .max_error_rad = 1e-5},
};

/* Wants a view, and adds missing pages, until none is missing. Returns true if a walk met its
 * bound. */
static bool fetch_in_bounded_steps(struct partial_fixture *f, const struct umb_partial_view *view)
{
    struct umb_error error = {0};
    bool met = false;
    for (;;) { /* ends: each round adds a page */
        uint32_t list[256];
        partial_build(f);
        if (umb_partial_want(f->partial, view, 0, &error) != UMB_OK) {
            fail_msg("want: %s", error.message);
        }
        const uint64_t nodes = f->partial->node_count, most = 1024 + 17 * nodes;
        if (f->partial->want_steps > most) {
            fail_msg("%llu steps of %llu nodes, at most %llu",
                     (unsigned long long)f->partial->want_steps, (unsigned long long)nodes,
                     (unsigned long long)most);
        }
        met = met || f->partial->want_steps > 1024 + 16 * nodes;
        const size_t count = umb_partial_missing(f->partial, list, 256, 0);
        for (size_t i = 0; i < count; i++) {
            partial_add(f, list[i]);
        }
        if (count == 0) {
            return met;
        }
    }
}

/* Points of the view's box must be answered exactly: the bound must not leave out a page that they
 * need. */
static void expect_exact(struct partial_fixture *f, const struct umb_box *box)
{
    enum {
        POINTS = 500
    };
    double positions[POINTS][3];
    float values[POINTS];
    uint64_t seed = 12;
    for (size_t i = 0; i < POINTS * (size_t)3; i++) {
        positions[i / 3][i % 3] =
            box->min[i % 3] + random_unit(&seed) * (box->max[i % 3] - box->min[i % 3]);
    }
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    const struct umb_query_settings one = {.taps = 1};
    struct umb_partial_answers answers = {.values = values};
    assert_int_equal(umb_partial_query(f->partial, &one, &points, 0, &answers, NULL), UMB_OK);
    assert_int_equal(answers.exact, POINTS);
}

static bool try_deep(const struct deep *deep, bool with_pages)
{
    struct partial_fixture f = {.file = deep_asset(deep, SIDE_M)};
    bool met = false;
    for (size_t i = 0; i < sizeof views / sizeof views[0]; i++) {
        f.partial = partial_open(&f.file, 0);
        for (uint32_t page = 0; with_pages && page < f.partial->head.page_count; page += 2) {
            partial_add(&f, page);
        }
        met = fetch_in_bounded_steps(&f, &views[i]) || met;
        if (views[i].has_box) {
            expect_exact(&f, &views[i].box);
        }
        umb_partial_close(f.partial);
    }
    bytes_finish(&f.file);
    return met;
}

/* One node a level, whose children are all the same node: each further level multiplies the cubes
 * of a walk by eight. */
static void a_chain_of_eight_equal_children_is_walked_in_bounded_steps(void **state)
{
    (void)state;
    for (uint32_t log2_size = 13; log2_size <= UMB_LEVEL_MAX; log2_size++) {
        assert_true(try_deep(&(struct deep){log2_size, 1, 8, 7, 32}, false));
    }
}

/* Paths part and meet again at each level, over many pages, whichever of them are here. */
static void diamonds_are_walked_in_bounded_steps_and_miss_nothing(void **state)
{
    (void)state;
    static const struct deep shapes[] = {
        {20, 2, 8, 1, 32},    {20, 8, 5, 2, 64},   {19, 20, 8, 3, 512},
        {20, 30, 8, 4, 1024}, {20, 60, 2, 5, 512},
    };
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i += (size_t)short_count(1, 2)) {
        const bool met = try_deep(&shapes[i], false);
        assert_true(met || shapes[i].mixed < 8);
        (void)try_deep(&shapes[i], true);
    }
}

/* Walks through assets of real scenes stay far below the bound, so that their pages are chosen
 * exactly. */
static void a_view_of_a_tree_that_is_one_meets_no_bound(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_partial_view view = {.light = UINT32_MAX, .has_box = 1};
    partial_fixture_open(&f, 0);
    for (unsigned axis = 0; axis < 3; axis++) {
        view.box.min[axis] = fixture_origin[axis] + 10;
        view.box.max[axis] = fixture_origin[axis] + 40;
    }
    assert_false(fetch_in_bounded_steps(&f, &view));
    partial_fixture_close(&f);
}

/* By looking at all pages. */
static uint32_t worst_of_all(const struct umb_partial *p)
{
    uint32_t worst = UINT32_MAX;
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        if (p->pages[page].stored &&
            (worst == UINT32_MAX || p->pages[page].benefit <= p->pages[worst].benefit)) {
            worst = page;
        }
    }
    return worst;
}

static void the_page_that_matters_least_is_found_whatever_comes_and_goes(void **state)
{
    (void)state;
    const struct deep deep = {20, 60, 2, 5, 512};
    struct partial_fixture f = {.file = deep_asset(&deep, SIDE_M)};
    uint64_t seed = 77;
    f.partial = partial_open(&f.file, 0);
    const uint32_t pages = f.partial->head.page_count;
    assert_true(pages > 20);
    assert_int_equal(umb__partial_worst(f.partial), UINT32_MAX);
    for (unsigned i = 0; i < (unsigned)short_count(5000, 1000); i++) {
        const uint32_t page = (uint32_t)(next_random(&seed) % pages);
        if (i % 500 == 0) { /* benefits change in a want only */
            partial_build(&f);
            assert_int_equal(umb_partial_want(f.partial, &views[i / 500 % 5], 0, NULL), UMB_OK);
        }
        if (!umb_partial_has(f.partial, page)) {
            partial_add(&f, page);
        } else if (next_random(&seed) % 3 > 0) {
            umb_partial_drop(f.partial, page);
        } else {
            umb_partial_drop(f.partial, umb__partial_worst(f.partial));
        }
        assert_int_equal(umb__partial_worst(f.partial), worst_of_all(f.partial));
    }
    umb_partial_close(f.partial);
    bytes_finish(&f.file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_chain_of_eight_equal_children_is_walked_in_bounded_steps),
        cmocka_unit_test(diamonds_are_walked_in_bounded_steps_and_miss_nothing),
        cmocka_unit_test(the_page_that_matters_least_is_found_whatever_comes_and_goes),
        cmocka_unit_test(a_view_of_a_tree_that_is_one_meets_no_bound),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
