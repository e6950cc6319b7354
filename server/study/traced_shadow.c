/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows by rays; see traced_shadow.h. */
#include "study/traced_shadow.h"

#include <math.h>
#include "study/study_vec.h"

#define SURFACE_OFFSET 2e-6 /* of the scene's diagonal */
#define FAR_FACTOR     2.0  /* no caster is further than the diagonal from a point of the scene */

double umbt_truth_bias(const struct umb_query_settings *settings,
                       const struct umb_frustum_info *frustum, const double normal[3])
{
    const double taps = settings->taps > 0 ? (double)settings->taps : 1.0;
    double across = 0.0, along = 0.0, mean = 0.0;
    switch (settings->bias_mode) {
    case UMB_BIAS_AUTO:
        across = fabs(umbt_dot(normal, frustum->voxel_step[0])) +
                 fabs(umbt_dot(normal, frustum->voxel_step[1]));
        along = fabs(umbt_dot(normal, frustum->voxel_step[2]));
        return 0.5 * (taps * across + along);
    case UMB_BIAS_VOXELS:
        for (int k = 0; k < 3; k++) {
            mean += umbt_length(frustum->voxel_step[k]) / 3.0;
        }
        return settings->bias * mean;
    case UMB_BIAS_METRES:
        return settings->bias;
    case UMB_BIAS_NONE:
        break;
    }
    return 0.0;
}

/* Voxel coordinates of a world point, x and y only. */
static void voxel_xy(const struct umbt_truth *truth, const double point[3], double xy[2])
{
    double p[3];
    umbt_subtract(point, truth->origin, p);
    for (int k = 0; k < 2; k++) {
        xy[k] = umbt_dot(truth->frustum.world_to_voxel[k], p) + truth->frustum.world_to_voxel[k][3];
    }
}

static int ray_reaches(const struct umbt_truth *truth, const double from[3])
{
    return !umbr_occluded(truth->rays, from, truth->to_light, 0.0, FAR_FACTOR * truth->diagonal_m);
}

/* side x side starts of rays, `pitch` texels apart, centred `centre` texels from the moved point.
 */
struct window {
    double moved[3];
    double centre[2];
    double pitch;
    uint32_t side;
};

/* The texels of the query's window: their centres, at the moved point's depth. */
static void texel_window(const struct umbt_truth *truth, const double point[3],
                         const double normal[3], struct window *window)
{
    double xy[2];
    umbt_along(point, umbt_truth_bias(&truth->settings, &truth->frustum, normal), normal,
               window->moved);
    voxel_xy(truth, window->moved, xy);
    for (int k = 0; k < 2; k++) {
        window->centre[k] = floor(xy[k]) + 0.5 - xy[k];
    }
    window->pitch = 1.0;
    window->side = truth->settings.taps > 0 ? truth->settings.taps : 1;
}

static void window_start(const struct umbt_truth *truth, const struct window *window, uint32_t i,
                         uint32_t j, double start[3])
{
    const double middle = 0.5 * (double)(window->side - 1);
    const double x = window->centre[0] + ((double)i - middle) * window->pitch;
    const double y = window->centre[1] + ((double)j - middle) * window->pitch;
    umbt_along(window->moved, x, truth->frustum.voxel_step[0], start);
    umbt_along(start, y, truth->frustum.voxel_step[1], start);
}

static float window_visibility(const struct umbt_truth *truth, const struct window *window)
{
    uint32_t lit = 0;
    for (uint32_t j = 0; j < window->side; j++) {
        for (uint32_t i = 0; i < window->side; i++) {
            double start[3];
            window_start(truth, window, i, j, start);
            lit += ray_reaches(truth, start) ? 1U : 0U;
        }
    }
    return (float)lit / (float)(window->side * window->side);
}

int umbt_truth_is_undefined(const struct umbt_truth *truth, const double point[3],
                            const double normal[3])
{
    if (truth->closed == NULL) {
        return 0;
    }
    struct window window;
    texel_window(truth, point, normal, &window);
    for (uint32_t j = 0; j < window.side; j++) {
        for (uint32_t i = 0; i < window.side; i++) {
            double start[3];
            int winding = 0, crossings = 0;
            window_start(truth, &window, i, j, start);
            umbr_crossings(truth->rays, start, truth->to_light, truth->closed, &winding,
                           &crossings);
            if (winding > 0) {
                return 1;
            }
        }
    }
    return 0;
}

float umbt_truth_visibility(const struct umbt_truth *truth, const double point[3],
                            const double normal[3])
{
    struct window window;
    if (!(umbt_dot(normal, truth->to_light) > 0.0)) {
        return 0.0F;
    }
    if (truth->kind == UMBT_TRUTH_SURFACE) {
        umbt_along(point, SURFACE_OFFSET * truth->diagonal_m, normal, window.moved);
        return ray_reaches(truth, window.moved) ? 1.0F : 0.0F;
    }
    texel_window(truth, point, normal, &window);
    if (truth->kind == UMBT_TRUTH_AREA) {
        window.centre[0] = 0.0;
        window.centre[1] = 0.0;
        window.pitch = (double)window.side / (double)truth->samples;
        window.side = truth->samples;
    }
    return window_visibility(truth, &window);
}
