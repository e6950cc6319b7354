/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_LAMP_PENUMBRA_H
#define UMBRAGE_CORE_QUERY_LAMP_PENUMBRA_H
/*
 * Penumbras of spot, point and area lights (lamps).
 *
 * Let W be the distance from the light along the axis of a face, and q = 1 / W. In the space of
 * texels and q, rays stay straight. A ray from a receiver (x, y, q) to the point L + d of a light
 * at L has the same slope all along:
 *
 *     slope of x = (X.d - x W.d) / (1 - q W.d)      texels for each unit of q; y likewise
 *
 * where X.d and W.d are the parts of the face's transform that act on vectors. An occluder at qo
 * therefore covers the light's points whose slope times (qo - q) is its place in the map, as the
 * occluders of a sun do, whose rays have constant slopes in voxel space. The blocker search is that
 * of suns (penumbra.c) in this space. A column beyond the face's edge is read in the face that
 * answers there.
 *
 * The answer is the mean of UMB__LAMP_SAMPLES look-ups at the places in which rays to points of the
 * light pass the blockers' mean distance. So a long narrow light, or one seen obliquely, keeps its
 * shape. Each look-up is at the depth of the receiver's plane, at most halfway to the blockers, so
 * that the receiver casts no shadow on itself. Points of the light behind the receiver's horizon
 * are dark.
 *
 * Precision: doubles; the same bits on all machines. q and its differences are right to 2^-52 of q,
 * which is 2^-52 W of depth at the receiver.
 */
#include "query/stages.h"

#define UMB__LAMP_SAMPLES 233U /* A Fibonacci lattice over the light */

/* Checks that the light has an extent in metres. Fails: E_ARGUMENT (an extent in radians),
 * E_UNSUPPORTED (no extent, or one above UMB_LAMP_SIZE_MAX). */
UMB_CHECKED enum umb_status umb__lamp_penumbra_check(const struct umb__plan *plan,
                                                     struct umb_error *error);

/* Stage that answers points under a lamp. */
umb__kernel umb__lamp_penumbra;

#endif
