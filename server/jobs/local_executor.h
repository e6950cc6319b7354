/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_LOCAL_EXECUTOR_H
#define UMBRAGE_SERVER_JOBS_LOCAL_EXECUTOR_H
/*
 * Bakes on this machine: each try is a thread that starts umbrage-bake, listens to it, and stages
 * what it made. No process outlives the daemon (worker_process.h).
 */
#include "jobs/executor.h"

#define UMBJ_WORKERS_MAX 256

struct umbj_local_options {
    const char *program;       /* umbrage-bake; borrowed */
    const char *assets;        /* folder for what was baked; borrowed */
    unsigned workers;          /* tries at once, 1..UMBJ_WORKERS_MAX */
    unsigned threads;          /* of one bake */
    uint32_t tile;             /* texels along its side; 0 = as umbrage-bake has it */
    uint64_t memory_bytes;     /* of one bake */
    uint64_t cache_bytes;      /* of one owner's tiles */
    uint64_t timeout_ms;       /* of one try, wall clock */
    uint64_t max_output_bytes; /* of an asset */
    umbj_report_fn report;
    void *user;
};

/* Makes an executor; its destroy frees it. Fails: E_UNAVAILABLE (no such program), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_local_executor_create(const struct umbj_local_options *options,
                                                       struct umbj_executor **out,
                                                       struct umb_error *error);

#endif
