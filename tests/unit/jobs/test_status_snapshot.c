/* SPDX-License-Identifier: Apache-2.0 */
/* The snapshot of jobs: what it keeps, and how it handles a worker's wrong reports. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "jobs/status_snapshot.h"

static int setup(void **state)
{
    struct umb_error error;
    struct umbj_snapshot *snapshot = NULL;
    assert_int_equal(umbj_snapshot_create(&snapshot, &error), UMB_OK);
    *state = snapshot;
    return 0;
}

static int teardown(void **state)
{
    umbj_snapshot_destroy(*state);
    umbj_snapshot_destroy(NULL);
    return 0;
}

static struct umbj_job job_of(unsigned number, enum umbj_state state)
{
    struct umbj_job job = {.state = state, .epoch = 3, .owner = "ann"};
    snprintf(job.id, sizeof job.id, "%08x", number);
    return job;
}

static struct umbj_report report_of(unsigned number, enum umbj_report_kind kind, uint64_t done,
                                    uint64_t total, const char *text)
{
    struct umbj_report report = {.kind = kind, .epoch = 3, .done = done, .total = total};
    snprintf(report.job, sizeof report.job, "%08x", number);
    snprintf(report.text, sizeof report.text, "%s", text);
    return report;
}

/* A standing with copies of its texts. */
struct seen {
    struct umbj_standing standing;
    size_t plan, notices; /* bytes */
};

static void take(void *user, const struct umbj_standing *standing)
{
    struct seen *seen = user;
    seen->standing = *standing;
    seen->plan = standing->plan != NULL ? strlen(standing->plan) : 0;
    seen->notices = standing->notices != NULL ? strlen(standing->notices) : 0;
}

static struct seen look(struct umbj_snapshot *snapshot, unsigned number)
{
    struct seen seen = {.plan = 0};
    char id[UMBJ_ID_SIZE];
    snprintf(id, sizeof id, "%08x", number);
    assert_true(umbj_snapshot_look(snapshot, id, NULL, take, &seen));
    assert_true(umbj_snapshot_look(snapshot, id, "ann", take, &seen));
    assert_false(umbj_snapshot_look(snapshot, id, "bob", take, &seen));
    return seen;
}

static void oldest_finished_job_leaves_first(void **state)
{
    struct umbj_snapshot *snapshot = *state;
    struct seen seen;
    struct umbj_job running = job_of(0xffff, UMBJ_RUNNING);
    umbj_snapshot_set(snapshot, &running, 0);
    for (unsigned i = 0; i < UMBJ_SNAPSHOT_MAX + 2; i++) {
        struct umbj_job job = job_of(i, UMBJ_DONE);
        umbj_snapshot_set(snapshot, &job, 1); /* not served yet: it is not over */
        umbj_snapshot_set(snapshot, &job, 0);
        umbj_snapshot_set(snapshot, &job, 0); /* its end counts once */
    }
    assert_int_equal(umbj_snapshot_version(snapshot, "00000000"), 0);
    assert_int_equal(umbj_snapshot_version(snapshot, "00000001"), 0);
    assert_false(umbj_snapshot_look(snapshot, "00000001", NULL, take, &seen));
    assert_int_equal(look(snapshot, 2).standing.job.state, UMBJ_DONE);
    assert_int_equal(look(snapshot, 0xffff).standing.job.state, UMBJ_RUNNING);
}

static void numbers_of_a_worker_are_not_believed(void **state)
{
    struct umbj_snapshot *snapshot = *state;
    struct umbj_job job = job_of(1, UMBJ_RUNNING);
    umbj_snapshot_set(snapshot, &job, 0);
    struct umbj_report report = report_of(1, UMBJ_REPORT_PHASE, 0, 0, "bake");
    (void)umbj_snapshot_report(snapshot, &report, 1000);
    report =
        report_of(1, UMBJ_REPORT_PROGRESS, 50, 10, "a unit that is longer than its field may be");
    (void)umbj_snapshot_report(snapshot, &report, 1000); /* no time has passed */
    struct seen seen = look(snapshot, 1);
    assert_int_equal(seen.standing.done, 10);
    assert_int_equal(strlen(seen.standing.unit), UMBJ_PHASE_SIZE - 1);
    assert_int_equal(seen.standing.left_ms, -1);
    report = report_of(1, UMBJ_REPORT_PROGRESS, 5, 10, "tile");
    (void)umbj_snapshot_report(snapshot, &report, 3000);
    assert_int_equal(look(snapshot, 1).standing.left_ms, 2000);
    report = report_of(1, UMBJ_REPORT_TILES, 9, 4, "");
    report.found = 7;
    struct umbj_tiles more = umbj_snapshot_report(snapshot, &report, 3000);
    assert_true(more.done == 4 && more.found == 4);
    report = report_of(1, UMBJ_REPORT_TILES, 2, 4, ""); /* fewer than before */
    more = umbj_snapshot_report(snapshot, &report, 3000);
    assert_true(more.done == 0 && more.found == 0);
    assert_int_equal(umbj_snapshot_tiles(snapshot).done, 2);
    /* Reports of an older try, and of a job that is not there, change nothing. */
    const uint64_t version = look(snapshot, 1).standing.version;
    report.epoch = 2;
    (void)umbj_snapshot_report(snapshot, &report, 4000);
    report = report_of(2, UMBJ_REPORT_TASK, 1, 2, "");
    (void)umbj_snapshot_report(snapshot, &report, 4000);
    assert_int_equal(look(snapshot, 1).standing.version, version);
}

static void plan_without_end_is_cut_and_each_try_begins_anew(void **state)
{
    struct umbj_snapshot *snapshot = *state;
    struct umbj_job job = job_of(1, UMBJ_RUNNING);
    char line[UMBJ_CAUSE_SIZE];
    memset(line, 'x', sizeof line - 1);
    line[sizeof line - 1] = '\0';
    umbj_snapshot_set(snapshot, &job, 0);
    struct umbj_report report = report_of(1, UMBJ_REPORT_PHASE, 0, 0, "plan");
    (void)umbj_snapshot_report(snapshot, &report, 0);
    for (int i = 0; i < 2 * UMBJ_PLAN_MAX / UMBJ_CAUSE_SIZE; i++) {
        report = report_of(1, i % 2 == 0 ? UMBJ_REPORT_PLAN : UMBJ_REPORT_NOTICE, 0, 0, line);
        (void)umbj_snapshot_report(snapshot, &report, 0);
        (void)umbj_snapshot_report(snapshot, &report, 0);
        (void)umbj_snapshot_report(snapshot, &report, 0);
    }
    struct seen seen = look(snapshot, 1);
    assert_in_range(seen.plan, UMBJ_PLAN_MAX - UMBJ_CAUSE_SIZE - 1, UMBJ_PLAN_MAX - 1);
    assert_in_range(seen.notices, UMBJ_PLAN_MAX - UMBJ_CAUSE_SIZE - 1, UMBJ_PLAN_MAX - 1);
    report = report_of(1, UMBJ_REPORT_ENDED, 0, 0, "");
    (void)umbj_snapshot_report(snapshot, &report, 0);
    job.epoch = 4;
    umbj_snapshot_set(snapshot, &job, 0);
    report = report_of(1, UMBJ_REPORT_PHASE, 0, 0, "import");
    report.epoch = 4;
    (void)umbj_snapshot_report(snapshot, &report, 0);
    seen = look(snapshot, 1);
    assert_true(seen.plan == 0 && seen.notices == 0);
    assert_string_equal(seen.standing.phase, "import");
}

static void owners_are_kept_apart_even_of_assets_in_one_bucket(void **state)
{
    struct umbj_snapshot *snapshot = *state;
    const uint8_t one[UMBJ_HASH_BYTES] = {1, 2, 3}, other[UMBJ_HASH_BYTES] = {1, 2, 4};
    umbj_snapshot_own(snapshot, one, "ann");
    umbj_snapshot_own(snapshot, one, "ann");
    umbj_snapshot_own(snapshot, one, "bob");
    umbj_snapshot_own(snapshot, other, "ann");
    assert_true(umbj_snapshot_owns(snapshot, one, "ann"));
    assert_true(umbj_snapshot_owns(snapshot, other, "ann"));
    assert_false(umbj_snapshot_owns(snapshot, other, "bob"));
    umbj_snapshot_disown(snapshot, one, "ann");
    assert_false(umbj_snapshot_owns(snapshot, one, "ann"));
    assert_true(umbj_snapshot_owns(snapshot, one, "bob"));
    umbj_snapshot_disown(snapshot, one, NULL);
    assert_false(umbj_snapshot_owns(snapshot, one, "bob"));
    assert_true(umbj_snapshot_owns(snapshot, other, "ann"));
    umbj_snapshot_disown(snapshot, one, "ann"); /* a missing one is fine */
}

int main(void)
{
#define SNAPSHOT_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        SNAPSHOT_TEST(oldest_finished_job_leaves_first),
        SNAPSHOT_TEST(numbers_of_a_worker_are_not_believed),
        SNAPSHOT_TEST(plan_without_end_is_cut_and_each_try_begins_anew),
        SNAPSHOT_TEST(owners_are_kept_apart_even_of_assets_in_one_bucket),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
