/* SPDX-License-Identifier: Apache-2.0 */
/* See plan_choices.h. */
#include "bake/plan_choices.h"

#include "bake/bake_transmittance.h"
#include "base/try.h"

/* Forecasts the bytes of voxels and maps of an analysed scene. */
static enum umb_status forecast(const struct umbb_small_job *job, size_t working_bytes,
                                double *bytes, struct umb_error *error)
{
    struct umb__transmittance_bytes maps;
    uint32_t level;
    *bytes = 0.0;
    if (job->analysis->count > 0) {
        UMB__TRY(umbb_packed_forecast(job, bytes, error));
    }
    const enum umb_status status =
        umbb_transmittance_bake(job->analysis, job->options, working_bytes, &maps, &level, error);
    *bytes += (double)maps.count;
    umb__transmittance_bytes_finish(&maps);
    return status;
}

enum umb_status umbb_sharp_price_find(const struct umbb_small_job *job, size_t working_bytes,
                                      struct umb_error *error)
{
    const struct umbs_cuts *cuts = &job->analysis->cuts;
    struct umbb_sharp_price *price = &job->analysis->sharp_price;
    if (cuts->sharp.triangles == 0 || cuts->translucent.triangles == 0 ||
        job->options->sharp_cut_outs || job->options->opaque_translucents) {
        return UMB_OK;
    }
    struct umbb_options options = *job->options;
    struct umbb_analysis analysis;
    struct umbb_small_job cut = *job;
    options.sharp_cut_outs = 1;
    cut.options = &options;
    cut.analysis = &analysis;
    UMB__TRY(forecast(job, working_bytes, &price->blend_bytes, error));
    UMB__TRY(umbb_analysis_run(job->view, &options, &analysis, error));
    enum umb_status status = umbb_closed_choose(&cut, error);
    if (status == UMB_OK) {
        status = forecast(&cut, working_bytes, &price->cut_bytes, error);
    }
    price->known = status == UMB_OK;
    umbb_analysis_finish(&analysis);
    return status;
}
