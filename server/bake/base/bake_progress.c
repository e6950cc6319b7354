/* SPDX-License-Identifier: Apache-2.0 */
/* The supervisor's lines, see bake_progress.h. */
#include "bake/base/bake_progress.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "tool/clock.h"

#define INTERVAL_S 0.2

static int told = -1; /* descriptor of a supervisor */
static int held;      /* 1: no lines about progress and tiles */

void umbb_progress_tell_to(int fd)
{
    told = fd;
}

void umbb_progress_hold(int on)
{
    held = on;
}

/* Writes a line to the supervisor by a single write, so that a pipe does not cut the line. */
static void tell(const char *text, size_t length)
{
    if (told >= 0 && write(told, text, length) < 0) {
        told = -1; /* SIGPIPE is ignored */
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
    static uint64_t told_done, told_total;
    static double told_s;
    const double now = told >= 0 ? umbu_clock_s() : 0;
    const int is_new = done != told_done || total != told_total;
    if (told < 0 || held || !is_new || (0 < done && done < total && now - told_s < INTERVAL_S)) {
        return;
    }
    char line[96];
    told_done = done;
    told_total = total;
    told_s = now;
    tell(line,
         (size_t)snprintf(line, sizeof line, "tiles %llu %llu %llu\n", (unsigned long long)done,
                          (unsigned long long)total, (unsigned long long)found));
}

void umbb_progress_start(struct umbb_progress *progress, int quiet, const char *unit,
                         uint64_t total)
{
    *progress = (struct umbb_progress){.total = total};
    umbu_progress_begin(&progress->line, unit, quiet);
}

/* Writes a progress line to the supervisor, unless the last one was less than INTERVAL_S ago. */
static void tell_progress(struct umbb_progress *progress, uint64_t done)
{
    const double now = told >= 0 ? umbu_clock_s() : 0;
    if (told >= 0 && !held && now - progress->told_s >= INTERVAL_S) {
        char line[96];
        progress->told_s = now;
        tell(line, (size_t)snprintf(line, sizeof line, "progress %llu %llu %.31s\n",
                                    (unsigned long long)done, (unsigned long long)progress->total,
                                    progress->line.unit + 1)); /* without the M of a million */
    }
}

void umbb_progress_update(void *user, uint64_t done)
{
    struct umbb_progress *progress = user;
    tell_progress(progress, done);
    umbu_progress_show(&progress->line, 1e-6 * (double)done,
                       progress->total > 0 ? (double)done / (double)progress->total : 1);
}

void umbb_progress_end(struct umbb_progress *progress)
{
    umbu_progress_end(&progress->line);
}
