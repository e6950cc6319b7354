/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_PROGRESS_H
#define UMBRAGE_SERVER_STUDY_STUDY_PROGRESS_H
/*
 * A progress line on stderr, with rate and time left. Shown only on a terminal, only after a
 * second, at most ten times a second. Single-threaded.
 */

struct umbt_progress {
    const char *unit; /* "Msamples" */
    double start_s, shown_s;
    int enabled, visible;
};

void umbt_progress_start(struct umbt_progress *progress, const char *unit, int quiet);
void umbt_progress_show(struct umbt_progress *progress, double done, double total);
void umbt_progress_end(struct umbt_progress *progress); /* wipes the line */

#endif
