/* SPDX-License-Identifier: Apache-2.0 */
/* Colours and shading normals of receivers; see surface.h. */
#include "study/surface.h"

#include <math.h>
#include <string.h>

#include "study/study_math.h"

#define GROUND_REACH 14.0 /* extent of the ground in diagonals of the scene, beyond the eye */
#define FADE_BEGIN   0.25 /* share of the extent where the ground begins to fade */

static const struct umbt_rgb ground_color = {{0.46, 0.45, 0.43}};

void umbt_receiver_surface(const struct umbt_scene *scene, const struct umbt_gbuffer *buffer,
                           size_t receiver, struct umbt_surface *surface)
{
    const uint32_t triangle = buffer->triangles[receiver];
    umbt_widen(buffer->normals[receiver], surface->normal);
    surface->color = triangle == UMBT_GROUND
                         ? ground_color
                         : umbt_surface_color(umbt_scene_surface_key(scene, triangle));
}

struct umbt_ground umbt_ground_below(const struct umbt_scene *scene, const struct umbt_camera *camera,
                                     int z_up)
{
    const int axis = z_up ? 2 : 1;
    const double foot = scene->box.min[axis];
    double to_centre[3];
    for (int k = 0; k < 3; k++) {
        to_centre[k] = 0.5 * (scene->box.min[k] + scene->box.max[k]) - camera->eye[k];
    }
    return (struct umbt_ground){
        .wanted = 1,
        .axis = axis,
        .height = foot,
        .extent_m = umb__length(to_centre) + GROUND_REACH * scene->diagonal_m,
    };
}

struct umbt_rgb umbt_ground_fade(const struct umbt_ground *ground, const double eye[3],
                                 const double position[3], struct umbt_rgb color,
                                 struct umbt_rgb sky)
{
    double way[3];
    umb__subtract(position, eye, way);
    const double share = (umb__length(way) / ground->extent_m - FADE_BEGIN) / (1.0 - FADE_BEGIN);
    const double t = fmin(fmax(share, 0.0), 1.0), fade = t * t * (3.0 - 2.0 * t);
    for (int k = 0; k < 3; k++) {
        color.c[k] += fade * (sky.c[k] - color.c[k]);
    }
    return color;
}
