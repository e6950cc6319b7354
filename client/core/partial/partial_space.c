/* SPDX-License-Identifier: Apache-2.0 */
/* Views and cubes; see partial_space.h. Comparisons are written so that NaN, which only a hostile
 * frustum makes, counts as inside the view. */
#include "partial/partial_space.h"

#include <math.h>
#include <string.h>

#include "base/try.h"
#include "base/vec.h"
#include "format/canonical.h"

static bool normalize(double v[3])
{
    const double length = sqrt(umb__dot(v, v));
    if (!(length > 0 && isfinite(length))) {
        return false;
    }
    for (unsigned i = 0; i < 3; i++) {
        v[i] /= length;
    }
    return true;
}

/* Sine of the angle up to which forward and up count as parallel: far above rounding errors. */
#define PARALLEL 1e-9

/* Makes the camera's four side planes; false if forward and up are parallel. */
static bool make_planes(struct umb__sight *sight)
{
    const struct umb_partial_view *view = sight->view;
    double forward[3], right[3], up[3];
    memcpy(forward, view->camera.forward, sizeof forward);
    if (!normalize(forward)) {
        return false;
    }
    umb__cross(forward, view->camera.up, right);
    if (!(umb__dot(right, right) >
          PARALLEL * PARALLEL * umb__dot(view->camera.up, view->camera.up)) ||
        !normalize(right)) {
        return false;
    }
    umb__cross(right, forward, up);
    const double tall = tan(view->camera.fov_y / 2), wide = tall * view->camera.aspect;
    for (unsigned side = 0; side < 4; side++) {
        const double *across = side < 2 ? right : up;
        const double slope = side < 2 ? wide : tall, sign = side % 2 ? 1.0 : -1.0;
        double *plane = sight->planes[side];
        for (unsigned i = 0; i < 3; i++) {
            plane[i] = forward[i] * slope + sign * across[i];
        }
        if (!normalize(plane)) {
            return false;
        }
        plane[3] = -umb__dot(plane, view->camera.eye);
    }
    return true;
}

static enum umb_status check_box(const struct umb_partial_view *view, struct umb_error *error)
{
    for (unsigned i = 0; i < 3; i++) {
        if (!isfinite(view->box.min[i]) || !isfinite(view->box.max[i]) ||
            view->box.min[i] > view->box.max[i]) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "box: %g to %g along axis %u, must be finite "
                            "and in order",
                            view->box.min[i], view->box.max[i], i);
        }
    }
    return UMB_OK;
}

static enum umb_status check_camera(struct umb__sight *sight, struct umb_error *error)
{
    const struct umb_camera *camera = &sight->view->camera;
    const double *eye = camera->eye, *forward = camera->forward, *up = camera->up;
    if (!umb__all_finite(eye, 3)) {
        return umb_fail(error, UMB_E_ARGUMENT, "camera.eye: (%g, %g, %g), must be finite", eye[0],
                        eye[1], eye[2]);
    }
    if (!(camera->fov_y > 0 && camera->fov_y < 3.14159)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "camera.fov_y: %g, must be above 0 and below 3.14159 (radians)",
                        camera->fov_y);
    }
    if (!(camera->aspect > 0 && camera->aspect < 1e6)) {
        return umb_fail(error, UMB_E_ARGUMENT, "camera.aspect: %g, must be above 0 and below 1e6",
                        camera->aspect);
    }
    return make_planes(sight)
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "camera.forward (%g, %g, %g) and up (%g, %g, %g): must be finite, longer "
                          "than 0 and not parallel",
                          forward[0], forward[1], forward[2], up[0], up[1], up[2]);
}

enum umb_status umb__sight_init(struct umb__sight *sight, const struct umb_partial_view *view,
                                struct umb_error *error)
{
    memset(sight, 0, sizeof *sight);
    sight->view = view;
    if (!(view->max_error_m >= 0) || !(view->max_error_rad >= 0) || !(view->bias_m >= 0) ||
        !(view->camera.far_m >= 0)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "view: max_error_m %g, max_error_rad %g, bias_m %g "
                        "and far_m %g must be 0 or more",
                        view->max_error_m, view->max_error_rad, view->bias_m, view->camera.far_m);
    }
    if (view->taps > UMB_TAPS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "taps: %u, at most %d", view->taps, UMB_TAPS_MAX);
    }
    if (view->has_box) {
        UMB__TRY(check_box(view, error));
    }
    return view->has_camera ? check_camera(sight, error) : UMB_OK;
}

/*
 * Returns the largest distance in metres of a point's look-up from the point: the bias, half the
 * width of the window, and a voxel for rounding down. The automatic bias (umbrage/query.h) is at
 * most (taps (|n.ex| + |n.ey|) + |n.ez|) / 2 along a normal n, or (2 taps + 1) / (2 sqrt(3)) voxels
 * of depth without a normal. A point that moves from one face of a perspective light to another
 * moves at most twice as far.
 */
static double margin_of(const struct umb__space *s, double taps)
{
    const double diagonal = sqrt(s->edges[0] * s->edges[0] + s->edges[1] * s->edges[1]);
    const double slack = 65.0 / 64.0;
    const double normal = slack * 0.5 * (taps * diagonal + s->edges[2]);
    const double plain = slack * (2 * taps + 1) / (2 * sqrt(3.0)) * s->edges[2];
    const double bias = normal > plain ? normal : plain;
    return (s->is_perspective ? 4 * bias : bias) + (taps / 2 + 1) * diagonal + s->edges[2];
}

void umb__space_init(struct umb__space *s, const struct umb__content *content, uint32_t frustum,
                     const struct umb_partial_view *view)
{
    const struct umb_frustum_info *f = &content->frusta[frustum];
    const struct umb_light_info *light = &content->lights[f->light];
    memset(s, 0, sizeof *s);
    memcpy(s->step, f->voxel_step, sizeof s->step);
    s->is_perspective = umb__is_perspective(f) != 0;
    s->log2_size = f->log2_size;
    umb_frustum_voxel_edges(f, s->edges);
    if (s->is_perspective) {
        for (unsigned i = 0; i < 3; i++) {
            s->base[i] = light->position[i] - content->origin[i];
        }
        /* Opening the file proved that the frustum can be inverted. */
        (void)umb__perspective_derive(f, &s->perspective);
    } else {
        for (unsigned axis = 0; axis < 3; axis++) {
            for (unsigned i = 0; i < 3; i++) {
                s->base[i] -= f->voxel_step[axis][i] * f->world_to_voxel[axis][3];
            }
        }
    }
    for (unsigned i = 0; i < 3; i++) {
        s->base[i] += content->origin[i];
    }
    s->margin_m = margin_of(s, view->taps ? view->taps : UMB_TAPS_MAX) + view->bias_m;
}

static void corner(const struct umb__space *s, const double v[3], double world[3])
{
    const double w = s->is_perspective ? s->perspective.offset + s->perspective.scale * v[2] : 1.0;
    for (unsigned i = 0; i < 3; i++) {
        const double across = v[0] * s->step[0][i] + v[1] * s->step[1][i];
        world[i] = s->base[i] + (s->is_perspective ? w * (across + s->perspective.axis[i])
                                                   : across + v[2] * s->step[2][i]);
    }
}

/* Computes the world box around a cube of voxels, extended by the margin. The last layer of voxels
 * answers for all space behind the frustum, so a cube in that layer is extended in depth by four
 * times the frustum's size. */
static void bound_cube(const struct umb__space *s, uint32_t level, const uint32_t at[3],
                       double low[3], double high[3])
{
    const double edge = (double)(1U << level), size = (double)(1U << s->log2_size);
    const bool last = at[2] + (1U << level) == 1U << s->log2_size;
    for (unsigned c = 0; c < 8; c++) {
        double v[3], world[3];
        for (unsigned i = 0; i < 3; i++) {
            v[i] = (double)at[i] + (c >> i & 1 ? edge : 0.0);
        }
        if (last && c >> 2) {
            v[2] += 4 * size;
        }
        corner(s, v, world);
        for (unsigned i = 0; i < 3; i++) {
            low[i] = c == 0 || world[i] < low[i] ? world[i] : low[i];
            high[i] = c == 0 || world[i] > high[i] ? world[i] : high[i];
        }
    }
    for (unsigned i = 0; i < 3; i++) {
        low[i] -= s->margin_m;
        high[i] += s->margin_m;
    }
}

static void see_box(const struct umb_box *box, const double low[3], const double high[3],
                    struct umb__seen_cube *cube)
{
    for (unsigned i = 0; i < 3; i++) {
        cube->out = cube->out || high[i] < box->min[i] || low[i] > box->max[i];
        cube->whole = cube->whole && low[i] >= box->min[i] && high[i] <= box->max[i];
    }
}

static void see_camera(const struct umb__sight *sight, const double low[3], const double high[3],
                       struct umb__seen_cube *cube)
{
    double square = 0, reach = 0;
    for (unsigned i = 0; i < 3; i++) {
        const double eye = sight->view->camera.eye[i];
        const double gap = eye < low[i] ? low[i] - eye : eye > high[i] ? eye - high[i] : 0;
        const double most = fabs(low[i] - eye) > fabs(high[i] - eye) ? low[i] - eye : high[i] - eye;
        square += gap * gap;
        reach += most * most;
    }
    cube->distance_m = sqrt(square);
    for (unsigned side = 0; side < 4; side++) {
        const double *plane = sight->planes[side];
        double most = plane[3], least = plane[3];
        for (unsigned i = 0; i < 3; i++) {
            const double a = plane[i] * low[i], b = plane[i] * high[i];
            most += a > b ? a : b;
            least += a > b ? b : a;
        }
        cube->out = cube->out || most < 0;
        cube->whole = cube->whole && least >= 0;
    }
    const double far = sight->view->camera.far_m;
    if (far > 0) {
        cube->out = cube->out || square > far * far;
        cube->whole = cube->whole && reach <= far * far;
    }
}

double umb__space_edge(const struct umb__space *space, uint32_t level, uint32_t z)
{
    const double count = (double)(1U << level), *edges = space->edges;
    double across = fmax(edges[0], edges[1]);
    if (space->is_perspective) { /* `edges` holds those of the last layer of voxels */
        const double size = (double)(1U << space->log2_size);
        const double offset = space->perspective.offset, scale = space->perspective.scale;
        across *= (offset + scale * ((double)z + count)) / (offset + scale * size);
    }
    return fmax(across, edges[2]) * count;
}

struct umb__seen_cube umb__sight_cube(const struct umb__sight *sight,
                                      const struct umb__space *space, uint32_t level, uint32_t x,
                                      uint32_t y, uint32_t z)
{
    const struct umb_partial_view *view = sight->view;
    const double longest = fmax(space->edges[0], fmax(space->edges[1], space->edges[2]));
    struct umb__seen_cube cube = {.whole = true, .edge_m = umb__space_edge(space, level, z)};
    double low[3], high[3];
    if (view->has_box || view->has_camera) {
        bound_cube(space, level, (const uint32_t[3]){x, y, z}, low, high);
    }
    if (view->has_box) {
        see_box(&view->box, low, high, &cube);
    }
    cube.benefit = cube.edge_m * cube.edge_m;
    if (view->has_camera && !cube.out) {
        see_camera(sight, low, high, &cube);
        /* Distance in metres below which the benefit hardly grows */
        const double near = 16 * longest;
        cube.benefit /= cube.distance_m * cube.distance_m + near * near;
    }
    return cube;
}
