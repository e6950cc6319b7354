/* SPDX-License-Identifier: Apache-2.0 */
/* SQLite for the job table, see job_sql.h. */
#include "jobs/job_sql.h"

#include <stddef.h>
#include <string.h>

#include "base/try.h"

#define BUSY_MS     5000 /* a user may have the table open in sqlite3 */
#define ANSWER_SIZE 32
#define BLOCK_BYTES 4096

/* A mode that the database must have. */
struct mode {
    const char *set, *ask, *answer;
};

static enum umb_status status_of(int code)
{
    switch (code & 0xff) {
    case SQLITE_NOMEM:
        return UMB_E_NO_MEMORY;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
        return UMB_E_BUSY;
    case SQLITE_FULL:
        return UMB_E_LIMIT;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
        return UMB_E_CORRUPT;
    case SQLITE_CANTOPEN:
        return UMB_E_CANNOT_CREATE;
    case SQLITE_IOERR:
    case SQLITE_READONLY:
        return UMB_E_IO;
    default:
        return UMB_E_INTERNAL;
    }
}

static enum umb_status fail(const struct umbj_sql *sql, int code, struct umb_error *error)
{
    return umb_fail(error, status_of(code), "job table: %.200s",
                    sql->database != NULL ? sqlite3_errmsg(sql->database) : sqlite3_errstr(code));
}

/*
 * Sets one mode and reads it back. If the file system or the build of SQLite does not allow a mode,
 * SQLite keeps the old one without an error.
 */
static enum umb_status set_up(struct umbj_sql *sql, const struct mode *mode,
                              struct umb_error *error)
{
    char answer[ANSWER_SIZE] = "";
    UMB__TRY(umbj_sql_do(sql, error, mode->set, ""));
    UMB__TRY(umbj_sql_do(sql, error, mode->ask, ">t", answer, sizeof answer));
    if (strcmp(answer, mode->answer) != 0) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "job table: '%s' gives '%.20s', not '%s', so acknowledged jobs would not "
                        "survive a power cut; put the table on a local disk (--jobs-db)",
                        mode->set, answer, mode->answer);
    }
    return UMB_OK;
}

enum umb_status umbj_sql_open(const char *path, struct umbj_sql *sql, struct umb_error *error)
{
    static const struct mode modes[] = {
        {"PRAGMA journal_mode=WAL", "PRAGMA journal_mode", "wal"},
        {"PRAGMA synchronous=FULL", "PRAGMA synchronous", "2"},
        {"PRAGMA foreign_keys=ON", "PRAGMA foreign_keys", "1"},
    };
    const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
    const int code = sqlite3_open_v2(path, &sql->database, flags, NULL);
    enum umb_status status = code == SQLITE_OK ? UMB_OK : fail(sql, code, error);
    if (status == UMB_OK) {
        (void)sqlite3_extended_result_codes(sql->database, 1);
        (void)sqlite3_busy_timeout(sql->database, BUSY_MS);
    }
    for (size_t i = 0; status == UMB_OK && i < sizeof modes / sizeof modes[0]; i++) {
        status = set_up(sql, &modes[i], error);
    }
    if (status != UMB_OK) {
        umbj_sql_close(sql);
    }
    return status;
}

void umbj_sql_close(struct umbj_sql *sql)
{
    (void)sqlite3_close(sql->database); /* every statement has been finalized */
    sql->database = NULL;
}

/* Binds the arguments; returns SQLite's code. *types moves to the '>' or the end. */
static int bind(sqlite3_stmt *statement, const char **types, va_list *arguments)
{
    int code = SQLITE_OK;
    for (int i = 1; code == SQLITE_OK && **types != '\0' && **types != '>'; i++, ++*types) {
        if (**types == 't') {
            code = sqlite3_bind_text(statement, i, va_arg(*arguments, const char *), -1,
                                     SQLITE_STATIC);
        } else if (**types == 'i') {
            code = sqlite3_bind_int64(statement, i, va_arg(*arguments, int64_t));
        } else {
            code = sqlite3_bind_blob(statement, i, va_arg(*arguments, const uint8_t *),
                                     UMBJ_HASH_BYTES, SQLITE_STATIC);
        }
    }
    return code;
}

/* Stores the columns of a row. Fails: E_NOT_FOUND: a column is not a hash. */
static enum umb_status store(sqlite3_stmt *row, const char *types, va_list *arguments)
{
    int good = 1;
    for (int i = 0; good && types[i] != '\0'; i++) {
        if (types[i] == 't') {
            char *text = va_arg(*arguments, char *);
            umbj_sql_text(row, i, text, va_arg(*arguments, size_t));
        } else if (types[i] == 'h') {
            good = umbj_sql_hash(row, i, va_arg(*arguments, uint8_t *));
        } else {
            int64_t *number = va_arg(*arguments, int64_t *);
            const int is_null = sqlite3_column_type(row, i) == SQLITE_NULL;
            *number = is_null ? *number : sqlite3_column_int64(row, i);
        }
    }
    return good ? UMB_OK : UMB_E_NOT_FOUND;
}

enum umb_status umbj_sql_run_list(struct umbj_sql *sql, struct umb_error *error, umbj_row_fn row,
                                  void *user, const char *text, const char *types,
                                  va_list arguments)
{
    sqlite3_stmt *statement = NULL;
    va_list list;
    va_copy(list, arguments);
    int code = sqlite3_prepare_v2(sql->database, text, -1, &statement, NULL);
    if (code == SQLITE_OK) {
        code = bind(statement, &types, &list);
    }
    if (code == SQLITE_OK) {
        code = SQLITE_ROW;
    }
    int stores = *types == '>';
    enum umb_status status = UMB_OK;
    while (code == SQLITE_ROW && status == UMB_OK) {
        code = sqlite3_step(statement);
        if (code == SQLITE_ROW && stores) {
            stores = 0;
            status = store(statement, types + 1, &list);
        } else if (code == SQLITE_ROW && row != NULL) {
            status = row(user, statement);
        }
    }
    va_end(list);
    if (status == UMB_OK && code != SQLITE_DONE) {
        status = fail(sql, code, error);
    }
    (void)sqlite3_finalize(statement); /* repeats the status of step */
    return status == UMB_OK && stores ? UMB_E_NOT_FOUND : status;
}

enum umb_status umbj_sql_run(struct umbj_sql *sql, struct umb_error *error, umbj_row_fn row,
                             void *user, const char *text, const char *types, ...)
{
    va_list arguments;
    va_start(arguments, types);
    const enum umb_status status = umbj_sql_run_list(sql, error, row, user, text, types, arguments);
    va_end(arguments);
    return status;
}

enum umb_status umbj_sql_do_all(struct umbj_sql *sql, struct umb_error *error,
                                const char *const *texts, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        UMB__TRY(umbj_sql_do(sql, error, texts[i], ""));
    }
    return UMB_OK;
}

/* Reads one file; pointer: the code that gives SQLite's handle of it. */
static int read_file(struct umbj_sql *sql, int pointer)
{
    char block[BLOCK_BYTES];
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    int code = sqlite3_file_control(sql->database, "main", pointer, &file);
    if (code != SQLITE_OK || file == NULL || file->pMethods == NULL) {
        return code; /* there is none */
    }
    code = file->pMethods->xFileSize(file, &size);
    for (sqlite3_int64 at = 0; code == SQLITE_OK && at < size; at += BLOCK_BYTES) {
        const sqlite3_int64 left = size - at;
        code = file->pMethods->xRead(file, block, left < BLOCK_BYTES ? (int)left : BLOCK_BYTES, at);
    }
    return code;
}

enum umb_status umbj_sql_read_files(struct umbj_sql *sql, struct umb_error *error)
{
    int code = read_file(sql, SQLITE_FCNTL_FILE_POINTER);
    if (code == SQLITE_OK) {
        code = read_file(sql, SQLITE_FCNTL_JOURNAL_POINTER);
    }
    return code == SQLITE_OK
               ? UMB_OK
               : umb_fail(error, status_of(code), "job table: %s", sqlite3_errstr(code));
}

int64_t umbj_sql_changes(const struct umbj_sql *sql)
{
    return sqlite3_changes(sql->database);
}

/* Rolls an open transaction back. If memory is short the transaction stays open, and the next begin
 * tries again. */
static void roll_back(struct umbj_sql *sql)
{
    struct umb_error ignored; /* the caller reports the failure that led here */
    if (!sqlite3_get_autocommit(sql->database)) {
        (void)!umbj_sql_do(sql, &ignored, "ROLLBACK", "");
    }
}

enum umb_status umbj_sql_begin(struct umbj_sql *sql, struct umb_error *error)
{
    roll_back(sql);
    const enum umb_status status = umbj_sql_do(sql, error, "BEGIN IMMEDIATE", "");
    if (status != UMB_OK) {
        roll_back(sql);
    }
    return status;
}

enum umb_status umbj_sql_end(struct umbj_sql *sql, enum umb_status status, struct umb_error *error)
{
    if (status == UMB_OK) {
        status = umbj_sql_do(sql, error, "COMMIT", "");
    }
    if (status != UMB_OK) {
        roll_back(sql);
    }
    return status;
}

void umbj_sql_text(sqlite3_stmt *row, int column, char *out, size_t size)
{
    const unsigned char *text = sqlite3_column_text(row, column);
    size_t length = text != NULL ? strlen((const char *)text) : 0;
    length = length < size ? length : size - 1;
    if (length > 0) {
        memcpy(out, text, length);
    }
    out[length] = '\0';
}

int umbj_sql_hash(sqlite3_stmt *row, int column, uint8_t out[UMBJ_HASH_BYTES])
{
    const void *bytes = sqlite3_column_blob(row, column);
    if (bytes == NULL || sqlite3_column_bytes(row, column) != UMBJ_HASH_BYTES) {
        memset(out, 0, UMBJ_HASH_BYTES);
        return 0;
    }
    memcpy(out, bytes, UMBJ_HASH_BYTES);
    return 1;
}
