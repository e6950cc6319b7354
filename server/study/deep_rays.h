/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_DEEP_RAYS_H
#define UMBRAGE_SERVER_STUDY_DEEP_RAYS_H
/*
 * Transmittance by rays, where a map's texels play no part: the product of what all casters leave
 * on the way from a point to the light, and its mean over a filter's window around the point.
 */
#include "study/study_scene.h"
#include "umbrage/maps.h"

struct umbt_deep_rays {
    const struct umbt_scene *scene;
    double alpha; /* share of the light that a BLEND surface without an alpha of its own takes */
};

/* Share of the light that a triangle absorbs: all, unless its material is BLEND. */
float umbt_deep_alpha(const struct umbt_deep_rays *rays, uint32_t triangle);

/*
 * Returns the mean transmittance over samples x samples rays, spread evenly over a square of
 * `width` texels around a place of map space. All start at the place's own depth.
 *
 * In:    at: texels and depth. width: 0 for the place alone. samples: 1 or more.
 */
double umbt_deep_traced(const struct umbt_deep_rays *rays, const struct umb_map_frustum *frustum,
                        const double at[3], double width, uint32_t samples);

#endif
