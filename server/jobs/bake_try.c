/* SPDX-License-Identifier: Apache-2.0 */
/* Tries of jobs, see bake_try.h: functions for all tries, and the bake on this machine. */
#include "jobs/bake_try.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sysexits.h>

#include "common/clean_text.h"

struct umbj_report umbj_try_report(const struct umbj_try *try, enum umbj_report_kind kind)
{
    struct umbj_report report = {.kind = kind, .epoch = try->work->epoch, .staged = {.fd = -1}};
    memcpy(report.job, try->work->job, sizeof report.job);
    return report;
}

void umbj_try_tell(const struct umbj_try *try, const struct umbj_report *report)
{
    try->options->report(try->options->user, report);
}

void umbj_try_tell_phase(const struct umbj_try *try, const char *phase)
{
    struct umbj_report report = umbj_try_report(try, UMBJ_REPORT_PHASE);
    snprintf(report.text, sizeof report.text, "%s", phase);
    umbj_try_tell(try, &report);
}

void umbj_try_text(char out[UMBJ_CAUSE_SIZE], const char *text)
{
    umbs_text_clean(out, UMBJ_CAUSE_SIZE, text, strlen(text));
}

enum umbj_failure umbj_try_fail(struct umbj_try *try, enum umbj_failure failure, const char *format,
                                ...)
{
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(try->cause, sizeof try->cause, format, arguments);
    va_end(arguments);
    return failure;
}

enum umbj_failure umbj_try_fail_status(struct umbj_try *try, enum umb_status status,
                                       const struct umb_error *error)
{
    enum umbj_failure failure = UMBJ_INTERNAL;
    if (status == UMB_E_NO_MEMORY || status == UMB_E_LIMIT || status == UMB_E_BUSY ||
        status == UMB_E_UNAVAILABLE) {
        failure = UMBJ_TEMPORARY;
    } else if (status == UMB_E_IO || status == UMB_E_CANNOT_CREATE) {
        failure = UMBJ_IO;
    } else if (status == UMB_E_TOO_LARGE) {
        failure = UMBJ_REJECTED;
    }
    return umbj_try_fail(try, failure, "%s", error->message);
}

static void on_said(void *user, const char *line)
{
    static const char name[] = "umbrage-bake: ", notice[] = "notice: ";
    struct umbj_try *try = user;
    if (strncmp(line, name, sizeof name - 1) == 0) {
        line += sizeof name - 1;
    }
    if (strncmp(line, notice, sizeof notice - 1) == 0) {
        struct umbj_report report = umbj_try_report(try, UMBJ_REPORT_NOTICE);
        umbj_try_text(report.text, line + sizeof notice - 1);
        umbj_try_tell(try, &report);
    } else {
        umbj_try_text(try->said, line);
    }
}

static void on_progress(void *user, const char *line)
{
    struct umbj_try *try = user;
    struct umbj_report report = umbj_try_report(try, UMBJ_REPORT_PHASE);
    unsigned long long done = 0, total = 0, found = 0;
    char unit[UMBJ_PHASE_SIZE] = "";
    if (strncmp(line, "phase ", 6) == 0) {
        umbj_try_text(report.text, line + 6);
    } else if (strncmp(line, "plan ", 5) == 0) {
        report.kind = UMBJ_REPORT_PLAN;
        umbj_try_text(report.text, line + 5);
    } else if (sscanf(line, "progress %llu %llu %31s", &done, &total, unit) == 3) {
        report.kind = UMBJ_REPORT_PROGRESS;
        umbj_try_text(report.text, unit);
    } else if (sscanf(line, "tiles %llu %llu %llu", &done, &total, &found) == 3) {
        report.kind = UMBJ_REPORT_TILES;
        try->tiles = total;
    } else {
        return;
    }
    report.done = done;
    report.total = total;
    report.found = found;
    umbj_try_tell(try, &report);
}

/* Returns 1 if a write met the process's limit of file size; such a failure would repeat in every
 * try. It is recognised by the system's error text in the C locale, which the program prints. */
static int met_size_limit(const struct umbj_try *try, const struct umbj_process_end *end)
{
    return end->exit_code == EX_IOERR && strstr(try->said, "File too large") != NULL;
}

enum umbj_failure umbj_try_judge(struct umbj_try *try, const struct umbj_process_end *end)
{
    const enum umbj_failure failure = umbj_process_judge(end);
    if (failure == UMBJ_TIMEOUT) {
        return umbj_try_fail(try, failure,
                             "the bake took longer than the server allows (--job-time)");
    }
    if (end->signal != 0) {
        return umbj_try_fail(try, failure, "signal %d (%s) ended the bake", end->signal,
                             umbj_failure_name(failure));
    }
    if (met_size_limit(try, end)) {
        return umbj_try_fail(try, UMBJ_REJECTED,
                             "a file of the bake is over the server's limit of %llu bytes "
                             "(--max-asset)",
                             (unsigned long long)try->options->max_output_bytes);
    }
    if (failure != UMBJ_NO_FAILURE && try->said[0] == '\0') {
        return umbj_try_fail(try, failure, "the bake ended with %d", end->exit_code);
    }
    return umbj_try_fail(try, failure, "%s", try->said);
}

enum umbj_failure umbj_try_run(struct umbj_try *try, struct umbj_words *words, const char *folder)
{
    struct umbj_process_end end;
    struct umb_error error = {0};
    const struct umbj_process process = {
        .folder = folder,
        .max_output_bytes = try->options->max_output_bytes,
        .timeout_ms = try->options->timeout_ms,
        .stop = try->stop,
        .said = on_said,
        .progress = on_progress,
        .user = try,
    };
    try->said[0] = '\0';
    const enum umb_status status = umbj_process_run(&process, words, &end, &error);
    return status == UMB_OK ? umbj_try_judge(try, &end) : umbj_try_fail_status(try, status, &error);
}

int umbj_try_keeps_tiles(const struct umbj_try *try)
{
    const char *settings = try->work->settings;
    return !umbj_settings_have(settings, "--depth=embree") &&
           !umbj_settings_have(settings, "--static") &&
           !umbj_settings_have(settings, "--effect=static=on");
}

enum umbj_failure umbj_bake_here(struct umbj_try *try)
{
    const struct umbj_try_options *options = try->options;
    const struct umbj_work *work = try->work;
    struct umbj_words words = {0};
    umbj_words_add(&words, "%s", options->program);
    umbj_words_add(&words, "--output=%s/out.umb", work->folder);
    umbj_words_add(&words, "--memory=%llu", (unsigned long long)options->memory_bytes);
    umbj_words_add(&words, "--threads=%u", options->threads);
    umbj_words_add(&words, "--progress-fd=%d", UMBJ_WORKER_FD_PROGRESS);
    umbj_words_add_sandbox(&words, options->sandbox);
    if (work->cache != NULL && umbj_try_keeps_tiles(try)) {
        umbj_words_add(&words, "--cache=%s", work->cache);
        umbj_words_add(&words, "--cache-size=%llu", (unsigned long long)options->cache_bytes);
    }
    umbj_words_add_settings(&words, work->settings, options->tile);
    umbj_words_add(&words, "./%s", work->scene);
    return umbj_try_run(try, &words, work->bundle);
}
