/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Validation of rows of the job table. A damaged page, or a user with sqlite3, may put any value
 * into any column. So each column is checked before use, like a manifest.
 *
 * A damaged row becomes a failed job, with the column's name as its cause. A row with a damaged id
 * or owner cannot be shown to any owner and is removed. Neither is run: no value of a damaged row
 * reaches a path or a command line.
 */
#include "jobs/job_table_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"
#include "jobs/bundle.h"

#define NUMBER_MAX ((int64_t)1 << 53) /* limit of times, epochs, bytes: exact as a double */

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

void umbj__read_job(sqlite3_stmt *row, struct umbj_job *job)
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

/* Stores the failed job that umbj__read_job made of a damaged row; removes a row without a valid
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
    umbj__read_job(row, user);
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
        umbj__read_job(row, job);
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
