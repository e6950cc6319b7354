/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_TRY_EXECUTOR_H
#define UMBRAGE_SERVER_JOBS_TRY_EXECUTOR_H
/*
 * The executor of all bakes: each try is a thread. It has the asset baked, on this machine
 * (bake_try.h) or by a farm (farm.h), passes the reports on, and stages the result. No process
 * outlives the daemon (worker_process.h); a farm's tasks end when they find that the try's folder
 * is gone.
 */
#include "jobs/executor.h"
#include "jobs/farm.h"

#define UMBJ_WORKERS_MAX 256

struct umbj_try_options {
    const char *program;    /* umbrage-bake, absolute; borrowed, as all texts */
    const char *assets;     /* folder for the finished assets */
    const char *work;       /* folder of the tries' folders */
    struct umbj_farm *farm; /* NULL = this machine; owned by the executor, also if create fails */
    const char *sandbox;    /* mode of umbrage-bake --sandbox; NULL = required */
    unsigned workers;       /* tries at once, 1..UMBJ_WORKERS_MAX */
    unsigned threads;       /* threads of one bake, or of one task of it */
    uint32_t tile;          /* texels along a tile's side; 0 = umbrage-bake's choice */
    uint64_t memory_bytes;  /* limit of one bake, or of one task of it */
    uint64_t interval_ms;   /* milliseconds between status calls to the farm */
    uint64_t cache_bytes;   /* limit of one owner's tiles */
    uint64_t timeout_ms;    /* wall-clock limit of one try */
    uint64_t max_output_bytes; /* limit of an asset */
    umbj_report_fn report;
    void *user;
};

/* Makes an executor; its destroy frees it. Fails: E_UNAVAILABLE (no such program), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_try_executor_create(const struct umbj_try_options *options,
                                                     struct umbj_executor **out,
                                                     struct umb_error *error);

#endif
