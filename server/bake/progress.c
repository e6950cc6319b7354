/* SPDX-License-Identifier: Apache-2.0 */
/* Draws the line; the rate is the mean since the start. */
#include "bake/progress.h"

#include <string.h>
#include <time.h>
#include <unistd.h>

#define SILENT_S   1.0
#define INTERVAL_S 0.2
#define BAR_CELLS  24

double umbb_clock_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int report_fd = -1; /* descriptor of a supervisor */

void umbb_progress_tell_to(int fd)
{
    report_fd = fd;
}

/* Writes a line to the supervisor in one write, so that a pipe does not cut it. */
static void tell(const char *text, size_t length)
{
    if (report_fd >= 0 && write(report_fd, text, length) < 0) {
        report_fd = -1; /* SIGPIPE is ignored */
    }
}

void umbb_progress_phase(const char *phase)
{
    char line[64];
    tell(line, (size_t)snprintf(line, sizeof line, "phase %.40s\n", phase));
}

void umbb_progress_plan(const char *plan)
{
    while (*plan != '\0') {
        char line[512];
        const size_t length = strcspn(plan, "\n");
        tell(line, (size_t)snprintf(line, sizeof line, "plan %.*s\n",
                                    (int)(length < 500 ? length : 500), plan));
        plan += length + (plan[length] == '\n');
    }
}

void umbb_progress_tiles(uint64_t done, uint64_t total, uint64_t found)
{
    static uint64_t reported_done, reported_total;
    static double reported_s;
    const double now = report_fd >= 0 ? umbb_clock_s() : 0;
    const int is_new = done != reported_done || total != reported_total;
    if (report_fd < 0 || !is_new || (0 < done && done < total && now - reported_s < INTERVAL_S)) {
        return;
    }
    char line[96];
    reported_done = done;
    reported_total = total;
    reported_s = now;
    tell(line,
         (size_t)snprintf(line, sizeof line, "tiles %llu %llu %llu\n", (unsigned long long)done,
                          (unsigned long long)total, (unsigned long long)found));
}

void umbb_progress_start(struct umbb_progress *progress, FILE *to, int quiet, const char *unit,
                         uint64_t total)
{
    *progress = (struct umbb_progress){
        .to = !quiet && isatty(fileno(to)) ? to : NULL,
        .start_s = umbb_clock_s(),
        .total = total,
        .unit = unit,
    };
}

void umbb_progress_text(char *text, size_t size, const char *unit, uint64_t done, uint64_t total,
                        double seconds)
{
    const double share = total == 0 ? 1.0 : (double)done / (double)total;
    const double rate = seconds > 0.0 ? (double)done / seconds : 0.0;
    char bar[BAR_CELLS + 1];
    for (int i = 0; i < BAR_CELLS; i++) {
        bar[i] = (double)i < share * BAR_CELLS ? '#' : '.';
    }
    bar[BAR_CELLS] = '\0';
    if (done == 0) {
        snprintf(text, size, "[%s]   0 %%", bar);
        return;
    }
    const double left_s = (double)(total - done) / rate;
    snprintf(text, size, "[%s] %3.0f %%  %.3g %s/s  %.0f:%02.0f left", bar, 100.0 * share,
             1e-6 * rate, unit, (double)(int64_t)(left_s / 60.0),
             left_s - 60.0 * (double)(int64_t)(left_s / 60.0));
}

/* Reports progress to the supervisor, if it is due. */
static void tell_progress(struct umbb_progress *progress, uint64_t done, double now)
{
    if (report_fd >= 0 && now - progress->reported_s >= INTERVAL_S) {
        char line[96];
        progress->reported_s = now;
        tell(line, (size_t)snprintf(line, sizeof line, "progress %llu %llu %.31s\n",
                                    (unsigned long long)done, (unsigned long long)progress->total,
                                    progress->unit + 1)); /* without the M of a million */
    }
}

void umbb_progress_update(void *user, uint64_t done)
{
    struct umbb_progress *progress = user;
    if (progress->to == NULL && report_fd < 0) {
        return;
    }
    const double now = umbb_clock_s();
    tell_progress(progress, done, now);
    if (progress->to == NULL) {
        return;
    }
    const double since =
        progress->shown_s > 0.0 ? now - progress->shown_s : now - progress->start_s;
    if (since < (progress->shown_s > 0.0 ? INTERVAL_S : SILENT_S)) {
        return;
    }
    char text[160];
    umbb_progress_text(text, sizeof text, progress->unit, done, progress->total,
                       now - progress->start_s);
    fprintf(progress->to, "\r%s\033[K", text);
    fflush(progress->to);
    progress->shown_s = now;
}

void umbb_progress_end(struct umbb_progress *progress)
{
    if (progress->to != NULL && progress->shown_s > 0.0) {
        fputs("\r\033[K", progress->to);
        fflush(progress->to);
    }
    progress->to = NULL;
}
