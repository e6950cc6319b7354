/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BASE_BAKE_PROGRESS_H
#define UMBRAGE_SERVER_BAKE_BASE_BAKE_PROGRESS_H
/*
 * How far a bake is: on a terminal (tool/progress.h), and for a supervisor.
 */
#include <stdint.h>
#include "tool/progress.h"

struct umbb_progress {
    struct umbu_progress line;
    double told_s;  /* Time of the last line to the supervisor, umbu_clock_s; 0 = none yet. */
    uint64_t total; /* Number of what is counted. */
};

/* Starts. In: quiet: 1 = never draw; unit: borrowed, the name of a million of what is counted. */
void umbb_progress_start(struct umbb_progress *progress, int quiet, const char *unit,
                         uint64_t total);

/* Draws and tells. In: user: the struct umbb_progress; done: of its total. */
void umbb_progress_update(void *user, uint64_t done);

/* Removes the line. */
void umbb_progress_end(struct umbb_progress *progress);

/*
 * A supervisor reads these lines from a descriptor, with --quiet too:
 *
 *     phase import | analysis | bake | write | verify
 *     plan ...                                     each line of the plan
 *     progress DONE TOTAL UNIT                     of the phase, at most five a second
 *     tiles DONE TOTAL FOUND                       FOUND: of DONE, in the folder of tiles already
 *
 * _tell_to: sets the descriptor, -1 = none (tests). _phase, _plan: write those lines; _tiles if
 * they are more, at most five a second and at the end. After a failed write no more are written.
 * Threads: as umbb_progress_update; one bake a process.
 */
void umbb_progress_tell_to(int fd);
void umbb_progress_phase(const char *phase);
void umbb_progress_plan(const char *plan);
void umbb_progress_tiles(uint64_t done, uint64_t total, uint64_t found);

#endif
