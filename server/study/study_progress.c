/* SPDX-License-Identifier: Apache-2.0 */
/* A progress line on stderr. */
#include "study/study_progress.h"

#include <stdio.h>
#include <unistd.h>

#include "tool/clock.h"

void umbt_progress_start(struct umbt_progress *progress, const char *unit, int quiet)
{
    progress->unit = unit;
    progress->start_s = umbu_clock_s();
    progress->shown_s = progress->start_s;
    progress->enabled = !quiet && isatty(STDERR_FILENO);
    progress->visible = 0;
}

void umbt_progress_show(struct umbt_progress *progress, double done, double total)
{
    const double now = umbu_clock_s(), spent = now - progress->start_s;
    if (!progress->enabled || spent < 1.0 || now - progress->shown_s < 0.1 || !(done > 0.0)) {
        return;
    }
    const int filled = (int)(24.0 * done / total);
    char bar[25];
    for (int i = 0; i < 24; i++) {
        bar[i] = i < filled ? '#' : '.';
    }
    bar[24] = '\0';
    fprintf(stderr, "\r[%s] %3.0f %%  %.2f %s/s  %.0f s left \033[K", bar, 100.0 * done / total,
            done / spent, progress->unit, spent * (total - done) / done);
    fflush(stderr);
    progress->shown_s = now;
    progress->visible = 1;
}

void umbt_progress_end(struct umbt_progress *progress)
{
    if (progress->visible) {
        fputs("\r\033[K", stderr);
        fflush(stderr);
        progress->visible = 0;
    }
}
