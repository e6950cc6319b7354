/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALIBRATIONS_H
#define UMBRAGE_SERVER_DAEMON_CALIBRATIONS_H
/*
 * What settings cost on this machine, in nanoseconds a point, as far as budgets have asked for it:
 * for each light of each asset and each kind of points that were asked about, the last few hundred.
 * Kept by the asset's id, so that a file that is loaded again need not be measured again.
 *
 * Threads: all functions but create and destroy from any thread.
 */
#include <stdint.h>
#include "umbrage/curve.h"

/* Points that cost alike. */
enum umbd_point_kind {
    UMBD_POINTS_FEW = 0,   /* too few to tell: taken to lie all over the scene */
    UMBD_POINTS_SCATTERED, /* all over the scene */
    UMBD_POINTS_COHERENT,  /* next to each other, mostly */
    UMBD_POINT_KINDS,
};

/* Which kind a batch for a light is. are_depths: of a picture's pixels, one number each, not
 * points; they lie next to each other. Cost: looks at 512 points at most; allocates nothing. */
enum umbd_point_kind umbd_point_kind_of(const struct umb_asset *asset, uint32_t light,
                                        const struct umb_points *points, int are_depths);

struct umbd_calibrations; /* opaque */

/* NULL: out of memory. */
struct umbd_calibrations *umbd_calibrations_create(void);
void umbd_calibrations_destroy(struct umbd_calibrations *table);

/* Keeps a calibration, perhaps instead of the oldest one. */
void umbd_calibrations_put(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                           uint32_t light, enum umbd_point_kind kind,
                           const struct umb_calibration *calibration);

/* Finds one. Returns 1, or 0 and leaves calibration empty. */
int umbd_calibrations_get(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                          uint32_t light, enum umbd_point_kind kind,
                          struct umb_calibration *calibration);

#endif
