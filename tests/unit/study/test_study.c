/* SPDX-License-Identifier: Apache-2.0 */
/* The study's samples, compared with a scene whose shadow is known; and its summary of made-up
 * results. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "study/study.h"
#include "study/study_probe.h"

static struct umbt_study study;

static void fill_results(void)
{
    static const struct umbt_study_result results[] = {
        {.bake = 0, .taps = 1, .wrong = 0.16, .wrong_view = 0.08, .view = {20.0, 0.01}},
        {.bake = 0, .taps = 9, .wrong = 0.30, .wrong_view = 0.15, .view = {40.0, 0.01}},
        {.bake = 1, .taps = 1, .wrong = 0.04, .wrong_view = 0.02, .view = {25.0, 0.01}},
        {.bake = 1, .taps = 9, .wrong = 0.08, .wrong_view = 0.04, .view = {90.0, 0.01}},
        {.bake = 2, .taps = 1, .wrong = 0.01, .wrong_view = 0.005, .view = {30.0, 0.01}},
        /* Fast, but half of its answers are wrong. */
        {.bake = 2, .taps = 3, .wrong = 0.5, .wrong_view = 0.5, .view = {1.0, 0.01}},
    };
    memset(&study, 0, sizeof study);
    study.bake_count = 4;
    for (uint32_t b = 0; b < 3; b++) {
        study.bakes[b].resolution = 512U << (2 * b);
        study.bakes[b].info.packed_bytes = 1000000ULL << b;
        study.bakes[b].cpu_s = 1.0 + b;
    }
    study.bakes[3].resolution = 16384;
    (void)snprintf(study.bakes[3].name, sizeof study.bakes[3].name, "16384-auto");
    (void)snprintf(study.bakes[3].reason, sizeof study.bakes[3].reason, "no room");
    memcpy(study.results, results, sizeof results);
    study.result_count = sizeof results / sizeof results[0];
    for (uint32_t i = 0; i < study.result_count; i++) {
        study.results[i].judged = 10000;
    }
    study.points.reach_m = 100.0;
    study.rays[UMBT_RAYS_VIEW].ns = 500.0;
    study.rays[UMBT_RAYS_VIEW8].ns = 600.0; /* the better way counts */
}

static void expect(const char *text, const char *sentence)
{
    if (strstr(text, sentence) == NULL) {
        fail_msg("'%s' is not in:\n%s", sentence, text);
    }
}

/* Three steps, each with a quarter of the wrong answers, twice the bytes and a little more time. */
static void summary_begins_with_what_the_resolution_costs_and_buys(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    umbt_study_summary(&study, text, sizeof text);
    const char *first = "8192 voxels a side instead of 512: 4 times the bytes (1 to 4 MB on disk), "
                        "1.5 times the time of a look-up (20 to 30 ns) and 3 times the bake (1 to "
                        "3 s of processor time). They buy 16 times fewer wrong answers: 0.5 % "
                        "instead of 8 % of what the cameras see is wrong.\n";
    assert_int_equal(strncmp(text, first, strlen(first)), 0);
    /* To reduce the error to a quarter takes four times the voxels; to halve it takes twice as
     * many. */
    expect(text, "\nHalf the error costs: 2 times the voxels a side, and with them 1.4 times the "
                 "bytes, 1.1 times the time");
}

static void summary_says_where_voxels_buy_nothing(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    for (uint32_t i = 0; i < study.result_count; i++) {
        study.results[i].wrong = study.results[i].wrong_view = 0.0;
    }
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "They buy nothing here: none of what the cameras see is wrong at either.");
    expect(text, "\nHalf the error costs: not told, because too few answers are wrong.\n");
    assert_null(strstr(text, "Not monotone"));
    fill_results();
    study.results[2].wrong_view = study.results[4].wrong_view = 0.0;
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "They remove every wrong answer: none instead of 8 % of what");
}

static void summary_owns_up_to_a_rise(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    study.results[2].wrong = 0.17;
    study.results[0].judged = study.results[2].judged = 100;
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "Not monotone: with 1 x 1 taps, 512 voxels a side have 16 % of all samples wrong, "
                 "2048 have 17 %: within the chance of the sample.");
    study.results[0].judged = study.results[2].judged = 1000000;
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "2048 have 17 %: more than the chance of the sample.");
    study.results[0].undefined = 10001;
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "2048 have 17 %: fewer samples are left out");
    assert_null(strstr(text, "of what the cameras see wrong"));
    study.results[2].wrong_view = 0.09;
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "512 voxels a side have 8 % of what the cameras see wrong, 2048 have 9 %");
}

static void summary_names_the_fastest_setting_below_each_error(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "At most 10 % wrong: 512 voxels a side, 1 x 1 taps: 20 ns a point, 1 MB on disk; "
                 "with wide filters 2048 voxels a side, 9 x 9 taps: 90 ns");
    expect(text, "At most 5 % wrong: 2048 voxels a side, 1 x 1 taps: 25 ns a point, 2 MB on disk; "
                 "with wide filters as in the line above.");
    expect(text, "At most 2 % wrong: 2048 voxels a side, 1 x 1 taps: 25 ns");
    expect(text, "At most 1 % wrong: 8192 voxels a side, 1 x 1 taps: 30 ns");
    assert_null(strstr(text, "At most 0.2 % wrong")); /* no setting has it */
    expect(text, "Sharpest of these: 8192 voxels a side, 1 x 1 taps: 30 ns a point, 4 MB on disk; "
                 "wrong are 0.5 %");
    expect(text, "17 times the sharpest");
    expect(text, "Not reached: 16384-auto: no room.");
    assert_null(strstr(text, "Unsteady"));
    assert_null(strstr(text, "3 x 3"));
}

static void summary_repeats_nothing_and_owns_up_to_noise(void **state)
{
    char text[4096];
    (void)state;
    fill_results();
    study.results[0].view.spread = 0.4;
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "of 6 settings, 1 on one thread and 0 on all threads have least runs");
    expect(text, "20 ns a point");                       /* the unsteady one's, all the same */
    assert_null(strstr(text, "At most 5 % wrong: 512")); /* the same as for 10 % */
    study.results[3].view.ns = 22.0; /* the fastest below 5 %, and its filter is wide */
    umbt_study_summary(&study, text, sizeof text);
    expect(text, "At most 5 % wrong: 2048 voxels a side, 9 x 9 taps: 22 ns a point, 2 MB on "
                 "disk.\n");
}

static void summary_says_what_peers_of_the_same_voxels_cost(void **state)
{
    static const struct umbt_study_result more[] = {
        {.method = UMBT_STUDY_DEPTH_MAP,
         .bake = 1,
         .taps = 1,
         .view = {5.0, 0.1},
         .bytes = 35000000},
        {.method = UMBT_STUDY_DEPTH_MAP,
         .bake = 1,
         .taps = 9,
         .view = {25.0, 0.1},
         .bytes = 35000000},
    };
    char text[4096];
    (void)state;
    fill_results();
    study.results[2].bytes = 4000000;
    study.missing = "NanoVDB was not measured: it is not here.";
    memcpy(study.results + study.result_count, more, sizeof more);
    study.result_count += 2;
    umbt_study_summary(&study, text, sizeof text);
    /* A peer is not a setting: the sharpest setting must be an asset's. */
    expect(text, "Sharpest of these: 8192 voxels a side, 1 x 1 taps: 30 ns");
    expect(text, "A plain depth map (AVX2) of the same 2048 voxels a side: 35 MB in memory, the "
                 "open asset 4 MB; 1 x 1 taps 5 ns against 25 ns, 9 x 9 taps 25 ns against "
                 "90 ns.\n");
    expect(text, "\nNanoVDB was not measured: it is not here.\n");
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

static void errors_of(size_t count, const float *answers, const float *truth, const float *boundary,
                      const uint8_t *undefined, struct umbt_study_result *result)
{
    float off[256];
    const struct umbt_judged judged = {.count = count,
                                       .border = count / 2,
                                       .reach_m = 50.0,
                                       .answers = answers,
                                       .area = truth,
                                       .sharp = truth,
                                       .boundary_m = boundary,
                                       .undefined = undefined};
    memset(result, 0, sizeof *result);
    umbt_errors_area(&judged, result);
    umbt_errors_edges(&judged, off, result);
}

/* The answers of a coarse level, far from every boundary and close to one. */
static void one_half_is_no_side_and_is_off_by_the_way_to_the_boundary(void **state)
{
    static const float answers[] = {0.5F, 0.5F, 1.0F, 0.0F, 1.0F, 0.0F, 0.5F, 0.5F};
    static const float truth[] = {1.0F, 0.0F, 1.0F, 0.0F, 0.0F, 1.0F, 1.0F, 1.0F};
    static const uint8_t undefined[] = {0, 0, 0, 0, 0, 0, 0, 1};
    const float boundary[] = {7.0F, 3.0F, 9.0F, 9.0F, 1.0F, 2.0F, INFINITY, 100.0F};
    struct umbt_study_result result;
    (void)state;
    errors_of(8, answers, truth, boundary, undefined, &result);
    assert_int_equal(result.judged, 7);
    assert_int_equal(result.undefined, 1);
    assert_true(fabs(result.false_light - 1.0 / 7.0) < 1e-12);
    assert_true(fabs(result.false_shadow - 1.0 / 7.0) < 1e-12);
    assert_true(fabs(result.undecided - 3.0 / 7.0) < 1e-12);
    assert_true(fabs(result.wrong - 5.0 / 7.0) < 1e-12);
    assert_true(fabs(result.wrong_view - 2.0 / 4.0) < 1e-12);
    assert_true(fabs(result.wrong_border - 3.0 / 3.0) < 1e-12);
    assert_true(fabs(result.off_unknown - 1.0 / 7.0) < 1e-12);
    assert_true(result.off_max_m == 50.0); /* no boundary within reach: the reach counts */
    assert_true(fabs(result.off_mean_m - (7.0 + 3.0 + 1.0 + 2.0 + 50.0) / 7.0) < 1e-12);
    assert_true(fabs(result.over_05 - 2.0 / 7.0) < 1e-12);
}

/* Errors are over all samples: with fewer wrong answers they fall, even if those that remain are
 * the far ones. A statistic of the wrong answers alone would rise here. */
static void fewer_wrong_answers_are_a_smaller_error(void **state)
{
    float answers[256], truth[256], boundary[256];
    const uint8_t undefined[256] = {0};
    struct umbt_study_result many, few, none;
    (void)state;
    for (int i = 0; i < 256; i++) {
        truth[i] = (float)(i % 2);
        boundary[i] = i < 16 ? 4.0F : 1.0F;
        answers[i] = i < 64 ? 1.0F - truth[i] : truth[i];
    }
    errors_of(256, answers, truth, boundary, undefined, &many);
    memcpy(answers + 8, truth + 8, 248 * sizeof *answers);
    errors_of(256, answers, truth, boundary, undefined, &few);
    errors_of(256, truth, truth, boundary, undefined, &none);
    assert_true(many.wrong == 0.25 && few.wrong == 0.03125);
    assert_true(many.off_mean_m == (16 * 4.0 + 48 * 1.0) / 256);
    assert_true(few.off_mean_m == 8 * 4.0 / 256);
    assert_true(many.off_p95_m == 4.0 && few.off_p95_m == 0.0 && few.off_p99_m == 4.0);
    assert_true(none.wrong == 0.0 && none.off_mean_m == 0.0 && none.off_max_m == 0.0);
}

/* An interrupted run takes longer; the least time of the runs counts. */
static void the_least_run_counts(void **state)
{
    double ns[7] = {90.0, 10.5, 10.0, 400.0, 11.0, 35.0, 20.0};
    (void)state;
    const struct umbt_time time = umbt_least(ns, 7);
    assert_true(time.ns == 10.0);
    assert_true(fabs(time.spread - 0.1) < 1e-12); /* 11 beside 10 */
}

static void instructions_are_counted_or_the_reason_is_given(void **state)
{
    char reason[160] = "untouched";
    volatile uint32_t sum = 0;
    (void)state;
    const int counter = umbt_instructions_open(reason, sizeof reason);
    const uint64_t before = umbt_instructions_read(counter);
    for (uint32_t i = 0; i < 100000; i++) {
        sum += i;
    }
    const uint64_t count = umbt_instructions_read(counter) - before;
    assert_int_equal(sum, 704982704); /* the loop ran: 4999950000 modulo 2^32 */
    if (counter < 0) {
        assert_true(strlen(reason) > 10 && strcmp(reason, "untouched") != 0 && count == 0);
    } else {
        assert_true(reason[0] == '\0' && count >= 200000 && count < 10000000);
        (void)close(counter);
    }
}

static void map_stands_beside_a_dag_of_equal_texels_and_of_equal_bytes(void **state)
{
    static struct umbt_study_bake bakes[4] = {
        {.resolution = 512}, {.resolution = 512}, {.resolution = 1024}, {.resolution = 2048}};
    static const uint64_t bytes[4] = {100, 300, 900, 4000};
    (void)state;
    memset(&study, 0, sizeof study);
    bakes[0].frusta[0].closed = 1;
    study.technique_resolution = 512;
    study.techniques[study.technique_count++] =
        (struct umbt_study_technique){.truth = UMBT_BOX, .result = {.info = {.bytes = 1000}}};
    for (int i = 0; i < 4; i++) {
        study.techniques[study.technique_count++] = (struct umbt_study_technique){
            .truth = UMBT_BOX, .bake = &bakes[i], .result = {.info = {.bytes = bytes[i]}}};
    }
    study.techniques[study.technique_count++] =
        (struct umbt_study_technique){.truth = UMBT_POINT, .result = {.info = {.bytes = 1000}}};
    umbt_study_techniques_pair(&study);
    assert_int_equal(study.techniques[0].same_texels, 2); /* the open one, as a map is */
    assert_int_equal(study.techniques[0].same_bytes, 3);
    assert_int_equal(study.techniques[5].same_texels, -1); /* no DAG with this truth */
    assert_int_equal(study.techniques[5].same_bytes, -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(summary_begins_with_what_the_resolution_costs_and_buys),
        cmocka_unit_test(summary_says_where_voxels_buy_nothing),
        cmocka_unit_test(summary_owns_up_to_a_rise),
        cmocka_unit_test(summary_names_the_fastest_setting_below_each_error),
        cmocka_unit_test(summary_repeats_nothing_and_owns_up_to_noise),
        cmocka_unit_test(summary_says_what_peers_of_the_same_voxels_cost),
        cmocka_unit_test(summary_fits_any_buffer),
        cmocka_unit_test(one_half_is_no_side_and_is_off_by_the_way_to_the_boundary),
        cmocka_unit_test(fewer_wrong_answers_are_a_smaller_error),
        cmocka_unit_test(the_least_run_counts),
        cmocka_unit_test(instructions_are_counted_or_the_reason_is_given),
        cmocka_unit_test(map_stands_beside_a_dag_of_equal_texels_and_of_equal_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
