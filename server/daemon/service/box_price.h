/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_BOX_PRICE_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_BOX_PRICE_H
/* Cost estimate of a box, before its voxels are counted. A large box spends nearly all its time in
 * the bricks that its sides cut. */
#include "umbrage/asset.h"

#define UMBD_BRICK_VOXELS 8.0

/*
 * Returns the approximate number of bricks that the sides of a box cut. The result is at most the
 * number of bricks on the six sides of the light's whole frustum.
 *
 * A plane with unit normal n cuts, for each unit of its area, the sum over the three axes of |n .
 * axis| times the brick's edge along that axis, divided by the brick's volume. Voxels may be much
 * longer across the light than along it. A convex body's surface meets each row of bricks twice.
 *
 * In:    box: min, max: any numbers; a value that is not finite counts as the whole frustum.
 */
double umbd_box_bricks(const struct umb_frustum_info *frustum, const struct umb_box *box);

#endif
