/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_JOB_TABLE_INTERNAL_H
#define UMBRAGE_SERVER_JOBS_JOB_TABLE_INTERNAL_H
/*
 * Shared by the files of the job table. Each file uses only those before it: job_assets.c keeps
 * owners, counts and quotas, job_table.c validates rows and finds jobs, job_moves.c changes them.
 */
#include "jobs/job_sql.h"
#include "jobs/job_table.h"

struct umbj_table {
    struct umbj_sql sql;
    struct umbj_limits limits;
    int64_t damaged; /* Number of damaged rows */
    int64_t refused[UMBJ_QUOTA_COUNT];
};

/* Beginning of a statement that reads whole rows. */
#define UMBJ__SELECT_JOBS                                                                          \
    "SELECT id, owner, key, state, failure, priority, epoch, tries, hard_tries, submitted_ms,"     \
    " started_ms, ended_ms, not_before_ms, lease_until_ms, bundle_bytes, asset, cause, seq"        \
    " FROM job "

/* Largest bake_ms: 31 days, the longest --job-time. _TEXT is the same number for statements. */
#define UMBJ__BAKE_MS_MAX      2678400000
#define UMBJ__BAKE_MS_MAX_TEXT UMBJ__TEXT(UMBJ__BAKE_MS_MAX)
#define UMBJ__TEXT(number)     UMBJ__TEXT_OF(number)
#define UMBJ__TEXT_OF(number)  #number

/* SQL condition for a queued job whose pause is over. ?1: now; ?2: now and the longest pause. */
#define UMBJ__MAY_START "(not_before_ms <= ?1 OR not_before_ms > ?2)"

/* --- job_table.c --- */

/*
 * Finds the one job of a statement that begins with UMBJ__SELECT_JOBS. Damaged rows are retired,
 * with the time `now` (0: unknown), and the statement runs again.
 *
 * Fails: E_NOT_FOUND: there is no job `what`; as umbj_sql_run.
 */
UMB_CHECKED enum umb_status umbj__find_job(struct umbj_table *table, int64_t now,
                                           struct umbj_job *job, const char *what,
                                           struct umb_error *error, const char *text,
                                           const char *types, ...);

/* Reads every row once and retires damaged rows. */
UMB_CHECKED enum umb_status umbj__mend(struct umbj_table *table, int64_t now,
                                       struct umb_error *error);

/* --- job_assets.c --- */

/* Creates the tables of counts and their triggers. umbj__count_anew counts all rows. */
UMB_CHECKED enum umb_status umbj__make_counts(struct umbj_table *table, struct umb_error *error);
UMB_CHECKED enum umb_status umbj__count_anew(struct umbj_table *table, struct umb_error *error);

#endif
