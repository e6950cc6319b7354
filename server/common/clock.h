/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_CLOCK_H
#define UMBRAGE_SERVER_COMMON_CLOCK_H
/* A monotonic clock, for deadlines and durations. Cannot fail. */
#include <stdint.h>
#include <time.h>

/* Milliseconds since a fixed moment in the past. Async-signal-safe. */
static inline int64_t umbs_now_ms(void)
{
    struct timespec now = {0};
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

#endif
