/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_CALIBRATIONS_H
#define UMBRAGE_SERVER_DAEMON_WORK_CALIBRATIONS_H
/*
 * Measured costs of settings on this machine, in nanoseconds for each point. The table has an entry
 * for each light of each asset and each kind of points for which a budget was used. It keeps the
 * last few hundred entries. The key contains the asset's id, so a file that is loaded again need
 * not be measured again.
 *
 * Threads: all functions but create and destroy from any thread.
 */
#include <stdint.h>
#include "umbrage/curve.h"

/* Kinds of points; points of one kind cost alike. */
enum umbd_point_kind {
    UMBD_POINTS_FEW = 0,   /* Too few to tell: treated as scattered */
    UMBD_POINTS_SCATTERED, /* Scattered over the scene */
    UMBD_POINTS_COHERENT,  /* Mostly next to each other */
    UMBD_POINT_KINDS,
};

/* Returns the kind of a batch's points for a light. are_depths: 1 if the batch has a picture's
 * depths, one number for each pixel in the picture's order. Cost: reads 512 points at most;
 * allocates nothing. */
enum umbd_point_kind umbd_point_kind_of(const struct umb_asset *asset, uint32_t light,
                                        const struct umb_points *points, int are_depths);

struct umbd_calibrations; /* opaque */

/* Makes an empty table. NULL: out of memory. */
struct umbd_calibrations *umbd_calibrations_create(void);
void umbd_calibrations_destroy(struct umbd_calibrations *table);

/* Stores a calibration; a full table drops the oldest one. */
void umbd_calibrations_put(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                           uint32_t light, enum umbd_point_kind kind,
                           const struct umb_calibration *calibration);

/* Finds one. Returns 1, or 0 and leaves calibration empty. */
int umbd_calibrations_get(struct umbd_calibrations *table, const uint8_t asset[UMB_ID_BYTES],
                          uint32_t light, enum umbd_point_kind kind,
                          struct umb_calibration *calibration);

#endif
