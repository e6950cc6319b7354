/* SPDX-License-Identifier: Apache-2.0 */
/* See deep_rays.h. */
#include "study/deep_rays.h"

#include <math.h>
#include "study/study_math.h"

#define STEP_SHARE 1e-7 /* step beyond a hit, to find the next, as a share of the ray */
#define LEAST      1e-6 /* transmittance below which a ray ends */

float umbt_deep_alpha(const struct umbt_deep_rays *rays, uint32_t triangle)
{
    const struct umbs_scene_view *view = &rays->scene->scene->view;
    const uint32_t material = rays->scene->materials[triangle];
    if (material >= view->material_count ||
        view->materials[material].alpha_mode != UMBS_ALPHA_BLEND) {
        return 1.0F;
    }
    const float own = view->materials[material].base_alpha;
    return own < 1.0F ? own : (float)rays->alpha;
}

/* Returns the transmittance from a point over `length` metres along a unit direction. */
static double ray_left(const struct umbt_deep_rays *rays, const double start[3],
                       const double direction[3], double length)
{
    double left = 1.0, reached = 0.0;
    while (left > LEAST) {
        struct umbr_hit hit;
        umbr_nearest(rays->scene->rays, start, direction, reached, length, &hit);
        if (hit.distance < 0.0) {
            break;
        }
        left *= 1.0 - (double)umbt_deep_alpha(rays, hit.triangle);
        reached = hit.distance + STEP_SHARE * length;
    }
    return left;
}

double umbt_deep_traced(const struct umbt_deep_rays *rays, const struct umb_map_frustum *frustum,
                        const double at[3], double width, uint32_t samples)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < samples * samples; i++) {
        const double u = ((double)(i % samples) + 0.5) / (double)samples - 0.5;
        const double v = ((double)(i / samples) + 0.5) / (double)samples - 0.5;
        const double x = at[0] + width * u, y = at[1] + width * v;
        double start[3], light[3];
        /* Rays to depth -1 leave the scene, which lies behind depth 0. */
        if (umb_map_frustum_point(frustum, x, y, at[2], start) != UMB_OK ||
            umb_map_frustum_point(frustum, x, y, -1.0, light) != UMB_OK) {
            sum += 1.0;
            continue;
        }
        umb__subtract(light, start, light);
        const double length = umbt_normalize(light);
        sum += ray_left(rays, start, light, length);
    }
    return sum / (double)(samples * samples);
}
