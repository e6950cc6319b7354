/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_SWEEP_H
#define UMBRAGE_LOAD_LOAD_SWEEP_H
/*
 * The knee of a service: the highest rate at which its latency stays within a bound.
 *
 * A step is a run at a constant rate. The step holds if the 99th percentile is within the bound, no
 * call failed and every call was sent. Rates double until a step fails. Then the interval between
 * the last rate that held and the first that failed is halved five times: the knee is known to 3 %.
 * A failed step is tried a second time, because noise can make a step fail.
 */
#include "load/load_run.h"

/* Most steps: 30 doublings from the lowest rate to the highest and 5 halvings, all tried twice. */
#define UMBC_SWEEP_STEPS 80

struct umbc_load_step {
    double rate, calls_s; /* calls a second: sent, and answered */
    double p50_ms, p99_ms;
    uint64_t failed; /* number of errors and of calls never sent */
    double generator_cores;
    double server_cores; /* processors that the daemon used; 0 = not known */
    bool kept;           /* true: the step holds */
};

struct umbc_load_sweep {
    double bound_ms;
    double knee; /* calls a second; 0 = the first rate failed */
    size_t step_count;
    struct umbc_load_step steps[UMBC_SWEEP_STEPS]; /* [step_count] in order of time */
    struct umbc_load_result at_knee;               /* result at the knee; zero without one */
};

/* Called at the end of each step; may be NULL. */
typedef void (*umbc_load_step_fn)(void *user, const struct umbc_load_step *step);

/*
 * Finds the knee.
 *
 * In:    settings: rate of the first step, duration of each.
 * Fails: as umbc_load_run.
 */
UMB_CHECKED enum umb_status umbc_load_sweep_run(const struct umbc_load_settings *settings,
                                                const struct umbc_load_pool *pool, double bound_ms,
                                                umbc_load_step_fn tell, void *user,
                                                struct umbc_load_sweep *sweep,
                                                struct umb_error *error);

#endif
