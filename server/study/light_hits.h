/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_LIGHT_HITS_H
#define UMBRAGE_SERVER_STUDY_LIGHT_HITS_H
/* All surfaces on the light's path through each texel of a map, by traced rays. */
#include "study/study_scene.h"
#include "umbrage/maps.h"

/*
 * Computes the ray of the light through a texel's centre, from depth 0 to depth 1.
 *
 * In:  texel: number in rows. Out: start, direction (unit).
 * Returns the ray's length in metres; 0 for a texel outside of the frustum.
 */
double umbt_texel_ray(const struct umb_map_frustum *frustum, size_t texel, double start[3],
                      double direction[3]);

#define UMBT_HITS_MAX 64U /* most hits of a ray; farther hits are left out */

struct umbt_light_hits {
    struct umb_map_fragment *fragments; /* [first[texels]], nearest first in a texel */
    uint64_t *first;                    /* [texels + 1] */
    size_t occupied;                    /* texels with a fragment */
};

/*
 * Traces the map. A surface whose material is BLEND absorbs its own constant alpha if that is below
 * 1, else `alpha`; every other surface absorbs all light.
 *
 * Fails: E_NO_MEMORY; hits is then zeroed.
 */
UMB_CHECKED enum umb_status umbt_light_hits_trace(const struct umbt_scene *scene,
                                                  const struct umb_map_frustum *frustum,
                                                  double alpha, unsigned threads,
                                                  struct umbt_light_hits *hits,
                                                  struct umb_error *error);
void umbt_light_hits_finish(struct umbt_light_hits *hits); /* a zeroed struct is allowed */

#endif
