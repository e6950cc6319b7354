/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Assets made by jobs and their owners; counts of jobs and assets; and the quotas for both.
 *
 * An asset lives as long as it has an owner. Its file is removed before its row, so no file is ever
 * left without a row.
 *
 * Counts: jobs by state, and the jobs and bytes kept for each owner. Triggers update the counts in
 * the transaction of each change, so no change scans all rows. Each start counts all rows again.
 */
#include "jobs/job_table_internal.h"

#include <string.h>

#include "base/try.h"

enum umb_status umbj__make_counts(struct umbj_table *table, struct umb_error *error)
{
    static const char *const steps[] = {
        "CREATE TABLE state_count(state INTEGER PRIMARY KEY, count INTEGER NOT NULL)",
        /* jobs: finished jobs; bytes: size of the owner's assets */
        "CREATE TABLE tally(owner TEXT PRIMARY KEY, jobs INTEGER NOT NULL DEFAULT 0,"
        " bytes INTEGER NOT NULL DEFAULT 0)",
        "CREATE INDEX job_over ON job(owner, seq) WHERE state > 1",
        "CREATE INDEX asset_unowned ON asset(owners) WHERE owners < 1",
        "CREATE TRIGGER job_added AFTER INSERT ON job BEGIN"
        " UPDATE state_count SET count = count + 1 WHERE state = new.state;"
        " INSERT OR IGNORE INTO tally(owner) VALUES(new.owner); END",
        "CREATE TRIGGER job_moved AFTER UPDATE OF state ON job WHEN old.state <> new.state BEGIN"
        " UPDATE state_count SET count = count - 1 WHERE state = old.state;"
        " UPDATE state_count SET count = count + 1 WHERE state = new.state;"
        " UPDATE tally SET jobs = jobs + (new.state > 1) - (old.state > 1) WHERE owner = new.owner;"
        " END",
        "CREATE TRIGGER job_removed AFTER DELETE ON job BEGIN"
        " UPDATE state_count SET count = count - 1 WHERE state = old.state;"
        " UPDATE tally SET jobs = jobs - (old.state > 1) WHERE owner = old.owner; END",
        "CREATE TRIGGER owned_added AFTER INSERT ON owned BEGIN"
        " INSERT OR IGNORE INTO tally(owner) VALUES(new.owner);"
        " UPDATE tally SET bytes = bytes + (SELECT bytes FROM asset WHERE id = new.asset)"
        " WHERE owner = new.owner;"
        " UPDATE asset SET owners = owners + 1 WHERE id = new.asset; END",
        "CREATE TRIGGER owned_removed AFTER DELETE ON owned BEGIN"
        " UPDATE tally SET bytes = bytes - coalesce((SELECT bytes FROM asset WHERE id = "
        "old.asset), 0)"
        " WHERE owner = old.owner;"
        " UPDATE asset SET owners = owners - 1 WHERE id = old.asset; END",
        "CREATE TRIGGER asset_sized AFTER UPDATE OF bytes ON asset WHEN old.bytes <> new.bytes "
        "BEGIN"
        " UPDATE tally SET bytes = bytes + new.bytes - old.bytes WHERE owner IN"
        " (SELECT owner FROM owned WHERE asset = new.id); END",
    };
    return umbj_sql_do_all(&table->sql, error, steps, sizeof steps / sizeof steps[0]);
}

enum umb_status umbj__count_anew(struct umbj_table *table, struct umb_error *error)
{
    static const char *const steps[] = {
        "DELETE FROM state_count",
        "INSERT INTO state_count VALUES(0, 0), (1, 0), (2, 0), (3, 0), (4, 0)",
        "UPDATE state_count SET count = (SELECT count(*) FROM job WHERE job.state ="
        " state_count.state)",
        "DELETE FROM tally",
        "INSERT INTO tally(owner, jobs) SELECT owner, sum(state > 1) FROM job GROUP BY owner",
        "INSERT OR IGNORE INTO tally(owner) SELECT DISTINCT owner FROM owned",
        "UPDATE tally SET bytes = (SELECT coalesce(sum(asset.bytes), 0) FROM owned JOIN asset ON"
        " asset.id = owned.asset WHERE owned.owner = tally.owner)",
        "UPDATE asset SET owners = (SELECT count(*) FROM owned WHERE owned.asset = asset.id)",
    };
    UMB__TRY(umbj_sql_begin(&table->sql, error));
    return umbj_sql_end(&table->sql,
                        umbj_sql_do_all(&table->sql, error, steps, sizeof steps / sizeof steps[0]),
                        error);
}

static enum umb_status take_state_count(void *user, sqlite3_stmt *row)
{
    int64_t *counts = user;
    const int64_t state = sqlite3_column_int64(row, 0);
    if (state >= 0 && state < UMBJ_STATE_COUNT) {
        counts[state] = sqlite3_column_int64(row, 1);
    }
    return UMB_OK;
}

enum umb_status umbj_table_count(struct umbj_table *table, int64_t counts[UMBJ_STATE_COUNT],
                                 struct umb_error *error)
{
    memset(counts, 0, UMBJ_STATE_COUNT * sizeof *counts);
    return umbj_sql_run(&table->sql, error, take_state_count, counts,
                        "SELECT state, count FROM state_count", "");
}

enum umb_status umbj_table_kept(struct umbj_table *table, const char *owner, struct umbj_kept *kept,
                                struct umb_error *error)
{
    *kept = (struct umbj_kept){0, 0};
    return owner != NULL
               ? umbj_sql_do(&table->sql, error,
                             "SELECT sum(jobs), sum(bytes) FROM tally WHERE owner = ?", "t>ii",
                             owner, &kept->jobs, &kept->asset_bytes)
               : umbj_sql_do(&table->sql, error, "SELECT sum(jobs), sum(bytes) FROM tally", ">ii",
                             &kept->jobs, &kept->asset_bytes);
}

enum umb_status umbj_table_trim(struct umbj_table *table, const char *owner,
                                struct umb_error *error)
{
    struct umbj_kept kept;
    const int64_t most = table->limits.owner_history;
    UMB__TRY(umbj_table_kept(table, owner, &kept, error));
    if (most == 0 || kept.jobs <= most) {
        return UMB_OK;
    }
    return umbj_sql_do(&table->sql, error,
                       "DELETE FROM job WHERE seq IN (SELECT seq FROM job WHERE owner = ? AND"
                       " state > 1 ORDER BY seq LIMIT ?)",
                       "ti", owner, kept.jobs - most);
}

/* Counts a refusal by a quota. Returns E_BUSY, for which the caller has already written the
 * message. */
static enum umb_status refuse(struct umbj_table *table, enum umbj_quota quota)
{
    table->refused[quota]++;
    return UMB_E_BUSY;
}

/* Checks the quota of an owner's assets. At a submission the quota must not be full; at publishing
 * the asset must fit. */
static enum umb_status check_assets(struct umbj_table *table, const char *owner, int64_t bytes,
                                    struct umb_error *error)
{
    struct umbj_kept kept;
    const int64_t most = table->limits.owner_assets;
    UMB__TRY(umbj_table_kept(table, owner, &kept, error));
    if (most == 0 || bytes <= most - kept.asset_bytes) {
        return UMB_OK;
    }
    (void)umb_fail(error, UMB_E_BUSY,
                   "assets: you keep %lld bytes, %s%lld more are over the limit of %lld "
                   "(--owner-assets); delete some of yours (umbrage rm ASSET)",
                   (long long)kept.asset_bytes, bytes > 1 ? "and " : "so that even ",
                   (long long)bytes, (long long)most);
    return refuse(table, UMBJ_QUOTA_ASSETS);
}

enum umb_status umbj_table_check_asset(struct umbj_table *table, const char *owner,
                                       const uint8_t *asset, int64_t bytes, struct umb_error *error)
{
    int owned = 0;
    UMB__TRY(umbj_table_asset(table, asset, owner, &owned, error));
    return owned ? UMB_OK : check_assets(table, owner, bytes, error);
}

/* Reads the number and the bytes of the owner's unfinished jobs, and the bytes of all owners'
 * jobs. */
static enum umb_status count_unfinished(struct umbj_table *table, const char *owner,
                                        struct umbj_pending *used, struct umb_error *error)
{
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "SELECT count(*), sum(bundle_bytes) FROM job WHERE state IN (0, 1)"
                         " AND owner = ?",
                         "t>ii", owner, &used->own_jobs, &used->own_bytes));
    return umbj_sql_do(&table->sql, error,
                       "SELECT sum(bytes) FROM (SELECT max(bundle_bytes) AS bytes FROM job"
                       " WHERE state IN (0, 1) GROUP BY key)",
                       ">i", &used->all_bytes);
}

enum umb_status umbj_table_check_quota(struct umbj_table *table, const char *owner,
                                       int64_t bundle_bytes, const struct umbj_pending *pending,
                                       struct umb_error *error)
{
    static const struct umbj_pending none = {0, 0, 0};
    const struct umbj_limits *limits = &table->limits;
    struct umbj_pending used = {0, 0, 0};
    UMB__TRY(count_unfinished(table, owner, &used, error));
    pending = pending != NULL ? pending : &none;
    const int64_t jobs = used.own_jobs + pending->own_jobs;
    const int64_t bytes = used.own_bytes + pending->own_bytes;
    if (jobs >= limits->owner_jobs) {
        (void)umb_fail(error, UMB_E_BUSY,
                       "jobs: %lld of yours are unfinished, the limit is %lld (--owner-jobs)",
                       (long long)jobs, (long long)limits->owner_jobs);
        return refuse(table, UMBJ_QUOTA_JOBS);
    }
    if (bundle_bytes > limits->owner_bytes - bytes) {
        (void)umb_fail(error, UMB_E_BUSY,
                       "bundle: %lld bytes and %lld of your unfinished jobs are over the limit of "
                       "%lld (--owner-bytes)",
                       (long long)bundle_bytes, (long long)bytes, (long long)limits->owner_bytes);
        return refuse(table, UMBJ_QUOTA_BYTES);
    }
    if (bundle_bytes > limits->total_bytes - used.all_bytes - pending->all_bytes) {
        (void)umb_fail(error, UMB_E_BUSY,
                       "bundle: the server's space for jobs is full; try again "
                       "later (--job-bytes)");
        return refuse(table, UMBJ_QUOTA_SPACE);
    }
    return check_assets(table, owner, 1, error);
}

int64_t umbj_table_refused(const struct umbj_table *table, enum umbj_quota quota)
{
    return table->refused[quota];
}

const char *umbj_quota_name(enum umbj_quota quota)
{
    static const char *const names[UMBJ_QUOTA_COUNT] = {"jobs", "bytes", "space", "assets"};
    return (unsigned)quota < UMBJ_QUOTA_COUNT ? names[quota] : "unknown";
}

enum umb_status umbj_table_announce(struct umbj_table *table, const uint8_t *asset, int64_t bytes,
                                    struct umb_error *error)
{
    UMB__TRY(
        umbj_sql_do(&table->sql, error, "INSERT OR IGNORE INTO asset(id) VALUES(?)", "h", asset));
    return umbj_sql_do(&table->sql, error,
                       "UPDATE asset SET bytes = ?1 WHERE id = ?2 AND bytes <> ?1", "ih", bytes,
                       asset);
}

/* Adds the message where a statement has found no row. */
static enum umb_status explain(enum umb_status status, const char *otherwise,
                               struct umb_error *error)
{
    return status == UMB_E_NOT_FOUND ? umb_fail(error, status, "%s", otherwise) : status;
}

enum umb_status umbj_table_find_bake(struct umbj_table *table, const uint8_t *key,
                                     uint8_t asset[UMBJ_HASH_BYTES], int64_t *bake_ms,
                                     struct umb_error *error)
{
    *bake_ms = 0;
    enum umb_status status =
        umbj_sql_do(&table->sql, error, "SELECT asset, bake_ms FROM bake WHERE key = ?", "h>hi",
                    key, asset, bake_ms);
    if (status == UMB_OK && (*bake_ms < 0 || *bake_ms > UMBJ__BAKE_MS_MAX)) {
        status = UMB_E_NOT_FOUND;
    }
    return explain(status, "no bake of this scene is known", error);
}

enum umb_status umbj_table_asset(struct umbj_table *table, const uint8_t *asset, const char *owner,
                                 int *owned, struct umb_error *error)
{
    int64_t owners = 0;
    const enum umb_status status = umbj_sql_do(&table->sql, error,
                                               "SELECT count(*) FROM owned WHERE asset = ?1"
                                               " AND (?2 IS NULL OR owner = ?2)",
                                               "ht>i", asset, owner, &owners);
    *owned = owners > 0;
    return status;
}

enum umb_status umbj_table_disown(struct umbj_table *table, const uint8_t *asset, const char *owner,
                                  struct umb_error *error)
{
    UMB__TRY(umbj_sql_do(&table->sql, error,
                         "DELETE FROM owned WHERE asset = ?1 AND (?2 IS NULL OR owner = ?2)", "ht",
                         asset, owner));
    return umbj_sql_changes(&table->sql) > 0
               ? UMB_OK
               : umb_fail(error, UMB_E_NOT_FOUND, "asset: no job of yours made it");
}

enum umb_status umbj_table_unowned(struct umbj_table *table, uint8_t asset[UMBJ_HASH_BYTES],
                                   struct umb_error *error)
{
    const enum umb_status status = umbj_sql_do(
        &table->sql, error, "SELECT id FROM asset WHERE owners < 1 AND length(id) = 32 LIMIT 1",
        ">h", asset);
    return explain(status, "every asset has an owner", error);
}

enum umb_status umbj_table_next_unsized(struct umbj_table *table, uint8_t asset[UMBJ_HASH_BYTES],
                                        struct umb_error *error)
{
    uint8_t after[UMBJ_HASH_BYTES];
    memcpy(after, asset, sizeof after);
    const enum umb_status status =
        umbj_sql_do(&table->sql, error,
                    "SELECT id FROM asset WHERE bytes = 0 AND id > ? AND length(id) = 32"
                    " ORDER BY id LIMIT 1",
                    "h>h", after, asset);
    return explain(status, "every asset has a size", error);
}

static enum umb_status forget(struct umbj_sql *sql, const uint8_t *asset, struct umb_error *error)
{
    UMB__TRY(umbj_sql_do(sql, error,
                         "DELETE FROM asset WHERE id = ?1 AND NOT EXISTS"
                         " (SELECT 1 FROM owned WHERE asset = ?1)",
                         "h", asset));
    return umbj_sql_do(sql, error,
                       "DELETE FROM bake WHERE asset = ?1 AND NOT EXISTS"
                       " (SELECT 1 FROM owned WHERE asset = ?1)",
                       "h", asset);
}

enum umb_status umbj_table_forget(struct umbj_table *table, const uint8_t *asset,
                                  struct umb_error *error)
{
    UMB__TRY(umbj_sql_begin(&table->sql, error));
    return umbj_sql_end(&table->sql, forget(&table->sql, asset, error), error);
}

struct owned_reading {
    umbj_owned_fn found;
    void *user;
};

static enum umb_status take_owned(void *user, sqlite3_stmt *row)
{
    const struct owned_reading *reading = user;
    uint8_t asset[UMBJ_HASH_BYTES];
    char owner[UMBJ_OWNER_SIZE];
    umbj_sql_text(row, 1, owner, sizeof owner);
    if (umbj_sql_hash(row, 0, asset)) {
        reading->found(reading->user, asset, owner);
    }
    return UMB_OK;
}

enum umb_status umbj_table_owned(struct umbj_table *table, umbj_owned_fn found, void *user,
                                 struct umb_error *error)
{
    struct owned_reading reading = {found, user};
    return umbj_sql_run(&table->sql, error, take_owned, &reading,
                        "SELECT asset.id, coalesce(owned.owner, '') FROM asset"
                        " JOIN owned ON owned.asset = asset.id",
                        "");
}
