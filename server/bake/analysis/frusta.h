/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_FRUSTA_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_FRUSTA_H
/*
 * The frusta of all lights. A directional light has one frustum, and so has a spot light whose cone
 * is at most 2 * UMBB_SPOT_HALF_ANGLE_DEG wide. A point light has the faces of a cube; a wider spot
 * light has all of them but the one behind it. A face that sees no caster is left out.
 */
#include "bake/analysis/light_choice.h"
#include "bake/analysis/perspective_frame.h"

/* Greatest half angle of a cone with a single frustum. The frustum of a wider cone would spend most
 * of its texels far from the cone's middle. */
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
 * Fails: E_BAD_SCENE (the casters have no extent), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_frusta_fit(const struct umbb_frusta_input *input,
                                            struct umbb_light_choice *choice,
                                            struct umb_frustum_info **frusta, uint32_t *count,
                                            struct umb_error *error);

/* Returns the distance in metres from a light to the farthest corner of the casters' box. */
double umbb_light_reach(const struct umb_box *bounds, const double position[3]);

/*
 * Lamps too near to a surface.
 *
 * A face leaves out casters nearer than UMBB_NEAR_SHARE of its reach (perspective_frame.h). A
 * surface there would let light through, so a lamp with such a surface in its light is refused. One
 * case is allowed: a spot light on a surface that its cone does not cross, such as a ceiling.
 */

/* Distance below which a lamp counts as on a surface, as a share of the greatest coordinate. This
 * share is the rounding error of the distance. */
#define UMBB_ON_SHARE 0x1p-47

/* A surface in a lamp's light that is nearer than a face can draw. */
struct umbb_contact {
    double distance; /* metres from the lamp; 0: the lamp is on the surface */
    double at[3];    /* nearest place of the surface, metres, world */
};

/* Finds the nearest surface that one face of a lamp cannot draw; returns 0 if there is none.
 * Triangles without an area do not count, because they cast nothing. */
int umbb_lamp_contact(const struct umbb_fit *fit, const struct umbb_eye *eye,
                      struct umbb_contact *contact);

#endif
