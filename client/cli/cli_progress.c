/* SPDX-License-Identifier: Apache-2.0 */
/* The progress line, see cli_progress.h. */
#include "cli_progress.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <unistd.h>
#include "tool/clock.h"

#define FIRST_AFTER_S 1.0
#define REDRAW_S      0.2
#define BAR_WIDTH     30

void umbc_progress_begin(struct umbc_progress *progress, bool quiet)
{
    progress->wanted = !quiet && isatty(STDERR_FILENO) == 1;
    progress->drawn = false;
    progress->unit = "points";
    progress->started_s = umbu_clock_s();
    progress->drawn_s = 0;
}

/* 1 if it is time to draw again; *elapsed is then the time since the begin. */
static bool is_due(struct umbc_progress *progress, double *elapsed)
{
    const double now = umbu_clock_s();
    *elapsed = now - progress->started_s;
    if (!progress->wanted || *elapsed < FIRST_AFTER_S || now - progress->drawn_s < REDRAW_S) {
        return false;
    }
    progress->drawn = true;
    progress->drawn_s = now;
    return true;
}

static void draw_bar(double fraction, char bar[BAR_WIDTH + 1])
{
    for (int i = 0; i < BAR_WIDTH; i++) {
        bar[i] = (double)i < fraction * BAR_WIDTH ? '#' : '.';
    }
    bar[BAR_WIDTH] = '\0';
}

void umbc_progress_show_bytes(struct umbc_progress *progress, uint64_t done, uint64_t total)
{
    const double fraction = total > 0 ? (double)done / (double)total : 1;
    double elapsed;
    char bar[BAR_WIDTH + 1];
    if (is_due(progress, &elapsed) && done > 0) {
        draw_bar(fraction, bar);
        (void)fprintf(stderr, "\r[%s] %3.0f %%  %.1f MB/s  %.0f s left \033[K", bar, fraction * 100,
                      1e-6 * (double)done / elapsed, elapsed * (1 - fraction) / fraction);
        (void)fflush(stderr);
    }
}

void umbc_progress_show(struct umbc_progress *progress, double count, double fraction)
{
    double elapsed;
    if (!is_due(progress, &elapsed)) {
        return;
    }
    const double rate = count / elapsed;
    if (fraction > 0 && fraction <= 1) {
        char bar[BAR_WIDTH + 1];
        draw_bar(fraction, bar);
        (void)fprintf(stderr, "\r[%s] %3.0f %%  %.3g %s/s  %.0f s left \033[K", bar, fraction * 100,
                      rate, progress->unit, elapsed * (1 - fraction) / fraction);
    } else {
        (void)fprintf(stderr, "\r%.0f %s  %.3g %s/s \033[K", floor(count), progress->unit, rate,
                      progress->unit);
    }
    (void)fflush(stderr);
}

void umbc_progress_end(struct umbc_progress *progress)
{
    if (progress->drawn) {
        (void)fputs("\r\033[K", stderr);
        progress->drawn = false;
    }
}
