/* SPDX-License-Identifier: Apache-2.0 */
/* The progress line, see progress.h. The rate is the mean since umbu_progress_begin. */
#include "tool/progress.h"

#include <stdio.h>
#include <unistd.h>

#include "tool/clock.h"

#define SILENT_S   1.0
#define INTERVAL_S 0.2
#define BAR_CELLS  24

void umbu_progress_begin(struct umbu_progress *progress, const char *unit, bool quiet)
{
    *progress = (struct umbu_progress){
        .wanted = !quiet && isatty(STDERR_FILENO) == 1,
        .unit = unit,
        .started_s = umbu_clock_s(),
    };
}

void umbu_progress_text(char *text, size_t size, const char *unit, double done, double share,
                        double seconds)
{
    const double rate = done / seconds;
    char bar[BAR_CELLS + 1] = "";
    if (!(share >= 0 && share <= 1)) {
        (void)snprintf(text, size, "%.0f %s  %.3g %s/s", done, unit, rate, unit);
        return;
    }
    for (int i = 0; i < BAR_CELLS; i++) {
        bar[i] = (double)i < share * BAR_CELLS ? '#' : '.';
    }
    if (share == 0) {
        (void)snprintf(text, size, "[%s]   0 %%", bar);
        return;
    }
    const double left_s = seconds * (1 - share) / share;
    const double minutes = (double)(long long)(left_s / 60);
    (void)snprintf(text, size, "[%s] %3.0f %%  %.3g %s/s  %.0f:%02.0f left", bar, 100 * share, rate,
                   unit, minutes, left_s - 60 * minutes);
}

void umbu_progress_show(struct umbu_progress *progress, double done, double share)
{
    const double now = progress->wanted ? umbu_clock_s() : 0;
    if (!progress->wanted || now - progress->started_s < SILENT_S ||
        now - progress->drawn_s < INTERVAL_S) {
        return;
    }
    char text[160];
    umbu_progress_text(text, sizeof text, progress->unit, done, share, now - progress->started_s);
    (void)fprintf(stderr, "\r%s\033[K", text);
    (void)fflush(stderr);
    progress->drawn = true;
    progress->drawn_s = now;
}

void umbu_progress_end(struct umbu_progress *progress)
{
    if (progress->drawn) {
        (void)fputs("\r\033[K", stderr);
        (void)fflush(stderr);
        progress->drawn = false;
    }
}
