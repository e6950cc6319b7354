/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BASE_BAKE_PROGRESS_H
#define UMBRAGE_SERVER_BAKE_BASE_BAKE_PROGRESS_H
/*
 * Progress of a bake, shown on a terminal (tool/progress.h) and written for a supervisor.
 */
#include <stdint.h>
#include "tool/progress.h"

struct umbb_progress {
    struct umbu_progress line;
    double told_s;  /* time of the last line to the supervisor, umbu_clock_s; 0 = none yet */
    uint64_t total; /* number of items of the phase: texels or points */
};

/* Starts a phase. quiet: 1 = never draw. unit: name of a million items, such as "Mtexel";
 * borrowed. */
void umbb_progress_start(struct umbb_progress *progress, int quiet, const char *unit,
                         uint64_t total);

/* Draws the line on the terminal, and writes a line for the supervisor (below). In: user: the
 * struct umbb_progress. done: number of items done. */
void umbb_progress_update(void *user, uint64_t done);

/* Removes the line. */
void umbb_progress_end(struct umbb_progress *progress);

/*
 * A supervisor reads these lines from a descriptor, with --quiet too:
 *
 *     phase import | analysis | bake | write | verify
 *     plan ...                                     each line of the plan
 *     progress DONE TOTAL UNIT                     of the phase, at most five a second
 *     tiles DONE TOTAL FOUND                       FOUND of the DONE tiles came from the cache
 *
 * After a failed write no more lines are written.
 * Threads: one at a time; a process has one bake.
 */

/* Sets the descriptor; -1: no supervisor. */
void umbb_progress_tell_to(int fd);
/* Turns lines about progress and tiles off (1) and on (0), for bakes that are only samples. */
void umbb_progress_hold(int on);
void umbb_progress_phase(const char *phase);
void umbb_progress_plan(const char *plan);

/* Writes a line if the counts changed: at most five a second, and always the last. */
void umbb_progress_tiles(uint64_t done, uint64_t total, uint64_t found);

#endif
