/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_SURFACE_H
#define UMBRAGE_SERVER_STUDY_SURFACE_H
/*
 * The look of the surface at a receiver: its colour, and the normal that light is shaded by.
 *
 * Where the scene file has normals, shading interpolates them; queries and rays always take the
 * triangle's own. Where colours of the file tell materials apart, surfaces have these; else they
 * have those of umbt_surface_color, by material or by part. Images are not read: a material whose
 * colour is in one has a colour of umbt_surface_color times its factor.
 */
#include "study/gbuffer.h"
#include "study/picture.h"

struct umbt_surface {
    struct umbt_rgb color;
    double normal[3]; /* unit, on the camera's side of the triangle */
};

/* Finds the surface at a receiver of a filled buffer. Pure. */
void umbt_receiver_surface(const struct umbt_scene *scene, const struct umbt_gbuffer *buffer,
                           size_t receiver, struct umbt_surface *surface);

/* Makes a ground below a scene: level with its lowest point. reach_m: metres from the eye in which
 * the ground fades into the sky. */
struct umbt_ground umbt_ground_below(const struct umbt_scene *scene,
                                     const struct umbt_camera *camera, int z_up);

/* Fades a colour of the ground into the sky, far away from the eye. */
struct umbt_rgb umbt_ground_fade(const struct umbt_ground *ground, const double eye[3],
                                 const double position[3], struct umbt_rgb color,
                                 struct umbt_rgb sky);

#endif
