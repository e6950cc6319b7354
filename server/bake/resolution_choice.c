/* SPDX-License-Identifier: Apache-2.0 */
/* See resolution_choice.h. */
#include "bake/resolution_choice.h"

#include <math.h>
#include <string.h>

#include "bake/bake_frusta.h"
#include "base/try.h"
#include "common/sha256.h"
#include "format/content.h"
#include "tool/clock.h"
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

static enum umb_status fit(const struct umbb_resolution_job *job, uint32_t log2_size,
                           struct umb_error *error)
{
    UMB__TRY(umbb_analysis_need_corners(job->analysis, job->view, error));
    return umbb_analysis_refit(job->analysis, log2_size, error);
}

static enum umb_status divide(const struct umbb_resolution_job *job, uint32_t log2_size,
                              struct umbb_memory_plan *plan, struct umb_error *error)
{
    struct umbb_memory_input input = job->memory;
    input.log2_size = log2_size;
    input.tile_log2 = input.tile_log2 < log2_size ? input.tile_log2 : log2_size;
    return umbb_memory_divide(&input, plan, error);
}

static enum umb_status count_bytes(void *user, const void *bytes, size_t count)
{
    (void)bytes;
    *(double *)user += (double)count;
    return UMB_OK;
}

/* Packs an octree without writing it, for its size. */
static enum umb_status pack(const struct umbb_resolution_job *job, const struct umb__octree *octree,
                            double *packed_bytes, struct umb_error *error)
{
    static char nothing[] = "";
    const struct umb__content content = {
        .light_count = job->analysis->choice.count,
        .frustum_count = job->analysis->frustum_count,
        .lights = job->analysis->choice.lights,
        .frusta = job->analysis->frusta,
        .bounds = job->analysis->bounds,
        .plan = nothing,
        .settings = nothing,
    };
    const struct umb_sink sink = {count_bytes, packed_bytes};
    uint8_t id[UMB_ID_BYTES];
    return umb__pack_write(&content, octree, &umbs_sha256, &sink, id, error);
}

/* Bakes at a small resolution. */
static enum umb_status bake_small(const struct umbb_resolution_job *job, uint32_t log2_size,
                                  struct umbb_costs *sample, struct umb_error *error)
{
    struct umbb_options options = *job->options;
    struct umbb_memory_plan memory;
    struct umb__octree octree = {0};
    struct umbb_bake_figures figures = {0};
    const double start = umbu_process_cpu_s();
    const struct umbb_frusta_job bake = {
        .analysis = job->analysis, .view = job->view, .options = &options, .memory = &memory};
    memset(sample, 0, sizeof *sample);
    options.task = UMBB_TASK_BAKE; /* everything, also if only tiles are wanted afterwards */
    options.only_given = 0;
    options.resolution_log2 = log2_size;
    options.quiet = 1;
    UMB__TRY(fit(job, log2_size, error));
    UMB__TRY(divide(job, log2_size, &memory, error));
    enum umb_status status = umbb_bake_frusta(&bake, &octree, &figures, error);
    if (status == UMB_OK) {
        status = pack(job, &octree, &sample->packed_bytes, error);
    }
    umb__octree_finish(&octree);
    sample->seconds = umbu_process_cpu_s() - start;
    sample->octree_bytes = (double)figures.octree_bytes;
    return status;
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
static int fits(const struct umbb_resolution_job *job, uint32_t log2_size,
                const struct umbb_forecast *forecast)
{
    struct umbb_memory_plan plan;
    return divide(job, log2_size, &plan, NULL) == UMB_OK &&
           forecast->costs.octree_bytes <= (double)plan.octree_max_bytes;
}

/* Fails because the wanted resolution is out of reach. The message names the best one that fits. */
static enum umb_status fail_memory(const struct umbb_resolution_job *job,
                                   const struct umbb_costs samples[2], uint32_t wanted_log2,
                                   const struct umbb_forecast *wanted, struct umb_error *error)
{
    uint32_t log2_size = wanted_log2;
    struct umbb_forecast forecast = *wanted;
    while (log2_size > SMALL_LOG2 && !fits(job, log2_size, &forecast)) {
        extrapolate(samples, --log2_size, &forecast);
    }
    UMB__TRY(fit(job, log2_size, error));
    return umb_fail(error, UMB_E_LIMIT,
                    "--max-error: %g m needs %u voxels a side, about %.0f MiB of nodes while it is "
                    "baked: too much for --memory %llu MiB; %u voxels reach %.3g m",
                    job->options->max_error_m, 1U << wanted_log2,
                    wanted->costs.octree_bytes / 1048576.0,
                    (unsigned long long)(job->memory.memory_bytes >> 20), 1U << log2_size,
                    bound_m(job->analysis));
}

/* Finds the smallest resolution within the bound, and leaves the frusta fitted to it. */
static enum umb_status find(const struct umbb_resolution_job *job, uint32_t *log2_size,
                            struct umbb_forecast *forecast, struct umb_error *error)
{
    const double wanted_m = job->options->max_error_m;
    for (*log2_size = UMBB_RESOLUTION_LOG2_MIN; *log2_size <= UMBB_RESOLUTION_LOG2_MAX;
         ++*log2_size) {
        UMB__TRY(fit(job, *log2_size, error));
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

enum umb_status umbb_resolution_choose(const struct umbb_resolution_job *job, uint32_t *log2_size,
                                       struct umbb_forecast *forecast, struct umb_error *error)
{
    struct umbb_costs samples[2];
    memset(forecast, 0, sizeof *forecast);
    UMB__TRY(find(job, log2_size, forecast, error));
    if (*log2_size <= SMALL_LOG2 + 1) {
        return UMB_OK;
    }
    UMB__TRY(bake_small(job, SMALL_LOG2 - 1, &samples[0], error));
    UMB__TRY(bake_small(job, SMALL_LOG2, &samples[1], error));
    extrapolate(samples, *log2_size, forecast);
    if (!fits(job, *log2_size, forecast)) {
        return fail_memory(job, samples, *log2_size, forecast, error);
    }
    return fit(job, *log2_size, error);
}
