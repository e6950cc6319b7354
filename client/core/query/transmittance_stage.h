/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_TRANSMITTANCE_STAGE_H
#define UMBRAGE_CORE_QUERY_TRANSMITTANCE_STAGE_H
/*
 * The stage of translucent casters: what the kernels answer of the opaque ones is multiplied by the
 * light that deep maps (format/transmittance.h) have left.
 *
 * Light left is a mean over a box of voxels around the point's at its depth, each voxel with the
 * value of the texel that holds it. The box is as wide as the window of opaque casters, and at
 * least one texel and a voxel: in between it goes over from texel to texel without a step. A
 * texel's list was made along its middle, so that the automatic bias counts half a texel to the
 * box. All sums are of integers: the same bits on all machines.
 */
#include "query/query_parts.h"

/* Sets what the stage needs; leaves it out if no translucent caster lies before the light. */
void umb__transmittance_set(struct umb__query *query, const struct umb_asset *asset,
                            const struct umb_light_info *light);

/* As umb_query_run promises. */
void umb__transmittance_run(const struct umb__query *query, const struct umb_points *points,
                            size_t first, size_t count, struct umb_answers *answers);

/* Light that translucent casters leave point i, 0..1. */
double umb__transmittance_at(const struct umb__query *query, const struct umb_points *points,
                             size_t i);

#endif
