/* SPDX-License-Identifier: Apache-2.0 */
/* See steady_time.h. */
#include "study/steady_time.h"

#include <math.h>
#include <stdlib.h>

#include "tool/clock.h"

#define RUNS     5
#define ATTEMPTS 3
#define RUN_S    0.002
#define CALLS    1000 /* calls a run, at most */

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double calls_s(void (*ask)(void *user), void *user, int calls)
{
    const double start = umbu_thread_cpu_s();
    for (int i = 0; i < calls; i++) {
        ask(user);
    }
    return umbu_thread_cpu_s() - start;
}

struct umbt_steady_time umbt_steady_time(void (*ask)(void *user), void *user, size_t points,
                                         double enough)
{
    struct umbt_steady_time best = {0.0, INFINITY};
    const double once = calls_s(ask, user, 1); /* after a first call has warmed up the caches */
    const int calls = 1 + (int)fmin(RUN_S / fmax(once, 1e-9), CALLS);
    for (int attempt = 0; attempt < ATTEMPTS && best.spread > enough; attempt++) {
        double seconds[RUNS];
        for (int run = 0; run < RUNS; run++) {
            seconds[run] = calls_s(ask, user, calls);
        }
        qsort(seconds, RUNS, sizeof *seconds, by_size);
        const double middle = seconds[RUNS / 2];
        const double spread = middle > 0.0 ? (seconds[RUNS - 2] - seconds[1]) / middle : 0.0;
        if (spread < best.spread) {
            best.ns = 1e9 * middle / ((double)calls * (double)points);
            best.spread = spread;
        }
    }
    return best;
}
