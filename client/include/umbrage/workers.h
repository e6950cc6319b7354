/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WORKERS_H
#define UMBRAGE_WORKERS_H
/*
 * Threads that the caller lends to the core, which has no threads of its own.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/*
 * A set of threads. `run` calls job(job_user, number, worker) once for each number below `jobs`, on
 * any threads and in any order. It returns when all calls are done; their writes are then visible
 * to the caller. worker is below `count`, and differs between calls that run at the same time.
 */
struct umb_workers {
    unsigned count; /* Number of threads, at least 1 */
    void (*run)(void *user, void (*job)(void *job_user, uint32_t number, unsigned worker),
                void *job_user, uint32_t jobs);
    void *user; /* First argument of `run` */
};

#ifdef __cplusplus
}
#endif
#endif
