/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_SWEEP_H
#define UMBRAGE_LOAD_LOAD_SWEEP_H
/*
 * The knee of a service: the highest rate at which it keeps its promise.
 *
 * A step is a run at a constant rate. It is kept if the 99th percentile is within the bound,
 * nothing failed, and nothing was left unsent. Rates double until a step fails, then the interval
 * between the last kept and the first failed one is halved five times: the knee is known to 3 %.
 * Noise can make a step fail; a failed one is therefore tried a second time.
 */
#include "load/load_run.h"

/* Thirty doublings from the lowest first rate to the highest, five halvings, all tried twice. */
#define UMBC_SWEEP_STEPS 80

struct umbc_load_step {
    double rate, calls_s; /* asked, and answered, a second */
    double p50_ms, p99_ms;
    uint64_t failed; /* errors and unsent */
    double generator_cores;
    double server_cores; /* 0 = not known */
    bool kept;
};

struct umbc_load_sweep {
    double bound_ms;
    double knee; /* calls a second; 0 = not even the first rate was kept */
    size_t step_count;
    struct umbc_load_step steps[UMBC_SWEEP_STEPS]; /* in the order in which they were taken */
    struct umbc_load_result at_knee;               /* zero if there is none */
};

/* Told about each step as it ends; may be NULL. */
typedef void (*umbc_load_step_fn)(void *user, const struct umbc_load_step *step);

/*
 * In:    settings: rate: of the first step; duration: of each.
 * Fails: as umbc_load_run.
 */
UMB_CHECKED enum umb_status umbc_load_sweep_run(const struct umbc_load_settings *settings,
                                                const struct umbc_load_pool *pool, double bound_ms,
                                                umbc_load_step_fn tell, void *user,
                                                struct umbc_load_sweep *sweep,
                                                struct umb_error *error);

#endif
