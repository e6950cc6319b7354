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
    int owned;
    uint8_t unowned[UMBJ_HASH_BYTES];
    assert_int_equal(umbj_table_asset(f->table, asset, NULL, &owned, &f->error), UMB_OK);
    assert_int_equal(owned, 0);
    assert_int_equal(umbj_table_unowned(f->table, unowned, &f->error), UMB_E_NOT_FOUND);
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

static void a_frozen_table_is_read_and_not_written(void **state)
{
    struct fixture *f = *state;
    struct umbj_job job;
    char id[UMBJ_ID_SIZE];
    int is_new;
    assert_int_equal(submit_as(f, "ann", 1, 0, 1, &job, &is_new), UMB_OK);
    memcpy(id, job.id, sizeof id);
    assert_int_equal(umbj_table_freeze(f->table, &f->error), UMB_OK);
    assert_int_equal(umbj_table_cancel(f->table, id, "ann", 2, &job, &f->error), UMB_E_IO);
    assert_int_equal(submit_as(f, "ann", 2, 0, 2, &job, &is_new), UMB_E_IO);
    assert_int_equal(umbj_table_get(f->table, id, "ann", &job, &f->error), UMB_OK);
    assert_int_equal(job.state, UMBJ_QUEUED);
    reopen(f);
    assert_int_equal(umbj_table_cancel(f->table, id, "ann", 2, &job, &f->error), UMB_OK);
}

/* Reopens with other limits. */
static void reopen_with(struct fixture *f, int64_t owner_assets, int64_t owner_history)
{
    struct umbj_limits other = limits;
    other.owner_assets = owner_assets;
    other.owner_history = owner_history;
    umbj_table_close(f->table);
    assert_int_equal(umbj_table_open(f->path, &other, &f->table, &f->error), UMB_OK);
}

/* Bakes a scene to an asset of so many bytes. */
static enum umb_status bake(struct fixture *f, const char *owner, unsigned content, int64_t bytes,
                            struct umbj_job *job)
{
    uint8_t asset[UMBJ_HASH_BYTES];
    int is_new;
    key_of(1000 + content, asset);
    enum umb_status status = submit_as(f, owner, content, 0, 1000, job, &is_new);
    if (status == UMB_OK) {
        assert_int_equal(umbj_table_claim(f->table, 2000, 2000, job, &f->error), UMB_OK);
        status = umbj_table_check_asset(f->table, owner, asset, bytes, &f->error);
    }
    if (status == UMB_OK) {
        assert_int_equal(umbj_table_announce(f->table, asset, bytes, &f->error), UMB_OK);
        finish(f, job, 1000 + content);
    }
    return status;
}

static void what_an_owner_keeps_has_a_quota(void **state)
{
    struct fixture *f = *state;
    struct umbj_job job;
    struct umbj_kept kept;
    uint8_t asset[UMBJ_HASH_BYTES];
    reopen_with(f, 100, 0);
    assert_int_equal(bake(f, "ann", 1, 60, &job), UMB_OK);
    assert_int_equal(bake(f, "ann", 2, 41, &job), UMB_E_BUSY);
    assert_non_null(strstr(f->error.message, "--owner-assets"));
    assert_non_null(strstr(f->error.message, "60"));
    assert_non_null(strstr(f->error.message, "umbrage rm"));
    assert_int_equal(umbj_table_refused(f->table, UMBJ_QUOTA_ASSETS), 1);
    assert_int_equal(umbj_table_fail(f->table, &job, UMBJ_REJECTED, "full", 2001, &f->error),
                     UMB_OK);
    assert_int_equal(bake(f, "ann", 2, 40, &job), UMB_OK);
    assert_int_equal(bake(f, "bob", 1, 60, &job), UMB_OK);    /* each owner has its own */
    assert_int_equal(bake(f, "ann", 3, 1, &job), UMB_E_BUSY); /* already at the submission */
    key_of(1001, asset); /* what is the owner's already needs no more room */
    assert_int_equal(umbj_table_check_asset(f->table, "ann", asset, 60, &f->error), UMB_OK);
    assert_int_equal(umbj_table_kept(f->table, "ann", &kept, &f->error), UMB_OK);
    assert_int_equal(kept.asset_bytes, 100);
    assert_int_equal(umbj_table_kept(f->table, NULL, &kept, &f->error), UMB_OK);
    assert_int_equal(kept.asset_bytes, 160);
    assert_int_equal(umbj_table_disown(f->table, asset, "ann", &f->error), UMB_OK);
    assert_int_equal(bake(f, "ann", 3, 60, &job), UMB_OK);
    assert_int_equal(umbj_table_unowned(f->table, asset, &f->error), UMB_E_NOT_FOUND);
    assert_int_equal(umbj_table_disown(f->table, asset, "bob", &f->error), UMB_OK);
    assert_int_equal(umbj_table_unowned(f->table, asset, &f->error), UMB_OK);
    assert_int_equal(umbj_table_forget(f->table, asset, &f->error), UMB_OK);
    assert_int_equal(umbj_table_unowned(f->table, asset, &f->error), UMB_E_NOT_FOUND);
    assert_string_equal(umbj_quota_name(UMBJ_QUOTA_ASSETS), "assets");
    assert_string_equal(umbj_quota_name(UMBJ_QUOTA_COUNT), "unknown");
}

static void the_oldest_jobs_of_an_owner_are_forgotten(void **state)
{
    struct fixture *f = *state;
    struct umbj_job job, *jobs = NULL;
    size_t count = 0;
    int is_new;
    reopen_with(f, 0, 3);
    for (unsigned i = 0; i < 6; i++) {
        assert_int_equal(bake(f, "ann", i, 1, &job), UMB_OK);
        assert_int_equal(bake(f, "bob", 100 + i % 2, 1, &job), UMB_OK);
        assert_int_equal(umbj_table_cancel(f->table, job.id, "bob", 1, &job, &f->error), UMB_OK);
        uint8_t asset[UMBJ_HASH_BYTES];
        key_of(1100 + i % 2, asset);
        assert_int_equal(umbj_table_disown(f->table, asset, "bob", &f->error), UMB_OK);
        assert_int_equal(umbj_table_trim(f->table, "ann", &f->error), UMB_OK);
    }
    assert_int_equal(submit_as(f, "ann", 50, 0, 1000, &job, &is_new), UMB_OK);
    assert_int_equal(umbj_table_trim(f->table, "ann", &f->error), UMB_OK);
    assert_int_equal(umbj_table_list(f->table, "ann", 100, &jobs, &count, &f->error), UMB_OK);
    assert_int_equal(count, 4); /* three that are over, and one that is not */
    assert_int_equal(jobs[1].key[0], 5);
    assert_int_equal(jobs[3].key[0], 3);
    free(jobs);
    assert_int_equal(umbj_table_list(f->table, "bob", 100, &jobs, &count, &f->error), UMB_OK);
    assert_int_equal(count, 6); /* not trimmed */
    free(jobs);
}

static void a_step_of_the_clock_moves_no_lease_and_lengthens_no_pause(void **state)
{
    static const int64_t steps[] = {1200000, -3600000, INT64_C(86400000) * 400};
    struct fixture *f = *state;
    struct umbj_job job, other;
    int64_t when = 0;
    for (unsigned i = 0; i < 3; i++) {
        const int64_t now = INT64_C(1700000000000), steady = 5000;
        int is_new;
        assert_int_equal(submit_as(f, "ann", i, 0, now, &job, &is_new), UMB_OK);
        assert_int_equal(umbj_table_claim(f->table, now, steady, &job, &f->error), UMB_OK);
        assert_int_equal(umbj_table_renew(f->table, job.id, job.epoch, steady + 50, &f->error),
                         UMB_OK);
        /* The lease is of the steady clock alone. */
        assert_int_equal(umbj_table_expired(f->table, steady + 150, &other, &f->error),
                         UMB_E_NOT_FOUND);
        assert_int_equal(umbj_table_expired(f->table, steady + 151, &other, &f->error), UMB_OK);
        assert_int_equal(umbj_table_fail(f->table, &job, UMBJ_TEMPORARY, "no", now, &f->error),
                         UMB_OK);
        assert_int_equal(umbj_table_next_start(f->table, now, &when, &f->error), UMB_OK);
        assert_int_equal(when, now + UMBJ_PAUSE_MS);
        assert_int_equal(umbj_table_next_start(f->table, now + steps[i], &when, &f->error), UMB_OK);
        assert_int_equal(when, now + steps[i]); /* over, whichever way the clock was set */
        assert_int_equal(umbj_table_claim(f->table, now + steps[i], steady, &job, &f->error),
                         UMB_OK);
        finish(f, &job, i + 1);
    }
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
        TABLE_TEST(a_frozen_table_is_read_and_not_written),
        TABLE_TEST(what_an_owner_keeps_has_a_quota),
        TABLE_TEST(the_oldest_jobs_of_an_owner_are_forgotten),
        TABLE_TEST(a_step_of_the_clock_moves_no_lease_and_lengthens_no_pause),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
