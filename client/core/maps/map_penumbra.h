/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_PENUMBRA_H
#define UMBRAGE_CORE_MAPS_MAP_PENUMBRA_H
/*
 * The width of a penumbra, by similar triangles between a light of some size, a blocker and a plane
 * through the receiver across the light.
 * Source: Fernando 2005 (percentage-closer soft shadows), w = size (d_receiver - d_blocker) /
 * d_blocker; for a directional light of angular diameter a, w = 2 tan(a/2) (d_receiver -
 * d_blocker).
 */
#include "maps/map_parts.h"

/*
 * Returns the texels that the penumbra of a blocker at `blocker_depth` spans, clamped to 1..limit.
 * A blocker at or behind the receiver gives 1; one at a point light's own position the limit.
 */
double umb__penumbra_texels(const struct umb__map_query *query,
                            const struct umb__receiver *receiver, double blocker_depth);

#endif
