/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_BOX_PRICE_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_BOX_PRICE_H
/* Cost estimate of a box, before it is counted: nearly all the time of a large box goes into the
 * bricks that its sides cut. */
#include "umbrage/asset.h"

#define UMBD_BRICK_VOXELS 8.0

/*
 * Approximate number of bricks that the sides of a box cut, at most that of a frustum of parallel
 * light.
 *
 * A plane of unit normal n cuts, for each unit of its area, the sum over the three axes of |n .
 * axis| times the brick's edge along it, over the brick's volume: voxels may be much longer across
 * the light than along it. A convex body's surface meets each row of bricks twice.
 *
 * In: box: min, max: any numbers; a value that is not finite counts as the whole frustum.
 */
double umbd_box_bricks(const struct umb_frustum_info *frustum, const struct umb_box *box);

#endif
