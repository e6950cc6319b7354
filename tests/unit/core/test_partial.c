/* SPDX-License-Identifier: Apache-2.0 */
/* Partial assets: their answers from some of the pages, the pages that they want, and their memory
 * budget. */
#include "partial_fixture.h"

static const struct umb_query_settings ways[] = {
    {.light = 0, .taps = 1},
    {.light = 0, .taps = 17},
    {.light = 0, .taps = 9, .filter = UMB_FILTER_TENT},
    {.light = 0, .taps = 7, .filter = UMB_FILTER_GAUSSIAN},
    {.light = 1, .taps = 5, .bias_mode = UMB_BIAS_METRES, .bias = 0.5},
};

static void all_pages_answer_bit_for_bit_like_the_file(void **state)
{
    (void)state;
    struct partial_fixture f;
    partial_fixture_open(&f, 0);
    for (uint32_t page = f.page_count; page-- > 0;) { /* any order will do */
        partial_add(&f, page);
    }
    partial_build(&f);
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        const size_t count = i == 0 ? PARTIAL_POINTS : PARTIAL_POINTS / 10;
        assert_int_equal(partial_compare(&f, &ways[i], count, 0), count);
        assert_memory_equal(f.values, f.truth, count * sizeof *f.values);
    }
    partial_fixture_close(&f);
}

static void penumbras_of_a_part_are_refused(void **state)
{
    struct partial_fixture f;
    struct umb_error error;
    struct umb_partial_answers answers = {0};
    const struct umb_points none = {.format = UMB_POINT_F32};
    const struct umb_query_settings settings = {.filter = UMB_FILTER_PENUMBRA, .light_extent = 0.1};
    (void)state;
    partial_fixture_open(&f, 0);
    partial_build(&f);
    assert_int_equal(umb_partial_query(f.partial, &settings, &none, 0, &answers, &error),
                     UMB_E_UNSUPPORTED);
    assert_memory_equal(error.message, "filter: penumbra", 16);
    partial_fixture_close(&f);
}

static void the_truth_lies_within_the_bounds_while_pages_arrive(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_error error;
    const struct umb_partial_view everything = {.light = UINT32_MAX};
    partial_fixture_open(&f, 0);
    assert_true(f.page_count > 12);
    uint64_t before = 0, first = 0;
    for (size_t round = 0;; round++) {
        uint32_t list[3];
        partial_build(&f);
        uint64_t exact = 0;
        for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
            exact += partial_compare(&f, &ways[i], 3000, 0);
        }
        assert_true(exact >= before);
        before = exact;
        first = round == 0 ? exact : first;
        assert_int_equal(umb_partial_want(f.partial, &everything, 0, &error), UMB_OK);
        size_t count = umb_partial_missing(f.partial, list, 3, 0);
        if (count == 0) {
            break;
        }
        for (size_t i = 0; i < count; i++) {
            partial_add(&f, list[i]);
        }
    }
    assert_int_equal(before, 3000 * sizeof ways / sizeof ways[0]);
    assert_true(first < before / 2);
    struct umb_partial_stats stats;
    umb_partial_get_stats(f.partial, &stats);
    assert_int_equal(stats.pages_held, f.page_count);
    partial_fixture_close(&f);
}

/* Fetches the pages that a view wants, round by round. Returns the number of rounds. */
static unsigned fetch(struct partial_fixture *f, const struct umb_partial_view *view)
{
    struct umb_error error = {0};
    for (unsigned round = 0;; round++) {
        uint32_t list[64];
        partial_build(f);
        if (umb_partial_want(f->partial, view, 0, &error) != UMB_OK) {
            fail_msg("want: %s", error.message);
        }
        size_t count = umb_partial_missing(f->partial, list, 64, 0);
        if (count == 0) {
            return round;
        }
        for (size_t i = 0; i < count; i++) {
            partial_add(f, list[i]);
        }
    }
}

static struct umb_box box_around(const double *p, double radius)
{
    struct umb_box box;
    for (unsigned axis = 0; axis < 3; axis++) {
        box.min[axis] = fixture_origin[axis] + p[axis] - radius;
        box.max[axis] = fixture_origin[axis] + p[axis] + radius;
    }
    return box;
}

static int inside(const struct umb_box *box, const double *p)
{
    for (unsigned axis = 0; axis < 3; axis++) {
        const double world = fixture_origin[axis] + p[axis];
        if (!(world >= box->min[axis] && world <= box->max[axis])) {
            return 0;
        }
    }
    return 1;
}

static void a_box_holds_all_that_its_points_need_and_not_the_rest(void **state)
{
    (void)state;
    struct partial_fixture f;
    partial_fixture_open(&f, 0);
    struct umb_partial_stats stats;
    struct umb_partial_view view = {
        .light = 0, .has_box = 1, .box = box_around(f.points + 3, 6.0), .taps = 1};
    fetch(&f, &view);
    umb_partial_get_stats(f.partial, &stats);
    assert_true(stats.pages_held < f.page_count / 2);
    view.taps = 0;
    fetch(&f, &view);
    size_t count = 0;
    for (size_t i = 0; i < 3; i++) { /* those of light 0: the windows of all filters */
        partial_compare(&f, &ways[i], 100000, 0);
        for (size_t k = 0; k < 100000; k++) {
            if (inside(&view.box, f.points + 3 * k)) {
                assert_true(f.low[k] == f.high[k]);
                count++;
            }
        }
    }
    assert_true(count > 30);
    partial_fixture_close(&f);
}

static void a_camera_holds_all_that_its_picture_needs(void **state)
{
    (void)state;
    struct partial_fixture f;
    partial_fixture_open(&f, 0);
    const double *eye = f.points + 3;
    const struct umb_partial_view view = {.light = 0,
                                          .has_camera = 1,
                                          .camera.eye = {fixture_origin[0] + eye[0],
                                                         fixture_origin[1] + eye[1],
                                                         fixture_origin[2] + eye[2]},
                                          .camera.forward = {-eye[0], -eye[1], -eye[2]},
                                          .camera.up = {0, 0, 1},
                                          .camera.fov_y = 0.6,
                                          .camera.aspect = 1.5,
                                          .camera.far_m = 15};
    fetch(&f, &view);
    struct umb_partial_stats stats;
    umb_partial_get_stats(f.partial, &stats);
    assert_true(stats.pages_held < f.page_count);
    partial_compare(&f, &ways[1], 100000, 0);
    size_t count = 0;
    const double length = sqrt(eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2]);
    for (size_t k = 0; k < 100000; k++) {
        double d[3], along = 0, square = 0;
        for (unsigned axis = 0; axis < 3; axis++) {
            d[axis] = f.points[3 * k + axis] - eye[axis];
            along -= d[axis] * eye[axis] / length;
            square += d[axis] * d[axis];
        }
        /* A cone inside the picture. */
        if (along > 0 && along * along > 0.96 * square && square < 15.0 * 15.0) {
            assert_true(f.low[k] == f.high[k]);
            count++;
        }
    }
    assert_true(count > 10);
    partial_fixture_close(&f);
}

static void a_camera_whose_up_lies_along_its_view_is_refused(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_error error = {0};
    uint64_t seed = 9;
    partial_fixture_open(&f, 0);
    partial_build(&f);
    for (unsigned i = 0; i < 100; i++) {
        struct umb_partial_view view = {.has_camera = 1, .camera.fov_y = 0.6, .camera.aspect = 1.5};
        for (unsigned k = 0; k < 3; k++) {
            view.camera.forward[k] = random_unit(&seed) * 2 - 1;
            view.camera.up[k] = view.camera.forward[k] * (0.1 + i);
        }
        assert_int_equal(umb_partial_want(f.partial, &view, 0, &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "not parallel"));
        view.camera.up[i % 3] += 1e-3 * (0.1 + i);
        assert_int_equal(umb_partial_want(f.partial, &view, 0, &error), UMB_OK);
        memset(view.camera.forward, 0, sizeof view.camera.forward); /* no direction at all */
        assert_int_equal(umb_partial_want(f.partial, &view, 0, &error), UMB_E_ARGUMENT);
    }
    partial_fixture_close(&f);
}

static void points_ask_for_just_the_pages_they_miss(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_error error;
    partial_fixture_open(&f, 0);
    for (unsigned round = 0;; round++) {
        uint32_t list[64];
        assert_true(round < 20);
        partial_build(&f);
        assert_int_equal(umb_partial_want(f.partial, NULL, 0, &error), UMB_OK);
        const uint64_t exact = partial_compare(&f, &ways[1], 5, 1);
        const size_t count = umb_partial_missing(f.partial, list, 64, 0);
        if (exact == 5) {
            assert_int_equal(count, 0);
            break;
        }
        assert_true(count > 0);
        for (size_t i = 0; i < count; i++) {
            partial_add(&f, list[i]);
        }
    }
    struct umb_partial_stats stats;
    umb_partial_get_stats(f.partial, &stats);
    assert_true(stats.pages_held < f.page_count / 2);
    partial_fixture_close(&f);
}

static void cells_that_are_small_enough_are_not_looked_into(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_partial_stats stats;
    partial_fixture_open(&f, 0);
    struct umb_partial_view view = {.light = 0, .max_error_m = 1000};
    fetch(&f, &view);
    umb_partial_get_stats(f.partial, &stats);
    assert_int_equal(stats.pages_held, 0);
    view.max_error_m = 40; /* 64 voxels of up to 0.47 m are seen as cells, 128 are looked into */
    fetch(&f, &view);
    partial_compare(&f, &ways[0], 20000, 0);
    for (size_t i = 0; i < 20000; i++) {
        assert_true(f.error_m[i] <= 40);
    }
    umb_partial_get_stats(f.partial, &stats);
    assert_true(stats.pages_held < f.page_count);
    partial_fixture_close(&f);
}

static void a_budget_is_never_exceeded_and_everything_is_answered(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct umb_partial_stats stats;
    struct umb_error error = {0};
    partial_fixture_open(&f, 0);
    for (uint32_t page = 0; page < f.page_count; page++) {
        partial_add(&f, page);
    }
    partial_build(&f);
    umb_partial_get_stats(f.partial, &stats);
    const uint64_t budget = stats.memory_peak_bytes / 3;
    umb_partial_close(f.partial);
    f.partial = partial_open(&f.file, budget);
    partial_build(&f);
    for (size_t step = 0; step < 12; step++) { /* a walk through the scene */
        const struct umb_partial_view view = {
            .light = 0, .taps = 1, .has_box = 1, .box = box_around(f.points + 3 * step, 2.0)};
        for (unsigned round = 0; round < 4; round++) {
            uint32_t list[64], length;
            assert_int_equal(umb_partial_want(f.partial, &view, 0, &error), UMB_OK);
            const size_t count = umb_partial_missing(f.partial, list, 64, 0);
            for (size_t i = 0; i < count; i++) {
                const uint8_t *stored = partial_page(&f, list[i], &length);
                enum umb_status status =
                    umb_partial_add(f.partial, list[i], stored, length, &error);
                assert_true(status == UMB_OK || status == UMB_E_NO_MEMORY);
            }
            partial_build(&f);
        }
        (void)partial_compare(&f, &ways[step % 4], 300, 0);
    }
    umb_partial_get_stats(f.partial, &stats);
    assert_true(stats.memory_peak_bytes <= budget);
    assert_true(stats.pages_dropped > 0);
    assert_true(stats.pages_held > 0);
    partial_fixture_close(&f);
}

static void a_saved_file_answers_as_before(void **state)
{
    (void)state;
    struct partial_fixture f;
    struct bytes saved = {0};
    struct umb_sink sink = bytes_sink(&saved);
    struct umb_error error = {0};
    struct umb_asset *asset;
    partial_fixture_open(&f, 0);
    for (uint32_t page = 0; page < f.page_count; page += 2) {
        partial_add(&f, page);
    }
    partial_build(&f);
    assert_int_equal(umb_partial_save(f.partial, &sink, &error), UMB_OK);
    const uint64_t exact = partial_compare(&f, &ways[0], 20000, 0);
    assert_true(exact > 0 && exact < 20000);
    umb_partial_close(f.partial);
    const struct umb_partial_options options = {.sha256 = &test_digest};
    if (umb_partial_open_saved(saved.data, saved.size, &options, &f.partial, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(partial_compare(&f, &ways[0], 20000, 0), exact);
    /* Functions for whole files must say that this is a partial file; every prefix must be
     * refused. */
    assert_int_equal(umb_asset_open_bytes(saved.data, saved.size, NULL, &asset, &error),
                     UMB_E_UNSUPPORTED);
    for (size_t size = 0; size < saved.size; size += 1 + saved.size / 997) {
        struct umb_partial *other;
        uint8_t *exact_block = malloc(size ? size : 1);
        memcpy(exact_block, saved.data, size);
        assert_int_not_equal(umb_partial_open_saved(exact_block, size, &options, &other, &error),
                             UMB_OK);
        assert_null(other);
        free(exact_block);
    }
    bytes_finish(&saved);
    partial_fixture_close(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_pages_answer_bit_for_bit_like_the_file),
        cmocka_unit_test(penumbras_of_a_part_are_refused),
        cmocka_unit_test(the_truth_lies_within_the_bounds_while_pages_arrive),
        cmocka_unit_test(a_box_holds_all_that_its_points_need_and_not_the_rest),
        cmocka_unit_test(a_camera_holds_all_that_its_picture_needs),
        cmocka_unit_test(a_camera_whose_up_lies_along_its_view_is_refused),
        cmocka_unit_test(points_ask_for_just_the_pages_they_miss),
        cmocka_unit_test(cells_that_are_small_enough_are_not_looked_into),
        cmocka_unit_test(a_budget_is_never_exceeded_and_everything_is_answered),
        cmocka_unit_test(a_saved_file_answers_as_before),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
