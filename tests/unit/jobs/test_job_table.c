/* SPDX-License-Identifier: Apache-2.0 */
/* The job table: order, tries, fencing, owners. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "job_table_fixture.h"

static struct umbj_job submit(struct fixture *f, const char *owner, unsigned content)
{
    struct umbj_job job;
    int is_new;
    assert_int_equal(submit_as(f, owner, content, 0, 1000, &job, &is_new), UMB_OK);
    assert_int_equal(is_new, 1);
    return job;
}

static struct umbj_job claim(struct fixture *f, int64_t now)
{
    struct umbj_job job;
    assert_int_equal(umbj_table_claim(f->table, now, now, &job, &f->error), UMB_OK);
    assert_int_equal(job.state, UMBJ_RUNNING);
    return job;
}

static void the_same_submission_of_one_owner_is_one_job(void **state)
{
    struct fixture *f = *state;
    struct umbj_job first = submit(f, "ann", 1), again;
    int is_new;
    assert_int_equal(submit_as(f, "ann", 1, 0, 1001, &again, &is_new), UMB_OK);
    assert_int_equal(is_new, 0);
    assert_string_equal(again.id, first.id);
    struct umbj_job other = submit(f, "bob", 1); /* not ann's, though the same scene */
    assert_string_not_equal(other.id, first.id);
    struct umbj_job running = claim(f, 1002);
    finish(f, &running, 7);
    assert_int_equal(submit_as(f, "ann", 1, 0, 1003, &again, &is_new), UMB_OK);
    assert_int_equal(is_new, 0);
    assert_int_equal(again.state, UMBJ_DONE);
    assert_int_equal(umbj_table_disown(f->table, again.asset, "ann", &f->error), UMB_OK);
    assert_int_equal(submit_as(f, "ann", 1, 0, 1004, &again, &is_new), UMB_OK);
    assert_int_equal(is_new, 1); /* she deleted it: it is made again */
}

static void owners_take_turns_whatever_they_submit(void **state)
{
    struct fixture *f = *state;
    char order[16] = "";
    for (unsigned i = 0; i < 5; i++) {
        submit(f, "ann", i);
    }
    submit(f, "bob", 10);
    submit(f, "cyd", 11);
    submit(f, "bob", 12);
    for (int i = 0; i < 8; i++) {
        struct umbj_job job = claim(f, 1100);
        order[i] = job.owner[0];
        finish(f, &job, 20);
    }
    assert_string_equal(order, "abcabaaa");
}

static void an_owner_with_fewer_running_jobs_comes_first(void **state)
{
    struct fixture *f = *state;
    submit(f, "ann", 1);
    submit(f, "ann", 2);
    submit(f, "bob", 3);
    submit(f, "bob", 4);
    struct umbj_job a = claim(f, 1100);
    struct umbj_job b = claim(f, 1100);
    assert_string_not_equal(a.owner, b.owner);
    finish(f, &b, 5);
    assert_string_equal(claim(f, 1100).owner, b.owner);
}

static void priority_orders_the_jobs_of_one_owner_only(void **state)
{
    struct fixture *f = *state;
    struct umbj_job low, high;
    int is_new;
    submit(f, "bob", 9);
    assert_int_equal(submit_as(f, "ann", 1, 0, 1000, &low, &is_new), UMB_OK);
    assert_int_equal(submit_as(f, "ann", 2, 10, 1000, &high, &is_new), UMB_OK);
    assert_string_equal(claim(f, 1100).id, high.id);
    assert_string_equal(claim(f, 1100).owner, "bob");
    assert_string_equal(claim(f, 1100).id, low.id);
}

static void quotas_name_their_limit(void **state)
{
    struct fixture *f = *state;
    struct umbj_job job;
    int is_new;
    for (unsigned i = 0; i < 8; i++) {
        submit(f, "ann", i);
    }
    assert_int_equal(submit_as(f, "ann", 9, 0, 1000, &job, &is_new), UMB_E_BUSY);
    assert_non_null(strstr(f->error.message, "--owner-jobs"));
    submit(f, "bob", 9);
    assert_int_equal(umbj_table_check_quota(f->table, "bob", 950, NULL, &f->error), UMB_E_BUSY);
    assert_non_null(strstr(f->error.message, "--owner-bytes"));
}

static void failures_end_or_repeat_by_their_class(void **state)
{
    static const struct {
        enum umbj_failure failure;
        int tries;
        enum umbj_state end;
    } rules[] = {
        {UMBJ_REJECTED, 1, UMBJ_FAILED},
        {UMBJ_TIMEOUT, 1, UMBJ_FAILED},
        {UMBJ_INTERNAL, 1, UMBJ_FAILED},
        {UMBJ_TEMPORARY, UMBJ_TRIES_MAX, UMBJ_FAILED},
        {UMBJ_IO, UMBJ_TRIES_MAX, UMBJ_FAILED},
        {UMBJ_LOST, UMBJ_TRIES_MAX, UMBJ_POISON},
        {UMBJ_CRASH, UMBJ_HARD_TRIES_MAX, UMBJ_POISON},
        {UMBJ_MEMORY, UMBJ_HARD_TRIES_MAX, UMBJ_POISON},
        {UMBJ_SANDBOX, UMBJ_HARD_TRIES_MAX, UMBJ_POISON},
    };
    struct fixture *f = *state;
    int64_t now = 10000;
    for (unsigned i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        submit(f, "ann", 100 + i);
        int64_t pause = UMBJ_PAUSE_MS;
        for (int try = 1; try <= rules[i].tries; try++) {
            struct umbj_job job = claim(f, now);
            assert_int_equal(job.epoch, try);
            assert_int_equal(
                umbj_table_fail(f->table, &job, rules[i].failure, "a cause", now, &f->error),
                UMB_OK);
            assert_string_equal(job.cause, "a cause");
            if (try < rules[i].tries) {
                assert_int_equal(job.state, UMBJ_QUEUED);
                assert_int_equal(job.not_before_ms, now + pause);
                struct umbj_job early;
                assert_int_equal(
                    umbj_table_claim(f->table, now + pause - 1, now, &early, &f->error),
                    UMB_E_NOT_FOUND);
                now += pause;
                pause *= 2;
            } else {
                assert_int_equal(job.state, rules[i].end);
            }
        }
    }
}

static void who_reports_for_an_old_epoch_changes_nothing(void **state)
{
    struct fixture *f = *state;
    uint8_t asset[UMBJ_HASH_BYTES];
    key_of(77, asset);
    submit(f, "ann", 1);
    struct umbj_job old = claim(f, 1000), lost;
    assert_int_equal(umbj_table_expired(f->table, 1100, &lost, &f->error), UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_renew(f->table, old.id, old.epoch, 1050, &f->error), UMB_OK);
    assert_int_equal(umbj_table_expired(f->table, 1150, &lost, &f->error), UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_expired(f->table, 1151, &lost, &f->error), UMB_OK);
    assert_int_equal(umbj_table_fail(f->table, &lost, UMBJ_LOST, "late", 1151, &f->error), UMB_OK);
    struct umbj_job now = claim(f, 5000);
    assert_int_equal(now.epoch, old.epoch + 1);
    assert_int_equal(umbj_table_finish(f->table, &old, asset, 1, 5001, &f->error), UMB_E_STATE);
    assert_int_equal(umbj_table_renew(f->table, old.id, old.epoch, 5001, &f->error), UMB_E_STATE);
    assert_int_equal(umbj_table_fail(f->table, &old, UMBJ_CRASH, "x", 5001, &f->error),
                     UMB_E_STATE);
    int known, owned;
    assert_int_equal(umbj_table_asset(f->table, asset, NULL, &known, &owned, &f->error), UMB_OK);
    assert_int_equal(known, 0);
    finish(f, &now, 77);
    assert_int_equal(umbj_table_finish(f->table, &now, asset, 1, 5002, &f->error), UMB_E_STATE);
}

static void a_cancelled_job_cannot_be_finished(void **state)
{
    struct fixture *f = *state;
    uint8_t asset[UMBJ_HASH_BYTES];
    key_of(77, asset);
    submit(f, "ann", 1);
    struct umbj_job job = claim(f, 1000), cancelled;
    assert_int_equal(umbj_table_cancel(f->table, job.id, "bob", 1001, &cancelled, &f->error),
                     UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_cancel(f->table, job.id, "ann", 1001, &cancelled, &f->error),
                     UMB_OK);
    assert_int_equal(cancelled.state, UMBJ_FAILED);
    assert_int_equal(cancelled.failure, UMBJ_CANCELLED);
    assert_int_equal(umbj_table_finish(f->table, &job, asset, 1, 1002, &f->error), UMB_E_STATE);
}

static void a_restart_queues_what_ran(void **state)
{
    struct fixture *f = *state;
    int64_t count;
    submit(f, "ann", 1);
    submit(f, "ann", 2);
    struct umbj_job ran = claim(f, 1000), after;
    reopen(f);
    assert_int_equal(umbj_table_recover(f->table, 2000, &count, &f->error), UMB_OK);
    assert_int_equal(count, 1);
    assert_int_equal(umbj_table_get(f->table, ran.id, "ann", &after, &f->error), UMB_OK);
    assert_int_equal(after.state, UMBJ_QUEUED);
    assert_int_equal(after.failure, UMBJ_LOST);
}

static void an_asset_lives_as_long_as_somebody_has_it(void **state)
{
    struct fixture *f = *state;
    uint8_t asset[UMBJ_HASH_BYTES], found[UMBJ_HASH_BYTES], key[UMBJ_HASH_BYTES];
    int64_t bake_ms;
    key_of(50, asset);
    key_of(1, key);
    submit(f, "ann", 1);
    submit(f, "bob", 1);
    for (int i = 0; i < 2; i++) {
        struct umbj_job job = claim(f, 1000);
        finish(f, &job, 50);
    }
    assert_int_equal(umbj_table_find_bake(f->table, key, found, &bake_ms, &f->error), UMB_OK);
    assert_memory_equal(found, asset, sizeof asset);
    assert_int_equal(umbj_table_disown(f->table, asset, "ann", &f->error), UMB_OK);
    assert_int_equal(umbj_table_disown(f->table, asset, "ann", &f->error), UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_unowned(f->table, found, &f->error), UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_disown(f->table, asset, "bob", &f->error), UMB_OK);
    assert_int_equal(umbj_table_unowned(f->table, found, &f->error), UMB_OK);
    assert_memory_equal(found, asset, sizeof asset);
    assert_int_equal(umbj_table_forget(f->table, asset, &f->error), UMB_OK);
    assert_int_equal(umbj_table_find_bake(f->table, key, found, &bake_ms, &f->error),
                     UMB_E_NOT_FOUND);
}

static void a_file_that_is_no_table_is_refused(void **state)
{
    struct fixture *f = *state;
    umbj_table_close(f->table);
    f->table = NULL;
    FILE *file = fopen(f->path, "w");
    assert_non_null(file);
    for (int i = 0; i < 100; i++) {
        fputs("this is no database at all, it is a text\n", file);
    }
    fclose(file);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_E_CORRUPT);
    unlink(f->path);
    reopen(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        TABLE_TEST(the_same_submission_of_one_owner_is_one_job),
        TABLE_TEST(owners_take_turns_whatever_they_submit),
        TABLE_TEST(an_owner_with_fewer_running_jobs_comes_first),
        TABLE_TEST(priority_orders_the_jobs_of_one_owner_only),
        TABLE_TEST(quotas_name_their_limit),
        TABLE_TEST(failures_end_or_repeat_by_their_class),
        TABLE_TEST(who_reports_for_an_old_epoch_changes_nothing),
        TABLE_TEST(a_cancelled_job_cannot_be_finished),
        TABLE_TEST(a_restart_queues_what_ran),
        TABLE_TEST(an_asset_lives_as_long_as_somebody_has_it),
        TABLE_TEST(a_file_that_is_no_table_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
