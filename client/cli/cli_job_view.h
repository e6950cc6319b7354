/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_JOB_VIEW_H
#define UMBRAGE_CLI_CLI_JOB_VIEW_H
/* Watching and printing jobs, for the sub-commands about jobs. */
#include "cli/shared/cli_common.h"
#include "tool/json.h"
#include "umbrage/jobs.h"

/*
 * Watches a job until it is over, with a line of progress on a terminal, and prints how it ended. A
 * lost connection is made again, until the daemon is silent for UMBC_WATCH_PATIENCE_S seconds.
 *
 * Returns the exit code: 0 done, 65 bad scene, 70 the bake failed, 75 temporary.
 */
#define UMBC_WATCH_PATIENCE_S 300
int umbc_job_wait(struct umb_client *client, const char *job, bool as_json, bool quiet);

/* Names of a state and of a kind of failure. */
const char *umbc_job_state(int state);
const char *umbc_job_failure(int failure);

/* Writes the members of a job's object. */
void umbc_job_json(struct umbu_json *json, const struct umb_job_status *status);

/* Writes a time as "2026-01-31 12:00:00", in UTC; "-" for 0. */
void umbc_format_time(int64_t unix_ms, char text[24]);

#endif
