/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STEADY_TIME_H
#define UMBRAGE_SERVER_STUDY_STEADY_TIME_H
/* How long something takes on one thread, of several runs, each long enough for the clock. */
#include <stddef.h>

struct umbt_steady_time {
    double ns;     /* CPU time a point, median of the runs */
    double spread; /* of the runs but the quickest and the slowest: (largest - least) / median */
};

/* Takes the time of `ask`, which handles `points` points a call; of up to three attempts the
 * steadiest, and no more than it takes for a spread of at most `enough`. */
struct umbt_steady_time umbt_steady_time(void (*ask)(void *user), void *user, size_t points,
                                         double enough);

#endif
