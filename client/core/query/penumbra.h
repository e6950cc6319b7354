/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_PENUMBRA_H
#define UMBRAGE_CORE_QUERY_PENUMBRA_H
/*
 * Penumbras of lights with an extent: percentage closer soft shadows (Fernando 2005) on the DAG. A
 * search finds the blockers in the cone of the light's rays to the receiver. Their distance gives
 * the width of the penumbra, and a box of that width at the receiver's depth gives the answer.
 *
 * Columns are those of open bakes: lit down to their first occluder, then shadowed. Under the
 * closed rule the occluder depth map has the first occluders (format/occluder_depth.h), and a
 * single voxel proves nothing about its column.
 */
#include "query/query_parts.h"

/* What a search found. */
struct umb__blockers {
    double gap;     /* Depth between receiver and blockers, voxels; 0: no blocker */
    uint32_t count; /* samples that block */
};

/*
 * Searches the cone of a directional light's rays to a receiver for first occluders.
 *
 * A column blocks if its first shadowed voxel's centre lies inside the cone, widened by half a
 * texel: |x + 1/2 - v.x| - 1/2 <= reach.x * (v.z - centre), likewise in y. Columns are sampled in
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
