/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_RAY_HOLES_H
#define UMBRAGE_SERVER_RAYS_RAY_HOLES_H
/* Triangles that rays pass through: holes of cut-outs, triangles that cast nothing, translucent
 * ones. */
#include "scene/scene_alpha.h"

/* Returns 1 if a ray passes through a triangle at these weights of its second and third corner. */
static inline int umbr_is_hole(const struct umbs_cuts *cuts, uint32_t triangle, double second,
                               double third)
{
    const uint32_t number = cuts->of[triangle];
    if (number >= UMBS_CUT_CLEAR || umbs_cut_is_translucent(cuts, number)) {
        return number != UMBS_CUT_NONE;
    }
    const float(*uv)[2] = cuts->cuts[number].uv;
    const double first = 1 - second - third;
    const double u =
        first * (double)uv[0][0] + second * (double)uv[1][0] + third * (double)uv[2][0];
    const double v =
        first * (double)uv[0][1] + second * (double)uv[1][1] + third * (double)uv[2][1];
    return !umbs_cut_keeps(cuts, number, u, v);
}

#endif
