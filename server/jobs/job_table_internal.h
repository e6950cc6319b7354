/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_TABLE_INTERNAL_H
#define UMBRAGE_SERVER_JOBS_JOB_TABLE_INTERNAL_H
/* Shared by the files of the job table: job_table.c reads, job_moves.c changes, job_assets.c keeps
 * owners, job_rows.c validates rows, job_counts.c counts. */
#include "jobs/job_sql.h"
#include "jobs/job_table.h"

struct umbj_table {
    struct umbj_sql sql;
    struct umbj_limits limits;
    int64_t damaged; /* Number of damaged rows */
    int64_t refused[UMBJ_QUOTA_COUNT];
};

/* Columns that umbj__take_job reads, in its order. */
#define UMBJ__JOB_COLUMNS                                                                          \
    "id, owner, key, state, failure, priority, epoch, tries, hard_tries, submitted_ms, "           \
    "started_ms,"                                                                                  \
    " ended_ms, not_before_ms, lease_until_ms, bundle_bytes, asset, cause, seq"

/* Greatest bake_ms, 31 days: the longest --job-time. _TEXT: for statements. */
#define UMBJ__BAKE_MS_MAX      2678400000
#define UMBJ__BAKE_MS_MAX_TEXT UMBJ__TEXT(UMBJ__BAKE_MS_MAX)
#define UMBJ__TEXT(number)     UMBJ__TEXT_OF(number)
#define UMBJ__TEXT_OF(number)  #number

/* Condition of a queued job whose pause is over; ?1: now, ?2: now and the longest pause. */
#define UMBJ__MAY_START "(not_before_ms <= ?1 OR not_before_ms > ?2)"

/* A row callback: takes the one job of a result. user is a zeroed struct umbj_job; afterwards an
 * empty id means that there was none. _found turns that into E_NOT_FOUND, naming `id`. */
enum umb_status umbj__take_job(void *user, sqlite3_stmt *row);
UMB_CHECKED enum umb_status umbj__found(enum umb_status status, const struct umbj_job *job,
                                        const char *id, struct umb_error *error);

/* A row callback: takes a number; user is an int64_t. */
enum umb_status umbj__take_number(void *user, sqlite3_stmt *row);

/* --- job_rows.c --- */

/* Reads a row of UMBJ__JOB_COLUMNS. A damaged row has `damage` and is a failed job with a cause;
 * its id is empty if it has no valid owner. */
void umbj__read_job(sqlite3_stmt *row, struct umbj_job *job);

/* Stores the failed job that umbj__read_job made of a damaged row, or removes the row. */
UMB_CHECKED enum umb_status umbj__retire(struct umbj_table *table, const struct umbj_job *job,
                                         int64_t now, struct umb_error *error);

/* For loops: 1 if *job was damaged and is retired, so the query must run again. */
int umbj__retired(struct umbj_table *table, enum umb_status *status, struct umbj_job *job,
                  int64_t now, struct umb_error *error);

/* A row callback for scene and settings. */
struct umbj__spec {
    int found;
    char *scene, *settings; /* [UMBJ_SCENE_SIZE], [UMBJ_SETTINGS_SIZE] */
    const char *damage;     /* Name of the damaged column, NULL = none */
};
enum umb_status umbj__take_spec(void *user, sqlite3_stmt *row);

/* Reads every row once and retires damaged rows. */
UMB_CHECKED enum umb_status umbj__mend(struct umbj_table *table, int64_t now,
                                       struct umb_error *error);

/* --- job_counts.c --- */

extern const char *const umbj__count_schema[]; /* ends with NULL */

UMB_CHECKED enum umb_status umbj__count_anew(struct umbj_table *table, struct umb_error *error);

#endif
