/* SPDX-License-Identifier: Apache-2.0 */
/* Reading the settings again while the daemon serves. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/daemon.h"
#include "daemon/base/service_manager.h"

/* Returns the settings as a config file in memory; free() it. NULL: out of memory. */
static char *settings_text(const struct umbd_options *options)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (out == NULL) {
        return NULL;
    }
    umbd_options_print(options, out);
    if (fclose(out) != 0) {
        free(text);
        return NULL;
    }
    return text;
}

static int has_line(const char *text, const char *line)
{
    size_t length = strlen(line);
    const char *at = strstr(text, line);
    while (at != NULL && ((at != text && at[-1] != '\n') || at[length] != '\n')) {
        at = strstr(at + 1, line);
    }
    return at != NULL;
}

/* Logs each setting of `after` that differs from `before`: such a setting needs a restart. */
static void log_waiting(const struct umbs_log *log, const char *before, char *after)
{
    char *rest;
    for (char *line = strtok_r(after, "\n", &rest); line != NULL;
         line = strtok_r(NULL, "\n", &rest)) {
        if (!has_line(before, line)) {
            char quoted[UMBS_LOG_QUOTE_SIZE];
            umbs_log_event(log, UMB_LOG_WARN, "restart_needed", "setting=%s",
                           umbs_log_quote(line, quoted));
        }
    }
}

static void take_over(struct umbd_daemon *daemon, const struct umbd_options *now)
{
    struct umbd_options *old = &daemon->server.options;
    old->log_level = now->log_level;
    old->scrub_interval_ms = now->scrub_interval_ms;
    umbs_log_set_level(&daemon->server.log, now->log_level);
    umbd_store_watch_set_scrub(daemon->watch, now->scrub_interval_ms);
    char *before = settings_text(old);
    char *after = settings_text(now);
    if (before != NULL && after != NULL) {
        log_waiting(&daemon->server.log, before, after);
    }
    free(before);
    free(after);
    umbs_log_event(&daemon->server.log, UMB_LOG_INFO, "reloaded", "what=config");
}

static void reload_config(struct umbd_daemon *daemon)
{
    struct umbd_options now;
    struct umb_error error;
    if (daemon->server.options.argv == NULL) {
        return;
    }
    umbd_notify_reloading();
    if (umbd_options_parse(daemon->server.options.argc, daemon->server.options.argv, &now,
                           &error) == UMB_OK) {
        take_over(daemon, &now);
    } else {
        char quoted[UMBS_LOG_QUOTE_SIZE];
        umbs_log_event(&daemon->server.log, UMB_LOG_ERROR, "not_reloaded", "what=config reason=%s",
                       umbs_log_quote(error.message, quoted));
    }
    umbd_options_finish(&now);
    umbd_notify("READY=1");
}

static void log_reload(const struct umbd_daemon *daemon, const char *what, enum umb_status status,
                       const struct umb_error *error)
{
    if (status == UMB_OK) {
        umbs_log_event(&daemon->server.log, UMB_LOG_INFO, "reloaded", "what=%s", what);
    } else {
        umbs_log_event(&daemon->server.log, UMB_LOG_ERROR, "not_reloaded", "what=%s reason=\"%s\"",
                       what, error->message);
    }
}

void umbd_daemon_reload(struct umbd_daemon *daemon)
{
    struct umb_error error;
    reload_config(daemon);
    if (daemon->server.tls != NULL) {
        log_reload(daemon, "tls", umbd_tls_reload(daemon->server.tls, &error), &error);
    }
    if (daemon->backend.tokens != NULL) {
        log_reload(daemon, "tokens", umbd_tokens_reload(daemon->backend.tokens, &error), &error);
    }
    umbd_store_watch_kick(daemon->watch);
}
