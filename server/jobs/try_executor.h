/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_TRY_EXECUTOR_H
#define UMBRAGE_SERVER_JOBS_TRY_EXECUTOR_H
/*
 * The executor of all bakes: each try is a thread, which has the asset baked, on this machine
 * (bake_try.h) or by a farm (farm.h), listens to what is told of it, and stages what was made. No
 * process outlives the daemon (worker_process.h); what a farm runs ends when it notices that the
 * try's folder is gone.
 */
#include "jobs/executor.h"
#include "jobs/farm.h"

#define UMBJ_WORKERS_MAX 256

struct umbj_try_options {
    const char *program;       /* umbrage-bake, absolute; borrowed, as all texts */
    const char *assets;        /* folder for what was baked */
    const char *work;          /* folder of the tries' folders */
    struct umbj_farm *farm;    /* NULL = this machine; the executor's, also if create fails */
    const char *sandbox;       /* of umbrage-bake --sandbox; NULL = required */
    unsigned workers;          /* tries at once, 1..UMBJ_WORKERS_MAX */
    unsigned threads;          /* of one bake, or of one task of it */
    uint32_t tile;             /* texels along its side; 0 = as umbrage-bake has it */
    uint64_t memory_bytes;     /* of one bake, or of one task of it */
    uint64_t interval_ms;      /* between questions to the farm */
    uint64_t cache_bytes;      /* of one owner's tiles */
    uint64_t timeout_ms;       /* of one try, wall clock */
    uint64_t max_output_bytes; /* of an asset */
    umbj_report_fn report;
    void *user;
};

/* Makes an executor; its destroy frees it. Fails: E_UNAVAILABLE (no such program), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_try_executor_create(const struct umbj_try_options *options,
                                                     struct umbj_executor **out,
                                                     struct umb_error *error);

#endif
