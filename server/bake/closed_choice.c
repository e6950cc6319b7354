/* SPDX-License-Identifier: Apache-2.0 */
/* See plan_choices.h. */
#include "bake/plan_choices.h"

#include <math.h>

#include "bake/byte_growth.h"
#include "base/try.h"

/* Model of the processor time of a bake, in seconds: for each triangle of a frustum, and for each
 * texel of a sun's and of a lamp's frustum. */
#define TRIANGLE_S   0.15e-6
#define SUN_TEXEL_S  4e-9
#define LAMP_TEXEL_S 15e-9
/* Processor time of the import, the analysis and the comparison with rays together, in seconds for
 * each triangle. */
#define REST_TRIANGLE_S 2e-6

/* Limits of the time of the choice: seconds, or a share of the bake. */
#define BUDGET_S     0.3
#define BUDGET_SHARE 0.1

#define EXACT_LOG2_MAX  12U /* the largest resolution that may be baked itself */
#define SAMPLE_LOG2_MAX 12U /* the largest sample, for resolutions up to 2^15 */
#define SAMPLE_LOG2_MIN 8U
#define DOUBLINGS_MAX   3U      /* above that, samples are larger */
#define MANY_TRIANGLES  500000U /* above that, two samples instead of three */
#define DEPTH_LOG2      10U     /* resolution of the samples of first occluders */

/* A bake under both rules at a few resolutions. */
struct samples {
    const struct umbb_small_job *job;
    uint32_t last_log2, count;
    struct umbb_costs costs[2][3]; /* [closed][i]: ascending resolutions */
};

/* Processor time of a bake, by the model. */
static double work_of(const struct umbb_analysis *analysis, uint32_t log2_size)
{
    const double texels = ldexp(1.0, 2 * (int)log2_size);
    double seconds = 0.0;
    for (uint32_t i = 0; i < analysis->frustum_count; i++) {
        const uint32_t light = analysis->frusta[i].light;
        const int lamp = analysis->choice.lights[light].kind != UMB_LIGHT_DIRECTIONAL;
        seconds +=
            TRIANGLE_S * (double)analysis->count + (lamp ? LAMP_TEXEL_S : SUN_TEXEL_S) * texels;
    }
    return seconds;
}

/* Processor time of samples under both rules, by the model. */
static double work_of_samples(const struct umbb_analysis *analysis, uint32_t last_log2,
                              uint32_t count)
{
    double seconds = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        seconds += 2.0 * work_of(analysis, last_log2 - i);
    }
    return seconds;
}

/* Chooses the samples for a bake of 2^log2_size voxels a side. */
static void choose_samples(struct samples *samples, uint32_t log2_size)
{
    const struct umbb_analysis *analysis = samples->job->analysis;
    const double whole = work_of(analysis, log2_size) + REST_TRIANGLE_S * (double)analysis->count;
    const double budget = fmax(BUDGET_S, BUDGET_SHARE * whole);
    samples->count = analysis->count > MANY_TRIANGLES ? 2 : 3;
    samples->last_log2 = log2_size < SAMPLE_LOG2_MAX + 1 ? log2_size - 1 : SAMPLE_LOG2_MAX;
    if (log2_size > SAMPLE_LOG2_MAX + DOUBLINGS_MAX) {
        samples->last_log2 = log2_size - DOUBLINGS_MAX;
    }
    while (samples->last_log2 > SAMPLE_LOG2_MIN &&
           work_of_samples(analysis, samples->last_log2, samples->count) > budget) {
        samples->last_log2--;
    }
    if (log2_size <= SAMPLE_LOG2_MIN + 2 ||
        (log2_size <= EXACT_LOG2_MAX && work_of_samples(analysis, log2_size, 1) <= budget)) {
        samples->last_log2 = log2_size;
        samples->count = 1;
    }
}

/* Bakes the samples of one rule, without the first ones. */
static enum umb_status bake_samples(struct samples *samples, int closed, uint32_t without,
                                    struct umb_error *error)
{
    umbb_analysis_rule(samples->job->analysis, closed);
    for (uint32_t i = without; i < samples->count; i++) {
        const uint32_t log2_size = samples->last_log2 - (samples->count - 1 - i);
        UMB__TRY(umbb_small_bake(samples->job, log2_size, &samples->costs[closed][i], error));
    }
    return UMB_OK;
}

enum umb_status umbb_packed_forecast(const struct umbb_small_job *job, double *bytes,
                                     struct umb_error *error)
{
    const int closed = job->analysis->closed_rule;
    const uint32_t log2_size = job->options->resolution_log2;
    struct samples samples = {.job = job};
    choose_samples(&samples, log2_size);
    UMB__TRY(bake_samples(&samples, closed, 0, error));
    const struct umbb_growth_samples grown = {samples.costs[closed], samples.count};
    *bytes = samples.count == 1 ? grown.costs->packed_bytes
                                : umbb_growth_packed(&grown, log2_size - samples.last_log2);
    return umbb_small_fit(job, log2_size, error);
}

/* Estimates the bytes of the map of first occluders, if the options ask for one. */
static enum umb_status find_depth_bytes(const struct umbb_small_job *job, double *bytes,
                                        struct umb_error *error)
{
    struct umbb_small_job mapped = *job;
    const uint32_t log2_size = job->options->resolution_log2;
    const uint32_t last = log2_size < DEPTH_LOG2 ? log2_size : DEPTH_LOG2;
    struct umbb_costs costs[2];
    *bytes = 0.0;
    if (!job->options->occluder_depth) {
        return UMB_OK;
    }
    mapped.occluder_depth = 1;
    mapped.packed = 0;
    umbb_analysis_rule(job->analysis, 1);
    for (uint32_t i = 0; i < 2; i++) {
        UMB__TRY(umbb_small_bake(&mapped, last - 1 + i, &costs[i], error));
    }
    *bytes = costs[1].depth_bytes;
    const double growth = *bytes / fmax(costs[0].depth_bytes, 1.0);
    for (uint32_t i = last; i < log2_size; i++) {
        *bytes *= fmin(fmax(growth, 1.0), 4.0);
    }
    return UMB_OK;
}

/* Makes the price from samples. */
static void make_price(const struct samples *samples, double depth_bytes,
                       struct umbb_closed_price *price)
{
    const struct umbb_growth_samples open = {samples->costs[0], samples->count};
    const struct umbb_growth_samples closed = {samples->costs[1], samples->count};
    const uint32_t doublings = samples->job->options->resolution_log2 - samples->last_log2;
    struct umbb_rule_bytes nodes, packed = {0.0, 0.0};
    if (samples->count == 1) {
        nodes = (struct umbb_rule_bytes){umbb_level_bytes_sum(open.costs),
                                         umbb_level_bytes_sum(closed.costs)};
        packed = (struct umbb_rule_bytes){open.costs->packed_bytes, closed.costs->packed_bytes};
    } else {
        nodes = umbb_growth_nodes(&open, &closed, doublings);
        if (samples->job->packed) {
            packed = (struct umbb_rule_bytes){umbb_growth_packed(&open, doublings),
                                              umbb_growth_packed(&closed, doublings)};
        }
    }
    *price =
        (struct umbb_closed_price){.known = 1,
                                   .exact = samples->count == 1 && !(depth_bytes > 0.0),
                                   .sample_log2 = samples->last_log2,
                                   .saved = 1.0 - (nodes.closed + depth_bytes) / nodes.open,
                                   .factor = umbb_growth_packed_factor(samples->count, doublings),
                                   .open_bytes = packed.open,
                                   .closed_bytes = packed.closed + depth_bytes};
}

enum umb_status umbb_closed_choose(const struct umbb_small_job *job, struct umb_error *error)
{
    struct umbb_analysis *analysis = job->analysis;
    struct samples samples = {.job = job};
    double depth_bytes;
    if (!analysis->closed_rule || job->options->closed != UMBB_CLOSED_AUTO) {
        return UMB_OK;
    }
    choose_samples(&samples, job->options->resolution_log2);
    UMB__TRY(bake_samples(&samples, 0, 0, error));
    /* Of the closed rule's nodes only the ratio to the open one's is continued. */
    UMB__TRY(bake_samples(&samples, 1, samples.count > 2 && !job->packed ? 1 : 0, error));
    UMB__TRY(find_depth_bytes(job, &depth_bytes, error));
    make_price(&samples, depth_bytes, &analysis->closed_price);
    UMB__TRY(umbb_small_fit(job, job->options->resolution_log2, error));
    umbb_analysis_rule(analysis, analysis->closed_price.saved >= UMBB_CLOSED_SAVES);
    return UMB_OK;
}
