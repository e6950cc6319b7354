/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows by rays; see traced_shadow.h. */
#include "study/traced_shadow.h"

#include <math.h>
#include "rays/verify_light_frame.h"
#include "study/study_math.h"

#define SURFACE_OFFSET 2e-6 /* share of the scene's diagonal */
/* Length of rays in diagonals of the scene: no caster is farther from a point of the scene. */
#define FAR_FACTOR 2.0
#define LAMP_SHARE 1e-6 /* share of the way at its end that rays to points of a lamp leave out */

struct umbt_truth umbt_truth_of(const struct umbt_scene *scene, const double to_light[3],
                                const double origin[3], const struct umb_frustum_info *frustum)
{
    return (struct umbt_truth){
        .rays = scene->rays,
        .layers = scene->casts.layers,
        .to_light = {to_light[0], to_light[1], to_light[2]},
        .diagonal_m = scene->diagonal_m,
        .origin = {origin[0], origin[1], origin[2]},
        .frustum = *frustum,
        .closed = frustum->closed ? scene->parts.closed : NULL,
    };
}

double umbt_truth_bias(const struct umb_query_settings *settings,
                       const struct umb_frustum_info *frustum, const double normal[3])
{
    const double taps = settings->taps > 0 ? (double)settings->taps : 1.0;
    double across = 0.0, along = 0.0, mean = 0.0;
    switch (settings->bias_mode) {
    case UMB_BIAS_AUTO:
        across = fabs(umb__dot(normal, frustum->voxel_step[0])) +
                 fabs(umb__dot(normal, frustum->voxel_step[1]));
        along = fabs(umb__dot(normal, frustum->voxel_step[2]));
        return 0.5 * (taps * across + along);
    case UMB_BIAS_VOXELS:
        for (int k = 0; k < 3; k++) {
            mean += umb__length(frustum->voxel_step[k]) / 3.0;
        }
        return settings->bias * mean;
    case UMB_BIAS_METRES:
        return settings->bias;
    case UMB_BIAS_NONE:
        break;
    }
    return 0.0;
}

/* Returns 1 if the bias lifts points along the light: the automatic one of parallel light. */
static int lifts(const struct umbt_truth *truth)
{
    return truth->lamp == NULL && truth->settings.bias_mode == UMB_BIAS_AUTO &&
           truth->settings.level == 0 && !truth->by_normal;
}

/* Returns the longest lift in metres. */
static double longest_lift(const struct umbt_truth *truth, const struct umb_frustum_info *frustum)
{
    const double(*step)[3] = frustum->voxel_step;
    const double taps = truth->settings.taps > 0 ? (double)truth->settings.taps : 1.0;
    return (2.0 * taps - 0.5) * 0.5 * (umb__length(step[0]) + umb__length(step[1]));
}

void umbt_truth_move(const struct umbt_truth *truth, const struct umb_frustum_info *frustum,
                     const double point[3], const double normal[3], double moved[3])
{
    const double need = umbt_truth_bias(&truth->settings, frustum, normal);
    const double facing = umb__dot(normal, truth->to_light);
    double lift = 0.0;
    if (lifts(truth) && facing > 0.0) {
        lift = fmin(need / facing, longest_lift(truth, frustum));
    }
    umbt_along(point, need - lift * facing, normal, moved);
    umbt_along(moved, lift, truth->to_light, moved);
}

double umbt_towards_light(const struct umb_light_info *lamp, const double to_light[3],
                          const double point[3], double towards[3])
{
    double distance = INFINITY;
    if (lamp == NULL) {
        for (int k = 0; k < 3; k++) {
            towards[k] = to_light[k];
        }
    } else {
        umbr_towards_light(lamp, point, towards, &distance);
    }
    return distance;
}

/* X, Y, Z or W of a world point. */
static double row_of(const struct umb_frustum_info *frustum, int row, const double origin[3],
                     const double point[3])
{
    double p[3];
    umb__subtract(point, origin, p);
    return umb__dot(frustum->world_to_voxel[row], p) + frustum->world_to_voxel[row][3];
}

void umbt_truth_frustum_at(const struct umbt_truth *truth, const double point[3],
                           struct umb_frustum_info *at)
{
    const struct umb_frustum_info *face = &truth->frustum;
    double w = 1.0, ray[3];
    if (truth->lamp != NULL) {
        face = &truth->frusta[0];
        w = row_of(face, 3, truth->origin, point);
    }
    for (uint32_t i = 1; truth->lamp != NULL && i < truth->frustum_count; i++) {
        const double other = row_of(&truth->frusta[i], 3, truth->origin, point);
        face = other > w ? &truth->frusta[i] : face;
        w = other > w ? other : w;
    }
    *at = *face;
    if (truth->lamp == NULL) {
        return;
    }
    const double thickness = umb__dot(face->world_to_voxel[3], face->voxel_step[2]);
    umb__subtract(point, truth->lamp->position, ray);
    for (int k = 0; k < 3; k++) {
        at->voxel_step[0][k] *= w;
        at->voxel_step[1][k] *= w;
        at->voxel_step[2][k] = ray[k] / w * thickness;
    }
}

/* Share of light that arrives along a ray. */
static double ray_share(const struct umbt_truth *truth, const double from[3],
                        const double towards[3], double far_m)
{
    return umbr_occluded(truth->rays, from, towards, 0.0, far_m)
               ? 0.0
               : umbr_layers_pass(truth->layers, from, towards, far_m);
}

/* Share of light that arrives from the lamp, or along parallel light. */
static double light_share(const struct umbt_truth *truth, const double from[3])
{
    double towards[3];
    const double far = umbt_towards_light(truth->lamp, truth->to_light, from, towards);
    return ray_share(truth, from, towards,
                     truth->lamp != NULL ? far : FAR_FACTOR * truth->diagonal_m);
}

/* A window: side x side starts of rays, `pitch` texels apart, centred `centre` texels from the
 * moved point. */
struct window {
    double moved[3];
    double centre[2];
    double deeper; /* voxels of depth behind the moved point */
    double pitch;
    uint32_t side;
    struct umb_frustum_info frustum; /* frustum at the moved point */
};

/* Returns the number of voxels by which a lifted window looks up deeper than the moved point. The
 * query's lift counts from the depth of the surface's plane at the window's centre, and clears half
 * a texel less. */
static double follow_plane(const struct umbt_truth *truth, const double normal[3],
                           const struct window *window)
{
    const double(*step)[3] = window->frustum.voxel_step;
    const double need = umbt_truth_bias(&truth->settings, &window->frustum, normal);
    const double facing = umb__dot(normal, truth->to_light), depth = umb__dot(normal, step[2]);
    double deeper = 0.0;
    if (!lifts(truth) || window->side == 1 ||
        need > facing * longest_lift(truth, &window->frustum)) {
        return 0.0;
    }
    for (int k = 0; k < 2; k++) {
        const double slope = -umb__dot(normal, step[k]) / depth;
        deeper += slope * window->centre[k] + 0.5 * fabs(slope);
    }
    return deeper;
}

/* Makes the window of the query: the centres of its texels, at the moved point's depth. */
static void texel_window(const struct umbt_truth *truth, const double point[3],
                         const double normal[3], struct window *window)
{
    umbt_truth_frustum_at(truth, point, &window->frustum);
    umbt_truth_move(truth, &window->frustum, point, normal, window->moved);
    umbt_truth_frustum_at(truth, window->moved, &window->frustum);
    const double w = row_of(&window->frustum, 3, truth->origin, window->moved);
    for (int k = 0; k < 2; k++) {
        const double at = row_of(&window->frustum, k, truth->origin, window->moved) / w;
        window->centre[k] = floor(at) + 0.5 - at;
    }
    window->pitch = 1.0;
    window->side = truth->settings.taps > 0 ? truth->settings.taps : 1;
    window->deeper = follow_plane(truth, normal, window);
}

void umbt_truth_look_up(const struct umbt_truth *truth, const double point[3],
                        const double normal[3], double at[3])
{
    struct window window;
    texel_window(truth, point, normal, &window);
    umbt_along(window.moved, window.deeper, window.frustum.voxel_step[2], at);
}

/* Start of ray i, row by row. */
static void window_start(const struct window *window, uint32_t i, double start[3])
{
    const double middle = 0.5 * (double)(window->side - 1);
    const double x = window->centre[0] + ((double)(i % window->side) - middle) * window->pitch;
    const double y = window->centre[1] + ((double)(i / window->side) - middle) * window->pitch;
    umbt_along(window->moved, x, window->frustum.voxel_step[0], start);
    umbt_along(start, y, window->frustum.voxel_step[1], start);
    umbt_along(start, window->deeper, window->frustum.voxel_step[2], start);
}

static float window_visibility(const struct umbt_truth *truth, const struct window *window)
{
    const uint32_t count = window->side * window->side;
    double lit = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        double start[3];
        window_start(window, i, start);
        lit += light_share(truth, start);
    }
    return (float)lit / (float)count;
}

int umbt_truth_is_undefined(const struct umbt_truth *truth, const double point[3],
                            const double normal[3])
{
    if (truth->closed == NULL) {
        return 0;
    }
    struct window window;
    texel_window(truth, point, normal, &window);
    for (uint32_t i = 0; i < window.side * window.side; i++) {
        double start[3], towards[3];
        int winding = 0, crossings = 0;
        window_start(&window, i, start);
        (void)umbt_towards_light(truth->lamp, truth->to_light, start, towards);
        umbr_crossings(truth->rays, start, towards, truth->closed, &winding, &crossings);
        if (winding > 0) {
            return 1;
        }
    }
    return 0;
}

/* Two unit vectors perpendicular to a third. */
static void across(const double w[3], double u[3], double v[3])
{
    const double axis[3] = {fabs(w[0]) < 0.6, !(fabs(w[0]) < 0.6), 0};
    umb__cross(axis, w, u);
    (void)umbt_normalize(u);
    umb__cross(w, u, v);
}

/* Maps a place in the square -1..1 on both axes to the unit disc, with areas in proportion. */
static void square_to_disc(double a, double b, double *x, double *y)
{
    const double quarter = 0.7853981633974483;
    const int wide = fabs(a) > fabs(b);
    const double radius = wide ? a : b;
    const double turn = radius == 0.0 ? 0.0 : quarter * (wide ? b : a) / radius;
    *x = radius * (wide ? cos(turn) : sin(turn));
    *y = radius * (wide ? sin(turn) : cos(turn));
}

/* A light with an extent: its points are middle + a half[0] + b half[1], with a and b in the unit
 * disc or the square -1..1. The middle of parallel light is a direction. */
struct area {
    double half[2][3];
    int is_round;
};

static struct area area_of(const struct umbt_truth *truth, const double from[3])
{
    const struct umb_light_info *lamp = truth->lamp;
    struct area area = {.is_round = lamp == NULL || lamp->kind != UMB_LIGHT_RECTANGLE};
    double radius = lamp != NULL ? lamp->extent / 2 : tan(truth->extent / 2), towards[3];
    if (!area.is_round) {
        umb__cross(lamp->side, lamp->direction, area.half[1]);
        (void)umbt_normalize(area.half[1]);
        for (int k = 0; k < 3; k++) {
            area.half[0][k] = lamp->side[k] / 2;
            area.half[1][k] *= radius;
        }
        return area;
    }
    (void)umbt_towards_light(lamp, truth->to_light, from, towards);
    /* A sphere counts as the disc perpendicular to the direction to it; a flat disc keeps its own
     * plane. */
    across(lamp != NULL && lamp->kind == UMB_LIGHT_DISC ? lamp->direction : towards, area.half[0],
           area.half[1]);
    for (int k = 0; k < 3; k++) {
        area.half[0][k] *= radius;
        area.half[1][k] *= radius;
    }
    return area;
}

/* Share of the rays to the light's points that reach it. */
static float disc_visibility(const struct umbt_truth *truth, const double from[3],
                             const double normal[3])
{
    const struct area area = area_of(truth, from);
    const double side = (double)truth->samples;
    double lit = 0.0;
    for (uint32_t i = 0; i < truth->samples * truth->samples; i++) {
        double direction[3], x = 2 * (i % truth->samples + 0.5) / side - 1;
        double y = 2 * (i / truth->samples + 0.5) / side - 1;
        if (area.is_round) {
            square_to_disc(x, y, &x, &y);
        }
        if (truth->lamp != NULL) {
            umb__subtract(truth->lamp->position, from, direction);
        } else {
            umbt_along(truth->to_light, 0, normal, direction);
        }
        umbt_along(direction, x, area.half[0], direction);
        umbt_along(direction, y, area.half[1], direction);
        const double far = umb__length(direction);
        (void)umbt_normalize(direction);
        const double reach =
            truth->lamp != NULL ? far * (1 - LAMP_SHARE) : FAR_FACTOR * truth->diagonal_m;
        lit += umb__dot(direction, normal) > 0.0 ? ray_share(truth, from, direction, reach) : 0.0;
    }
    return (float)lit / (float)(truth->samples * truth->samples);
}

/*
 * Finds the start of a ray. `at` is an offset across the view from the receiver `from`: the eye
 * looks at this place, and the start is a point just off the surface that it sees there. Returns 0
 * if that is another surface, more than `depth_m` before or behind the plane of the receiver.
 */
static int footprint_start(const struct umbt_truth *truth, const double from[3],
                           const double normal[3], double depth_m, double at[3])
{
    double ray[3], to_plane[3];
    struct umbr_hit hit = {.distance = -1.0};
    umb__subtract(from, truth->settings.eye, to_plane);
    umbt_along(to_plane, 1.0, at, ray);
    (void)umbt_normalize(ray);
    const double plane_m = umb__dot(to_plane, normal) / umb__dot(ray, normal);
    umbr_nearest(truth->rays, truth->settings.eye, ray, 0.0, INFINITY, &hit);
    if (!(hit.distance >= 0.0) || !(fabs(hit.distance - plane_m) <= depth_m)) {
        return 0;
    }
    umbt_along(truth->settings.eye, hit.distance, ray, at);
    umbt_along(at, copysign(SURFACE_OFFSET * truth->diagonal_m, -umb__dot(hit.normal, ray)),
               hit.normal, at);
    return 1;
}

/* Share of the rays from the surface that the pixel covers that reach the light. */
static float footprint_visibility(const struct umbt_truth *truth, const double from[3],
                                  const double normal[3])
{
    const double side = (double)truth->samples;
    double view[3], u[3], v[3], lit = 0.0;
    uint32_t count = 0;
    umb__subtract(from, truth->settings.eye, view);
    const double pixel_m = truth->settings.pixel_rad * umb__length(view);
    (void)umbt_normalize(view);
    across(view, u, v);
    for (uint32_t i = 0; i < truth->samples * truth->samples; i++) {
        double at[3] = {0, 0, 0};
        umbt_along(at, ((i % truth->samples + 0.5) / side - 0.5) * pixel_m, u, at);
        umbt_along(at, ((i / truth->samples + 0.5) / side - 0.5) * pixel_m, v, at);
        if (footprint_start(truth, from, normal, pixel_m, at)) {
            lit += light_share(truth, at);
            count++;
        }
    }
    return count > 0 ? (float)(lit / count) : (float)light_share(truth, from);
}

/* Returns whether a point lies behind the plane of an area light, which shines to one side. */
static int is_behind(const struct umb_light_info *lamp, const double towards[3])
{
    return lamp != NULL && (lamp->kind == UMB_LIGHT_RECTANGLE || lamp->kind == UMB_LIGHT_DISC) &&
           !(umb__dot(towards, lamp->direction) < 0.0);
}

float umbt_truth_visibility(const struct umbt_truth *truth, const double point[3],
                            const double normal[3])
{
    struct window window;
    double towards[3];
    (void)umbt_towards_light(truth->lamp, truth->to_light, point, towards);
    if (!(umb__dot(normal, towards) > 0.0) || is_behind(truth->lamp, towards)) {
        return 0.0F;
    }
    if (truth->kind == UMBT_TRUTH_SURFACE || truth->kind == UMBT_TRUTH_DISC ||
        truth->kind == UMBT_TRUTH_FOOTPRINT) {
        umbt_along(point, SURFACE_OFFSET * truth->diagonal_m, normal, window.moved);
        if (truth->kind == UMBT_TRUTH_DISC) {
            return disc_visibility(truth, window.moved, normal);
        }
        if (truth->kind == UMBT_TRUTH_FOOTPRINT) {
            return footprint_visibility(truth, window.moved, normal);
        }
        return (float)light_share(truth, window.moved);
    }
    texel_window(truth, point, normal, &window);
    if (truth->kind == UMBT_TRUTH_AREA) {
        window.centre[0] = 0.0;
        window.centre[1] = 0.0;
        window.deeper = 0.0;
        window.pitch = (double)window.side / (double)truth->samples;
        window.side = truth->samples;
    }
    return window_visibility(truth, &window);
}
