/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage submit: hands a scene to a daemon to be baked. */
#include "cli/shared/cli_common.h"

#include <stdlib.h>
#include <string.h>
#include "cli_bundle.h"
#include "cli_job_view.h"
#include "tool/progress.h"
#include "tool/bake_settings.h"

struct submit_settings {
    const char *target; /* Scene file */
    struct umbu_session session;
    struct umbu_bake_settings bake;
    bool wait, json, quiet;
    int priority;
};
#define AT(field) UMBU_AT(struct submit_settings, field)

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct submit_settings, "SCENE",
                     "scene file: .gltf, .glb, .obj, .ply or .stl")},
    {"wait", NULL, "waits for the end of the job, as `umbrage watch` does", UMBU_FLAG, AT(wait)},
    {"priority", "N", "priority among your own jobs, -10 to 10; higher first", UMBU_NUMBER(-10, 10),
     AT(priority), .standard = "0"},
    UMBU_STALL_ROW(struct submit_settings),
    {UMBU_JSON_ROW(struct submit_settings)},
    {UMBU_QUIET_ROW(struct submit_settings,
                    "print only the id of the job (with --wait: of the asset), no notices")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage submit",
    .usage = "umbrage submit SCENE [bake options] [options]",
    .summary = "Sends a scene with its buffers and textures to a daemon, which bakes it. Bake\n"
               "options are those of umbrage-bake that decide what the asset holds. The same\n"
               "scene with the same options is the same job, however often it is submitted.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)},
                 {"bake options", UMBU_BAKE_SETTINGS, UMBU_BAKE_SETTING_COUNT,
                  offsetof(struct submit_settings, bake)},
                 UMBU_SESSION(struct submit_settings, session)},
};

static void on_sent(void *user, uint64_t done, uint64_t total)
{
    struct umbu_progress *progress = user;
    umbu_progress_show(progress, 1e-6 * (double)done, total > 0 ? (double)done / (double)total : 1);
}

static int report_submitted(const struct umb_job_submitted *submitted, bool as_json, bool quiet)
{
    if (as_json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbu_json_text(&json, "job", submitted->job);
        umbu_json_bool(&json, "existing", submitted->existing != 0);
        umbu_json_close(&json);
    } else {
        (void)printf(quiet ? "%s\n" : "job         %s%s\n", submitted->job,
                     submitted->existing ? " (submitted before)" : "");
    }
    return umbc_finish_stdout(0);
}

/* Submits the job. After a lost connection it submits the job once more: if the daemon had accepted
 * the job, the second call finds it. */
static enum umb_status submit(struct umb_client *client,
                              const struct umb_job_submission *submission,
                              struct umb_job_submitted *submitted, struct umb_error *error)
{
    enum umb_status status = umb_client_submit(client, submission, submitted, NULL, error);
    return status == UMB_E_UNAVAILABLE
               ? umb_client_submit(client, submission, submitted, NULL, error)
               : status;
}

static int run(struct submit_settings *settings)
{
    const bool quiet = settings->quiet, as_json = settings->json;
    struct umb_error error = {.status = UMB_OK};
    struct umb_job_submitted submitted;
    struct umbc_bundle bundle;
    struct umbu_progress progress;
    struct umb_client *client;
    if (umbc_bundle_gather(settings->target, quiet, &bundle, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    if (umbu_connect(&settings->session, &client, &error) != UMB_OK) {
        umbc_bundle_finish(&bundle);
        return umbc_complain(&error);
    }
    const struct umb_job_submission submission = {.scene = bundle.files[0].path,
                                                  .files = bundle.files,
                                                  .file_count = bundle.count,
                                                  .settings = settings->bake.list,
                                                  .setting_count = settings->bake.count,
                                                  .priority = settings->priority,
                                                  .sent = on_sent,
                                                  .user = &progress};
    umbu_progress_begin(&progress, "MB", quiet || as_json);
    enum umb_status status = submit(client, &submission, &submitted, &error);
    umbu_progress_end(&progress);
    umbc_bundle_finish(&bundle);
    int code;
    if (status != UMB_OK) {
        code = umbc_complain(&error);
    } else if (settings->wait) {
        code = umbc_job_wait(client, submitted.job, as_json, quiet);
    } else {
        code = report_submitted(&submitted, as_json, quiet);
    }
    umb_client_close(client);
    return code;
}

int umbc_submit(int argc, char **argv)
{
    static struct submit_settings settings; /* too large for a stack, and there is one */
    struct umbu_parsed parsed;
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &settings);
    return code >= 0 ? code : run(&settings);
}
