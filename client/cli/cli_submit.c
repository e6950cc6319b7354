/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage submit: hands a scene to a daemon to be baked. */
#include "cli_common.h"

#include <stdlib.h>
#include <string.h>
#include "cli_bundle.h"
#include "cli_job_view.h"
#include "cli_progress.h"
#include "cli_session.h"

#define SETTINGS_MAX 512

enum submit_option {
    OPTION_WAIT,
    OPTION_PRIORITY,
    OPTION_STALL,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_WAIT] = {"wait", NULL, "watch the job to its end, as `umbrage watch` does", 0},
    [OPTION_PRIORITY] = {"priority", "N", "-10 to 10: among your own jobs, higher first (0)", 0},
    [OPTION_STALL] = UMBC_STALL_OPTION,
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "the job's id only (with --wait the asset's), no notices",
                      'q'},
};

static const struct umbc_command COMMAND = {
    .usage = "umbrage submit SCENE [bake options] [options]",
    .summary = "Sends a scene with its buffers and textures to a daemon, which bakes it.\n\n"
               "Bake options are those of umbrage-bake that decide what the asset holds:\n"
               "--resolution, --sun, --sun-path, --point, --spot, --light, --light-size, --up,\n"
               "--closed, --static, --effect, --max-error, --depth, --verify. The same scene\n"
               "with the same options is the same job, however often it is submitted.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

/* Bake options; they may be repeated, and their order matters. */
static const struct {
    const char *name;
    bool has_value;
} BAKE_OPTIONS[] = {
    {"resolution", true}, {"sun", true},       {"sun-path", true}, {"point", true},
    {"spot", true},       {"light", true},     {"up", true},       {"light-size", true},
    {"closed", true},     {"depth", true},     {"verify", true},   {"static", false},
    {"effect", true},     {"max-error", true},
};

struct settings {
    struct umb_job_setting list[SETTINGS_MAX];
    size_t count;
};

/* Index of a bake option, or -1; *value is what follows '=', or NULL. */
static int find_bake_option(const char *word, const char **value)
{
    const char *equals = strchr(word, '=');
    const size_t length = equals == NULL ? strlen(word) : (size_t)(equals - word);
    *value = equals == NULL ? NULL : equals + 1;
    for (size_t i = 0; i < sizeof BAKE_OPTIONS / sizeof BAKE_OPTIONS[0]; i++) {
        if (length == strlen(BAKE_OPTIONS[i].name) + 2 && strncmp(word, "--", 2) == 0 &&
            strncmp(word + 2, BAKE_OPTIONS[i].name, length - 2) == 0) {
            return (int)i;
        }
    }
    return -1;
}

/* Moves the bake options out of argv. Returns the rest's count, or -1 after a usage error. */
static int take_settings(int argc, char **argv, struct settings *settings)
{
    int kept = 1;
    for (int at = 1; at < argc; at++) {
        const char *value;
        if (strcmp(argv[at], "--") == 0) {
            while (at < argc) {
                argv[kept++] = argv[at++];
            }
            break;
        }
        const int found = find_bake_option(argv[at], &value);
        if (found < 0) {
            argv[kept++] = argv[at];
            continue;
        }
        const char *name = BAKE_OPTIONS[found].name;
        if (BAKE_OPTIONS[found].has_value && value == NULL) {
            if (at + 1 >= argc) {
                (void)umbc_usage_error("submit: --%s needs a value", name);
                return -1;
            }
            value = argv[++at];
        }
        if (settings->count == SETTINGS_MAX || (value != NULL && !BAKE_OPTIONS[found].has_value)) {
            (void)umbc_usage_error("submit: --%s: %s", name,
                                   value != NULL ? "takes no value, or too many options"
                                                 : "too many options");
            return -1;
        }
        settings->list[settings->count++] =
            (struct umb_job_setting){name, value != NULL ? value : ""};
    }
    argv[kept] = NULL;
    return kept;
}

static void on_sent(void *user, uint64_t done, uint64_t total)
{
    struct umbc_progress *progress = user;
    umbc_progress_show_bytes(progress, done, total);
}

static int report_submitted(const struct umb_job_submitted *submitted, bool as_json, bool quiet)
{
    if (as_json) {
        struct umbc_json json = {.file = stdout};
        umbc_json_begin(&json, NULL, '{');
        umbc_json_text(&json, "job", submitted->job);
        umbc_json_bool(&json, "existing", submitted->existing != 0);
        umbc_json_end(&json, '}');
        (void)putchar('\n');
    } else {
        (void)printf(quiet ? "%s\n" : "job         %s%s\n", submitted->job,
                     submitted->existing ? " (submitted before)" : "");
    }
    return umbc_finish_stdout(0);
}

static int wait_for(struct umb_client *client, const char *job, bool as_json, bool quiet)
{
    struct umb_job_status status;
    struct umb_error error = {.status = UMB_OK};
    char *plan;
    int code;
    if (umbc_job_watch(client, job, quiet, &status, &plan, &error) == UMB_OK) {
        code = umbc_job_report(&status, plan, as_json, quiet);
    } else {
        code = umbc_complain(&error);
    }
    free(plan);
    return code;
}

/* Sends it; a lost connection is tried once more, which finds the job if it was accepted. */
static enum umb_status submit(struct umb_client *client,
                              const struct umb_job_submission *submission,
                              struct umb_job_submitted *submitted, struct umb_error *error)
{
    enum umb_status status = umb_client_submit(client, submission, submitted, NULL, error);
    return status == UMB_E_UNAVAILABLE
               ? umb_client_submit(client, submission, submitted, NULL, error)
               : status;
}

static int run(const struct umbc_parsed *parsed, const struct settings *settings, int priority)
{
    const bool quiet = parsed->values[OPTION_QUIET] != NULL;
    const bool as_json = parsed->values[OPTION_JSON] != NULL;
    struct umb_error error = {.status = UMB_OK};
    struct umb_job_submitted submitted;
    struct umbc_bundle bundle;
    struct umbc_progress progress;
    struct umb_client *client;
    if (umbc_bundle_gather(parsed->words[0], quiet, &bundle, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    int code =
        umbc_connect_patiently(parsed->session, "submit", parsed->values[OPTION_STALL], &client);
    if (code >= 0) {
        umbc_bundle_finish(&bundle);
        return code;
    }
    const struct umb_job_submission submission = {.scene = bundle.files[0].path,
                                                  .files = bundle.files,
                                                  .file_count = bundle.count,
                                                  .settings = settings->list,
                                                  .setting_count = settings->count,
                                                  .priority = priority,
                                                  .sent = on_sent,
                                                  .user = &progress};
    umbc_progress_begin(&progress, quiet || as_json);
    enum umb_status status = submit(client, &submission, &submitted, &error);
    umbc_progress_end(&progress);
    umbc_bundle_finish(&bundle);
    if (status != UMB_OK) {
        code = umbc_complain(&error);
    } else if (parsed->values[OPTION_WAIT] != NULL) {
        code = wait_for(client, submitted.job, as_json, quiet);
    } else {
        code = report_submitted(&submitted, as_json, quiet);
    }
    umb_client_close(client);
    return code;
}

int umbc_submit(int argc, char **argv)
{
    static struct settings settings; /* too large for a stack, and there is one */
    struct umbc_parsed parsed;
    double priority = 0;
    int kept = take_settings(argc, argv, &settings);
    if (kept < 0) {
        return UMBC_EXIT_USAGE;
    }
    int code = umbc_parse(&COMMAND, kept, argv, &parsed);
    if (code >= 0) {
        return code;
    }
    const char *text = parsed.values[OPTION_PRIORITY];
    if (text != NULL && (!umbc_parse_number(text, &priority) || priority != (int)priority ||
                         priority < -10 || priority > 10)) {
        return umbc_usage_error("submit: --priority: '%s' is not a whole number from -10 to 10",
                                text);
    }
    return run(&parsed, &settings, (int)priority);
}
