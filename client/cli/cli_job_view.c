/* SPDX-License-Identifier: Apache-2.0 */
/* Watching and showing jobs, see cli_job_view.h. */
#include "cli_job_view.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "tool/clock.h"
#include "tool/exit_code.h"

#define BAR_WIDTH    30
#define PAUSE_MS     250
#define PAUSE_MAX_MS 4000

const char *umbc_job_state(int state)
{
    static const char *const names[] = {"queued", "running", "done", "failed", "poison"};
    return state >= 0 && state <= UMB_JOB_POISON ? names[state] : "unknown";
}

const char *umbc_job_failure(int failure)
{
    static const char *const names[] = {"none",    "rejected", "temporary", "io",
                                        "lost",    "crash",    "memory",    "sandbox",
                                        "timeout", "internal", "cancelled"};
    return failure >= 0 && failure <= UMB_JOB_CANCELLED ? names[failure] : "unknown";
}

/* Exit code of a job that is over. */
static int exit_of(const struct umb_job_status *status)
{
    if (status->state == UMB_JOB_DONE) {
        return 0;
    }
    switch (status->failure) {
    case UMB_JOB_REJECTED:
        return umbu_exit_code(UMB_E_BAD_SCENE);
    case UMB_JOB_CRASH:
    case UMB_JOB_SANDBOX:
    case UMB_JOB_INTERNAL:
        return umbu_exit_code(UMB_E_INTERNAL);
    default:
        return umbu_exit_code(UMB_E_BUSY);
    }
}

void umbc_format_time(int64_t unix_ms, char text[24])
{
    const time_t seconds = (time_t)(unix_ms / 1000);
    struct tm utc;
    if (unix_ms <= 0 || gmtime_r(&seconds, &utc) == NULL) {
        (void)snprintf(text, 24, "-");
    } else {
        (void)strftime(text, 24, "%Y-%m-%d %H:%M:%S", &utc);
    }
}

/* State of a watch. */
struct view {
    bool drawn, wanted; /* true: the line is visible; the line may be drawn */
    double heard_s;     /* time of the daemon's last message, umbu_clock_s */
    struct umb_job_status status;
    char *plan;
};

static void draw(struct view *view, const char *note)
{
    const struct umb_job_status *s = &view->status;
    if (!view->wanted) {
        return;
    }
    view->drawn = true;
    (void)fprintf(stderr, "\r%s", umbc_job_state(s->state));
    if (note != NULL) {
        (void)fprintf(stderr, ": %s", note);
    } else if (s->state == UMB_JOB_QUEUED && s->cause[0] != '\0') {
        (void)fputs(" again: ", stderr);
        umbc_print_text(stderr, s->cause, strlen(s->cause) < 60 ? strlen(s->cause) : 60);
    } else if (s->state == UMB_JOB_RUNNING) {
        (void)fputs(": ", stderr);
        umbc_print_text(stderr, s->phase, strlen(s->phase));
        if (s->total > 0) {
            const double share = (double)s->done / (double)s->total;
            char bar[BAR_WIDTH + 1];
            for (int i = 0; i < BAR_WIDTH; i++) {
                bar[i] = (double)i < share * BAR_WIDTH ? '#' : '.';
            }
            bar[BAR_WIDTH] = '\0';
            (void)fprintf(stderr, " [%s] %3.0f %%  %.3g M", bar, 100 * share, 1e-6 * s->rate);
            umbc_print_text(stderr, s->unit, strlen(s->unit));
            (void)fprintf(stderr, "/s  %.0f s left",
                          s->left_ms >= 0 ? 1e-3 * (double)s->left_ms : 0);
        }
        if (s->tiles_total > 1) {
            (void)fprintf(stderr, "  tile %" PRIu64 " of %" PRIu64, s->tiles_done, s->tiles_total);
        }
    }
    (void)fputs(" \033[K", stderr);
    (void)fflush(stderr);
}

static int on_status(void *user, const struct umb_job_status *status)
{
    struct view *view = user;
    if (status->plan != NULL && status->plan[0] != '\0') {
        char *plan = strdup(status->plan);
        if (plan != NULL) {
            free(view->plan);
            view->plan = plan;
        }
    }
    view->status = *status;
    view->status.plan = view->status.notices = NULL;
    view->heard_s = umbu_clock_s();
    draw(view, NULL);
    return 1;
}

static bool is_over(int state)
{
    return state != UMB_JOB_QUEUED && state != UMB_JOB_RUNNING;
}

/* True for failures that end when the daemon is back. */
static bool may_pass(enum umb_status status)
{
    return status == UMB_OK || status == UMB_E_UNAVAILABLE || status == UMB_E_DEADLINE ||
           status == UMB_E_BUSY || status == UMB_E_CANCELLED || status == UMB_E_PROTOCOL;
}

/* Watches a job until it is over. Out: view: the last status, without texts except the plan, which
 * the caller frees with free(). */
static enum umb_status watch(struct umb_client *client, const char *job, bool quiet,
                             struct view *out, struct umb_error *error)
{
    struct view view = {.wanted = !quiet && isatty(STDERR_FILENO) == 1, .heard_s = umbu_clock_s()};
    long pause_ms = PAUSE_MS;
    enum umb_status result = UMB_OK;
    do {
        const double heard_s = view.heard_s;
        result = umb_client_watch(client, job, on_status, &view, NULL, error);
        if ((result == UMB_OK && is_over(view.status.state)) || !may_pass(result)) {
            break;
        }
        pause_ms = view.heard_s > heard_s ? PAUSE_MS : pause_ms * 2;
        pause_ms = pause_ms < PAUSE_MAX_MS ? pause_ms : PAUSE_MAX_MS;
        draw(&view, "the daemon does not answer, trying again");
        (void)nanosleep(&(struct timespec){pause_ms / 1000, pause_ms % 1000 * 1000000}, NULL);
    } while (umbu_clock_s() - view.heard_s < UMBC_WATCH_PATIENCE_S);
    if (view.drawn) {
        (void)fputs("\r\033[K", stderr);
    }
    if (result == UMB_OK && !is_over(view.status.state)) {
        result =
            umb_fail(error, UMB_E_UNAVAILABLE, "job %.40s: the daemon has stopped answering", job);
    }
    *out = view;
    return result;
}

void umbc_job_json(struct umbu_json *json, const struct umb_job_status *status)
{
    umbu_json_text(json, "job", status->job);
    umbu_json_text(json, "state", umbc_job_state(status->state));
    umbu_json_text(json, "failure", umbc_job_failure(status->failure));
    umbu_json_text(json, "cause", status->cause);
    if (status->has_asset) {
        umbc_json_id(json, "asset", status->asset);
    }
    umbu_json_text(json, "owner", status->owner);
    umbu_json_signed(json, "priority", status->priority);
    UMBU_JSON_COUNTS(json, {"epoch", status->epoch}, {"bundle_bytes", status->bundle_bytes});
    umbu_json_signed(json, "submitted_ms", status->submitted_ms);
    umbu_json_signed(json, "started_ms", status->started_ms);
    umbu_json_signed(json, "ended_ms", status->ended_ms);
    if (status->tiles_total > 0) {
        UMBU_JSON_COUNTS(json, {"tiles", status->tiles_total}, {"tiles_done", status->tiles_done},
                         {"tiles_found", status->tiles_found});
    }
}

/* Prints how a job ended, on stdout. Returns the exit code. */
static int report(const struct umb_job_status *status, const char *plan, bool as_json, bool quiet)
{
    char id[UMB_ID_TEXT_SIZE];
    const int code = exit_of(status);
    if (as_json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_job_json(&json, status);
        umbu_json_text(&json, "plan", plan != NULL ? plan : "");
        umbu_json_close(&json);
    } else if (status->has_asset) {
        umb_id_to_text(status->asset, id);
        (void)printf(quiet ? "%s\n" : "asset       %s\n", id);
        if (!quiet) {
            /* Both are times of the daemon's calendar, which may have been set back in between. */
            const double seconds = 1e-3 * ((double)status->ended_ms - (double)status->submitted_ms);
            (void)printf("job         %s: done", status->job);
            (void)(seconds >= 0 ? printf(" in %.1f s\n", seconds) : puts(""));
            if (status->tiles_total > 0) {
                (void)printf("tiles       %" PRIu64 ", of them %" PRIu64 " as baked before\n",
                             status->tiles_total, status->tiles_found);
            }
        }
    }
    if (code != 0) {
        (void)fprintf(stderr, "umbrage: job %s: %s (%s): ", status->job,
                      umbc_job_state(status->state), umbc_job_failure(status->failure));
        umbc_print_text(stderr, status->cause, strlen(status->cause));
        (void)fputc('\n', stderr);
    }
    return umbc_finish_stdout(code);
}

int umbc_job_wait(struct umb_client *client, const char *job, bool as_json, bool quiet)
{
    struct view view;
    struct umb_error error = {.status = UMB_OK};
    const int code = watch(client, job, quiet, &view, &error) == UMB_OK
                         ? report(&view.status, view.plan, as_json, quiet)
                         : umbc_complain(&error);
    free(view.plan);
    return code;
}
