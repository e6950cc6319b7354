/* SPDX-License-Identifier: Apache-2.0 */
/* A bake on an imitated farm in this file: which time counts as the bake's, and what happens when
 * the farm's answer was lost. The whole executor: tests/system/test_slurm_executor.py. */
#define _GNU_SOURCE /* syscall */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
#include <cmocka.h>

#include "jobs/bake_try.h"
#include "jobs/folder.h"

#define TILES       4
#define JOB_TIME_MS 3000
#define TOO_LARGE   "umbrage-bake: cannot write 'out.umb': File too large\n"

struct fixture {
    struct umbj_farm farm; /* first: the calls get it */
    char folder[64], program[96], bundle[96], work[96];
    struct umbj_try_options options;
    struct umbj_work order;
    struct umbj_try try;
    int64_t wait_ms; /* in the queue, before the tiles are done */
    int64_t since_ms;
    int state;  /* of tasks until then */
    int mute;   /* 1: takes the next array and says that it did not */
    int silent; /* questions that get no answer */
    int full;   /* so many arrays are refused but for TILES / 2 tasks, and time goes by */
    int stop_at_submit, too_large;
    const char *bad_end, *bad_text; /* of task 0, as often as bad_ends says */
    int bad_ends;
    int losing;                 /* tasks that are taken are never heard of again */
    int bad_merges, once_taken; /* tasks may be given out again in the next round */
    time_t skip_s;              /* of the clock, with each question */
    size_t arrays, merges, questions;
    uint8_t taken[TILES];
};

static _Atomic time_t skipped_s; /* of the clock, for the whole program */

int clock_gettime(clockid_t clock, struct timespec *now)
{
    const int code = (int)syscall(SYS_clock_gettime, clock, now);
    now->tv_sec += skipped_s;
    return code;
}

static int64_t now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static void put_end(const struct umbj_farm_stage *stage, const char *end, const char *said)
{
    char path[300];
    snprintf(path, sizeof path, "%s/%s", stage->folder, end);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(said, file);
    assert_int_equal(fclose(file), 0);
}

/* A limit of tasks in the queue that is reached for minutes. */
static enum umb_status take_half(struct fixture *f, uint8_t *wanted, struct umb_error *error)
{
    for (uint32_t i = 0; i < TILES / 2; i++) {
        f->taken[i] |= wanted[i];
        wanted[i] = 0;
    }
    skipped_s += 100;
    f->full--;
    return umb_fail(error, UMB_E_UNAVAILABLE, "there are enough of yours");
}

static enum umb_status submit_array(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                                    uint8_t *wanted, struct umb_error *error)
{
    struct fixture *f = (struct fixture *)self;
    const uint64_t one = 1;
    f->arrays++;
    if (f->once_taken) {
        memset(f->taken, 0, sizeof f->taken);
    }
    f->since_ms = now_ms();
    if (f->full > 0) {
        return take_half(f, wanted, error);
    }
    for (uint32_t i = 0; i < stage->count; i++) {
        assert_true(f->losing || !(f->taken[i] && wanted[i])); /* no twins */
        f->taken[i] |= wanted[i];
    }
    if (f->stop_at_submit) {
        assert_int_equal(write(f->try.stop, &one, sizeof one), sizeof one);
    }
    if (f->mute || f->stop_at_submit) {
        f->mute = 0;
        return umb_fail(error, UMB_E_UNAVAILABLE, "the answer was lost");
    }
    memset(wanted, 0, stage->count);
    return UMB_OK;
}

static enum umb_status submit_merge(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                                    struct umb_error *error)
{
    struct fixture *f = (struct fixture *)self;
    (void)error;
    f->merges++;
    if (f->bad_merges > 0) {
        f->bad_merges--;
        put_end(stage, "fail.0.75.1-0", "a tile is missing\n");
        return UMB_OK;
    }
    put_end(stage, f->too_large ? "fail.0.74.1-0" : "done.0", f->too_large ? TOO_LARGE : "");
    return UMB_OK;
}

static enum umb_status submit(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                              uint8_t *wanted, struct umb_error *error)
{
    return wanted != NULL ? submit_array(self, stage, wanted, error)
                          : submit_merge(self, stage, error);
}

static enum umb_status status(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                              uint8_t *known, struct umb_error *error)
{
    struct fixture *f = (struct fixture *)self;
    f->questions++;
    skipped_s += f->skip_s;
    memset(known, UMBJ_TASK_UNKNOWN, stage->count);
    if (f->silent > 0) {
        f->silent--;
        return umb_fail(error, UMB_E_UNAVAILABLE, "nobody answers");
    }
    for (uint32_t i = 0; i < stage->count; i++) {
        known[i] = f->taken[i] ? (uint8_t)f->state : UMBJ_TASK_UNKNOWN;
        if (f->losing) {
            known[i] = UMBJ_TASK_UNKNOWN;
            continue;
        }
        if (i == 0 && f->taken[0] && f->bad_ends > 0) {
            f->bad_ends--;
            f->taken[0] = 0;
            known[0] = UMBJ_TASK_UNKNOWN;
            put_end(stage, f->bad_end, f->bad_text);
            continue;
        }
        if (f->taken[i] && now_ms() - f->since_ms >= f->wait_ms) {
            char end[32];
            snprintf(end, sizeof end, "done.%u", i);
            put_end(stage, end, "");
        }
    }
    return UMB_OK;
}

static void cancel(struct umbj_farm *self, const char *name)
{
    (void)self;
    (void)name;
}

static enum umb_status reconcile(struct umbj_farm *self, const char *work, int stop,
                                 struct umb_error *error)
{
    (void)self;
    (void)work;
    (void)stop;
    (void)error;
    return UMB_OK;
}

static void ignore(void *user, const struct umbj_report *report)
{
    (void)user;
    (void)report;
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-farm-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->bundle, sizeof f->bundle, "%s/bundle", f->folder);
    snprintf(f->work, sizeof f->work, "%s/work", f->folder);
    snprintf(f->program, sizeof f->program, "%s/bake", f->folder);
    assert_int_equal(mkdir(f->bundle, 0700), 0);
    assert_int_equal(mkdir(f->work, 0700), 0);
    FILE *file = fopen(f->program, "w");
    assert_non_null(file);
    fprintf(file, "#!/bin/sh\n[ \"$1\" != --plan ] || echo tiles 0 %d 0 >&%d\n", TILES,
            UMBJ_WORKER_FD_PROGRESS);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(chmod(f->program, 0700), 0);
    f->farm = (struct umbj_farm){
        .submit = submit, .status = status, .cancel = cancel, .reconcile = reconcile};
    f->options = (struct umbj_try_options){.program = f->program,
                                           .work = f->work,
                                           .farm = &f->farm,
                                           .workers = 1,
                                           .threads = 1,
                                           .tile = 256,
                                           .interval_ms = 40,
                                           .timeout_ms = JOB_TIME_MS,
                                           .max_output_bytes = 1 << 20,
                                           .report = ignore};
    f->order = (struct umbj_work){.job = "00ff",
                                  .epoch = 1,
                                  .bundle = f->bundle,
                                  .folder = f->work,
                                  .scene = "a.obj",
                                  .settings = ""};
    f->state = UMBJ_TASK_RUNS;
    f->try = (struct umbj_try){
        .options = &f->options, .work = &f->order, .stop = eventfd(0, EFD_CLOEXEC)};
    assert_true(f->try.stop >= 0);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    close(f->try.stop);
    umbj_folder_remove(AT_FDCWD, f->folder);
    free(f);
    return 0;
}

static void expect(struct fixture *f, enum umbj_failure failure)
{
    const enum umbj_failure got = umbj_bake_on_farm(&f->try);
    if (got != failure) {
        print_message("%s\n", f->try.cause);
    }
    assert_int_equal(got, failure);
}

static void waiting_in_the_queue_is_not_the_bakes_time(void **state)
{
    struct fixture *f = *state;
    f->state = UMBJ_TASK_WAITS;
    f->wait_ms = JOB_TIME_MS + 300;
    expect(f, UMBJ_NO_FAILURE);
    assert_int_equal(f->merges, 1);
}

static void running_is_the_bakes_time(void **state)
{
    struct fixture *f = *state;
    f->options.timeout_ms = JOB_TIME_MS / 3;
    f->wait_ms = INT64_MAX;
    expect(f, UMBJ_TIMEOUT);
    assert_non_null(strstr(f->try.cause, "--job-time"));
}

static void tasks_whose_submission_was_not_answered_are_not_submitted_again(void **state)
{
    struct fixture *f = *state;
    f->mute = 1;
    f->silent = 3; /* nor is there an answer for a while whether they are there */
    f->wait_ms = 300;
    expect(f, UMBJ_NO_FAILURE);
    assert_int_equal(f->arrays, 1);
    assert_true(f->questions > 3);
}

static void a_farm_that_is_full_of_the_bakes_own_tasks_is_waited_for(void **state)
{
    static const int states[] = {UMBJ_TASK_WAITS, UMBJ_TASK_RUNS};
    struct fixture *f = *state;
    f->options.timeout_ms = 3600 * 1000;
    for (int i = 0; i < 2; i++) {
        memset(f->taken, 0, sizeof f->taken);
        f->state = states[i];
        f->full = 4;
        expect(f, UMBJ_NO_FAILURE);
        assert_int_equal(f->full, 0);
    }
}

static void a_try_that_is_stopped_while_it_submits_is_cancelled(void **state)
{
    struct fixture *f = *state;
    f->stop_at_submit = 1;
    f->wait_ms = INT64_MAX;
    expect(f, UMBJ_CANCELLED);
    assert_int_equal(f->merges, 0);
}

static void a_file_beyond_the_limit_is_no_reason_to_try_again(void **state)
{
    struct fixture *f = *state;
    f->too_large = 1;
    expect(f, UMBJ_REJECTED);
    assert_non_null(strstr(f->try.cause, "1048576 bytes (--max-asset)"));
    /* On this machine likewise. */
    FILE *file = fopen(f->program, "w");
    assert_non_null(file);
    fprintf(file, "#!/bin/sh\necho \"" TOO_LARGE "\" >&2\nexit 74\n");
    assert_int_equal(fclose(file), 0);
    f->try.cause[0] = '\0';
    assert_int_equal(umbj_bake_here(&f->try), UMBJ_REJECTED);
    assert_non_null(strstr(f->try.cause, "--max-asset"));
}

/* Reports each end of task 0 once, or as often as needed. */
static void what_a_task_says_decides_what_becomes_of_the_bake(void **state)
{
    static const struct {
        const char *end, *text;
        int times;
        enum umbj_failure failure;
    } cases[] = {
        {"fail.0.75.1-0", "umbrage-bake: no room\n\n", 1, UMBJ_NO_FAILURE},
        {"fail.0.74.1-0", "", 2, UMBJ_NO_FAILURE},
        {"fail.0.73.1-0", "no end of line", 1, UMBJ_NO_FAILURE},
        {"fail.0.75.1-0", "umbrage-bake: no room\n", 9, UMBJ_TEMPORARY},
        {"fail.0.65.1-0", "first\numbrage-bake: it is no scene\n", 1, UMBJ_REJECTED},
        {"fail.0.137.1-0", "", 1, UMBJ_MEMORY},
        {"fail.0.139.1-0", "", 1, UMBJ_CRASH},
        {"fail.0.70.1-0", "umbrage-bake: disagrees\n", 1, UMBJ_INTERNAL},
    };
    struct fixture *f = *state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        memset(f->taken, 0, sizeof f->taken);
        f->bad_end = cases[i].end;
        f->bad_text = cases[i].text;
        f->bad_ends = cases[i].times;
        umbj_folder_remove(AT_FDCWD, f->work);
        assert_int_equal(mkdir(f->work, 0700), 0);
        expect(f, cases[i].failure);
    }
    assert_non_null(strstr(f->try.cause, "disagrees"));
}

static void names_that_are_no_ends_are_not_believed(void **state)
{
    static const char *const names[] = {"done.99", "done.x",    "fail.99.65.1-0", "fail.0.999.1-0",
                                        "fail.0",  "log.0.1-0", "done.4294967296"};
    struct fixture *f = *state;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        memset(f->taken, 0, sizeof f->taken);
        f->bad_end = names[i];
        f->bad_text = "";
        f->bad_ends = 1; /* the task is lost besides, and given out again */
        expect(f, UMBJ_NO_FAILURE);
    }
}

static void tasks_that_are_lost_too_often_end_the_try(void **state)
{
    struct fixture *f = *state;
    f->losing = 1;
    expect(f, UMBJ_LOST);
    assert_non_null(strstr(f->try.cause, "was lost"));
    assert_int_equal(f->arrays, 4);
}

static void a_merge_without_its_tiles_bakes_them_again(void **state)
{
    struct fixture *f = *state;
    f->order.cache = f->bundle;
    f->options.timeout_ms = 60000;
    f->bad_merges = 3;
    f->once_taken = 1;
    expect(f, UMBJ_TEMPORARY);
    assert_int_equal(f->merges, 3);
    f->bad_merges = 1;
    expect(f, UMBJ_NO_FAILURE);
    assert_int_equal(f->merges, 5);
}

static void tiles_that_cannot_be_kept_are_baked_in_one_task(void **state)
{
    static const char *const settings[] = {"--depth=embree\n", "--static\n",
                                           "--effect=static=on\n"};
    struct fixture *f = *state;
    for (int i = 0; i < 3; i++) {
        f->order.settings = settings[i];
        expect(f, UMBJ_NO_FAILURE);
    }
    assert_int_equal(f->arrays, 0);
    assert_int_equal(f->merges, 3);
}

static void put_program(struct fixture *f, const char *script)
{
    FILE *file = fopen(f->program, "w");
    assert_non_null(file);
    fprintf(file, "#!/bin/sh\n%s\n", script);
    assert_int_equal(fclose(file), 0);
}

static void what_the_plan_refuses_never_reaches_the_farm(void **state)
{
    static const char *const scripts[] = {"[ \"$1\" != import ] || exit 65",
                                          "[ \"$1\" != --plan ] || exit 2",
                                          "[ \"$1\" != --plan ] || echo tiles 0 100001 0 >&3",
                                          "[ \"$1\" != --plan ] || echo tiles 0 0 0 >&3"};
    struct fixture *f = *state;
    for (size_t i = 0; i < sizeof scripts / sizeof scripts[0]; i++) {
        put_program(f, scripts[i]);
        expect(f, UMBJ_REJECTED);
    }
    assert_int_equal(f->arrays + f->merges, 0);
}

static void a_farm_that_never_answers_is_given_up(void **state)
{
    struct fixture *f = *state;
    f->silent = 1000000;
    f->skip_s = 50;
    f->options.timeout_ms = 3600 * 1000;
    f->wait_ms = INT64_MAX;
    expect(f, UMBJ_TEMPORARY);
}

int main(void)
{
#define FARM_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        FARM_TEST(waiting_in_the_queue_is_not_the_bakes_time),
        FARM_TEST(running_is_the_bakes_time),
        FARM_TEST(tasks_whose_submission_was_not_answered_are_not_submitted_again),
        FARM_TEST(a_farm_that_is_full_of_the_bakes_own_tasks_is_waited_for),
        FARM_TEST(a_try_that_is_stopped_while_it_submits_is_cancelled),
        FARM_TEST(a_file_beyond_the_limit_is_no_reason_to_try_again),
        FARM_TEST(what_a_task_says_decides_what_becomes_of_the_bake),
        FARM_TEST(names_that_are_no_ends_are_not_believed),
        FARM_TEST(tasks_that_are_lost_too_often_end_the_try),
        FARM_TEST(a_merge_without_its_tiles_bakes_them_again),
        FARM_TEST(tiles_that_cannot_be_kept_are_baked_in_one_task),
        FARM_TEST(what_the_plan_refuses_never_reaches_the_farm),
        FARM_TEST(a_farm_that_never_answers_is_given_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
