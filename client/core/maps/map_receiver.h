/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_RECEIVER_H
#define UMBRAGE_CORE_MAPS_MAP_RECEIVER_H
/*
 * Receivers: points of a query in map space, and the frusta that map them. The gradients of map
 * coordinates at a point give the world size of a texel there, and the depth that the receiver's
 * own plane gains per texel.
 */
#include "umbrage/maps.h"

enum umb__receiver_place {
    UMB__RECEIVER_INSIDE = 0,
    UMB__RECEIVER_OUTSIDE, /* Beyond the map, or before depth 0: lit */
    UMB__RECEIVER_FACING_AWAY,
};

struct umb__receiver {
    enum umb__receiver_place place;
    double x, y;    /* Position in texels */
    double depth;   /* Depth, above 0; may lie behind 1 */
    double gain[2]; /* Depth that the receiver's plane gains per texel in x and in y; 0 without a
                       normal, possibly infinite if the light grazes the plane */
    double texels_per_m; /* Texels a metre across the light: geometric mean of x and y */
};

/* A place in map space with its gradients. */
struct umb__map_point {
    double at[3];          /* x and y in texels, then depth */
    double gradient[3][3]; /* [coordinate][world axis] Change of a coordinate per metre */
};

/* Maps a world point. Returns 0 if the projection is undefined there (behind the light), else 1. */
int umb__frustum_map(const struct umb_map_frustum *frustum, const double world[3],
                     struct umb__map_point *out);

/* Checks a frustum from a caller. Fails: E_ARGUMENT, E_TOO_LARGE. */
UMB_CHECKED enum umb_status umb__frustum_check(const struct umb_map_frustum *frustum,
                                               struct umb_error *error);

/* Makes the receiver of point `index`: the point, moved by bias_normal and mapped. */
void umb__receiver_make(const struct umb_map_frustum *frustum, const struct umb_map_filter *filter,
                        const struct umb_points *points, size_t index,
                        struct umb__receiver *receiver);

#endif
