/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_SQL_H
#define UMBRAGE_SERVER_JOBS_JOB_SQL_H
/*
 * SQLite for the job table: one statement in each call, failures as umb_status.
 *
 * Life: umbj_sql_open, umbj_sql_run ..., umbj_sql_close. Changes that belong together go between
 * umbj_sql_begin and umbj_sql_end. If one of them fails, umbj_sql_end rolls all of them back.
 *
 * Durability: journal in WAL mode with synchronous=FULL. A change survives a kill and a power cut
 * once its statement, or the umbj_sql_end of its transaction, has succeeded (SQLite, "Write-Ahead
 * Logging").
 *
 * Threads: one at a time.
 */
#include <sqlite3.h>
#include <stdarg.h>
#include "jobs/job.h"

struct umbj_sql {
    sqlite3 *database;
};

/* Opens or creates a database and sets its modes. Fails: E_CANNOT_CREATE, E_CORRUPT (not a
 * database), E_BUSY (another process writes to it), E_UNSUPPORTED (the journal or the syncs
 * described above are not available), E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_sql_open(const char *path, struct umbj_sql *sql,
                                          struct umb_error *error);
void umbj_sql_close(struct umbj_sql *sql);

/* Callback for one row of a result. A status other than UMB_OK ends the statement with that
 * status. */
typedef enum umb_status (*umbj_row_fn)(void *user, sqlite3_stmt *row);

/*
 * Runs one statement.
 *
 * In:    row: callback for each row, or NULL. types: one letter for each `?` of the text and its
 *        argument: t const char *, i int64_t, h const uint8_t[UMBJ_HASH_BYTES]. A NULL pointer is
 *        SQL's NULL. After a '>' one letter for each column of the result's only row, and where to
 *        store it: t char * and its size_t; i int64_t *, unchanged if the column is NULL; h uint8_t
 *        [UMBJ_HASH_BYTES]. Such a statement has no callback.
 * Fails: E_IO, E_BUSY, E_LIMIT (disk full), E_CORRUPT, E_NO_MEMORY, or the status of row.
 *        E_NOT_FOUND, without a message: there is no row to store, or a column is not a hash.
 */
UMB_CHECKED enum umb_status umbj_sql_run(struct umbj_sql *sql, struct umb_error *error,
                                         umbj_row_fn row, void *user, const char *text,
                                         const char *types, ...);
UMB_CHECKED enum umb_status umbj_sql_run_list(struct umbj_sql *sql, struct umb_error *error,
                                              umbj_row_fn row, void *user, const char *text,
                                              const char *types, va_list arguments);

/* The same as umbj_sql_run, without a callback: umbj_sql_do(sql, error, text, types, ...). */
#define umbj_sql_do(sql, error, ...) umbj_sql_run(sql, error, NULL, NULL, __VA_ARGS__)

/* Runs `count` statements without rows and arguments, in order. */
UMB_CHECKED enum umb_status umbj_sql_do_all(struct umbj_sql *sql, struct umb_error *error,
                                            const char *const *texts, size_t count);

/* Reads the database's files from end to end, whatever their content. Fails: E_IO. */
UMB_CHECKED enum umb_status umbj_sql_read_files(struct umbj_sql *sql, struct umb_error *error);

/* Rows that the last changing statement touched. */
int64_t umbj_sql_changes(const struct umbj_sql *sql);

/* Begins and ends one transaction. umbj_sql_end commits if status is UMB_OK, else rolls back.
 * Returns status, or the failure of the commit, which then was rolled back too. */
UMB_CHECKED enum umb_status umbj_sql_begin(struct umbj_sql *sql, struct umb_error *error);
UMB_CHECKED enum umb_status umbj_sql_end(struct umbj_sql *sql, enum umb_status status,
                                         struct umb_error *error);

/* Copies a text column, cut at size - 1 bytes. umbj_sql_hash copies a blob column and returns 1; or
 * returns 0 if the column does not have UMBJ_HASH_BYTES. */
void umbj_sql_text(sqlite3_stmt *row, int column, char *out, size_t size);
int umbj_sql_hash(sqlite3_stmt *row, int column, uint8_t out[UMBJ_HASH_BYTES]);

#endif
