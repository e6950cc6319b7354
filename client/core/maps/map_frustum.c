/* SPDX-License-Identifier: Apache-2.0 */
/* Frusta of lights: makes them, and maps texels back to the world. */
#include <math.h>
#include <string.h>
#include "base/try.h"
#include "maps/map_receiver.h"
#include "base/reserved.h"
#include "base/vec.h"

static enum umb_status sides_check(uint32_t width, uint32_t height, struct umb_error *error)
{
    if (width < 1 || height < 1 || width > UMB_MAP_SIDE_MAX || height > UMB_MAP_SIDE_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "frustum: %u x %u texels; sides are 1..%d", width,
                        height, UMB_MAP_SIDE_MAX);
    }
    return UMB_OK;
}

/* Finds the lowest and highest coordinate of a box's corners along an axis, relative to
 * `origin`. */
static void box_extent(const struct umb_box *box, const double origin[3], const double axis[3],
                       double extent[2])
{
    extent[0] = 0.0;
    extent[1] = 0.0;
    for (int k = 0; k < 3; k++) {
        const double a = axis[k] * (box->min[k] - origin[k]);
        const double b = axis[k] * (box->max[k] - origin[k]);
        extent[0] += fmin(a, b);
        extent[1] += fmax(a, b);
    }
}

enum umb_status umb_map_frustum_fit(const double to_light[3], const struct umb_box *box,
                                    uint32_t width, uint32_t height,
                                    struct umb_map_frustum *frustum, struct umb_error *error)
{
    memset(frustum, 0, sizeof *frustum);
    double axes[3][3], diagonal = 0.0;
    UMB__TRY(sides_check(width, height, error));
    struct umb_map_frustum f = {.width = width, .height = height, .directional = 1};
    for (int k = 0; k < 3; k++) {
        axes[2][k] = -to_light[k];
        f.origin[k] = 0.5 * (box->min[k] + box->max[k]);
        diagonal += (box->max[k] - box->min[k]) * (box->max[k] - box->min[k]);
        if (!(box->min[k] <= box->max[k])) {
            diagonal = NAN;
        }
    }
    diagonal = sqrt(diagonal);
    if (!umb__unit(axes[2]) || !(diagonal > 0.0 && isfinite(diagonal))) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "frustum: the light needs a direction and the box an extent");
    }
    umb__across(axes[2], axes[0], axes[1]);
    const double sides[3] = {(double)width, (double)height, 1.0};
    for (int i = 0; i < 3; i++) {
        double extent[2];
        box_extent(box, f.origin, axes[i], extent);
        const double spare = i < 2 ? 1.0 / fmax(sides[i] - 2.0, 1.0) : 1e-3;
        const double length = fmax(extent[1] - extent[0], 1e-6 * diagonal) * (1.0 + 2.0 * spare);
        const double scale = sides[i] / length;
        for (int k = 0; k < 3; k++) {
            f.world_to_map[i][k] = axes[i][k] * scale;
        }
        f.world_to_map[i][3] = 0.5 * sides[i] - 0.5 * (extent[0] + extent[1]) * scale;
        f.depth_m = length; /* That of the last axis, depth, stays */
    }
    f.world_to_map[3][3] = 1.0;
    for (int k = 0; k < 3; k++) {
        f.light[k] = -axes[2][k];
    }
    *frustum = f;
    return UMB_OK;
}

enum umb_status umb_map_frustum_spot(const struct umb_map_spot *spot, uint32_t width,
                                     uint32_t height, struct umb_map_frustum *frustum,
                                     struct umb_error *error)
{
    memset(frustum, 0, sizeof *frustum);
    if (UMB__UNKNOWN(spot, "spot", error)) {
        return UMB_E_ARGUMENT;
    }
    UMB__TRY(sides_check(width, height, error));
    double z[3], x[3], y[3];
    memcpy(z, spot->forward, sizeof z);
    const int has_forward = umb__unit(z);
    umb__cross(z, spot->up, x);
    if (!has_forward || !umb__unit(x)) {
        return umb_fail(error, UMB_E_ARGUMENT, "spot: forward and up do not span a plane");
    }
    umb__cross(z, x, y);
    const int paraboloid = spot->projection == UMB_MAP_PARABOLOID;
    if (!paraboloid && spot->projection != UMB_MAP_PERSPECTIVE) {
        return umb_fail(error, UMB_E_ARGUMENT, "spot: projection %d is not one of a point",
                        (int)spot->projection);
    }
    if (!(spot->near_m >= 0.0 && spot->far_m > spot->near_m && isfinite(spot->far_m)) ||
        !(paraboloid || (spot->tangent > 0.0 && isfinite(spot->tangent)))) {
        return umb_fail(error, UMB_E_ARGUMENT, "spot: near %g, far %g, tangent %g; 0 <= near < far",
                        spot->near_m, spot->far_m, spot->tangent);
    }
    struct umb_map_frustum f = {
        .projection = spot->projection, .width = width, .height = height, .near_m = spot->near_m};
    f.depth_m = spot->far_m - spot->near_m;
    memcpy(f.origin, spot->position, sizeof f.origin);
    memcpy(f.light, spot->position, sizeof f.light);
    const double half[2] = {0.5 * (double)width, 0.5 * (double)height};
    for (int k = 0; k < 3; k++) {
        f.world_to_map[0][k] = paraboloid ? x[k] : half[0] * (x[k] / spot->tangent + z[k]);
        f.world_to_map[1][k] = paraboloid ? y[k] : half[1] * (y[k] / spot->tangent + z[k]);
        f.world_to_map[2][k] = paraboloid ? z[k] : z[k] / f.depth_m;
        f.world_to_map[3][k] = paraboloid ? 0.0 : z[k];
    }
    f.world_to_map[2][3] = paraboloid ? 0.0 : -spot->near_m / f.depth_m;
    f.world_to_map[3][3] = paraboloid ? 1.0 : 0.0;
    UMB__TRY(umb__frustum_check(&f, error));
    *frustum = f;
    return UMB_OK;
}

static int paraboloid_point(const struct umb_map_frustum *frustum, double x, double y, double depth,
                            double world[3])
{
    const double u = 2.0 * x / (double)frustum->width - 1.0;
    const double v = 2.0 * y / (double)frustum->height - 1.0;
    const double square = u * u + v * v;
    if (!(square <= 1.0)) {
        return 0;
    }
    const double r = frustum->near_m + depth * frustum->depth_m;
    const double local[3] = {2.0 * u / (1.0 + square), 2.0 * v / (1.0 + square),
                             (1.0 - square) / (1.0 + square)};
    for (int k = 0; k < 3; k++) {
        world[k] = frustum->origin[k];
        for (int i = 0; i < 3; i++) {
            world[k] += r * local[i] * frustum->world_to_map[i][k];
        }
    }
    return 1;
}

enum umb_status umb_map_frustum_point(const struct umb_map_frustum *frustum, double x, double y,
                                      double depth, double world[3])
{
    if (frustum->projection == UMB_MAP_PARABOLOID) {
        return paraboloid_point(frustum, x, y, depth, world) ? UMB_OK : UMB_E_NOT_FOUND;
    }
    /* The point is the intersection of three planes, by Cramer's rule: (m0 - x m3).p = 0, (m1 - y
     * m3).p = 0 and m2.p = depth. mi is row i of world_to_map. */
    const double(*m)[4] = frustum->world_to_map;
    const int affine = frustum->projection == UMB_MAP_AFFINE;
    const double at[3] = {x, y, depth};
    double rows[3][3], right[3], cross[3][3];
    for (int i = 0; i < 3; i++) {
        const double share = i < 2 && !affine ? at[i] : 0.0;
        for (int k = 0; k < 3; k++) {
            rows[i][k] = m[i][k] - share * m[3][k];
        }
        right[i] = i < 2 && !affine ? share * m[3][3] - m[i][3] : at[i] - m[i][3];
    }
    for (int i = 0; i < 3; i++) {
        umb__cross(rows[(i + 1) % 3], rows[(i + 2) % 3], cross[i]);
    }
    const double determinant = umb__dot(rows[0], cross[0]);
    for (int k = 0; k < 3; k++) {
        world[k] = frustum->origin[k] +
                   (right[0] * cross[0][k] + right[1] * cross[1][k] + right[2] * cross[2][k]) /
                       determinant;
        if (!isfinite(world[k])) {
            return UMB_E_NOT_FOUND;
        }
    }
    return UMB_OK;
}
