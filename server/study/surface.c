/* SPDX-License-Identifier: Apache-2.0 */
/* Colours and shading normals of receivers; see surface.h. */
#include "study/surface.h"

#include <math.h>
#include <string.h>

#include "study/study_math.h"

#define GROUND_REACH 14.0 /* extent of the ground in diagonals of the scene, beyond the eye */
#define FADE_BEGIN   0.25 /* share of the extent where the ground begins to fade */

static const struct umbt_rgb ground_color = {{0.46, 0.45, 0.43}};

/* Share of the incoming light that a white material sends back. */
static const double white = 0.78;

/* Interpolates the normals of a triangle's corners at a place, on the side of the unit normal
 * `facing`. Returns 0 if the file has none. */
static int smooth_normal(const struct umbt_scene *scene, uint32_t triangle,
                         const double position[3], const double facing[3], double out[3])
{
    const double(*corners)[3] = (const double(*)[3])scene->corners[triangle];
    const float(*normals)[3] = (const float(*)[3])scene->normals[triangle];
    double whole[3], sum[3] = {0.0, 0.0, 0.0};
    umb__triangle_cross(corners, whole);
    const double square = umb__dot(whole, whole);
    for (int k = 0; k < 3; k++) {
        double part[3][3], cross[3], normal[3];
        memcpy(part, corners, sizeof part);
        memcpy(part[k], position, sizeof part[k]);
        umb__triangle_cross((const double(*)[3])part, cross);
        umbt_widen(normals[k], normal);
        umbt_along(sum, umb__dot(cross, whole) / square, normal, sum);
    }
    if (!(umbt_normalize(sum) > 0.0)) {
        return 0;
    }
    const double side = umb__dot(whole, facing) < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; k++) {
        out[k] = side * sum[k];
    }
    return 1;
}

static struct umbt_rgb surface_color(const struct umbt_scene *scene, uint32_t triangle)
{
    const uint32_t number = scene->materials[triangle];
    const struct umbs_material *material =
        number != UMBS_NO_INDEX ? &scene->scene->view.materials[number] : NULL;
    struct umbt_rgb color = umbt_surface_color(umbt_scene_surface_key(scene, triangle));
    if (!scene->has_colors || material == NULL) {
        return color;
    }
    for (int k = 0; k < 3; k++) {
        const double base = (double)material->base_color[k];
        color.c[k] = material->has_image ? base * color.c[k] : base * white;
    }
    return color;
}

void umbt_receiver_surface(const struct umbt_scene *scene, const struct umbt_gbuffer *buffer,
                           size_t receiver, struct umbt_surface *surface)
{
    const uint32_t triangle = buffer->triangles[receiver];
    double facing[3];
    umbt_widen(buffer->normals[receiver], facing);
    memcpy(surface->normal, facing, sizeof facing);
    if (triangle == UMBT_GROUND) {
        surface->color = ground_color;
        return;
    }
    surface->color = surface_color(scene, triangle);
    if (scene->normals != NULL) {
        (void)smooth_normal(scene, triangle, buffer->positions[receiver], facing, surface->normal);
    }
}

struct umbt_ground umbt_ground_below(const struct umbt_scene *scene,
                                     const struct umbt_camera *camera, int z_up)
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
