/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_FRUSTA_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_FRUSTA_H
/*
 * The frusta of all lights. A directional light has one, as has a spot light whose cone is at most
 * 2 * UMBB_SPOT_HALF_ANGLE_DEG wide. Wider spot lights have cube faces (all but the opposite one),
 * as have point lights. Of cube faces only those are kept that see a caster.
 */
#include "bake/analysis/light_choice.h"
#include "bake/analysis/light_frame.h"

/* Beyond it a single frustum would spend most of its texels outside the cone's middle. */
#define UMBB_SPOT_HALF_ANGLE_DEG 65.0

struct umbb_frusta_input {
    struct umbb_fit fit;
    struct umb_box bounds; /* bounds of the corners */
    int closed;            /* 1: baked under the closed rule */
};

/*
 * Fits the frusta.
 *
 * Out:   choice: each light's first_frustum and frustum_count. frusta: malloced, in the order of
 *        lights; NULL on failure.
 * Fails: E_BAD_SCENE (no extent at all), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_frusta_fit(const struct umbb_frusta_input *input,
                                            struct umbb_light_choice *choice,
                                            struct umb_frustum_info **frusta, uint32_t *count,
                                            struct umb_error *error);

/* Distance from a light to the farthest corner of the casters' box, metres. */
double umbb_light_reach(const struct umb_box *bounds, const double position[3]);

#endif
