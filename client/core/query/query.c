/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Prepares and runs queries; see umbrage/query.h.
 *
 * Every product has all stages and filters. -DUMB_WITHOUT_FACES and the like compile one of them
 * out (here and in filter.c). Such builds prove that a query pays nothing for an effect that is
 * off: tests/system/test_effect_costs.sh counts their instructions.
 */
#include "umbrage/query.h"

#include <math.h>
#include <string.h>

#include "base/try.h"
#include "query/kernels.h"
#include "query/stages.h"

#ifndef UMB_WITHOUT_LEVELS
static bool has_level(const struct umb__plan *plan)
{
    return plan->settings->level > 0;
}

static void set_level(const struct umb__plan *plan, struct umb__query *q)
{
    (void)plan;
    q->run = q->kernel = umb__kernels_here()->coarse;
}

static const struct umb__stage level_stage = {has_level, set_level};
#endif

static bool is_parallel(const struct umb__plan *plan)
{
#ifdef UMB_WITHOUT_FACES
    (void)plan;
    return true;
#else
    return plan->light->kind == UMB_LIGHT_DIRECTIONAL;
#endif
}

/*
 * Sets up the bias of a directional light. The automatic bias takes its length from voxel_step,
 * which for coarse look-ups is twice a cell's edges: s >= |n.ex| + |n.ey| + |n.ez| for cells e. The
 * whole cell around the moved point then lies on the light's side of the surface's plane, wherever
 * in the cell the point is.
 */
static void set_bias(const struct umb__plan *plan, struct umb__query *q)
{
    const double(*step)[3] = plan->frustum->voxel_step;
    const double steps = q->level > 0 ? umb__coarse_steps(q) : 1;
    switch (q->bias_mode) {
    case UMB_BIAS_AUTO:
        q->no_normal_m = steps * umb__no_normal_m(plan, q, q->taps);
        q->lift_texel = umb__lift_texel(plan->frustum);
        for (unsigned axis = 0; axis < 3 && q->level > 0; axis++) {
            umb__scale(steps, q->voxel_step[axis]);
        }
        return;
    case UMB_BIAS_VOXELS:
        q->bias_m = plan->settings->bias *
                    (umb__length(step[0]) + umb__length(step[1]) + umb__length(step[2])) / 3.0;
        break;
    case UMB_BIAS_METRES:
        q->bias_m = plan->settings->bias;
        break;
    case UMB_BIAS_NONE:
        break;
    }
    q->no_normal_m = q->bias_m;
}

static const struct umb__stage bias_stage = {is_parallel, set_bias};

/* The stages around the kernel, from the outermost one inwards. */
static const struct umb__stage *const STAGES[] = {
#ifndef UMB_WITHOUT_LEVELS
    &level_stage,
#endif
    &bias_stage,
#ifndef UMB_WITHOUT_FACES
    &umb__faces_stage,
#endif
#ifndef UMB_WITHOUT_TRANSMITTANCE
    &umb__transmittance_stage,
#endif
#ifndef UMB_WITHOUT_STATIC
    &umb__receiver_mask_stage,
#endif
};

/* Returns the window width: taps, or the odd number of texels nearest to footprint_m. */
static enum umb_status choose_taps(const struct umb__plan *plan, int32_t *taps,
                                   struct umb_error *error)
{
    const double wanted = plan->settings->footprint_m;
    *taps = plan->settings->taps ? (int32_t)plan->settings->taps : 1;
    if (wanted == 0 || plan->filter->info.has_footprints) {
        return UMB_OK;
    }
    if (!is_parallel(plan)) { /* Texels of a lamp grow with the distance, so each point has a width
                                 of its own */
        *taps = UMB_TAPS_MAX;
        return wanted > 0 && wanted <= UMB_FOOTPRINT_MAX
                   ? UMB_OK
                   : umb_fail(error, UMB_E_ARGUMENT,
                              "footprint_m: %g, must be above 0 and at most %g", wanted,
                              UMB_FOOTPRINT_MAX);
    }
    const double(*step)[3] = plan->frustum->voxel_step;
    const double texel_m = (umb__length(step[0]) + umb__length(step[1])) / 2;
    const double limit = (UMB_TAPS_MAX + 1) * texel_m;
    if (!(wanted > 0 && wanted <= limit)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "footprint_m: %g, must be above 0 and at most %g (%d texels of %g m)",
                        wanted, limit, UMB_TAPS_MAX + 1, texel_m);
    }
    int32_t half = (int32_t)floor(wanted / texel_m / 2);
    *taps = half < UMB_TAPS_MAX / 2 ? 2 * half + 1 : UMB_TAPS_MAX;
    return UMB_OK;
}

static umb__kernel *kernel_of(const struct umb__plan *plan)
{
    const struct umb__kernels *here = umb__kernels_here();
    const struct umb__filter *filter = plan->filter;
    const bool is_own = filter->kernel != NULL && (filter->lamp_run == NULL || is_parallel(plan));
    return is_own ? filter->kernel : filter->is_tent ? here->tents : here->windows;
}

/* Returns the query with its kernel alone. */
static struct umb__query begin(const struct umb__plan *plan, int32_t taps)
{
    umb__kernel *kernel = kernel_of(plan);
    const struct umb__view *view = &plan->asset->view;
    const struct umb_frustum_info *frustum = plan->frustum;
    const struct umb__top *top = &view->tops[plan->light->first_frustum];
    struct umb__query q = {
        .run = kernel,
        .kernel = kernel,
        .grid = view->grid + top->first_cell,
        .columns = view->columns + top->first_column,
        .pieces = view->pieces + top->first_piece,
        .nodes = view->nodes,
        .bricks = view->bricks,
        .log2_size = frustum->log2_size,
        .grid_log2 = top->grid_log2,
        .column_level = top->column_level,
        .frustum = plan->light->first_frustum,
        .taps = taps,
        .total = plan->filter->total != NULL ? plan->filter->total(taps) : (uint32_t)(taps * taps),
        .total_of = plan->filter->total,
        .level = plan->settings->level,
        .filter = plan->settings->filter,
        .bias_mode = plan->settings->bias_mode,
        .format = plan->settings->format,
    };
    memcpy(q.world_to_voxel, frustum->world_to_voxel, sizeof q.world_to_voxel);
    memcpy(q.voxel_step, frustum->voxel_step, sizeof q.voxel_step);
    memcpy(q.direction, plan->light->direction, sizeof q.direction);
    memcpy(q.origin, plan->content->origin, sizeof q.origin);
    return q;
}

enum umb_status umb_query_prepare(const struct umb_asset *asset,
                                  const struct umb_query_settings *settings,
                                  struct umb_query *query, struct umb_error *error)
{
    struct umb__plan plan;
    int32_t taps;
    memset(query, 0, sizeof *query);
    UMB__TRY(umb__plan_make(asset, settings, &plan, error));
    UMB__TRY(choose_taps(&plan, &taps, error));
    struct umb__query q = begin(&plan, taps);
    for (size_t i = 0; i < sizeof STAGES / sizeof STAGES[0]; i++) {
        if (STAGES[i]->applies(&plan)) {
            STAGES[i]->set(&plan, &q);
        }
    }
    if (plan.filter->set != NULL) {
        plan.filter->set(&plan, &q);
    }
    memcpy(query->opaque, &q, sizeof q);
    return UMB_OK;
}

uint32_t umb_query_taps(const struct umb_query *query)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    return (uint32_t)q.taps;
}

void umb_query_run(const struct umb_query *query, const struct umb_points *points, size_t first,
                   size_t count, struct umb_answers *answers)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    q.run(&q, points, first, count, answers);
}
