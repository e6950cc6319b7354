/* SPDX-License-Identifier: Apache-2.0 */
/* Names of job states and failures. */
#include "jobs/job.h"

const char *umbj_state_name(enum umbj_state state)
{
    static const char *const names[UMBJ_STATE_COUNT] = {"queued", "running", "done", "failed",
                                                        "poison"};
    return (unsigned)state < UMBJ_STATE_COUNT ? names[state] : "unknown";
}

const char *umbj_failure_name(enum umbj_failure failure)
{
    static const char *const names[UMBJ_FAILURE_COUNT] = {
        "none",   "rejected", "temporary", "io",       "lost",     "crash",
        "memory", "sandbox",  "timeout",   "internal", "cancelled"};
    return (unsigned)failure < UMBJ_FAILURE_COUNT ? names[failure] : "unknown";
}

int umbj_is_over(enum umbj_state state)
{
    return state != UMBJ_QUEUED && state != UMBJ_RUNNING;
}
