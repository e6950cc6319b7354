/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_CLOCK_H
#define UMBRAGE_TOOL_CLOCK_H
/*
 * The clocks of all programs. Reading one cannot fail, keeps errno and is async-signal-safe.
 *
 * umbu_clock_*: steady time that counts from an unspecified moment, for deadlines and durations.
 * umbu_unix_ms: time of day, which may jump. umbu_*_cpu_*: processor time used.
 */
#include <stdint.h>
#include <time.h>

static inline uint64_t umbu__read_ns(clockid_t clock)
{
    struct timespec now = {0};
    (void)clock_gettime(clock, &now);
    return (uint64_t)now.tv_sec * UINT64_C(1000000000) + (uint64_t)now.tv_nsec;
}

static inline uint64_t umbu_clock_ns(void)
{
    return umbu__read_ns(CLOCK_MONOTONIC);
}

static inline int64_t umbu_clock_ms(void)
{
    return (int64_t)(umbu_clock_ns() / 1000000);
}

static inline double umbu_clock_s(void)
{
    return 1e-9 * (double)umbu_clock_ns();
}

/* Milliseconds since 1970, UTC. */
static inline int64_t umbu_unix_ms(void)
{
    return (int64_t)(umbu__read_ns(CLOCK_REALTIME) / 1000000);
}

/* Processor time of the calling thread. */
static inline uint64_t umbu_thread_cpu_ns(void)
{
    return umbu__read_ns(CLOCK_THREAD_CPUTIME_ID);
}

static inline double umbu_thread_cpu_s(void)
{
    return 1e-9 * (double)umbu_thread_cpu_ns();
}

/* Processor time of all threads of this process. */
static inline double umbu_process_cpu_s(void)
{
    return 1e-9 * (double)umbu__read_ns(CLOCK_PROCESS_CPUTIME_ID);
}

/* Returns the moment `after_ms` from now, for a condition variable that uses CLOCK_MONOTONIC. */
static inline struct timespec umbu_clock_deadline(int64_t after_ms)
{
    const uint64_t at_ns = umbu_clock_ns() + (uint64_t)after_ms * UINT64_C(1000000);
    return (struct timespec){.tv_sec = (time_t)(at_ns / UINT64_C(1000000000)),
                             .tv_nsec = (long)(at_ns % UINT64_C(1000000000))};
}

#endif
