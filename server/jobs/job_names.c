/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Names of assets that jobs replace. A name belongs to an owner. Its row has the asset that the
 * name means now, and the bundle of that asset, which the next version may use again. So the
 * bundle's bytes count for the owner's quota.
 */
#include "jobs/job_table_internal.h"

#include <stdio.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"
#include "jobs/bundle.h"

enum umb_status umbj__make_names(struct umbj_table *table, struct umb_error *error)
{
    static const char *const steps[] = {
        "ALTER TABLE job ADD COLUMN name TEXT NOT NULL DEFAULT ''",
        "CREATE TABLE name(owner TEXT NOT NULL, name TEXT NOT NULL, key BLOB NOT NULL, asset BLOB"
        " NOT NULL, bytes INTEGER NOT NULL, PRIMARY KEY(owner, name))",
        "CREATE INDEX name_by_key ON name(key)",
    };
    return umbj_sql_do_all(&table->sql, error, steps, sizeof steps / sizeof steps[0]);
}

enum umb_status umbj_table_set_name(struct umbj_table *table, const struct umbj_job *job,
                                    const uint8_t *asset, struct umb_error *error)
{
    return umbj_sql_do(&table->sql, error,
                       "INSERT OR REPLACE INTO name(owner, name, key, asset, bytes)"
                       " VALUES(?, ?, ?, ?, ?)",
                       "tthhi", job->owner, job->name, job->key, asset, job->bundle_bytes);
}

enum umb_status umbj_table_rename(struct umbj_table *table, struct umbj_job *job, const char *name,
                                  struct umb_error *error)
{
    (void)snprintf(job->name, sizeof job->name, "%s", name);
    return umbj_sql_do(&table->sql, error, "UPDATE job SET name = ? WHERE id = ?", "tt", name,
                       job->id);
}

enum umb_status umbj_table_find_name(struct umbj_table *table, const char *owner, const char *name,
                                     uint8_t key[UMBJ_HASH_BYTES], struct umb_error *error)
{
    const enum umb_status status =
        umbj_sql_do(&table->sql, error, "SELECT key FROM name WHERE owner = ? AND name = ?", "tt>h",
                    owner, name, key);
    return status == UMB_E_NOT_FOUND
               ? umb_fail(error, status, "replaces: you have no asset named '%.80s'", name)
               : status;
}

enum umb_status umbj_table_check_names(struct umbj_table *table, const char *owner,
                                       const char *name, struct umb_error *error)
{
    int64_t others = 0;
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "SELECT count(*) FROM name WHERE owner = ? AND name <> ?", "tt>i", owner,
                         name, &others));
    return others < UMBJ_NAMES_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_BUSY,
                          "replaces: %lld of your assets have names, the limit is %d; delete one "
                          "(umbrage rm ASSET)",
                          (long long)others, UMBJ_NAMES_MAX);
}

struct name_reading {
    umbj_name_fn found;
    void *user;
};

static enum umb_status take_name(void *user, sqlite3_stmt *row)
{
    const struct name_reading *reading = user;
    struct umbj_job job = {.row = 0};
    struct umb_error error;
    umbj_sql_text(row, 0, job.owner, sizeof job.owner);
    umbj_sql_text(row, 1, job.name, sizeof job.name);
    /* A damaged row names no file. */
    if (umbs_text_is_clean(job.owner, strlen(job.owner), 0) &&
        umbj_name_check(job.name, &error) == UMB_OK && umbj_sql_hash(row, 2, job.key) &&
        umbj_sql_hash(row, 3, job.asset)) {
        reading->found(reading->user, &job);
    }
    return UMB_OK;
}

enum umb_status umbj_table_each_name(struct umbj_table *table, umbj_name_fn found, void *user,
                                     struct umb_error *error)
{
    struct name_reading reading = {found, user};
    return umbj_sql_run(&table->sql, error, take_name, &reading,
                        "SELECT owner, name, key, asset FROM name", "");
}

static void copy_name(void *user, const struct umbj_job *job)
{
    *(struct umbj_job *)user = *job;
}

enum umb_status umbj_table_stale_name(struct umbj_table *table, struct umbj_job *name,
                                      struct umb_error *error)
{
    struct name_reading reading = {copy_name, name};
    memset(name, 0, sizeof *name);
    UMB__TRY(umbj_sql_run(&table->sql, error, take_name, &reading,
                          "SELECT owner, name, key, asset FROM name WHERE NOT EXISTS (SELECT 1 FROM"
                          " owned WHERE owned.asset = name.asset AND owned.owner = name.owner)"
                          " LIMIT 1",
                          ""));
    return name->name[0] != '\0' ? UMB_OK
                                 : umb_fail(error, UMB_E_NOT_FOUND, "every name has an asset");
}

enum umb_status umbj_table_drop_name(struct umbj_table *table, const struct umbj_job *name,
                                     struct umb_error *error)
{
    return umbj_sql_do(&table->sql, error, "DELETE FROM name WHERE owner = ? AND name = ?", "tt",
                       name->owner, name->name);
}
