/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The area truth of each filter (study_probe.h): what the filter estimates, by rays. Boxes and
 * penumbras are those of traced_shadow.h; tents and footprints are sums of single rays.
 */
#include "study/study_probe.h"

#include <math.h>
#include <string.h>

#define SURFACE_LIFT 2e-6 /* share of the diagonal, as in traced_shadow.h */
#define COARSE_TAPS  17   /* starts a side of the check for solids beneath a footprint */

/* Returns a truth that traces one ray, from the point itself. */
static struct umbt_truth single_ray(const struct umbt_study_truth *truth)
{
    struct umbt_truth ray = truth->rays;
    ray.kind = UMBT_TRUTH_AREA;
    ray.samples = 1;
    ray.settings = (struct umb_query_settings){.taps = 1, .bias_mode = UMB_BIAS_NONE};
    return ray;
}

/* Weight of the tent's texel at x texels from the centre. */
static double tent_weight(double x, uint32_t taps)
{
    return 0.5 * (taps + 1.0) - floor(fabs(x) + 0.5);
}

/* Returns the visibility by rays over the window, each with the weight that the tent filter has at
 * the ray's start. */
static float tent_visibility(const struct umbt_study_truth *truth, const double point[3],
                             const double normal[3])
{
    const struct umbt_truth *rays = &truth->rays, ray = single_ray(truth);
    const uint32_t taps = rays->settings.taps, side = rays->samples;
    double moved[3], sum = 0.0, weights = 0.0;
    struct umb_frustum_info at;
    umbt_truth_frustum_at(rays, point, &at);
    umbt_truth_move(rays, &at, point, normal, moved);
    umbt_truth_frustum_at(rays, moved, &at);
    for (uint32_t i = 0; i < side * side; i++) {
        const double x = ((i % side + 0.5) / side - 0.5) * taps;
        const double y = ((i / side + 0.5) / side - 0.5) * taps;
        const double weight = tent_weight(x, taps) * tent_weight(y, taps);
        double start[3];
        umbt_along(moved, x, at.voxel_step[0], start);
        umbt_along(start, y, at.voxel_step[1], start);
        sum += weight * (double)umbt_truth_visibility(&ray, start, normal);
        weights += weight;
    }
    return (float)(sum / weights);
}

/* Returns the visibility by rays that start in a square around the point, in the surface's tangent
 * plane. */
static float footprint_visibility(const struct umbt_study_truth *truth, const double point[3],
                                  const double normal[3])
{
    const struct umbt_truth ray = single_ray(truth);
    const uint32_t side = truth->rays.samples;
    double on[3], u[3], v[3], sum = 0.0;
    umbt_along(point, SURFACE_LIFT * truth->rays.diagonal_m, normal, on);
    umbt_study_tangents(normal, u, v);
    for (uint32_t i = 0; i < side * side; i++) {
        double start[3];
        umbt_along(on, ((i % side + 0.5) / side - 0.5) * truth->footprint_m, u, start);
        umbt_along(start, ((i / side + 0.5) / side - 0.5) * truth->footprint_m, v, start);
        sum += (double)umbt_truth_visibility(&ray, start, normal);
    }
    return (float)(sum / ((double)side * side));
}

float umbt_study_truth_visibility(const struct umbt_study_truth *truth, const double point[3],
                                  const double normal[3])
{
    switch (truth->method) {
    case UMBT_STUDY_TENT:
        return tent_visibility(truth, point, normal);
    case UMBT_STUDY_FOOTPRINT:
        return footprint_visibility(truth, point, normal);
    default:
        return umbt_truth_visibility(&truth->rays, point, normal);
    }
}

int umbt_study_truth_is_undefined(const struct umbt_study_truth *truth, const double point[3],
                                  const double normal[3])
{
    struct umbt_truth window = truth->rays;
    struct umb_frustum_info at;
    umbt_truth_frustum_at(&truth->rays, point, &at);
    const double stretch = truth->footprint_m / (COARSE_TAPS * umb__length(at.voxel_step[0]));
    if (truth->method == UMBT_STUDY_FOOTPRINT) {
        window.settings.taps = COARSE_TAPS;
    }
    /* Enlarges the voxels so that the window is as wide as the footprint. Only parallel light uses
     * this frustum; under a lamp the check covers just the middle of a wide footprint. */
    for (int k = 0; k < 9 && truth->method == UMBT_STUDY_FOOTPRINT; k++) {
        window.frustum.voxel_step[k / 3][k % 3] *= stretch;
    }
    return umbt_truth_is_undefined(&window, point, normal);
}

/* Returns 1 if rays of the truth start in the window of texels, so that the frustum matters. */
static int has_window(const struct umbt_study_truth *truth)
{
    return truth->rays.kind == UMBT_TRUTH_AREA && truth->method != UMBT_STUDY_FOOTPRINT;
}

int umbt_study_truth_is_same(const struct umbt_study_truth *a, const struct umbt_study_truth *b)
{
    const struct umb_frustum_info *f = &a->rays.frustum, *g = &b->rays.frustum;
    if (a->rays.kind != b->rays.kind || a->rays.layers != b->rays.layers ||
        has_window(a) != has_window(b) ||
        (a->method == UMBT_STUDY_TENT) != (b->method == UMBT_STUDY_TENT)) {
        return 0;
    }
    return !has_window(a) ||
           (a->rays.settings.taps == b->rays.settings.taps &&
            memcmp(f->world_to_voxel, g->world_to_voxel, sizeof f->world_to_voxel) == 0 &&
            memcmp(f->voxel_step, g->voxel_step, sizeof f->voxel_step) == 0 &&
            memcmp(a->rays.origin, b->rays.origin, sizeof a->rays.origin) == 0);
}
