/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_PROGRESS_H
#define UMBRAGE_SERVER_BAKE_PROGRESS_H
/*
 * One line on a terminal: share done, rate, time left. Silent for the first second, and always if
 * the stream is not a terminal.
 */
#include <stdint.h>
#include <stdio.h>

struct umbb_progress {
    FILE *to;          /* NULL = silent */
    double start_s;    /* monotonic */
    double shown_s;    /* time of the last drawing; 0 = never */
    double reported_s; /* time of the last report (umbb_progress_tell_to); 0 = never */
    uint64_t total;
    const char *unit; /* unit of a million: "Mtexel" */
};

/* Starts. In: quiet: 1 = never draw; unit: borrowed, the name of a million of the counted items. */
void umbb_progress_start(struct umbb_progress *progress, FILE *to, int quiet, const char *unit,
                         uint64_t total);

/* Draws at most five times a second. In: user: the struct umbb_progress; done: of its total. */
void umbb_progress_update(void *user, uint64_t done);

/* Removes the line. */
void umbb_progress_end(struct umbb_progress *progress);

/* Writes the line's text for a state, without a newline: a pure function (tests). */
void umbb_progress_text(char *text, size_t size, const char *unit, uint64_t done, uint64_t total,
                        double seconds);

/*
 * Reports to a supervisor on a descriptor, in addition to the line and regardless of --quiet:
 *
 *     phase import | analysis | bake | write | verify
 *     plan ...                                     each line of the plan
 *     progress DONE TOTAL UNIT                     of the phase, at most five a second
 *     tiles DONE TOTAL FOUND                       FOUND: of DONE, in the folder of tiles already
 *
 * _tell_to: sets the descriptor, -1 = no reports (tests). _phase, _plan: write those lines; _tiles:
 * if the count grew, at most five a second and at the end. After a reader has closed the pipe, no
 * more reports are written. Threads: as umbb_progress_update; one bake a process.
 */
void umbb_progress_tell_to(int fd);
void umbb_progress_phase(const char *phase);
void umbb_progress_plan(const char *plan);
void umbb_progress_tiles(uint64_t done, uint64_t total, uint64_t found);

/* Seconds of the monotonic clock. */
double umbb_clock_s(void);

#endif
