/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_PROGRESS_H
#define UMBRAGE_TOOL_PROGRESS_H
/*
 * One line on a terminal's stderr for work of more than a second: share done, rate, time left.
 *
 *     umbu_progress_begin(&progress, "Mtexel", quiet);
 *     umbu_progress_show(&progress, 1e-6 * done, share);     as often as you like
 *     umbu_progress_end(&progress);
 *
 * Threads: one at a time.
 */
#include <stdbool.h>
#include <stddef.h>

struct umbu_progress {
    bool wanted;      /* true: stderr is a terminal, and the line was not switched off */
    bool drawn;       /* true: the line is visible */
    const char *unit; /* Name of what is counted, borrowed. */
    double started_s; /* Time of begin, umbu_clock_s. */
    double drawn_s;   /* Time of the last drawing. */
};

void umbu_progress_begin(struct umbu_progress *progress, const char *unit, bool quiet);

/*
 * Draws the line at most five times a second, and not in the first second.
 * In: done: amount in units. share: share of the whole, 0..1, or any other number if it is not
 * known.
 */
void umbu_progress_show(struct umbu_progress *progress, double done, double share);

/* Removes the line. */
void umbu_progress_end(struct umbu_progress *progress);

/* Writes the text of the line: a pure function. In: seconds: seconds since umbu_progress_begin,
 * above 0. */
void umbu_progress_text(char *text, size_t size, const char *unit, double done, double share,
                        double seconds);

#endif
