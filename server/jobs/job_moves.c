/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Names of job states and failures, and changes of a job's state: submitted, claimed, renewed,
 * finished, failed, cancelled. Each change is one statement or one transaction. Changes on behalf
 * of a worker name its epoch.
 */
#include "jobs/job_table_internal.h"

#include <stdio.h>
#include <sys/random.h>

#include "base/try.h"
#include "umbrage/asset.h"

const char *umbj_state_name(enum umbj_state state)
{
    static const char *const names[UMBJ_STATE_COUNT] = {"queued", "running", "done", "failed",
                                                        "poison"};
    return (unsigned)state < UMBJ_STATE_COUNT ? names[state] : "unknown";
}

const char *umbj_failure_name(enum umbj_failure failure)
{
    static const char *const names[UMBJ_FAILURE_COUNT] = {
        "none",   "rejected", "temporary", "io",       "lost",     "crash",
        "memory", "sandbox",  "timeout",   "internal", "cancelled"};
    return (unsigned)failure < UMBJ_FAILURE_COUNT ? names[failure] : "unknown";
}

int umbj_is_over(enum umbj_state state)
{
    return state != UMBJ_QUEUED && state != UMBJ_RUNNING;
}

static enum umb_status make_id(char id[UMBJ_ID_SIZE], struct umb_error *error)
{
    uint8_t bytes[UMB_ID_BYTES];
    char text[UMB_ID_TEXT_SIZE];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes) {
        return umb_fail(error, UMB_E_INTERNAL, "no random bytes to be had for a job's id");
    }
    umb_id_to_text(bytes, text);
    (void)snprintf(id, UMBJ_ID_SIZE, "%.*s", UMBJ_ID_SIZE - 1, text);
    return UMB_OK;
}

static enum umb_status insert(struct umbj_table *table, const struct umbj_submission *submission,
                              int64_t now, struct umbj_job *job, struct umb_error *error)
{
    char id[UMBJ_ID_SIZE];
    UMB__TRY(
        umbj_table_check_quota(table, submission->owner, submission->bundle_bytes, NULL, error));
    UMB__TRY(make_id(id, error));
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "INSERT INTO job(id, owner, key, state, priority, submitted_ms,"
                         " bundle_bytes, scene, settings) VALUES(?, ?, ?, 0, ?, ?, ?, ?, ?)",
                         "tthiiitt", id, submission->owner, submission->key,
                         (int64_t)submission->priority, now, submission->bundle_bytes,
                         submission->scene, submission->settings));
    return umbj_table_get(table, id, NULL, job, error);
}

enum umb_status umbj_table_submit(struct umbj_table *table,
                                  const struct umbj_submission *submission, int64_t now,
                                  struct umbj_job *job, int *is_new, struct umb_error *error)
{
    *is_new = 0;
    UMB__TRY(umbj_sql_begin(&table->sql, error));
    enum umb_status status =
        umbj_table_find_same(table, submission->owner, submission->key, job, error);
    if (status == UMB_E_NOT_FOUND) {
        *is_new = 1;
        status = insert(table, submission, now, job, error);
    }
    return umbj_sql_end(&table->sql, status, error);
}

/* Chooses and starts a job. Order: the owner with the fewest running jobs, then the one not served
 * for the longest time, then the job's priority, then its age (job_table.h). */
static enum umb_status start(struct umbj_table *table, int64_t now, int64_t steady,
                             struct umbj_job *job, struct umb_error *error)
{
    UMB__TRY(umbj__find_job(
        table, now, job, "to be run", error,
        "WITH ready AS (SELECT owner FROM job WHERE state = 0 AND " UMBJ__MAY_START " GROUP BY"
        " owner), next AS (SELECT ready.owner AS owner FROM ready LEFT JOIN turn ON turn.owner ="
        " ready.owner ORDER BY (SELECT count(*) FROM job AS other WHERE other.state = 1 AND"
        " other.owner = ready.owner), coalesce(turn.number, 0), ready.owner LIMIT 1)"
        " " UMBJ__SELECT_JOBS "WHERE state = 0 AND " UMBJ__MAY_START " AND owner IN (SELECT owner"
        " FROM next) ORDER BY priority DESC, seq LIMIT 1",
        "ii", now, now + UMBJ_PAUSE_MAX_MS));
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "UPDATE job SET state = 1, epoch = epoch + 1, started_ms = ?,"
                         " lease_until_ms = ? WHERE id = ?",
                         "iit", now, steady + table->limits.lease_ms, job->id));
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "INSERT INTO turn(owner, number) VALUES(?1, (SELECT"
                         " coalesce(max(number), 0) + 1 FROM turn)) ON CONFLICT(owner) DO"
                         " UPDATE SET number = excluded.number",
                         "t", job->owner));
    return umbj_table_get(table, job->id, NULL, job, error);
}

enum umb_status umbj_table_claim(struct umbj_table *table, int64_t now, int64_t steady,
                                 struct umbj_job *job, struct umb_error *error)
{
    UMB__TRY(umbj_sql_begin(&table->sql, error));
    return umbj_sql_end(&table->sql, start(table, now, steady, job, error), error);
}

/* Returns the status of a statement that changes one running job: E_STATE if it changed none. */
static enum umb_status fenced(const struct umbj_table *table, enum umb_status status,
                              const char *id, int64_t epoch, struct umb_error *error)
{
    return status != UMB_OK || umbj_sql_changes(&table->sql) > 0
               ? status
               : umb_fail(error, UMB_E_STATE, "job %.40s: epoch %lld is not running any more", id,
                          (long long)epoch);
}

enum umb_status umbj_table_renew(struct umbj_table *table, const char *id, int64_t epoch,
                                 int64_t steady, struct umb_error *error)
{
    const enum umb_status status =
        umbj_sql_do(&table->sql, error,
                    "UPDATE job SET lease_until_ms = ? WHERE id = ? AND epoch = ? AND state = 1",
                    "iti", steady + table->limits.lease_ms, id, epoch);
    return fenced(table, status, id, epoch, error);
}

static enum umb_status finish(struct umbj_table *table, const struct umbj_job *job,
                              const uint8_t *asset, int64_t bake_ms, int64_t now,
                              struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    const enum umb_status status =
        umbj_sql_do(sql, error,
                    "UPDATE job SET state = 2, failure = 0, cause = '', asset = ?, ended_ms = ?"
                    " WHERE id = ? AND epoch = ? AND state = 1",
                    "hiti", asset, now, job->id, job->epoch);
    UMB__TRY(fenced(table, status, job->id, job->epoch, error));
    UMB__TRY(umbj_sql_do(sql, error, "INSERT OR IGNORE INTO asset(id) VALUES(?)", "h", asset));
    UMB__TRY(umbj_sql_do(sql, error, "INSERT OR IGNORE INTO owned(asset, owner) VALUES(?, ?)", "ht",
                         asset, job->owner));
    return umbj_sql_do(sql, error,
                       "INSERT OR REPLACE INTO bake(key, asset, bake_ms) VALUES(?, ?, ?)", "hhi",
                       job->key, asset, bake_ms);
}

enum umb_status umbj_table_finish(struct umbj_table *table, const struct umbj_job *job,
                                  const uint8_t *asset, int64_t bake_ms, int64_t now,
                                  struct umb_error *error)
{
    UMB__TRY(umbj_sql_begin(&table->sql, error));
    return umbj_sql_end(&table->sql, finish(table, job, asset, bake_ms, now, error), error);
}

static int takes_worker_down(enum umbj_failure failure)
{
    return failure == UMBJ_CRASH || failure == UMBJ_MEMORY || failure == UMBJ_SANDBOX;
}

static int may_pass(enum umbj_failure failure)
{
    return failure == UMBJ_TEMPORARY || failure == UMBJ_IO || failure == UMBJ_LOST;
}

/* Returns the pause in milliseconds before the next try, by the number of failed tries. */
static int64_t pause_ms(int64_t tries)
{
    int64_t pause = UMBJ_PAUSE_MS;
    for (int64_t i = 1; i < tries && pause < UMBJ_PAUSE_MAX_MS; i++) {
        pause *= 2;
    }
    return pause < UMBJ_PAUSE_MAX_MS ? pause : UMBJ_PAUSE_MAX_MS;
}

/* Sets the state of a job whose try failed. Its tries and hard_tries already include this try. */
static void judge(struct umbj_job *job, int64_t now)
{
    const enum umbj_failure failure = job->failure;
    const int hard = takes_worker_down(failure);
    job->tries++;
    job->hard_tries += hard;
    if ((hard && job->hard_tries < UMBJ_HARD_TRIES_MAX && job->tries < UMBJ_TRIES_MAX) ||
        (may_pass(failure) && job->tries < UMBJ_TRIES_MAX)) {
        job->state = UMBJ_QUEUED;
        job->not_before_ms = now + pause_ms(job->tries);
        return;
    }
    job->state = hard || failure == UMBJ_LOST ? UMBJ_POISON : UMBJ_FAILED;
    job->ended_ms = now;
}

enum umb_status umbj_table_fail(struct umbj_table *table, struct umbj_job *job,
                                enum umbj_failure failure, const char *cause, int64_t now,
                                struct umb_error *error)
{
    struct umbj_job after;
    UMB__TRY(umbj_table_get(table, job->id, NULL, &after, error));
    after.failure = failure;
    judge(&after, now);
    const enum umb_status status = umbj_sql_do(
        &table->sql, error,
        "UPDATE job SET state = ?, failure = ?, tries = ?, hard_tries = ?, not_before_ms = ?,"
        " ended_ms = ?, cause = ? WHERE id = ? AND epoch = ? AND state = 1",
        "iiiiiitti", (int64_t)after.state, (int64_t)failure, after.tries, after.hard_tries,
        after.not_before_ms, after.ended_ms, cause, job->id, job->epoch);
    UMB__TRY(fenced(table, status, job->id, job->epoch, error));
    return umbj_table_get(table, after.id, NULL, job, error);
}

enum umb_status umbj_table_cancel(struct umbj_table *table, const char *id, const char *owner,
                                  int64_t now, struct umbj_job *job, struct umb_error *error)
{
    UMB__TRY(umbj_table_get(table, id, owner, job, error));
    if (umbj_is_over(job->state)) {
        return UMB_OK;
    }
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "UPDATE job SET state = 3, failure = ?, cause = 'cancelled by its owner',"
                         " ended_ms = ? WHERE id = ? AND state IN (0, 1)",
                         "iit", (int64_t)UMBJ_CANCELLED, now, job->id));
    return umbj_table_get(table, job->id, owner, job, error);
}

enum umb_status umbj_table_expired(struct umbj_table *table, int64_t steady, struct umbj_job *job,
                                   struct umb_error *error)
{
    return umbj__find_job(table, 0, job, "with a lease that is over", error,
                          UMBJ__SELECT_JOBS
                          "WHERE state = 1 AND lease_until_ms < ? ORDER BY seq LIMIT 1",
                          "i", steady);
}

/* Marks every running job as lost. */
static enum umb_status lose_running(struct umbj_table *table, int64_t now, int64_t *count,
                                    struct umb_error *error)
{
    struct umbj_job job;
    enum umb_status status;
    while ((status = umbj_table_expired(table, INT64_MAX, &job, error)) == UMB_OK) {
        UMB__TRY(umbj_table_fail(table, &job, UMBJ_LOST,
                                 "the server ended while the job was running", now, error));
        ++*count;
    }
    return status == UMB_E_NOT_FOUND ? UMB_OK : status;
}

enum umb_status umbj_table_recover(struct umbj_table *table, int64_t now, int64_t *count,
                                   struct umb_error *error)
{
    *count = 0;
    UMB__TRY(umbj__mend(table, now, error));
    UMB__TRY(umbj__count_anew(table, error));
    return lose_running(table, now, count, error);
}

enum umb_status umbj_table_release(struct umbj_table *table, struct umb_error *error)
{
    return umbj_sql_do(&table->sql, error,
                       "UPDATE job SET state = 0, not_before_ms = 0 WHERE state = 1", "");
}
