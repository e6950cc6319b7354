/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage list, watch, jobs, cancel and rm: the assets and jobs of a daemon. */
#include "cli/shared/cli_common.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include "cli_job_view.h"
#include "tool/tool_try.h"

struct job_settings {
    const char *target; /* Id of a job */
    struct umbu_session session;
    bool json, quiet;
    uint32_t limit;              /* Most jobs to list */
    uint8_t asset[UMB_ID_BYTES]; /* Id of an asset */
};

static const struct umbu_option JOB_OPTIONS[] = {
    {UMBC_TARGET_ROW(struct job_settings, "JOB", "id of a job, as `umbrage submit` prints it")},
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "print only ids")},
};

/* Body of a command: prints its result and returns the exit code, or fails. */
typedef enum umb_status (*job_fn)(const struct job_settings *settings, struct umb_client *client,
                                  int *code, struct umb_error *error);

/* Parses, connects and runs a command. Returns the exit code. */
static int run(const struct umbu_command *command, int argc, char **argv, job_fn body)
{
    struct umb_error error = {.status = UMB_OK};
    struct umbu_parsed parsed;
    struct job_settings settings = {0};
    struct umb_client *client;
    int code = umbu_start(&parsed, command, argc, argv, &settings);
    if (code >= 0) {
        return code;
    }
    if (umbu_connect(&settings.session, &client, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    code = 0;
    const enum umb_status status = body(&settings, client, &code, &error);
    umb_client_close(client);
    return status == UMB_OK ? umbc_finish_stdout(code) : umbc_complain(&error);
}

/* --- list --- */

#define NAME_WIDTH 32U /* columns */

static const struct umbu_option LIST_OPTIONS[] = {
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "print only names")},
};

static const struct umbu_command LIST = {
    .name = "umbrage list",
    .usage = "umbrage list [options]",
    .summary = "Lists the assets of a daemon, by name.",
    .sections = {{"options", UMBU_ROWS(LIST_OPTIONS)}, UMBU_SESSION(struct job_settings, session)},
};

static void print_assets_json(const struct umb_client_asset *assets, size_t count)
{
    struct umbu_json json = umbu_json_open(stdout);
    umbu_json_begin(&json, "assets", '[');
    for (size_t i = 0; i < count; i++) {
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "name", assets[i].name);
        umbc_json_id(&json, "asset", assets[i].id);
        UMBU_JSON_COUNTS(&json, {"packed_bytes", assets[i].packed_bytes},
                         {"memory_bytes", assets[i].memory_bytes},
                         {"lights", assets[i].light_count});
        umbu_json_end(&json, '}');
    }
    umbu_json_close(&json);
}

static void print_assets(const struct umb_client_asset *assets, size_t count, bool names_only)
{
    for (size_t i = 0; i < count; i++) {
        size_t length = strlen(assets[i].name);
        umbc_print_text(stdout, assets[i].name, length);
        if (names_only) {
            (void)putchar('\n');
            continue;
        }
        char id[UMB_ID_TEXT_SIZE];
        char packed[32];
        char memory[32];
        umb_id_to_text(assets[i].id, id);
        umbc_format_bytes(assets[i].packed_bytes, packed);
        umbc_format_bytes(assets[i].memory_bytes, memory);
        (void)printf("%*s %s  %12s packed %12s in memory %5" PRIu32 " lights\n",
                     length < NAME_WIDTH ? (int)(NAME_WIDTH - length) : 0, "", id, packed, memory,
                     assets[i].light_count);
    }
}

static enum umb_status list_assets(const struct job_settings *settings, struct umb_client *client,
                                   int *code, struct umb_error *error)
{
    struct umb_client_asset *assets;
    size_t count;
    (void)code;
    UMB__TRY(umb_client_list_assets(client, &assets, &count, error));
    if (settings->json) {
        print_assets_json(assets, count);
    } else {
        print_assets(assets, count, settings->quiet);
    }
    umb_free(assets);
    return UMB_OK;
}

int umbc_list(int argc, char **argv)
{
    return run(&LIST, argc, argv, list_assets);
}

/* --- watch --- */

static const struct umbu_command WATCH = {
    .name = "umbrage watch",
    .usage = "umbrage watch JOB [options]",
    .summary = "Shows the progress of a job until it is over, then its asset or the reason why\n"
               "it has none. A lost connection is made again. Exit codes: 0 done, 65 bad scene,\n"
               "70 the bake failed, 75 cancelled or temporary.",
    .sections = {{"options", UMBU_ROWS(JOB_OPTIONS)}, UMBU_SESSION(struct job_settings, session)},
};

static enum umb_status watch(const struct job_settings *settings, struct umb_client *client,
                             int *code, struct umb_error *error)
{
    (void)error;
    *code = umbc_job_wait(client, settings->target, settings->json, settings->quiet);
    return UMB_OK;
}

int umbc_watch(int argc, char **argv)
{
    return run(&WATCH, argc, argv, watch);
}

/* --- jobs --- */

static const struct umbu_option JOBS_OPTIONS[] = {
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "print only ids")},
    {"limit", "N", "most jobs to list, 1 to 1000", UMBU_COUNT(1, 1000),
     UMBU_AT(struct job_settings, limit), .standard = "100"},
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

static enum umb_status list(const struct job_settings *settings, struct umb_client *client,
                            int *code, struct umb_error *error)
{
    struct umb_job_status *jobs;
    size_t count;
    (void)code;
    UMB__TRY(umb_client_list_jobs(client, settings->limit, &jobs, &count, NULL, error));
    print_jobs(jobs, count, settings->json, settings->quiet);
    umb_free(jobs);
    return UMB_OK;
}

int umbc_jobs(int argc, char **argv)
{
    return run(&JOBS, argc, argv, list);
}

/* --- cancel --- */

static const struct umbu_command CANCEL = {
    .name = "umbrage cancel",
    .usage = "umbrage cancel JOB [options]",
    .summary = "Cancels a job. A job that is over stays as it is.",
    .sections = {{"options", UMBU_ROWS(JOB_OPTIONS)}, UMBU_SESSION(struct job_settings, session)},
};

static enum umb_status cancel(const struct job_settings *settings, struct umb_client *client,
                              int *code, struct umb_error *error)
{
    struct umb_job_status status;
    (void)code;
    UMB__TRY(umb_client_cancel_job(client, settings->target, &status, NULL, error));
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_job_json(&json, &status);
        umbu_json_close(&json);
    } else if (!settings->quiet) {
        (void)printf("job         %s: %s\n", status.job, umbc_job_state(status.state));
    }
    return UMB_OK;
}

int umbc_cancel(int argc, char **argv)
{
    return run(&CANCEL, argc, argv, cancel);
}

/* --- rm --- */

static const struct umbu_option REMOVE_OPTIONS[] = {
    {"ASSET", NULL, "id of the asset", UMBC_ID, UMBU_AT(struct job_settings, asset),
     .needed = true},
    {UMBU_JSON_ROW(struct job_settings)},
    {UMBU_QUIET_ROW(struct job_settings, "print nothing but errors")},
};

static const struct umbu_command REMOVE = {
    .name = "umbrage rm",
    .usage = "umbrage rm ASSET [options]",
    .summary = "Gives up an asset that a job of yours made. ASSET is its id. The daemon removes\n"
               "the file when no owner holds it any more.",
    .sections = {{"options", UMBU_ROWS(REMOVE_OPTIONS)},
                 UMBU_SESSION(struct job_settings, session)},
};

static enum umb_status delete_asset(const struct job_settings *settings, struct umb_client *client,
                                    int *code, struct umb_error *error)
{
    (void)code;
    UMB__TRY(umb_client_delete_asset(client, settings->asset, NULL, error));
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_json_id(&json, "asset", settings->asset);
        umbu_json_close(&json);
    }
    return UMB_OK;
}

int umbc_rm(int argc, char **argv)
{
    return run(&REMOVE, argc, argv, delete_asset);
}
