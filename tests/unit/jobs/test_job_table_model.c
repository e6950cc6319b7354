/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the job table with a model, and kills the process in the middle. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <cmocka.h>

#include "job_table_fixture.h"

#define MODEL_JOBS 64

struct model_job {
    struct umbj_job job;
    int exists;
};

struct model {
    struct model_job jobs[MODEL_JOBS]; /* by content, of one owner each */
    unsigned count, random;
    int64_t now;
};

static unsigned draw(struct model *m, unsigned below)
{
    m->random = m->random * 1664525U + 1013904223U;
    return (m->random >> 8) % below;
}

static struct umbj_job *model_running(struct model *m)
{
    for (unsigned i = 0, first = draw(m, MODEL_JOBS); i < MODEL_JOBS; i++) {
        struct model_job *j = &m->jobs[(first + i) % MODEL_JOBS];
        if (j->exists && j->job.state == UMBJ_RUNNING) {
            return &j->job;
        }
    }
    return NULL;
}

static struct umbj_job *model_of(struct model *m, const char *id)
{
    for (unsigned i = 0; i < MODEL_JOBS; i++) {
        if (m->jobs[i].exists && strcmp(m->jobs[i].job.id, id) == 0) {
            return &m->jobs[i].job;
        }
    }
    fail_msg("a job that was never submitted: %s", id);
    return NULL;
}

static void model_fail(struct fixture *f, struct model *m, struct umbj_job *expected)
{
    const enum umbj_failure failure = (enum umbj_failure)(1 + draw(m, UMBJ_FAILURE_COUNT - 2));
    const int hard = failure == UMBJ_CRASH || failure == UMBJ_MEMORY || failure == UMBJ_SANDBOX;
    const int soft = failure == UMBJ_TEMPORARY || failure == UMBJ_IO || failure == UMBJ_LOST;
    struct umbj_job job = *expected;
    assert_int_equal(umbj_table_fail(f->table, &job, failure, "model", m->now, &f->error), UMB_OK);
    expected->tries++;
    expected->hard_tries += hard;
    if (expected->tries < UMBJ_TRIES_MAX && (soft || (hard && expected->hard_tries < 2))) {
        expected->state = UMBJ_QUEUED;
    } else {
        expected->state = hard || failure == UMBJ_LOST ? UMBJ_POISON : UMBJ_FAILED;
    }
    assert_int_equal(job.state, expected->state);
    *expected = job;
}

static void model_step(struct fixture *f, struct model *m)
{
    static const char *const owners[] = {"ann", "bob", "cyd"};
    struct umbj_job *running = model_running(m), job;
    int is_new;
    m->now += draw(m, 500);
    switch (draw(m, 6)) {
    case 0:
    case 1:
        if (m->count < MODEL_JOBS &&
            submit_as(f, owners[m->count % 3], m->count, (int)draw(m, 21) - 10, m->now, &job,
                      &is_new) == UMB_OK) {
            assert_int_equal(is_new, 1);
            m->jobs[m->count].exists = 1;
            m->jobs[m->count++].job = job;
        }
        break;
    case 2:
        if (umbj_table_claim(f->table, m->now, m->now, &job, &f->error) == UMB_OK) {
            struct umbj_job *expected = model_of(m, job.id);
            assert_int_equal(expected->state, UMBJ_QUEUED);
            assert_true(expected->not_before_ms <= m->now);
            assert_int_equal(job.epoch, expected->epoch + 1);
            *expected = job;
        } else {
            for (unsigned i = 0; i < m->count; i++) {
                assert_false(m->jobs[i].job.state == UMBJ_QUEUED &&
                             m->jobs[i].job.not_before_ms <= m->now);
            }
        }
        break;
    case 3:
        if (running != NULL) {
            finish(f, running, 900);
            running->state = UMBJ_DONE;
        }
        break;
    case 4:
        if (running != NULL) {
            model_fail(f, m, running);
        }
        break;
    default:
        if (m->count > 0) {
            struct umbj_job *any = &m->jobs[draw(m, m->count)].job;
            const int over = umbj_is_over(any->state);
            assert_int_equal(umbj_table_cancel(f->table, any->id, NULL, m->now, &job, &f->error),
                             UMB_OK);
            any->state = over ? any->state : UMBJ_FAILED;
            assert_int_equal(job.state, any->state);
        }
    }
}

static void random_work_agrees_with_a_model(void **state)
{
    struct fixture *f = *state;
    struct model *m = calloc(1, sizeof *m);
    assert_non_null(m);
    m->random = 20260131;
    for (int step = 0; step < 600; step++) {
        model_step(f, m);
        if (step % 97 == 0) {
            reopen(f);
        }
    }
    assert_int_equal(m->count, MODEL_JOBS);
    for (unsigned i = 0; i < m->count; i++) {
        struct umbj_job job;
        assert_int_equal(umbj_table_get(f->table, m->jobs[i].job.id, NULL, &job, &f->error),
                         UMB_OK);
        assert_int_equal(job.state, m->jobs[i].job.state);
        assert_int_equal(job.epoch, m->jobs[i].job.epoch);
    }
    free(m);
}

/* --- killed in the middle --- */

/* Submits and finishes jobs without end, and reports each acknowledgement. */
static void work_until_killed(const char *path, int tell)
{
    struct fixture f = {.table = NULL};
    snprintf(f.path, sizeof f.path, "%s", path);
    if (umbj_table_open(f.path, &limits, &f.table, &f.error) != UMB_OK) {
        _exit(1);
    }
    for (unsigned i = 0;; i++) {
        struct umbj_job job;
        int is_new;
        uint8_t asset[UMBJ_HASH_BYTES];
        key_of(i, asset);
        if (submit_as(&f, "ann", i, 0, 1000, &job, &is_new) != UMB_OK ||
            umbj_table_claim(f.table, 1000, 1000, &job, &f.error) != UMB_OK ||
            umbj_table_finish(f.table, &job, asset, 1, 1001, &f.error) != UMB_OK ||
            write(tell, job.id, sizeof job.id) != sizeof job.id) {
            _exit(1);
        }
    }
}

static void what_was_acknowledged_survives_kill_9(void **state)
{
    struct fixture *f = *state;
    umbj_table_close(f->table);
    f->table = NULL;
    for (long round = 1; round <= 4; round++) {
        int ends[2];
        char id[UMBJ_ID_SIZE], last[UMBJ_ID_SIZE] = "";
        unlink(f->path);
        assert_int_equal(pipe(ends), 0);
        pid_t child = fork();
        if (child == 0) {
            close(ends[0]);
            work_until_killed(f->path, ends[1]);
        }
        close(ends[1]);
        assert_int_equal(read(ends[0], id, sizeof id), sizeof id);
        (void)nanosleep(&(struct timespec){.tv_nsec = round * 7000000L}, NULL);
        kill(child, SIGKILL);
        waitpid(child, NULL, 0);
        reopen(f);
        do {
            memcpy(last, id, sizeof id);
            struct umbj_job job;
            assert_int_equal(umbj_table_get(f->table, id, "ann", &job, &f->error), UMB_OK);
            assert_int_equal(job.state, UMBJ_DONE);
        } while (read(ends[0], id, sizeof id) == sizeof id);
        close(ends[0]);
        assert_string_not_equal(last, "");
        int64_t count;
        assert_int_equal(umbj_table_recover(f->table, 2000, &count, &f->error), UMB_OK);
        assert_true(count <= 1);
        umbj_table_close(f->table);
        f->table = NULL;
        unlink(f->path);
    }
    reopen(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        TABLE_TEST(random_work_agrees_with_a_model),
        TABLE_TEST(what_was_acknowledged_survives_kill_9),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
