/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The job table: its file, its rows, and its look-ups.
 *
 * Invariants: a running job has epoch > 0 and a lease. A job that has ended has ended_ms; if it is
 * done it has an asset. Every change of state is one statement or one transaction.
 *
 * A damaged page, or a user with sqlite3, may put any value into any column. So each column is
 * checked before use, like a manifest. A damaged row becomes a failed job, with the column's name
 * as its cause. A row with a damaged id or owner cannot be shown to any owner and is removed.
 * Neither is run: no value of a damaged row reaches a path or a command line.
 */
#include "jobs/job_table_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "common/clean_text.h"
#include "jobs/bundle.h"

#define NUMBER_MAX     ((int64_t)1 << 53) /* limit of times, epochs, bytes: exact as a double */
#define SCHEMA_VERSION 2

/* Row being read, and the name of its first damaged column. */
struct reading {
    sqlite3_stmt *row;
    const char *damage;
};

static void blame(struct reading *reading, int is_sound, const char *column)
{
    if (!is_sound && reading->damage == NULL) {
        reading->damage = column;
    }
}

/* Takes a text of less than `size` bytes; "" if the column is not one. */
static int take_text(struct reading *reading, int column, char *out, size_t size)
{
    out[0] = '\0';
    if (sqlite3_column_type(reading->row, column) != SQLITE_TEXT) {
        return 0;
    }
    umbj_sql_text(reading->row, column, out, size);
    return (size_t)sqlite3_column_bytes(reading->row, column) == strlen(out);
}

static int64_t take_integer(struct reading *reading, int column, const char *name, int64_t least,
                            int64_t most)
{
    const int64_t value = sqlite3_column_int64(reading->row, column);
    const int is_sound = sqlite3_column_type(reading->row, column) == SQLITE_INTEGER &&
                         value >= least && value <= most;
    blame(reading, is_sound, name);
    return is_sound ? value : least > 0 ? least : 0;
}

static int is_id(const char *id)
{
    return strlen(id) == UMBJ_ID_SIZE - 1 && strspn(id, "0123456789abcdef") == UMBJ_ID_SIZE - 1;
}

static void take_names(struct reading *reading, struct umbj_job *job)
{
    if (!take_text(reading, 0, job->id, sizeof job->id) || !is_id(job->id)) {
        job->id[0] = '\0';
        blame(reading, 0, "id");
    }
    if (!take_text(reading, 1, job->owner, sizeof job->owner) ||
        !umbs_text_is_clean(job->owner, strlen(job->owner), 0)) {
        job->id[0] = '\0'; /* no owner may see it */
        job->owner[0] = '\0';
        blame(reading, 0, "owner");
    }
    blame(reading, umbj_sql_hash(reading->row, 2, job->key), "key");
}

static void take_numbers(struct reading *reading, struct umbj_job *job)
{
    job->state = (enum umbj_state)take_integer(reading, 3, "state", 0, UMBJ_STATE_COUNT - 1);
    job->failure =
        (enum umbj_failure)take_integer(reading, 4, "failure", 0, UMBJ_FAILURE_COUNT - 1);
    job->priority =
        (int)take_integer(reading, 5, "priority", -UMBJ_PRIORITY_MAX, UMBJ_PRIORITY_MAX);
    job->epoch = take_integer(reading, 6, "epoch", 0, NUMBER_MAX);
    job->tries = take_integer(reading, 7, "tries", 0, UMBJ_TRIES_MAX);
    job->hard_tries = take_integer(reading, 8, "hard_tries", 0, UMBJ_HARD_TRIES_MAX);
    job->submitted_ms = take_integer(reading, 9, "submitted_ms", 0, NUMBER_MAX);
    job->started_ms = take_integer(reading, 10, "started_ms", 0, NUMBER_MAX);
    job->ended_ms = take_integer(reading, 11, "ended_ms", 0, NUMBER_MAX);
    job->not_before_ms = take_integer(reading, 12, "not_before_ms", 0, NUMBER_MAX);
    job->lease_until_ms = take_integer(reading, 13, "lease_until_ms", 0, NUMBER_MAX);
    job->bundle_bytes = take_integer(reading, 14, "bundle_bytes", 0, NUMBER_MAX);
}

/* Checks columns against each other. */
static void check_whole(struct reading *reading, const struct umbj_job *job)
{
    const int has_asset = sqlite3_column_type(reading->row, 15) != SQLITE_NULL;
    blame(reading, has_asset == job->has_asset && (job->has_asset || job->state != UMBJ_DONE),
          "asset");
    blame(reading, job->epoch > 0 || job->state != UMBJ_RUNNING, "epoch");
}

/* Reads a row of UMBJ__SELECT_JOBS. For a damaged row `damage` is set, and the job is failed with a
 * cause; its id is empty if the row has no valid owner. */
static void read_job(sqlite3_stmt *row, struct umbj_job *job)
{
    char cause[UMBJ_CAUSE_SIZE];
    struct reading reading = {row, NULL};
    memset(job, 0, sizeof *job);
    take_names(&reading, job);
    take_numbers(&reading, job);
    job->has_asset = umbj_sql_hash(row, 15, job->asset);
    (void)take_text(&reading, 16, cause, sizeof cause); /* text for people only */
    umbs_text_clean(job->cause, sizeof job->cause, cause, strlen(cause));
    job->row = sqlite3_column_int64(row, 17);
    check_whole(&reading, job);
    if (reading.damage != NULL) {
        job->damage = reading.damage;
        job->state = UMBJ_FAILED;
        job->failure = UMBJ_INTERNAL;
        job->has_asset = 0;
        snprintf(job->cause, sizeof job->cause, "its row in the job table is damaged (%s)",
                 job->damage);
    }
}

/* Stores the failed job that read_job made of a damaged row; removes a row without a valid
 * owner. */
static enum umb_status retire(struct umbj_table *table, const struct umbj_job *job, int64_t now,
                              struct umb_error *error)
{
    const int64_t ended = now > 0 ? now : job->ended_ms > 0 ? job->ended_ms : job->submitted_ms;
    table->damaged++;
    if (job->id[0] == '\0') {
        return umbj_sql_do(&table->sql, error, "DELETE FROM job WHERE seq = ?", "i", job->row);
    }
    return umbj_sql_do(
        &table->sql, error,
        "UPDATE job SET key = ?, state = 3, failure = ?, priority = ?, epoch = ?, tries = ?,"
        " hard_tries = ?, submitted_ms = ?, started_ms = ?, ended_ms = ?, not_before_ms = 0,"
        " lease_until_ms = 0, bundle_bytes = ?, asset = NULL, cause = ?, scene = '', settings = ''"
        " WHERE seq = ?",
        "hiiiiiiiiiti", job->key, (int64_t)UMBJ_INTERNAL, (int64_t)job->priority, job->epoch,
        job->tries, job->hard_tries, job->submitted_ms, job->started_ms, ended, job->bundle_bytes,
        job->cause, job->row);
}

static enum umb_status take_job(void *user, sqlite3_stmt *row)
{
    read_job(row, user);
    return UMB_OK;
}

enum umb_status umbj__find_job(struct umbj_table *table, int64_t now, struct umbj_job *job,
                               const char *what, struct umb_error *error, const char *text,
                               const char *types, ...)
{
    do {
        va_list arguments;
        memset(job, 0, sizeof *job);
        va_start(arguments, types);
        const enum umb_status status =
            umbj_sql_run_list(&table->sql, error, take_job, job, text, types, arguments);
        va_end(arguments);
        UMB__TRY(status);
        if (job->damage != NULL) {
            UMB__TRY(retire(table, job, now, error));
        }
    } while (job->damage != NULL);
    return job->id[0] != '\0' ? UMB_OK
                              : umb_fail(error, UMB_E_NOT_FOUND, "job: there is no '%.40s'", what);
}

/* Scene and settings of one row. */
struct spec {
    int found;
    char *scene, *settings; /* [UMBJ_SCENE_SIZE], [UMBJ_SETTINGS_SIZE] */
    const char *damage;     /* Name of the damaged column, NULL = none */
};

static enum umb_status take_spec(void *user, sqlite3_stmt *row)
{
    struct spec *spec = user;
    struct reading reading = {row, NULL};
    struct umb_error error = {0};
    spec->found = 1;
    if (!take_text(&reading, 0, spec->scene, UMBJ_SCENE_SIZE) ||
        umbj_scene_check(spec->scene, &error) != UMB_OK) {
        spec->damage = "scene";
    } else if (!take_text(&reading, 1, spec->settings, UMBJ_SETTINGS_SIZE) ||
               umbj_settings_check(spec->settings, &error) != UMB_OK) {
        spec->damage = "settings";
    }
    return UMB_OK;
}

enum umb_status umbj_table_spec(struct umbj_table *table, const char *id,
                                char scene[UMBJ_SCENE_SIZE], char settings[UMBJ_SETTINGS_SIZE],
                                struct umb_error *error)
{
    struct spec spec = {0, scene, settings, NULL};
    UMB__TRY(umbj_sql_run(&table->sql, error, take_spec, &spec,
                          "SELECT scene, settings FROM job WHERE id = ?", "t", id));
    if (!spec.found) {
        return umb_fail(error, UMB_E_NOT_FOUND, "job: there is no '%.40s'", id);
    }
    return spec.damage == NULL ? UMB_OK
                               : umb_fail(error, UMB_E_CORRUPT,
                                          "its row in the job table is damaged (%s)", spec.damage);
}

/* Most damaged rows of one scan. Retiring a row changes the table, so it is done after the scan. */
#define LOOK_MOST 64
struct look {
    struct umbj_job jobs[LOOK_MOST];
    size_t count;
    int64_t last; /* seq of the last row read */
};

static enum umb_status look_at_row(void *user, sqlite3_stmt *row)
{
    struct look *look = user;
    if (look->count < LOOK_MOST) { /* other rows are read in the next scan */
        struct umbj_job *job = &look->jobs[look->count];
        read_job(row, job);
        look->last = job->row;
        look->count += job->damage != NULL;
    }
    return UMB_OK;
}

static enum umb_status mend_jobs(struct umbj_table *table, int64_t now, struct umb_error *error)
{
    struct look *look = calloc(1, sizeof *look);
    if (look == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the job table");
    }
    enum umb_status status = UMB_OK;
    look->last = INT64_MIN;
    do {
        look->count = 0;
        status = umbj_sql_run(&table->sql, error, look_at_row, look,
                              UMBJ__SELECT_JOBS "WHERE seq > ? ORDER BY seq", "i", look->last);
        for (size_t i = 0; status == UMB_OK && i < look->count; i++) {
            status = retire(table, &look->jobs[i], now, error);
        }
    } while (status == UMB_OK && look->count == LOOK_MOST);
    free(look);
    return status;
}

enum umb_status umbj__mend(struct umbj_table *table, int64_t now, struct umb_error *error)
{
    static const char *const sweeps[] = {
        "DELETE FROM owned WHERE typeof(asset) <> 'blob' OR length(asset) <> 32"
        " OR typeof(owner) <> 'text' OR length(CAST(owner AS BLOB)) > 63",
        "DELETE FROM bake WHERE typeof(key) <> 'blob' OR length(key) <> 32 OR typeof(asset) <>"
        " 'blob' OR length(asset) <> 32 OR typeof(bake_ms) <> 'integer' OR bake_ms < 0"
        " OR bake_ms > " UMBJ__BAKE_MS_MAX_TEXT,
        "DELETE FROM asset WHERE typeof(id) <> 'blob' OR length(id) <> 32",
        "UPDATE asset SET bytes = 0 WHERE typeof(bytes) <> 'integer' OR bytes < 0"
        " OR bytes > 1125899906842624",
        "DELETE FROM owned WHERE asset NOT IN (SELECT id FROM asset)",
        "DELETE FROM turn WHERE typeof(owner) <> 'text' OR typeof(number) <> 'integer'"
        " OR number < 0 OR number > 9007199254740992",
    };
    UMB__TRY(mend_jobs(table, now, error));
    for (size_t i = 0; i < sizeof sweeps / sizeof sweeps[0]; i++) {
        UMB__TRY(umbj_sql_do(&table->sql, error, sweeps[i], ""));
        table->damaged += umbj_sql_changes(&table->sql);
    }
    return UMB_OK;
}

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
    UMB__TRY(umbj_sql_do(&table->sql, error, "PRAGMA user_version", ">i", &version));
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

/* Fails: E_CORRUPT, with SQLite's verdict. */
static enum umb_status ask_verdict(struct umbj_sql *sql, struct umb_error *error)
{
    char verdict[200] = "ok";
    UMB__TRY(umbj_sql_do(sql, error, "PRAGMA quick_check(1)", ">t", verdict, sizeof verdict));
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
    if (!umb__grow(NULL, &list->jobs, &list->capacity, list->count + 1, sizeof *list->jobs)) {
        return UMB_E_NO_MEMORY;
    }
    struct umbj_job *job = &list->jobs[list->count];
    read_job(row, job);
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
        umbj_sql_do(&table->sql, error,
                    "SELECT min(CASE WHEN " UMBJ__MAY_START " THEN ?1 ELSE not_before_ms END)"
                    " FROM job WHERE state = 0",
                    "ii>i", now, now + UMBJ_PAUSE_MAX_MS, when);
    *when = *when < now ? now : *when;
    return status;
}

enum umb_status umbj_table_bundle_users(struct umbj_table *table, const uint8_t *key,
                                        int64_t *count, struct umb_error *error)
{
    *count = 0;
    return umbj_sql_do(&table->sql, error,
                       "SELECT count(*) FROM job WHERE key = ? AND state IN (0, 1)", "h>i", key,
                       count);
}

enum umb_status umbj_table_prune(struct umbj_table *table, int64_t before, struct umb_error *error)
{
    return umbj_sql_do(&table->sql, error, "DELETE FROM job WHERE state > 1 AND ended_ms < ?", "i",
                       before);
}
