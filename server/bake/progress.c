/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing the line; the rate is the mean since the start. */
#include "bake/progress.h"

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

void umbb_progress_update(void *user, uint64_t done)
{
    struct umbb_progress *progress = user;
    if (progress->to == NULL) {
        return;
    }
    const double now = umbb_clock_s();
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
