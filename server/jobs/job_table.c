/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The job table: its file, and its look-ups.
 *
 * Invariants: a running job has epoch > 0 and a lease. A job that has ended has ended_ms; if it is
 * done it has an asset. Every change of state is one statement or one transaction.
 */
#include "jobs/job_table_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"

#define SCHEMA_VERSION 2

static const char *const schema[] = {
    "CREATE TABLE job(seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE,"
    " owner TEXT NOT NULL, key BLOB NOT NULL, state INTEGER NOT NULL, failure INTEGER NOT NULL"
    " DEFAULT 0, priority INTEGER NOT NULL, epoch INTEGER NOT NULL DEFAULT 0, tries INTEGER NOT"
    " NULL DEFAULT 0, hard_tries INTEGER NOT NULL DEFAULT 0, submitted_ms INTEGER NOT NULL,"
    " started_ms INTEGER NOT NULL DEFAULT 0, ended_ms INTEGER NOT NULL DEFAULT 0, not_before_ms"
    " INTEGER NOT NULL DEFAULT 0, lease_until_ms INTEGER NOT NULL DEFAULT 0, bundle_bytes INTEGER"
    " NOT NULL, asset BLOB, cause TEXT NOT NULL DEFAULT '', scene TEXT NOT NULL, settings TEXT"
    " NOT NULL)",
    "CREATE INDEX job_by_owner ON job(owner, key)",
    "CREATE INDEX job_by_state ON job(state, owner)",
    /* Number of the claim at which an owner was last served. It orders owners like a clock, without
     * ties. */
    "CREATE TABLE turn(owner TEXT PRIMARY KEY, number INTEGER NOT NULL)",
    "CREATE TABLE asset(id BLOB PRIMARY KEY)", /* more columns come with version 2 */
    ("CREATE TABLE owned(asset BLOB NOT NULL REFERENCES asset(id), owner TEXT NOT NULL,"
     " PRIMARY KEY(asset, owner))"),
    "CREATE TABLE bake(key BLOB PRIMARY KEY, asset BLOB NOT NULL, bake_ms INTEGER NOT NULL)",
};

/* Additions of version 2: sizes of assets, number of owners of each asset, and counts. */
static const char *const sizes[] = {
    "ALTER TABLE asset ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE asset ADD COLUMN owners INTEGER NOT NULL DEFAULT 0",
};

/* Creates the tables, or upgrades those of version 1, in a transaction. */
static enum umb_status make_schema(struct umbj_table *table, int64_t from, struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    if (from == 0) {
        UMB__TRY(umbj_sql_do_all(sql, error, schema, sizeof schema / sizeof schema[0]));
    }
    UMB__TRY(umbj_sql_do_all(sql, error, sizes, sizeof sizes / sizeof sizes[0]));
    UMB__TRY(umbj__make_counts(table, error));
    return umbj_sql_do(sql, error, "PRAGMA user_version = 2", "");
}

static enum umb_status prepare_schema(struct umbj_table *table, struct umb_error *error)
{
    int64_t version = 0;
    UMB__TRY(umbj_sql_number(&table->sql, error, &version, "PRAGMA user_version", ""));
    if (version == SCHEMA_VERSION) {
        return UMB_OK;
    }
    if (version < 0 || version > SCHEMA_VERSION) {
        return umb_fail(error, UMB_E_VERSION, "job table: version %lld, this program knows %d",
                        (long long)version, SCHEMA_VERSION);
    }
    UMB__TRY(umbj_sql_begin(&table->sql, error));
    UMB__TRY(umbj_sql_end(&table->sql, make_schema(table, version, error), error));
    return umbj__count_anew(table, error);
}

static enum umb_status take_verdict(void *user, sqlite3_stmt *row)
{
    umbj_sql_text(row, 0, user, 200);
    return UMB_OK;
}

/* Fails: E_CORRUPT, with SQLite's verdict. */
static enum umb_status ask_verdict(struct umbj_sql *sql, struct umb_error *error)
{
    char verdict[200] = "ok";
    UMB__TRY(umbj_sql_run(sql, error, take_verdict, verdict, "PRAGMA quick_check(1)", ""));
    return strcmp(verdict, "ok") == 0 ? UMB_OK : umb_fail(error, UMB_E_CORRUPT, "%s", verdict);
}

/*
 * Checks for damaged pages at the start, before a job needs them. SQLite also reports a page as
 * damaged when the disk cannot deliver it. So the files are read plainly before that report is
 * believed.
 */
static enum umb_status check_pages(struct umbj_sql *sql, const char *path, struct umb_error *error)
{
    struct umb_error why = {0};
    enum umb_status status = ask_verdict(sql, &why);
    if (status == UMB_E_CORRUPT) {
        status = umbj_sql_read_files(sql, &why);
        status = status == UMB_OK ? ask_verdict(sql, &why) : status;
    }
    if (status != UMB_E_CORRUPT) {
        return status == UMB_OK ? UMB_OK : umb_fail(error, status, "%s", why.message);
    }
    return umb_fail(error, UMB_E_CORRUPT,
                    "job table: '%.150s' is damaged (%.150s); restore it from a copy, or save what "
                    "is left by `sqlite3 FILE .recover`",
                    path, why.message);
}

enum umb_status umbj_table_open(const char *path, const struct umbj_limits *limits,
                                struct umbj_table **out, struct umb_error *error)
{
    *out = NULL;
    struct umbj_table *table = calloc(1, sizeof *table);
    if (table == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the job table");
    }
    table->limits = *limits;
    enum umb_status status = umbj_sql_open(path, &table->sql, error);
    if (status == UMB_OK) {
        status = check_pages(&table->sql, path, error);
    }
    if (status == UMB_OK) {
        status = prepare_schema(table, error);
    }
    if (status != UMB_OK) {
        umbj_table_close(table);
        return status;
    }
    *out = table;
    return UMB_OK;
}

int64_t umbj_table_damaged(const struct umbj_table *table)
{
    return table->damaged;
}

enum umb_status umbj_table_freeze(struct umbj_table *table, struct umb_error *error)
{
    return umbj_sql_do(&table->sql, error, "PRAGMA query_only = ON", "");
}

void umbj_table_close(struct umbj_table *table)
{
    if (table != NULL) {
        umbj_sql_close(&table->sql);
        free(table);
    }
}

enum umb_status umbj_table_find_same(struct umbj_table *table, const char *owner,
                                     const uint8_t *key, struct umbj_job *job,
                                     struct umb_error *error)
{
    return umbj__find_job(table, 0, job, "like this", error,
                          UMBJ__SELECT_JOBS
                          "WHERE owner = ? AND key = ? AND (state IN (0, 1)"
                          " OR (state = 2 AND EXISTS(SELECT 1 FROM owned WHERE owned.asset ="
                          " job.asset AND owned.owner = job.owner))) ORDER BY seq DESC LIMIT 1",
                          "th", owner, key);
}

enum umb_status umbj_table_get(struct umbj_table *table, const char *id, const char *owner,
                               struct umbj_job *job, struct umb_error *error)
{
    char wanted[UMBJ_ID_SIZE]; /* id may be job->id */
    (void)snprintf(wanted, sizeof wanted, "%s", id);
    return umbj__find_job(table, 0, job, wanted, error,
                          UMBJ__SELECT_JOBS "WHERE id = ?1 AND (?2 IS NULL OR owner = ?2)", "tt",
                          wanted, owner);
}

struct list {
    struct umbj_job *jobs;
    size_t count, capacity;
};

static enum umb_status take_listed(void *user, sqlite3_stmt *row)
{
    struct list *list = user;
    if (list->count == list->capacity) {
        size_t capacity = list->capacity == 0 ? 16 : 2 * list->capacity;
        struct umbj_job *jobs = realloc(list->jobs, capacity * sizeof *jobs);
        if (jobs == NULL) {
            return UMB_E_NO_MEMORY;
        }
        list->jobs = jobs;
        list->capacity = capacity;
    }
    struct umbj_job *job = &list->jobs[list->count];
    umbj__read_job(row, job);
    list->count += job->id[0] != '\0'; /* a job without an id is not listed */
    return UMB_OK;
}

enum umb_status umbj_table_list(struct umbj_table *table, const char *owner, int64_t most,
                                struct umbj_job **jobs, size_t *count, struct umb_error *error)
{
    struct list list = {0};
    enum umb_status status =
        owner != NULL ? umbj_sql_run(&table->sql, error, take_listed, &list,
                                     UMBJ__SELECT_JOBS "WHERE owner = ? ORDER BY seq DESC LIMIT ?",
                                     "ti", owner, most)
                      : umbj_sql_run(&table->sql, error, take_listed, &list,
                                     UMBJ__SELECT_JOBS "ORDER BY seq DESC LIMIT ?", "i", most);
    if (status == UMB_E_NO_MEMORY) {
        (void)umb_fail(error, status, "out of memory for a list of jobs");
    }
    if (status != UMB_OK) {
        free(list.jobs);
        list = (struct list){0};
    }
    *jobs = list.jobs;
    *count = list.count;
    return status;
}

enum umb_status umbj_table_next_start(struct umbj_table *table, int64_t now, int64_t *when,
                                      struct umb_error *error)
{
    *when = INT64_MAX;
    const enum umb_status status =
        umbj_sql_number(&table->sql, error, when,
                        "SELECT min(CASE WHEN " UMBJ__MAY_START " THEN ?1 ELSE not_before_ms END)"
                        " FROM job WHERE state = 0",
                        "ii", now, now + UMBJ_PAUSE_MAX_MS);
    *when = *when < now ? now : *when;
    return status;
}

enum umb_status umbj_table_bundle_users(struct umbj_table *table, const uint8_t *key,
                                        int64_t *count, struct umb_error *error)
{
    *count = 0;
    return umbj_sql_number(&table->sql, error, count,
                           "SELECT count(*) FROM job WHERE key = ? AND state IN (0, 1)", "h", key);
}

enum umb_status umbj_table_prune(struct umbj_table *table, int64_t before, struct umb_error *error)
{
    return umbj_sql_do(&table->sql, error, "DELETE FROM job WHERE state > 1 AND ended_ms < ?", "i",
                       before);
}
