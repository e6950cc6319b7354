/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_TRANSMITTANCE_STAGE_H
#define UMBRAGE_CORE_QUERY_TRANSMITTANCE_STAGE_H
/*
 * The stage of translucent casters: multiplies the answers for opaque casters by the transmittance
 * of deep maps (format/transmittance.h).
 *
 * Transmittance is a mean over a box of voxels around the point's at its depth, each voxel with the
 * value of its texel. The box is as wide as the window of opaque casters, and at least one texel
 * and a voxel, so that it changes from texel to texel without a step. A texel's list was made along
 * its middle, so the automatic bias adds half a texel to the box. All sums are of integers: the
 * same bits on all machines.
 */
#include "query/query_parts.h"

/* Sets up the stage; leaves it out if the light has no translucent caster. */
void umb__transmittance_set(struct umb__query *query, const struct umb_asset *asset,
                            const struct umb_light_info *light);

/* Does what umb_query_run does. */
void umb__transmittance_run(const struct umb__query *query, const struct umb_points *points,
                            size_t first, size_t count, struct umb_answers *answers);

/* Returns the transmittance of translucent casters for point i, 0..1. */
double umb__transmittance_at(const struct umb__query *query, const struct umb_points *points,
                             size_t i);

#endif
