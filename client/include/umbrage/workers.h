/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WORKERS_H
#define UMBRAGE_WORKERS_H
/*
 * Threads that the core may use; it has none of its own.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/*
 * run: calls job(job_user, number, worker) once for each number below `jobs`, on any threads and in
 * any order, and returns when all are done; what they wrote is then visible to the caller. worker
 * is below `count`; no two calls under way have the same.
 */
struct umb_workers {
    unsigned count; /* 1.. */
    void (*run)(void *user, void (*job)(void *job_user, uint32_t number, unsigned worker),
                void *job_user, uint32_t jobs);
    void *user;
};

#ifdef __cplusplus
}
#endif
#endif
