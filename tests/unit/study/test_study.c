/* SPDX-License-Identifier: Apache-2.0 */
/* The study's samples against a scene whose shadow is known, and its summary of made-up results. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "study/study.h"
#include "study/study_probe.h"

static struct umbt_study study;

static void fill_results(void)
{
    static const struct umbt_study_result results[] = {
        {.bake = 0, .taps = 1, .off_p95_m = 4.0, .view = {20.0, 0.1}},
        {.bake = 0, .taps = 9, .off_p95_m = 8.0, .view = {40.0, 0.1}},
        {.bake = 1, .taps = 1, .off_p95_m = 0.4, .view = {50.0, 0.1}},
        {.bake = 1, .taps = 9, .off_p95_m = 0.8, .view = {90.0, 0.1}},
        /* Cheap, but most of its wrong answers are out of reach of any boundary. */
        {.bake = 0, .taps = 3, .off_p95_m = 0.5, .view = {1.0, 0.1}, .off_unknown = 0.9},
    };
    memset(&study, 0, sizeof study);
    study.bake_count = 3;
    study.bakes[0].resolution = 512;
    study.bakes[1].resolution = 4096;
    study.bakes[2].resolution = 8192;
    (void)snprintf(study.bakes[2].name, sizeof study.bakes[2].name, "8192-open");
    (void)snprintf(study.bakes[2].reason, sizeof study.bakes[2].reason, "no room");
    memcpy(study.results, results, sizeof results);
    study.result_count = sizeof results / sizeof results[0];
    study.points.reach_m = 100.0;
    study.rays[UMBT_RAYS_VIEW].ns = 500.0;
    study.rays[UMBT_RAYS_VIEW8].ns = 600.0; /* the better way counts */
}

static void summary_names_the_cheapest_setting_below_each_error(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    umbt_study_summary(&study, text, sizeof text);
    assert_non_null(strstr(text, "edges within 0.4 m: 4096^3 voxels open, 1 x 1 taps: 50 ns"));
    assert_non_null(strstr(text, "Edges within 1 m: 4096^3 voxels open, 1 x 1 taps: 50 ns"));
    assert_non_null(strstr(text, "with wide filters 4096^3 voxels open, 9 x 9 taps: 90 ns"));
    assert_non_null(strstr(text, "Edges within 5 m: 512^3 voxels open, 1 x 1 taps: 20 ns"));
    assert_non_null(strstr(text, "10 times the sharpest"));
    assert_non_null(strstr(text, "Not reached: 8192-open"));
    assert_null(strstr(text, "Not told"));
    assert_null(strstr(text, "3 x 3"));
}

static void summary_repeats_nothing_and_owns_up_to_noise(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    study.results[0].view.spread = 0.4;
    umbt_study_summary(&study, text, sizeof text);
    assert_non_null(strstr(text, "times of 1 of 5 settings on one thread and of 0 on all"));
    assert_null(strstr(text, "20 ns"));             /* the unsteady one's */
    assert_null(strstr(text, "Edges within 50 m")); /* the same as within 10 m */
}

static void summary_says_what_peers_of_the_same_voxels_cost(void **state)
{
    static const struct umbt_study_result more[] = {
        {.method = UMBT_STUDY_DEPTH_MAP,
         .bake = 1,
         .taps = 1,
         .view = {5.0, 0.1},
         .bytes = 35000000,
         .off_p95_m = 0.1},
        {.method = UMBT_STUDY_DEPTH_MAP,
         .bake = 1,
         .taps = 9,
         .view = {25.0, 0.9},
         .bytes = 35000000,
         .off_p95_m = 0.1},
    };
    char text[4096];
    (void)state;
    fill_results();
    study.results[2].bytes = 4000000;
    study.missing = "NanoVDB was not measured: it is not here.";
    memcpy(study.results + study.result_count, more, sizeof more);
    study.result_count += 2;
    umbt_study_summary(&study, text, sizeof text);
    /* A peer is no setting: the sharpest is an asset's. */
    assert_non_null(strstr(text, "edges within 0.4 m: 4096^3 voxels open, 1 x 1 taps: 50 ns"));
    assert_non_null(strstr(text, "A plain depth map (AVX2) of the same 4096^3 voxels: 35 MB in "
                                 "memory, the open asset 4 MB; 1 x 1 taps 5 ns against 50 ns, "
                                 "9 x 9 taps an unsteady time against 90 ns.\n"));
    assert_non_null(strstr(text, "\nNanoVDB was not measured: it is not here.\n"));
    assert_null(strstr(text, "A NanoVDB mask grid"));
}

static void summary_fits_any_buffer(void **state)
{
    char whole[4096], part[4096];
    (void)state;
    fill_results();
    umbt_study_summary(&study, whole, sizeof whole);
    for (size_t size = 1; size < strlen(whole); size++) {
        memset(part, '#', sizeof part);
        umbt_study_summary(&study, part, size);
        assert_int_equal(strlen(part), size - 1);
        assert_memory_equal(part, whole, size - 1);
        assert_int_equal(part[size], '#');
    }
}

/* Answers of a coarse level far from every boundary and close to one. */
static void one_half_is_no_side_and_is_off_by_the_way_to_the_boundary(void **state)
{
    static const float answers[] = {0.5F, 0.5F, 1.0F, 0.0F, 1.0F, 0.0F, 0.5F, 0.5F};
    static const float area[] = {1.0F, 0.0F, 1.0F, 0.0F, 0.0F, 1.0F, 1.0F, 1.0F};
    static const uint8_t lit[] = {1, 0, 1, 0, 0, 1, 1, 1};
    static const uint8_t undefined[] = {0, 0, 0, 0, 0, 0, 0, 1};
    const float boundary[] = {7.0F, 3.0F, 9.0F, 9.0F, 1.0F, 2.0F, INFINITY, 100.0F};
    const struct umbt_judged judged = {8, answers, area, lit, boundary, undefined};
    struct umbt_study_result result = {0};
    float wrong[8];
    (void)state;
    umbt_errors_area(&judged, &result);
    umbt_errors_edges(&judged, wrong, &result);
    assert_int_equal(result.judged, 7);
    assert_int_equal(result.undefined, 1);
    assert_true(fabs(result.false_light - 1.0 / 7.0) < 1e-12);
    assert_true(fabs(result.false_shadow - 1.0 / 7.0) < 1e-12);
    assert_true(fabs(result.undecided - 3.0 / 7.0) < 1e-12);
    assert_true(result.off_max_m == 7.0);
    assert_true(result.off_p50_m == 3.0); /* of 1, 2, 3, 7 */
    assert_true(fabs(result.off_unknown - 1.0 / 5.0) < 1e-12);
    assert_true(fabs(result.over_05 - 2.0 / 7.0) < 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(summary_names_the_cheapest_setting_below_each_error),
        cmocka_unit_test(summary_repeats_nothing_and_owns_up_to_noise),
        cmocka_unit_test(summary_says_what_peers_of_the_same_voxels_cost),
        cmocka_unit_test(summary_fits_any_buffer),
        cmocka_unit_test(one_half_is_no_side_and_is_off_by_the_way_to_the_boundary),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
