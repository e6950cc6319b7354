/* SPDX-License-Identifier: Apache-2.0 */
/* Points in map space; see map_receiver.h. */
#include "maps/map_receiver.h"

#include "base/reserved.h"
#include "query/query_parts.h"

static int affine_map(const struct umb_map_frustum *frustum, const double p[3],
                      struct umb__map_point *out)
{
    const double(*m)[4] = frustum->world_to_map;
    const double w = frustum->projection == UMB_MAP_AFFINE ? 1.0 : umb__dot(m[3], p) + m[3][3];
    if (!(w > 0.0)) {
        return 0;
    }
    for (int i = 0; i < 3; i++) {
        out->at[i] = umb__dot(m[i], p) + m[i][3];
        if (i < 2) {
            out->at[i] /= w;
        }
        for (int k = 0; k < 3; k++) {
            out->gradient[i][k] = m[i][k];
            if (i < 2 && frustum->projection == UMB_MAP_PERSPECTIVE) {
                out->gradient[i][k] = (m[i][k] - out->at[i] * m[3][k]) / w;
            }
        }
    }
    return 1;
}

static int paraboloid_map(const struct umb_map_frustum *frustum, const double p[3],
                          struct umb__map_point *out)
{
    const double(*m)[4] = frustum->world_to_map;
    const double half[2] = {0.5 * (double)frustum->width, 0.5 * (double)frustum->height};
    double q[3];
    for (int i = 0; i < 3; i++) {
        q[i] = umb__dot(m[i], p) + m[i][3];
    }
    const double r = umb__length(q);
    if (!(q[2] >= 0.0 && r > 0.0)) {
        return 0;
    }
    double local[3][3]; /* Gradients along the light's own axes */
    for (int i = 0; i < 2; i++) {
        const double u = q[i] / (r + q[2]);
        out->at[i] = (1.0 + u) * half[i];
        for (int k = 0; k < 3; k++) {
            const double self = k == i ? 1.0 : 0.0, axis = k == 2 ? 1.0 : 0.0;
            local[i][k] = half[i] * (self - u * (q[k] / r + axis)) / (r + q[2]);
        }
    }
    out->at[2] = (r - frustum->near_m) / frustum->depth_m;
    for (int k = 0; k < 3; k++) {
        local[2][k] = q[k] / (r * frustum->depth_m);
    }
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            out->gradient[i][k] =
                local[i][0] * m[0][k] + local[i][1] * m[1][k] + local[i][2] * m[2][k];
        }
    }
    return 1;
}

int umb__frustum_map(const struct umb_map_frustum *frustum, const double world[3],
                     struct umb__map_point *out)
{
    double p[3];
    umb__subtract(world, frustum->origin, p);
    return frustum->projection == UMB_MAP_PARABOLOID ? paraboloid_map(frustum, p, out)
                                                     : affine_map(frustum, p, out);
}

enum umb_status umb__frustum_check(const struct umb_map_frustum *frustum, struct umb_error *error)
{
    if (UMB__UNKNOWN(frustum, "frustum", error)) {
        return UMB_E_ARGUMENT;
    }
    if (frustum->width < 1 || frustum->height < 1 || frustum->width > UMB_MAP_SIDE_MAX ||
        frustum->height > UMB_MAP_SIDE_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "frustum: %u x %u texels; sides are 1..%d",
                        frustum->width, frustum->height, UMB_MAP_SIDE_MAX);
    }
    if ((unsigned)frustum->projection > UMB_MAP_PARABOLOID) {
        return umb_fail(error, UMB_E_ARGUMENT, "frustum: projection %d is unknown",
                        (int)frustum->projection);
    }
    int finite = 1;
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < 4; k++) {
            finite &= isfinite(frustum->world_to_map[i][k]) != 0;
        }
    }
    for (int k = 0; k < 3; k++) {
        finite &= isfinite(frustum->origin[k]) && isfinite(frustum->light[k]);
    }
    if (!finite || !isfinite(frustum->near_m)) {
        return umb_fail(error, UMB_E_ARGUMENT, "frustum: a number is not finite");
    }
    if (!(frustum->depth_m > 0.0 && isfinite(frustum->depth_m))) {
        return umb_fail(error, UMB_E_ARGUMENT, "frustum: depth_m is %g; it must be above 0",
                        frustum->depth_m);
    }
    return UMB_OK;
}

static int faces_away(const struct umb_map_frustum *frustum, const double world[3],
                      const double normal[3])
{
    double to_light[3];
    if (frustum->directional) {
        return !(umb__dot(normal, frustum->light) > 0.0);
    }
    umb__subtract(frustum->light, world, to_light);
    return !(umb__dot(normal, to_light) > 0.0);
}

/*
 * Computes the depth that a plane with normal n gains per texel. Let gx and gy be the gradients of
 * x and y. A step v within the plane that changes x by one texel and y not at all solves n.v = 0,
 * gx.v = 1 and gy.v = 0, so v = (gy x n) / (n . (gx x gy)).
 */
static void plane_gain(const struct umb__map_point *point, const double normal[3], double gain[2])
{
    double across[3], v[3];
    umb__cross(point->gradient[0], point->gradient[1], across);
    const double steep = umb__dot(normal, across);
    gain[0] = INFINITY;
    gain[1] = INFINITY;
    if (steep == 0.0 || isnan(steep)) {
        return; /* The light grazes the plane */
    }
    umb__cross(point->gradient[1], normal, v);
    gain[0] = umb__dot(point->gradient[2], v) / steep;
    umb__cross(normal, point->gradient[0], v);
    gain[1] = umb__dot(point->gradient[2], v) / steep;
}

/* Returns the length in metres of a move along the normal, after which half of a filter of `width`
 * texels causes no self-shadowing. */
static double normal_shift(const struct umb__map_point *point, const double normal[3], double width)
{
    double sum = 0.0;
    for (int i = 0; i < 2; i++) {
        const double *g = point->gradient[i];
        const double square = umb__dot(g, g);
        sum += square > 0.0 ? fabs(umb__dot(normal, g)) / square : 0.0;
    }
    return isfinite(sum) ? 0.5 * width * sum : 0.0;
}

void umb__receiver_make(const struct umb_map_frustum *frustum, const struct umb_map_filter *filter,
                        const struct umb_points *points, size_t index,
                        struct umb__receiver *receiver)
{
    double world[3], normal[3];
    struct umb__map_point point;
    *receiver = (struct umb__receiver){.place = UMB__RECEIVER_OUTSIDE};
    for (unsigned k = 0; k < 3; k++) {
        world[k] = points->origin[k] + umb__coordinate(points, index, k);
    }
    (void)umb__normal(points, index, normal);
    const int has_normal = umb__unit(normal);
    if (has_normal && faces_away(frustum, world, normal)) {
        receiver->place = UMB__RECEIVER_FACING_AWAY;
        return;
    }
    if (!umb__frustum_map(frustum, world, &point)) {
        return;
    }
    if (has_normal && filter->bias_normal > 0.0) {
        /* Texels under a BILINEAR box reach half a texel beyond it. */
        const double reach = filter->width + (filter->kernel == UMB_MAP_BILINEAR ? 1.0 : 0.0);
        const double shift = filter->bias_normal * normal_shift(&point, normal, reach);
        for (int k = 0; k < 3; k++) {
            world[k] += shift * normal[k];
        }
        if (!umb__frustum_map(frustum, world, &point)) {
            return;
        }
    }
    if (has_normal) {
        plane_gain(&point, normal, receiver->gain);
    }
    receiver->x = point.at[0];
    receiver->y = point.at[1];
    receiver->depth = point.at[2];
    receiver->texels_per_m = sqrt(umb__length(point.gradient[0]) * umb__length(point.gradient[1]));
    if (receiver->x >= 0.0 && receiver->x < (double)frustum->width && receiver->y >= 0.0 &&
        receiver->y < (double)frustum->height && receiver->depth > 0.0) {
        receiver->place = UMB__RECEIVER_INSIDE;
    }
}
