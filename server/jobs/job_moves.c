/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How jobs change their state: submitted, claimed, renewed, finished, failed, cancelled. Each
 * change is one statement or one transaction, and those of a worker name their epoch.
 */
#include "jobs/job_table_internal.h"

#include <string.h>
#include <sys/random.h>

#include "base/try.h"

static enum umb_status make_id(char id[UMBJ_ID_SIZE], struct umb_error *error)
{
    static const char digits[] = "0123456789abcdef";
    uint8_t bytes[(UMBJ_ID_SIZE - 1) / 2];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes) {
        return umb_fail(error, UMB_E_INTERNAL, "no random bytes to be had for a job's id");
    }
    for (size_t i = 0; i < sizeof bytes; i++) {
        id[2 * i] = digits[bytes[i] >> 4];
        id[2 * i + 1] = digits[bytes[i] & 15];
    }
    id[UMBJ_ID_SIZE - 1] = '\0';
    return UMB_OK;
}

static enum umb_status insert(struct umbj_table *table, const struct umbj_submission *submission,
                              int64_t now, struct umbj_job *job, struct umb_error *error)
{
    char id[UMBJ_ID_SIZE];
    enum umb_status status = make_id(id, error);
    if (status == UMB_OK) {
        status = umbj_sql_run(&table->sql, error, NULL, NULL,
                              "INSERT INTO job(id, owner, key, state, priority, submitted_ms,"
                              " bundle_bytes, scene, settings) VALUES(?, ?, ?, 0, ?, ?, ?, ?, ?)",
                              "tthiiitt", id, submission->owner, submission->key,
                              (int64_t)submission->priority, now, submission->bundle_bytes,
                              submission->scene, submission->settings);
    }
    return status == UMB_OK ? umbj_table_get(table, id, NULL, job, error) : status;
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
        status =
            umbj_table_check_quota(table, submission->owner, submission->bundle_bytes, NULL, error);
        if (status == UMB_OK) {
            status = insert(table, submission, now, job, error);
        }
    }
    return umbj_sql_end(&table->sql, status, error);
}

/* Order: fewest running, then longest not served, then priority, then age: see the header. */
static enum umb_status choose(struct umbj_table *table, int64_t now, struct umbj_job *job,
                              struct umb_error *error)
{
    memset(job, 0, sizeof *job);
    return umbj_sql_run(
        &table->sql, error, umbj__take_job, job,
        "WITH ready AS (SELECT owner FROM job WHERE state = 0 AND " UMBJ__MAY_START " GROUP BY"
        " owner), next AS (SELECT ready.owner AS owner FROM ready LEFT JOIN turn ON turn.owner ="
        " ready.owner ORDER BY (SELECT count(*) FROM job AS other WHERE other.state = 1 AND"
        " other.owner = ready.owner), coalesce(turn.number, 0), ready.owner LIMIT 1)"
        " SELECT " UMBJ__JOB_COLUMNS " FROM job WHERE state = 0 AND " UMBJ__MAY_START
        " AND owner IN (SELECT"
        " owner FROM next) ORDER BY priority DESC, seq LIMIT 1",
        "ii", now, now + UMBJ_PAUSE_MAX_MS);
}

static enum umb_status start(struct umbj_table *table, int64_t now, int64_t steady,
                             struct umbj_job *job, struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    enum umb_status status =
        umbj_sql_run(sql, error, NULL, NULL,
                     "UPDATE job SET state = 1, epoch = epoch + 1, started_ms = ?, lease_until_ms"
                     " = ? WHERE id = ?",
                     "iit", now, steady + table->limits.lease_ms, job->id);
    if (status == UMB_OK) {
        status = umbj_sql_run(sql, error, NULL, NULL,
                              "INSERT INTO turn(owner, number) VALUES(?1, (SELECT"
                              " coalesce(max(number), 0) + 1 FROM turn)) ON CONFLICT(owner) DO"
                              " UPDATE SET number = excluded.number",
                              "t", job->owner);
    }
    if (status == UMB_OK) {
        char id[UMBJ_ID_SIZE];
        memcpy(id, job->id, sizeof id);
        status = umbj_table_get(table, id, NULL, job, error);
    }
    return status;
}

enum umb_status umbj_table_claim(struct umbj_table *table, int64_t now, int64_t steady,
                                 struct umbj_job *job, struct umb_error *error)
{
    enum umb_status status = umbj_sql_begin(&table->sql, error);
    if (status != UMB_OK) {
        return status;
    }
    do {
        status = choose(table, now, job, error);
    } while (umbj__retired(table, &status, job, now, error));
    status = umbj__found(status, job, "to be run", error);
    if (status == UMB_OK) {
        status = start(table, now, steady, job, error);
    }
    return umbj_sql_end(&table->sql, status, error);
}

static enum umb_status fenced(const struct umbj_table *table, enum umb_status status,
                              const char *id, int64_t epoch, struct umb_error *error)
{
    if (status == UMB_OK && umbj_sql_changes(&table->sql) == 0) {
        status = umb_fail(error, UMB_E_STATE, "job %.40s: epoch %lld is not running any more", id,
                          (long long)epoch);
    }
    return status;
}

enum umb_status umbj_table_renew(struct umbj_table *table, const char *id, int64_t epoch,
                                 int64_t steady, struct umb_error *error)
{
    enum umb_status status =
        umbj_sql_run(&table->sql, error, NULL, NULL,
                     "UPDATE job SET lease_until_ms = ? WHERE id = ? AND epoch = ? AND state = 1",
                     "iti", steady + table->limits.lease_ms, id, epoch);
    return fenced(table, status, id, epoch, error);
}

enum umb_status umbj_table_finish(struct umbj_table *table, const struct umbj_job *job,
                                  const uint8_t *asset, int64_t bake_ms, int64_t now,
                                  struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    UMB__TRY(umbj_sql_begin(sql, error));
    enum umb_status status =
        umbj_sql_run(sql, error, NULL, NULL,
                     "UPDATE job SET state = 2, failure = 0, cause = '', asset = ?, ended_ms"
                     " = ? WHERE id = ? AND epoch = ? AND state = 1",
                     "hiti", asset, now, job->id, job->epoch);
    status = fenced(table, status, job->id, job->epoch, error);
    if (status == UMB_OK) {
        status = umbj_sql_run(sql, error, NULL, NULL, "INSERT OR IGNORE INTO asset(id) VALUES(?)",
                              "h", asset);
    }
    if (status == UMB_OK) {
        status = umbj_sql_run(sql, error, NULL, NULL,
                              "INSERT OR IGNORE INTO owned(asset, owner) VALUES(?, ?)", "ht", asset,
                              job->owner);
    }
    if (status == UMB_OK) {
        status = umbj_sql_run(sql, error, NULL, NULL,
                              "INSERT OR REPLACE INTO bake(key, asset, bake_ms) VALUES(?, ?, ?)",
                              "hhi", job->key, asset, bake_ms);
    }
    return umbj_sql_end(sql, status, error);
}

static int takes_worker_down(enum umbj_failure failure)
{
    return failure == UMBJ_CRASH || failure == UMBJ_MEMORY || failure == UMBJ_SANDBOX;
}

static int may_pass(enum umbj_failure failure)
{
    return failure == UMBJ_TEMPORARY || failure == UMBJ_IO || failure == UMBJ_LOST;
}

/* Pause in milliseconds before the next try, by the number of failed tries. */
static int64_t pause_ms(int64_t tries)
{
    int64_t pause = UMBJ_PAUSE_MS;
    for (int64_t i = 1; i < tries && pause < UMBJ_PAUSE_MAX_MS; i++) {
        pause *= 2;
    }
    return pause < UMBJ_PAUSE_MAX_MS ? pause : UMBJ_PAUSE_MAX_MS;
}

/* Sets the state of a job whose try failed; tries and hard_tries include this try. */
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
    enum umb_status status = umbj_sql_run(
        &table->sql, error, NULL, NULL,
        "UPDATE job SET state = ?, failure = ?, tries = ?, hard_tries = ?, not_before_ms = ?,"
        " ended_ms = ?, cause = ? WHERE id = ? AND epoch = ? AND state = 1",
        "iiiiiitti", (int64_t)after.state, (int64_t)failure, after.tries, after.hard_tries,
        after.not_before_ms, after.ended_ms, cause, job->id, job->epoch);
    status = fenced(table, status, job->id, job->epoch, error);
    return status == UMB_OK ? umbj_table_get(table, after.id, NULL, job, error) : status;
}

enum umb_status umbj_table_cancel(struct umbj_table *table, const char *id, const char *owner,
                                  int64_t now, struct umbj_job *job, struct umb_error *error)
{
    enum umb_status status = umbj_table_get(table, id, owner, job, error);
    if (status != UMB_OK || umbj_is_over(job->state)) {
        return status;
    }
    status = umbj_sql_run(&table->sql, error, NULL, NULL,
                          "UPDATE job SET state = 3, failure = ?, cause = 'cancelled by its owner',"
                          " ended_ms = ? WHERE id = ? AND state IN (0, 1)",
                          "iit", (int64_t)UMBJ_CANCELLED, now, id);
    return status == UMB_OK ? umbj_table_get(table, id, owner, job, error) : status;
}

enum umb_status umbj_table_expired(struct umbj_table *table, int64_t steady, struct umbj_job *job,
                                   struct umb_error *error)
{
    enum umb_status status;
    memset(job, 0, sizeof *job);
    do {
        status = umbj_sql_run(&table->sql, error, umbj__take_job, job,
                              "SELECT " UMBJ__JOB_COLUMNS
                              " FROM job WHERE state = 1 AND lease_until_ms < ? ORDER BY seq"
                              " LIMIT 1",
                              "i", steady);
    } while (umbj__retired(table, &status, job, 0, error));
    return umbj__found(status, job, "with a lease that is over", error);
}

/* Marks every running job as lost. */
static enum umb_status lose_running(struct umbj_table *table, int64_t now, int64_t *count,
                                    struct umb_error *error)
{
    struct umbj_job job;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK) {
        status = umbj_table_expired(table, INT64_MAX, &job, error);
        if (status == UMB_E_NOT_FOUND) {
            return UMB_OK;
        }
        if (status == UMB_OK) {
            status = umbj_table_fail(table, &job, UMBJ_LOST,
                                     "the server ended while the job was running", now, error);
            ++*count;
        }
    }
    return status;
}

enum umb_status umbj_table_recover(struct umbj_table *table, int64_t now, int64_t *count,
                                   struct umb_error *error)
{
    *count = 0;
    enum umb_status status = umbj__mend(table, now, error);
    if (status == UMB_OK) {
        status = umbj__count_anew(table, error);
    }
    return status == UMB_OK ? lose_running(table, now, count, error) : status;
}

enum umb_status umbj_table_release(struct umbj_table *table, struct umb_error *error)
{
    return umbj_sql_run(&table->sql, error, NULL, NULL,
                        "UPDATE job SET state = 0, not_before_ms = 0 WHERE state = 1", "");
}
