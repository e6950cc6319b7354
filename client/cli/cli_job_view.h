/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_JOB_VIEW_H
#define UMBRAGE_CLI_CLI_JOB_VIEW_H
/* What the sub-commands about jobs share: watching one to its end, and showing it. */
#include "cli_common.h"
#include "tool/json.h"
#include "umbrage/jobs.h"

/*
 * Watches a job until it is over, with a line of progress on a terminal. A connection that is lost
 * is made anew, for UMBC_WATCH_PATIENCE_S without a word from the daemon.
 *
 * Out: status: the last one, without its texts; plan: malloc or NULL.
 */
#define UMBC_WATCH_PATIENCE_S 300
UMB_CHECKED enum umb_status umbc_job_watch(struct umb_client *client, const char *job, bool quiet,
                                           struct umb_job_status *status, char **plan,
                                           struct umb_error *error);

/* The exit code that a job which is over stands for: 0, 65, 70, 75. */
int umbc_job_exit(const struct umb_job_status *status);

const char *umbc_job_state(int state);
const char *umbc_job_failure(int failure);

/* Writes the members of a job's object. */
void umbc_job_json(struct umbu_json *json, const struct umb_job_status *status);

/* Shows how a job ended, on stdout; returns the exit code. plan may be NULL. */
int umbc_job_report(const struct umb_job_status *status, const char *plan, bool as_json,
                    bool quiet);

/* "2026-01-31 12:00:00", in UTC; "-" for 0. */
void umbc_format_time(int64_t unix_ms, char text[24]);

#endif
