/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_FOG_H
#define UMBRAGE_SERVER_STUDY_STUDY_FOG_H
/*
 * Sunlit fog between the eye and the surface: light shafts. The lit intervals of each view ray come
 * from a segment query of the asset. So the integral over them is exact for a fog of constant
 * density: nothing is sampled along the ray.
 */
#include "umbrage/volume.h"

struct umbt_fog {
    struct umb_volume volume;
    double density; /* extinction, 1/m */
};

/* Makes fog of an asset's light. Fails: the errors of umb_volume_prepare and
 * umb_volume_check_parallel. */
UMB_CHECKED enum umb_status umbt_fog_make(const struct umb_asset *asset, uint32_t light,
                                          double density, struct umbt_fog *fog,
                                          struct umb_error *error);

/*
 * Looks through the fog.
 *
 * In:  eye, end: world space, metres, finite.
 * Out: through: share of the light from `end` that reaches the eye. lit: share of the fog's own
 *      light that is sunlit and reaches it: the integral of density * exp(-density s) over the lit
 *      intervals; lit + through <= 1.
 * Threads: any.
 */
void umbt_fog_look(const struct umbt_fog *fog, const double eye[3], const double end[3],
                   double *through, double *lit);

#endif
