/* SPDX-License-Identifier: Apache-2.0 */
/* A bake on a farm of this file's own: what counts as the bake's time, and what is done when the
 * farm's answer was lost. The whole executor: tests/system/test_slurm_executor.py. */
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
    f->since_ms = now_ms();
    if (f->full > 0) {
        return take_half(f, wanted, error);
    }
    for (uint32_t i = 0; i < stage->count; i++) {
        assert_int_equal(f->taken[i] && wanted[i], 0); /* no twins */
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
    put_end(stage, f->too_large ? "fail.0.74.1-0" : "done.0", f->too_large ? TOO_LARGE : "");
    return UMB_OK;
}

static enum umb_status status(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                              uint8_t *known, struct umb_error *error)
{
    struct fixture *f = (struct fixture *)self;
    f->questions++;
    memset(known, UMBJ_TASK_UNKNOWN, stage->count);
    if (f->silent > 0) {
        f->silent--;
        return umb_fail(error, UMB_E_UNAVAILABLE, "nobody answers");
    }
    for (uint32_t i = 0; i < stage->count; i++) {
        known[i] = f->taken[i] ? (uint8_t)f->state : UMBJ_TASK_UNKNOWN;
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
    f->farm = (struct umbj_farm){.submit_array = submit_array,
                                 .submit_merge = submit_merge,
                                 .status = status,
                                 .cancel = cancel,
                                 .reconcile = reconcile};
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
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
