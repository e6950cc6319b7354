/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage watch, jobs, cancel and rm: what became of submitted scenes. */
#include "cli_common.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include "cli_job_view.h"

struct job_settings {
    const char *target; /* A job, or an asset's id */
    struct umbu_session session;
    bool json, quiet;
    uint32_t limit; /* Jobs to list, 0 = 100 */
    uint8_t asset[UMB_ID_BYTES];
};

static const struct umbu_option JOB_OPTIONS[] = {
    {UMBC_TARGET_ROW(struct job_settings, "JOB", "a job's id, as `umbrage submit` prints it")},
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "no talk, ids only")},
};

/* Parses and connects. Returns -1 to go on, else the exit code. */
static int begin(const struct umbu_command *command, int argc, char **argv,
                 struct job_settings *settings, struct umb_client **client)
{
    struct umb_error error = {.status = UMB_OK};
    struct umbu_parsed parsed;
    *settings = (struct job_settings){0};
    int code = umbu_start(&parsed, command, argc, argv, settings);
    if (code < 0 && umbu_connect(&settings->session, client, &error) != UMB_OK) {
        code = umbc_complain(&error);
    }
    return code;
}

/* --- watch --- */

static const struct umbu_command WATCH = {
    .name = "umbrage watch",
    .usage = "umbrage watch JOB [options]",
    .summary = "Shows a job's progress until it is over; then its asset, or why there is none.\n"
               "A lost connection is made anew. Exit codes: 0 done, 65 the scene cannot be used,\n"
               "70 the bake went wrong, 75 cancelled or not to be had now.",
    .sections = {{"options", UMBU_ROWS(JOB_OPTIONS)}, UMBU_SESSION(struct job_settings, session)},
};

int umbc_watch(int argc, char **argv)
{
    struct job_settings settings;
    struct umb_client *client;
    struct umb_job_status status;
    struct umb_error error = {.status = UMB_OK};
    char *plan;
    int code = begin(&WATCH, argc, argv, &settings, &client);
    if (code >= 0) {
        return code;
    }
    const bool quiet = settings.quiet;
    if (umbc_job_watch(client, settings.target, quiet, &status, &plan, &error) == UMB_OK) {
        code = umbc_job_report(&status, plan, settings.json, quiet);
    } else {
        code = umbc_complain(&error);
    }
    free(plan);
    umb_client_close(client);
    return code;
}

/* --- jobs --- */

static const struct umbu_option JOBS_OPTIONS[] = {
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "ids only")},
    {"limit", "N", "so many, 1 to 1000", UMBU_COUNT(1, 1000), UMBU_AT(struct job_settings, limit),
     .standard = "100"},
};

static const struct umbu_command JOBS = {
    .name = "umbrage jobs",
    .usage = "umbrage jobs [options]",
    .summary = "Lists your jobs, newest first.",
    .sections = {{"options", UMBU_ROWS(JOBS_OPTIONS)}, UMBU_SESSION(struct job_settings, session)},
};

static void print_job(const struct umb_job_status *job)
{
    char when[24], asset[UMB_ID_TEXT_SIZE] = "";
    umbc_format_time(job->submitted_ms, when);
    if (job->has_asset) {
        umb_id_to_text(job->asset, asset);
    }
    (void)printf("%s  %s  %-7s  %s", job->job, when, umbc_job_state(job->state), asset);
    if (job->cause[0] != '\0') {
        (void)printf("%s: ", umbc_job_failure(job->failure));
        umbc_print_text(stdout, job->cause, strlen(job->cause));
    }
    (void)putchar('\n');
}

static void print_jobs(const struct umb_job_status *jobs, size_t count, bool as_json, bool quiet)
{
    struct umbu_json json = {.file = stdout};
    if (as_json) {
        umbu_json_begin(&json, NULL, '{');
        umbu_json_begin(&json, "jobs", '[');
    }
    for (size_t i = 0; i < count; i++) {
        if (as_json) {
            umbu_json_begin(&json, NULL, '{');
            umbc_job_json(&json, &jobs[i]);
            umbu_json_end(&json, '}');
        } else if (quiet) {
            (void)puts(jobs[i].job);
        } else {
            print_job(&jobs[i]);
        }
    }
    if (as_json) {
        umbu_json_close(&json);
    }
}

int umbc_jobs(int argc, char **argv)
{
    struct job_settings settings;
    struct umb_client *client;
    struct umb_job_status *jobs;
    struct umb_error error = {.status = UMB_OK};
    size_t count;
    int code = begin(&JOBS, argc, argv, &settings, &client);
    if (code >= 0) {
        return code;
    }
    if (umb_client_list_jobs(client, settings.limit, &jobs, &count, NULL, &error) == UMB_OK) {
        print_jobs(jobs, count, settings.json, settings.quiet);
        umb_free(jobs);
        code = umbc_finish_stdout(0);
    } else {
        code = umbc_complain(&error);
    }
    umb_client_close(client);
    return code;
}

/* --- cancel --- */

static const struct umbu_command CANCEL = {
    .name = "umbrage cancel",
    .usage = "umbrage cancel JOB [options]",
    .summary = "Ends a job that is not over; harmless if it is.",
    .sections = {{"options", UMBU_ROWS(JOB_OPTIONS)}, UMBU_SESSION(struct job_settings, session)},
};

int umbc_cancel(int argc, char **argv)
{
    struct job_settings settings;
    struct umb_client *client;
    struct umb_job_status status;
    struct umb_error error = {.status = UMB_OK};
    int code = begin(&CANCEL, argc, argv, &settings, &client);
    if (code >= 0) {
        return code;
    }
    if (umb_client_cancel_job(client, settings.target, &status, NULL, &error) != UMB_OK) {
        code = umbc_complain(&error);
    } else {
        if (settings.json) {
            struct umbu_json json = {.file = stdout};
            umbu_json_begin(&json, NULL, '{');
            umbc_job_json(&json, &status);
            umbu_json_close(&json);
        } else if (!settings.quiet) {
            (void)printf("job         %s: %s\n", status.job, umbc_job_state(status.state));
        }
        code = umbc_finish_stdout(0);
    }
    umb_client_close(client);
    return code;
}

/* --- rm --- */

static const struct umbu_option REMOVE_OPTIONS[] = {
    {"ASSET", NULL, "the asset's id", UMBC_ID, UMBU_AT(struct job_settings, asset), .needed = true},
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "no talk")},
};

static const struct umbu_command REMOVE = {
    .name = "umbrage rm",
    .usage = "umbrage rm ASSET [options]",
    .summary = "Gives an asset up that a job of yours made. ASSET is its id. The daemon removes\n"
               "the file when no owner holds it any more.",
    .sections = {{"options", UMBU_ROWS(REMOVE_OPTIONS)},
                 UMBU_SESSION(struct job_settings, session)},
};

int umbc_rm(int argc, char **argv)
{
    struct job_settings settings;
    struct umb_client *client;
    struct umb_error error = {.status = UMB_OK};
    int code = begin(&REMOVE, argc, argv, &settings, &client);
    if (code >= 0) {
        return code;
    }
    code = umb_client_delete_asset(client, settings.asset, NULL, &error) == UMB_OK
               ? 0
               : umbc_complain(&error);
    umb_client_close(client);
    if (code == 0 && settings.json) {
        struct umbu_json json = {.file = stdout};
        umbu_json_begin(&json, NULL, '{');
        char id[UMB_ID_TEXT_SIZE];
        umb_id_to_text(settings.asset, id);
        umbu_json_text(&json, "asset", id);
        umbu_json_close(&json);
    }
    return code == 0 ? umbc_finish_stdout(0) : code;
}
