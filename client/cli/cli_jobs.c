/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage watch, jobs, cancel and rm: what became of submitted scenes. */
#include "cli_common.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include "cli_job_view.h"
#include "cli_session.h"

enum plain_option {
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option PLAIN_OPTIONS[OPTION_COUNT] = {
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "no talk, ids only", 'q'},
};

/* Parses and connects. Returns -1 to go on, else the exit code. */
static int begin(const struct umbc_command *command, int argc, char **argv,
                 struct umbc_parsed *parsed, struct umb_client **client)
{
    struct umb_error error = {.status = UMB_OK};
    int code = umbc_parse(command, argc, argv, parsed);
    if (code < 0 && umbc_connect(parsed->session, client, &error) != UMB_OK) {
        code = umbc_complain(&error);
    }
    return code;
}

/* --- watch --- */

static const struct umbc_command WATCH = {
    .usage = "umbrage watch JOB [options]",
    .summary = "Shows a job's progress until it is over; then its asset, or why there is none.\n"
               "A lost connection is made anew. Exit codes: 0 done, 65 the scene cannot be used,\n"
               "70 the bake went wrong, 75 cancelled or not to be had now.",
    .options = PLAIN_OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

int umbc_watch(int argc, char **argv)
{
    struct umbc_parsed parsed;
    struct umb_client *client;
    struct umb_job_status status;
    struct umb_error error = {.status = UMB_OK};
    char *plan;
    int code = begin(&WATCH, argc, argv, &parsed, &client);
    if (code >= 0) {
        return code;
    }
    const bool quiet = parsed.values[OPTION_QUIET] != NULL;
    if (umbc_job_watch(client, parsed.words[0], quiet, &status, &plan, &error) == UMB_OK) {
        code = umbc_job_report(&status, plan, parsed.values[OPTION_JSON] != NULL, quiet);
    } else {
        code = umbc_complain(&error);
    }
    free(plan);
    umb_client_close(client);
    return code;
}

/* --- jobs --- */

enum jobs_option {
    JOBS_LIMIT = OPTION_COUNT,
    JOBS_OPTION_COUNT,
};

static const struct umbc_option JOBS_OPTIONS[JOBS_OPTION_COUNT] = {
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "ids only", 'q'},
    [JOBS_LIMIT] = {"limit", "N", "so many, 1 to 1000 (100)", 0},
};

static const struct umbc_command JOBS = {
    .usage = "umbrage jobs [options]",
    .summary = "Lists your jobs, newest first.",
    .options = JOBS_OPTIONS,
    .option_count = JOBS_OPTION_COUNT,
    .connects = true,
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
    struct umbc_json json = {.file = stdout};
    if (as_json) {
        umbc_json_begin(&json, NULL, '{');
        umbc_json_begin(&json, "jobs", '[');
    }
    for (size_t i = 0; i < count; i++) {
        if (as_json) {
            umbc_json_begin(&json, NULL, '{');
            umbc_job_json(&json, &jobs[i]);
            umbc_json_end(&json, '}');
        } else if (quiet) {
            (void)puts(jobs[i].job);
        } else {
            print_job(&jobs[i]);
        }
    }
    if (as_json) {
        umbc_json_end(&json, ']');
        umbc_json_end(&json, '}');
        (void)putchar('\n');
    }
}

int umbc_jobs(int argc, char **argv)
{
    struct umbc_parsed parsed;
    struct umb_client *client;
    struct umb_job_status *jobs;
    struct umb_error error = {.status = UMB_OK};
    unsigned long long limit = 0;
    size_t count;
    int code = umbc_parse(&JOBS, argc, argv, &parsed);
    if (code >= 0) {
        return code;
    }
    const char *text = parsed.values[JOBS_LIMIT];
    if (text != NULL && (!umbc_parse_count(text, 1000, &limit) || limit == 0)) {
        return umbc_usage_error("jobs: --limit: '%s' is not a number from 1 to 1000", text);
    }
    if (umbc_connect(parsed.session, &client, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    if (umb_client_list_jobs(client, (uint32_t)limit, &jobs, &count, NULL, &error) == UMB_OK) {
        print_jobs(jobs, count, parsed.values[OPTION_JSON] != NULL,
                   parsed.values[OPTION_QUIET] != NULL);
        umb_free(jobs);
        code = umbc_finish_stdout(0);
    } else {
        code = umbc_complain(&error);
    }
    umb_client_close(client);
    return code;
}

/* --- cancel --- */

static const struct umbc_command CANCEL = {
    .usage = "umbrage cancel JOB [options]",
    .summary = "Ends a job that is not over; harmless if it is.",
    .options = PLAIN_OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

int umbc_cancel(int argc, char **argv)
{
    struct umbc_parsed parsed;
    struct umb_client *client;
    struct umb_job_status status;
    struct umb_error error = {.status = UMB_OK};
    int code = begin(&CANCEL, argc, argv, &parsed, &client);
    if (code >= 0) {
        return code;
    }
    if (umb_client_cancel_job(client, parsed.words[0], &status, NULL, &error) != UMB_OK) {
        code = umbc_complain(&error);
    } else {
        if (parsed.values[OPTION_JSON] != NULL) {
            struct umbc_json json = {.file = stdout};
            umbc_json_begin(&json, NULL, '{');
            umbc_job_json(&json, &status);
            umbc_json_end(&json, '}');
            (void)putchar('\n');
        } else if (parsed.values[OPTION_QUIET] == NULL) {
            (void)printf("job         %s: %s\n", status.job, umbc_job_state(status.state));
        }
        code = umbc_finish_stdout(0);
    }
    umb_client_close(client);
    return code;
}

/* --- rm --- */

static const struct umbc_command REMOVE = {
    .usage = "umbrage rm ASSET [options]",
    .summary =
        "Gives an asset up that a job of yours made. ASSET is its id. The daemon removes the\n"
        "file when nobody has it any more.",
    .options = PLAIN_OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

int umbc_rm(int argc, char **argv)
{
    struct umbc_parsed parsed;
    struct umb_client *client;
    uint8_t asset[UMB_ID_BYTES];
    struct umb_error error = {.status = UMB_OK};
    int code = umbc_parse(&REMOVE, argc, argv, &parsed);
    if (code >= 0) {
        return code;
    }
    if (umb_id_from_text(parsed.words[0], asset) != UMB_OK) {
        return umbc_usage_error("rm: '%s' is not an id of 64 hexadecimal digits", parsed.words[0]);
    }
    if (umbc_connect(parsed.session, &client, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    code =
        umb_client_delete_asset(client, asset, NULL, &error) == UMB_OK ? 0 : umbc_complain(&error);
    umb_client_close(client);
    if (code == 0 && parsed.values[OPTION_JSON] != NULL) {
        struct umbc_json json = {.file = stdout};
        umbc_json_begin(&json, NULL, '{');
        umbc_json_text(&json, "asset", parsed.words[0]);
        umbc_json_end(&json, '}');
        (void)putchar('\n');
    }
    return code == 0 ? umbc_finish_stdout(0) : code;
}
