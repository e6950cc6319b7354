/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PROGRESS_H
#define UMBRAGE_CLI_CLI_PROGRESS_H
/* One line on a terminal's stderr for work of more than a second: done, rate, time left. */
#include <stdbool.h>
#include <stdint.h>

struct umbc_progress {
    bool wanted; /* stderr is a terminal and nobody asked for quiet */
    bool drawn;
    double started_s, drawn_s;
    const char *unit; /* of what is counted; begin says points */
};

void umbc_progress_begin(struct umbc_progress *progress, bool quiet);

/* Redraws at most five times a second. fraction: 0..1, or negative if not known. */
void umbc_progress_show(struct umbc_progress *progress, double count, double fraction);

/* The same for bytes of a known total. */
void umbc_progress_show_bytes(struct umbc_progress *progress, uint64_t done, uint64_t total);

/* Removes the line. */
void umbc_progress_end(struct umbc_progress *progress);

#endif
