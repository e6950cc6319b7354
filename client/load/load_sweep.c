/* SPDX-License-Identifier: Apache-2.0 */
/* The search for the knee, see load_sweep.h. */
#include "load/load_sweep.h"

#include <stdlib.h>
#include <string.h>

#include "tool/tool_try.h"

#define FIRST_RATE 100
#define RATE_MAX   1e6
#define HALVINGS   5

struct search {
    struct umbc_load_settings settings;
    const struct umbc_load_pool *pool;
    umbc_load_step_fn tell;
    void *user;
    struct umbc_load_sweep *sweep;
    struct umbc_load_result *result;
};

static enum umb_status take_step(struct search *search, double rate, bool *kept,
                                 struct umb_error *error)
{
    struct umbc_load_sweep *sweep = search->sweep;
    struct umbc_load_result *result = search->result;
    search->settings.rate = rate;
    UMB__TRY(umbc_load_run(&search->settings, search->pool, NULL, NULL, result, error));
    search->settings.admin_may_fail = true; /* The service answered once, so that a lost request
                                               does not end the sweep */
    struct umbc_load_step *step = &sweep->steps[sweep->step_count++];
    *step = (struct umbc_load_step){
        .rate = rate,
        .calls_s = (double)result->calls / result->seconds,
        .p50_ms = 1e-6 * (double)umbc_histogram_percentile(&result->latency, 0.5),
        .p99_ms = 1e-6 * (double)umbc_histogram_percentile(&result->latency, 0.99),
        .failed = result->error_count + result->unsent,
        .generator_cores = result->generator_cores,
        .server_cores = result->has_server ? result->server_cpu_s / result->server_s : 0,
    };
    step->kept = step->p99_ms <= sweep->bound_ms && step->failed == 0;
    *kept = step->kept;
    if (step->kept) {
        sweep->knee = rate;
        sweep->at_knee = *result;
    }
    if (search->tell != NULL) {
        search->tell(search->user, step);
    }
    return UMB_OK;
}

/* Takes a step, and once more if it failed. */
static enum umb_status try_rate(struct search *search, double rate, bool *kept,
                                struct umb_error *error)
{
    UMB__TRY(take_step(search, rate, kept, error));
    return *kept ? UMB_OK : take_step(search, rate, kept, error);
}

enum umb_status umbc_load_sweep_run(const struct umbc_load_settings *settings,
                                    const struct umbc_load_pool *pool, double bound_ms,
                                    umbc_load_step_fn tell, void *user,
                                    struct umbc_load_sweep *sweep, struct umb_error *error)
{
    struct search search = {
        .settings = *settings, .pool = pool, .tell = tell, .user = user, .sweep = sweep};
    memset(sweep, 0, sizeof *sweep);
    sweep->bound_ms = bound_ms;
    search.result = malloc(sizeof *search.result);
    if (search.result == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a sweep");
    }
    double rate = settings->rate > 0 ? settings->rate : FIRST_RATE;
    bool kept = true;
    enum umb_status status = try_rate(&search, rate, &kept, error);
    while (status == UMB_OK && kept && rate < RATE_MAX) {
        rate *= 2;
        status = try_rate(&search, rate, &kept, error);
    }
    double failed = rate;
    for (int i = 0; status == UMB_OK && sweep->knee > 0 && !kept && i < HALVINGS; i++) {
        rate = 0.5 * (sweep->knee + failed);
        bool good = false;
        status = try_rate(&search, rate, &good, error);
        failed = good ? failed : rate;
    }
    free(search.result);
    return status;
}
