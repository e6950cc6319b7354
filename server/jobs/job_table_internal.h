/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_TABLE_INTERNAL_H
#define UMBRAGE_SERVER_JOBS_JOB_TABLE_INTERNAL_H
/* Between the files of the job table: job_table.c reads, job_moves.c changes, job_assets.c owns. */
#include "jobs/job_sql.h"
#include "jobs/job_table.h"

struct umbj_table {
    struct umbj_sql sql;
    struct umbj_limits limits;
};

/* What umbj__take_job reads, in its order. */
#define UMBJ__JOB_COLUMNS                                                                          \
    "id, owner, key, state, failure, priority, epoch, tries, hard_tries, submitted_ms, "           \
    "started_ms,"                                                                                  \
    " ended_ms, not_before_ms, lease_until_ms, bundle_bytes, asset, cause"

/* A queued job whose pause is over; ?1: now, ?2: now and the longest pause. */
#define UMBJ__MAY_START "(not_before_ms <= ?1 OR not_before_ms > ?2)"

/* A row call-back: takes the one job of a result; user is a zeroed struct umbj_job, whose empty id
 * tells afterwards that there was none. _found turns that into E_NOT_FOUND, naming `id`. */
enum umb_status umbj__take_job(void *user, sqlite3_stmt *row);
UMB_CHECKED enum umb_status umbj__found(enum umb_status status, const struct umbj_job *job,
                                        const char *id, struct umb_error *error);

/* A row call-back: takes a number; user is an int64_t. */
enum umb_status umbj__take_number(void *user, sqlite3_stmt *row);

#endif
