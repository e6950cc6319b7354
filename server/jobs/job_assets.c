/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Assets made by jobs, and their owners. An asset lives as long as it has an owner. Its file is
 * removed first and its row after that, so that no file is ever left without a row.
 */
#include "base/try.h"
#include "jobs/job_table_internal.h"

enum umb_status umbj_table_announce(struct umbj_table *table, const uint8_t *asset, int64_t bytes,
                                    struct umb_error *error)
{
    enum umb_status status = umbj_sql_run(&table->sql, error, NULL, NULL,
                                          "INSERT OR IGNORE INTO asset(id) VALUES(?)", "h", asset);
    return status == UMB_OK
               ? umbj_sql_run(&table->sql, error, NULL, NULL,
                              "UPDATE asset SET bytes = ?1 WHERE id = ?2 AND bytes <> ?1", "ih",
                              bytes, asset)
               : status;
}

struct unsized_reading {
    umbj_unsized_fn found;
    void *user;
};

static enum umb_status take_unsized(void *user, sqlite3_stmt *row)
{
    const struct unsized_reading *reading = user;
    uint8_t asset[UMBJ_HASH_BYTES];
    if (umbj_sql_hash(row, 0, asset)) {
        reading->found(reading->user, asset);
    }
    return UMB_OK;
}

enum umb_status umbj_table_unsized(struct umbj_table *table, umbj_unsized_fn found, void *user,
                                   struct umb_error *error)
{
    struct unsized_reading reading = {found, user};
    return umbj_sql_run(&table->sql, error, take_unsized, &reading,
                        "SELECT id FROM asset WHERE bytes = 0", "");
}

struct bake_found {
    int found;
    uint8_t *asset;
    int64_t *bake_ms;
};

static enum umb_status take_bake(void *user, sqlite3_stmt *row)
{
    struct bake_found *bake = user;
    *bake->bake_ms = sqlite3_column_int64(row, 1);
    bake->found = umbj_sql_hash(row, 0, bake->asset) && *bake->bake_ms >= 0 &&
                  *bake->bake_ms <= UMBJ__BAKE_MS_MAX;
    return UMB_OK;
}

enum umb_status umbj_table_find_bake(struct umbj_table *table, const uint8_t *key,
                                     uint8_t asset[UMBJ_HASH_BYTES], int64_t *bake_ms,
                                     struct umb_error *error)
{
    struct bake_found bake = {0, asset, bake_ms};
    enum umb_status status =
        umbj_sql_run(&table->sql, error, take_bake, &bake,
                     "SELECT asset, bake_ms FROM bake WHERE key = ?", "h", key);
    if (status == UMB_OK && !bake.found) {
        status = umb_fail(error, UMB_E_NOT_FOUND, "no bake of this scene is known");
    }
    return status;
}

enum umb_status umbj_table_asset(struct umbj_table *table, const uint8_t *asset, const char *owner,
                                 int *known, int *owned, struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    int64_t rows = 0, owners = 0;
    enum umb_status status = umbj_sql_run(sql, error, umbj__take_number, &rows,
                                          "SELECT count(*) FROM asset WHERE id = ?", "h", asset);
    if (status == UMB_OK && owner != NULL) {
        status = umbj_sql_run(sql, error, umbj__take_number, &owners,
                              "SELECT count(*) FROM owned WHERE asset = ? AND owner = ?", "ht",
                              asset, owner);
    } else if (status == UMB_OK) {
        status = umbj_sql_run(sql, error, umbj__take_number, &owners,
                              "SELECT count(*) FROM owned WHERE asset = ?", "h", asset);
    }
    *known = rows > 0;
    *owned = owners > 0;
    return status;
}

enum umb_status umbj_table_disown(struct umbj_table *table, const uint8_t *asset, const char *owner,
                                  struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    enum umb_status status =
        owner != NULL
            ? umbj_sql_run(sql, error, NULL, NULL,
                           "DELETE FROM owned WHERE asset = ? AND owner = ?", "ht", asset, owner)
            : umbj_sql_run(sql, error, NULL, NULL, "DELETE FROM owned WHERE asset = ?", "h", asset);
    if (status == UMB_OK && umbj_sql_changes(sql) == 0) {
        status = umb_fail(error, UMB_E_NOT_FOUND, "asset: no job of yours made it");
    }
    return status;
}

static enum umb_status take_hash(void *user, sqlite3_stmt *row)
{
    struct bake_found *bake = user;
    bake->found = umbj_sql_hash(row, 0, bake->asset);
    return UMB_OK;
}

enum umb_status umbj_table_unowned(struct umbj_table *table, uint8_t asset[UMBJ_HASH_BYTES],
                                   struct umb_error *error)
{
    struct bake_found found = {.asset = asset};
    enum umb_status status = umbj_sql_run(&table->sql, error, take_hash, &found,
                                          "SELECT id FROM asset WHERE owners < 1 AND"
                                          " length(id) = 32 LIMIT 1",
                                          "");
    if (status == UMB_OK && !found.found) {
        status = umb_fail(error, UMB_E_NOT_FOUND, "every asset has an owner");
    }
    return status;
}

enum umb_status umbj_table_forget(struct umbj_table *table, const uint8_t *asset,
                                  struct umb_error *error)
{
    struct umbj_sql *sql = &table->sql;
    UMB__TRY(umbj_sql_begin(sql, error));
    enum umb_status status = umbj_sql_run(sql, error, NULL, NULL,
                                          "DELETE FROM asset WHERE id = ?1 AND NOT EXISTS"
                                          " (SELECT 1 FROM owned WHERE asset = ?1)",
                                          "h", asset);
    if (status == UMB_OK) {
        status = umbj_sql_run(sql, error, NULL, NULL,
                              "DELETE FROM bake WHERE asset = ?1 AND NOT EXISTS"
                              " (SELECT 1 FROM owned WHERE asset = ?1)",
                              "h", asset);
    }
    return umbj_sql_end(sql, status, error);
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
    return umbj_sql_hash(row, 0, asset) ? reading->found(reading->user, asset, owner) : UMB_OK;
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
