/* SPDX-License-Identifier: Apache-2.0 */
/* See plan_choices.h. */
#include "bake/plan_choices.h"

#include <math.h>
#include <string.h>

#include "base/try.h"
#include "umbrage/curve.h"

#define SMALL_LOG2 11U /* voxels a side of the second small bake */

/* Limits of the growth of time and bytes with each doubling. Lines grow twofold, areas fourfold. */
#define GROWTH_MIN 1.5
#define GROWTH_MAX 3.5

static double bound_m(const struct umbb_analysis *analysis)
{
    double bound = 0;
    for (uint32_t i = 0; i < analysis->frustum_count; i++) {
        bound = fmax(bound, umb_frustum_bound_m(&analysis->frusta[i], 0, 1));
    }
    return bound;
}

static double grown(double first, double second, uint32_t doublings)
{
    const double growth = first > 0 ? second / first : GROWTH_MAX;
    return second * pow(fmin(fmax(growth, GROWTH_MIN), GROWTH_MAX), doublings);
}

static void extrapolate(const struct umbb_costs samples[2], uint32_t log2_size,
                        struct umbb_forecast *forecast)
{
    const uint32_t doublings = log2_size - SMALL_LOG2;
    forecast->small_log2 = SMALL_LOG2;
    forecast->costs.seconds = grown(samples[0].seconds, samples[1].seconds, doublings);
    forecast->costs.packed_bytes =
        grown(samples[0].packed_bytes, samples[1].packed_bytes, doublings);
    forecast->costs.octree_bytes =
        grown(samples[0].octree_bytes, samples[1].octree_bytes, doublings);
}

/* 1 if a bake is likely to fit its memory. */
static int fits(const struct umbb_small_job *job, uint32_t log2_size,
                const struct umbb_forecast *forecast)
{
    struct umbb_memory_plan plan;
    return umbb_small_divide(job, log2_size, &plan, NULL) == UMB_OK &&
           forecast->costs.octree_bytes <= (double)plan.octree_max_bytes;
}

/* Fails because the wanted resolution is out of reach. The message names the best one that fits. */
static enum umb_status fail_memory(const struct umbb_small_job *job,
                                   const struct umbb_costs samples[2], uint32_t wanted_log2,
                                   const struct umbb_forecast *wanted, struct umb_error *error)
{
    uint32_t log2_size = wanted_log2;
    struct umbb_forecast forecast = *wanted;
    while (log2_size > SMALL_LOG2 && !fits(job, log2_size, &forecast)) {
        extrapolate(samples, --log2_size, &forecast);
    }
    UMB__TRY(umbb_small_fit(job, log2_size, error));
    return umb_fail(error, UMB_E_LIMIT,
                    "--max-error: %g m needs %u voxels a side, about %.0f MiB of nodes while it is "
                    "baked: too much for --memory %llu MiB; %u voxels reach %.3g m",
                    job->options->max_error_m, 1U << wanted_log2,
                    wanted->costs.octree_bytes / 1048576.0,
                    (unsigned long long)(job->memory.memory_bytes >> 20), 1U << log2_size,
                    bound_m(job->analysis));
}

/* Finds the smallest resolution within the bound, and leaves the frusta fitted to it. */
static enum umb_status find(const struct umbb_small_job *job, uint32_t *log2_size,
                            struct umbb_forecast *forecast, struct umb_error *error)
{
    const double wanted_m = job->options->max_error_m;
    for (*log2_size = UMBB_RESOLUTION_LOG2_MIN; *log2_size <= UMBB_RESOLUTION_LOG2_MAX;
         ++*log2_size) {
        UMB__TRY(umbb_small_fit(job, *log2_size, error));
        forecast->bound_m = bound_m(job->analysis);
        if (forecast->bound_m <= wanted_m) {
            return UMB_OK;
        }
        /* A doubling halves the bound, apart from margins. So resolutions that cannot reach the
         * wanted bound are skipped. */
        while (*log2_size < UMBB_RESOLUTION_LOG2_MAX && forecast->bound_m > 4 * wanted_m) {
            forecast->bound_m /= 2;
            ++*log2_size;
        }
    }
    /* Not E_LIMIT: another try, as of a job, would never help. */
    return umb_fail(error, UMB_E_ARGUMENT,
                    "--max-error: %g m: %u voxels a side, the most, reach %.3g m", wanted_m,
                    1U << UMBB_RESOLUTION_LOG2_MAX, forecast->bound_m);
}

enum umb_status umbb_resolution_choose(const struct umbb_small_job *job, uint32_t *log2_size,
                                       struct umbb_forecast *forecast, struct umb_error *error)
{
    struct umbb_costs samples[2];
    memset(forecast, 0, sizeof *forecast);
    UMB__TRY(find(job, log2_size, forecast, error));
    if (*log2_size <= SMALL_LOG2 + 1) {
        return UMB_OK;
    }
    UMB__TRY(umbb_small_bake(job, SMALL_LOG2 - 1, &samples[0], error));
    UMB__TRY(umbb_small_bake(job, SMALL_LOG2, &samples[1], error));
    extrapolate(samples, *log2_size, forecast);
    if (!fits(job, *log2_size, forecast)) {
        return fail_memory(job, samples, *log2_size, forecast, error);
    }
    return umbb_small_fit(job, *log2_size, error);
}
