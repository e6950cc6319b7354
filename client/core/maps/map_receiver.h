/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_RECEIVER_H
#define UMBRAGE_CORE_MAPS_MAP_RECEIVER_H
/*
 * Receivers: points of a query in map space, and the frusta that map them.
 *
 * The gradient of map coordinates at the point gives everything else: the world size of a texel
 * there, and the depth that the receiver's own plane gains per texel.
 */
#include "umbrage/maps.h"

enum umb__receiver_place {
    UMB__RECEIVER_INSIDE = 0,
    UMB__RECEIVER_OUTSIDE, /* beyond the map, or before depth 0: lit */
    UMB__RECEIVER_FACING_AWAY,
};

struct umb__receiver {
    enum umb__receiver_place place;
    double x, y;    /* texels */
    double depth;   /* > 0; may lie behind 1 */
    double gain[2]; /* depth that the receiver's plane gains per texel in x and y; 0 without normal;
                       may be infinite for a grazing one */
    double texels_per_m; /* across the light, geometric mean of x and y */
};

/* A place in map space with its gradients, per metre. */
struct umb__map_point {
    double at[3];          /* x, y in texels, depth */
    double gradient[3][3]; /* [coordinate][world axis] */
};

/* Maps a world point; 0 if the projection is undefined there (behind the light). */
int umb__frustum_map(const struct umb_map_frustum *frustum, const double world[3],
                     struct umb__map_point *out);

/* Checks a frustum from a caller. Fails: E_ARGUMENT, E_TOO_LARGE. */
UMB_CHECKED enum umb_status umb__frustum_check(const struct umb_map_frustum *frustum,
                                               struct umb_error *error);

/* Makes the receiver of point `index`: reads it, moves it by bias_normal, maps it. */
void umb__receiver_make(const struct umb_map_frustum *frustum, const struct umb_map_filter *filter,
                        const struct umb_points *points, size_t index,
                        struct umb__receiver *receiver);

#endif
