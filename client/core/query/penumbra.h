/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_PENUMBRA_H
#define UMBRAGE_CORE_QUERY_PENUMBRA_H
/*
 * Half shadows of lights that are no points: percentage closer soft shadows (Fernando 2005) on the
 * DAG. What blocks the light is searched in the cone of its rays to the receiver; how far away that
 * is says how wide the penumbra is there; a box of that width at the receiver's depth is the
 * answer.
 *
 * Columns are those of open bakes: lit down to their first occluder, then shadowed. Under the
 * closed rule the occluder depth map tells where that is (format/occluder_depth.h), and no proof
 * by a single voxel holds.
 */
#include "query/query_parts.h"

/* What a search found. */
struct umb__blockers {
    double gap;     /* depth between receiver and blockers, voxels; 0: nothing blocks */
    uint32_t count; /* samples that block */
};

/*
 * Searches the cone of a directional light's rays to a receiver for first occluders.
 *
 * A column blocks if its first shadowed voxel's centre lies inside the cone, widened by half a
 * texel: |x + 1/2 - v.x| - 1/2 <= reach.x * (v.z - centre), likewise in y. Columns are looked at in
 * square rings around the receiver's, at distances 0, 1, 2, 3..4, 5..8, 9..16 ... texels; the ring
 * that ends at 4 * s takes every s-th texel, 56 of them. A sample at distance g of depth (at least
 * 2^-20 voxels) that stands for s * s texels covers s * s / g^2 of the light's disc; the mean gap
 * weighs by that.
 *
 * In:    v: voxel space, |v| < 2^30.
 * Cost:  of open frusta a few node reads for each ring without occluders (proven by one slice).
 */
struct umb__blockers umb__penumbra_search(const struct umb__query *query, const double v[3],
                                          struct umb_query_stats *stats);

#endif
