/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STEADY_TIME_H
#define UMBRAGE_SERVER_STUDY_STEADY_TIME_H
/* Time of a function on one thread: several runs, each long enough for the clock. */
#include <stddef.h>

struct umbt_steady_time {
    double ns;     /* CPU time a point, median of the runs */
    double spread; /* spread without the fastest and the slowest run: (largest - least) / median */
};

/* Times `ask`, which handles `points` points a call. Of up to three attempts it takes the
 * steadiest; it stops at a spread of at most `enough`. */
struct umbt_steady_time umbt_steady_time(void (*ask)(void *user), void *user, size_t points,
                                         double enough);

#endif
