/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_PLAN_CHOICES_H
#define UMBRAGE_SERVER_BAKE_PLAN_CHOICES_H
/*
 * Choices and prices found by small bakes: the resolution of --max-error, the closed or the open
 * rule, and the bytes of sharp BLEND materials as cut-outs.
 */
#include "bake/small_bake.h"

/*
 * --max-error: the smallest resolution whose bound at one tap (umb_frustum_bound_m) stays below a
 * length, in every frustum; and a forecast of the bake's costs from two small bakes.
 *
 * The choice depends on the scene and the lights alone. The forecast decides only whether the
 * octree is likely to fit the memory. Time and bytes are assumed to grow with each doubling as they
 * did from the first small bake to the second.
 */
struct umbb_forecast {
    double bound_m;          /* bound at one tap, metres: the largest of all frusta */
    struct umbb_costs costs; /* zero: no forecast */
    uint32_t small_log2;     /* log2 of the voxels a side of the larger small bake */
};

/*
 * Chooses the resolution.
 *
 * In:    job: its options have max_error_m above 0, and packed is 1. Its analysis is then fitted to
 *        the choice.
 * Out:   log2_size. forecast: without costs if the bake itself is small.
 * Fails: E_ARGUMENT (no resolution reaches the bound), E_LIMIT (no such resolution fits the
 *        memory): both messages name the best bound that can be reached; E_NO_MEMORY, E_CANCELLED,
 *        and the errors of umbb_analysis_refit.
 * Cost:  a pass over the triangles for each resolution tried, and two bakes of 1024 and 2048
 *        voxels.
 */
UMB_CHECKED enum umb_status umbb_resolution_choose(const struct umbb_small_job *job,
                                                   uint32_t *log2_size,
                                                   struct umbb_forecast *forecast,
                                                   struct umb_error *error);

/*
 * Closed or open: the rule with fewer bytes, by small bakes of the scene under both.
 *
 * Where a bake at the wanted resolution is cheap, both are baked at it, and the bytes are exact.
 * Otherwise both are baked at lower resolutions. The nodes of each level grow from one to the next,
 * and the growth, which changes slowly, is continued (byte_growth.h).
 *
 * The choice depends on scene, lights and resolution alone: on no clock, thread count, memory or
 * compression, because the asset's id depends on it. docs/explained/effects.md has its accuracy.
 */

/* Least share of the nodes' bytes that the closed rule must save. Below it the asset keeps
 * penumbras, columns and derived maps instead. The share of the file's bytes may be a few per cent
 * higher or lower, so this limit keeps the rule on wherever it saves a tenth of the file. */
#define UMBB_CLOSED_SAVES 0.03

/*
 * Decides the closed rule of a scene with closed parts, unless the options decide it. Sets the
 * analysis's rule and closed_price.
 *
 * In:    job: its analysis is left fitted to the options' resolution. With job->packed the price
 *        has packed bytes.
 * Fails: the errors of umbb_small_bake.
 * Cost:  by a model of its work, at most 0.3 s of a thread or a tenth of the bake.
 */
UMB_CHECKED enum umb_status umbb_closed_choose(const struct umbb_small_job *job,
                                               struct umb_error *error);

/* Forecasts the packed bytes of a scene's voxels under the rule of its analysis. In: job: packed is
 * 1. Fails: the errors of umbb_small_bake. Cost: half of umbb_closed_choose's. */
UMB_CHECKED enum umb_status umbb_packed_forecast(const struct umbb_small_job *job, double *bytes,
                                                 struct umb_error *error);

/*
 * Finds the bytes that sharp BLEND materials (scene_alpha.h) take as translucent casters and as
 * cut-outs, and sets the analysis's sharp_price. It does so only if the scene has translucent
 * triangles of such materials and the options do not choose between the two.
 * In:    job: packed is 1. working_bytes: limit of the memory for transmittance maps.
 * Fails: the errors of umbb_analysis_run, umbb_small_bake and umbb_transmittance_bake.
 * Cost:  a second analysis, forecasts of both, and the maps.
 */
UMB_CHECKED enum umb_status umbb_sharp_price_find(const struct umbb_small_job *job,
                                                  size_t working_bytes, struct umb_error *error);

#endif
