/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_VIEW_H
#define UMBRAGE_CORE_MAPS_MAP_VIEW_H
/*
 * A camera's view as the maps compute with it, and as Regions.DeriveMap sends it, so that client
 * and server derive from the same doubles.
 */
#include "umbrage/derive.h"

struct umb__map_view {
    double eye[3];                      /* Position in metres, world space */
    double right[3], up[3], forward[3]; /* Axes, orthonormal */
    double tan_x, tan_y;                /* Tangents of half the fields of view, 1e-6 .. 1000 */
    double near_m, far_m;               /* Distances along forward, 1e-30 <= near < far <= 1e30 */
};

/* Makes a camera's view. Fails: E_ARGUMENT (forward and up that span no plane). */
UMB_CHECKED enum umb_status umb__map_view_make(const struct umb_camera *camera,
                                               struct umb__map_view *view, struct umb_error *error);

/* Plans cascades as umb_cascades_plan does, for a view that has been checked. */
UMB_CHECKED enum umb_status
umb__cascades_plan(const struct umb__map_view *view, const double to_light[3],
                   const struct umb_box *scene, const struct umb_cascade_settings *settings,
                   struct umb_cascade_plan *plan, struct umb_error *error);

#define UMB__SEAM_POINTS 4096 /* Points at which the contrast of a cascade is matched */

/* Derives maps as umb_derive, from a view in place of settings->camera. NULL: no cascades. */
UMB_CHECKED enum umb_status umb__derive(const struct umb_asset *asset,
                                        const struct umb_derive_settings *settings,
                                        const struct umb__map_view *view,
                                        const struct umb_alloc *alloc, struct umb_derived **out,
                                        struct umb_error *error);

#endif
