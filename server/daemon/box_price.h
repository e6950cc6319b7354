/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BOX_PRICE_H
#define UMBRAGE_SERVER_DAEMON_BOX_PRICE_H
/* What a box costs before it is counted: nearly all of a large box's time goes where its sides cut
 * bricks. */
#include "umbrage/asset.h"

#define UMBD_BRICK_VOXELS 8.0

/*
 * How many bricks the sides of a box cut, about; no more than those of a frustum of parallel light.
 *
 * A plane of unit normal n cuts, for each unit of its area, the sum over the three axes of
 * |n . axis| times the brick's edge along it, over the brick's volume: voxels may be much longer
 * across the light than along it. And a convex body's surface meets each row of bricks twice.
 *
 * In: box: min, max: any numbers; what is not finite counts as the whole frustum.
 */
double umbd_box_bricks(const struct umb_frustum_info *frustum, const struct umb_box *box);

#endif
