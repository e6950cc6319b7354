/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_RESOLUTION_CHOICE_H
#define UMBRAGE_SERVER_BAKE_RESOLUTION_CHOICE_H
/*
 * --max-error: the smallest resolution whose bound at one tap (umb_frustum_bound_m) stays below a
 * length, in every frustum; and a forecast of the bake's costs from two small bakes.
 *
 * The choice depends on the scene and the lights alone. The forecast decides only whether the
 * octree is likely to fit the memory. Time and bytes are assumed to grow with each doubling as they
 * did from the first small bake to the second.
 */
#include "bake/small_bake.h"

struct umbb_forecast {
    double bound_m;          /* bound at one tap, metres: the largest of all frusta */
    struct umbb_costs costs; /* zero: no forecast */
    uint32_t small_log2;     /* log2 of the voxels a side of the larger small bake */
};

/*
 * Chooses the resolution.
 *
 * In:    job: its options have max_error_m above 0. Its analysis is then fitted to the choice.
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

#endif
