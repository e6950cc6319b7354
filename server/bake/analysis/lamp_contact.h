/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_LAMP_CONTACT_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_LAMP_CONTACT_H
/*
 * Lamps too near to a surface.
 *
 * A face leaves out casters nearer than UMBB_NEAR_SHARE of its reach (perspective_frame.h). A
 * surface there would let light through, so a lamp with such a surface in its light is refused. One
 * case is allowed: a spot light on a surface that its cone does not cross, such as a ceiling.
 */
#include "bake/analysis/perspective_frame.h"

/* A lamp is on a surface if it is nearer than this share of the greatest coordinate, which is the
 * rounding error of the distance. */
#define UMBB_ON_SHARE 0x1p-47

/* A surface in a lamp's light that is nearer than a face can draw. */
struct umbb_contact {
    double distance; /* metres; 0: the lamp is on it */
    double at[3];    /* nearest place of the surface, metres, world */
};

/* Finds the nearest such surface in one face of a lamp; returns 0 if there is none. Triangles
 * without an area do not count, because they cast nothing. */
int umbb_lamp_contact(const struct umbb_fit *fit, const struct umbb_eye *eye,
                      struct umbb_contact *contact);

#endif
