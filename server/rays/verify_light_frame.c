/* SPDX-License-Identifier: Apache-2.0 */
/* Inverse frustum transforms: three equations in three unknowns, solved by minors. */
#include "rays/verify_light_frame.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* Share of the way to a lamp that must be free. A surface beyond this share may be the one that the
 * lamp stands on, which float rays meet or miss by rounding. */
#define FREE_SHARE (1.0 - 0x1p-16)

/*
 * Solves for the point of voxel (x, y, z): X = x W, Y = y W and Z = z are three linear equations.
 * Returns 0 if they have no unique solution.
 */
static int solve(const struct umbr_light_frame *light_frame, const double voxel[3], double at[3])
{
    const double(*m)[4] = light_frame->world_to_voxel;
    double row[3][3], value[3], minors[3][3];
    for (int i = 0; i < 3; i++) {
        const double share = i < 2 ? voxel[i] : 0; /* share of W */
        for (int k = 0; k < 3; k++) {
            row[i][k] = m[i][k] - share * m[3][k];
        }
        value[i] = (i < 2 ? share * m[3][3] : voxel[2]) - m[i][3];
    }
    for (int i = 0; i < 3; i++) {
        umb__cross(row[(i + 1) % 3], row[(i + 2) % 3], minors[i]);
    }
    const double determinant =
        row[0][0] * minors[0][0] + row[0][1] * minors[0][1] + row[0][2] * minors[0][2];
    for (int k = 0; k < 3; k++) {
        at[k] = (value[0] * minors[0][k] + value[1] * minors[1][k] + value[2] * minors[2][k]) /
                determinant;
    }
    return isfinite(at[0]) && isfinite(at[1]) && isfinite(at[2]);
}

/* Inverts an affine matrix once, by minors as in solve: millions of points use the result. */
static void invert_parallel(struct umbr_light_frame *light_frame)
{
    const double(*m)[4] = light_frame->world_to_voxel;
    light_frame->parallel = m[3][0] == 0 && m[3][1] == 0 && m[3][2] == 0 && m[3][3] == 1;
    for (int i = 0; i < 3 && light_frame->parallel; i++) {
        const double *row = m[i];
        double *step = light_frame->step[i];
        umb__cross(m[(i + 1) % 3], m[(i + 2) % 3], step);
        const double determinant = row[0] * step[0] + row[1] * step[1] + row[2] * step[2];
        for (int k = 0; k < 3; k++) {
            step[k] /= determinant;
        }
    }
}

double umbr_light_frame_w(const struct umbr_light_frame *light_frame, const double local[3])
{
    const double *w = light_frame->world_to_voxel[3];
    return w[3] + (w[0] * local[0] + w[1] * local[1] + w[2] * local[2]);
}

/* Edges of the smallest voxel: those of a perspective grow with W. */
static void measure(struct umbr_light_frame *light_frame, const struct umb_frustum_info *info)
{
    const double *z = light_frame->world_to_voxel[2], *w = light_frame->world_to_voxel[3];
    double edge[3];
    for (int i = 0; i < 3; i++) {
        edge[i] = umb__length(info->voxel_step[i]);
    }
    if (!light_frame->parallel) { /* Z = rate W + offset */
        const double rate = umb__dot(z, w) / umb__dot(w, w), offset = z[3] - rate * w[3];
        light_frame->w_first = -offset / rate;
        light_frame->w_last = (light_frame->size - offset) / rate;
        edge[0] *= fmax(light_frame->w_first, 0);
        edge[1] *= fmax(light_frame->w_first, 0);
    }
    light_frame->least_edge = fmin(fmin(edge[0], edge[1]), edge[2]);
}

enum umb_status umbr_light_frame_init(struct umbr_light_frame *light_frame,
                                      const struct umb_asset *asset, uint32_t frustum,
                                      struct umb_error *error)
{
    struct umb_frustum_info info;
    struct umb_asset_info about;
    if (umb_asset_get_frustum(asset, frustum, &info) != UMB_OK) {
        return umb_fail(error, UMB_E_ARGUMENT, "frustum %u is not in the asset", frustum);
    }
    umb_asset_get_info(asset, &about);
    memcpy(light_frame->origin, about.origin, sizeof light_frame->origin);
    light_frame->size = (double)(UINT64_C(1) << info.log2_size);
    light_frame->closed = info.closed;
    memcpy(light_frame->world_to_voxel, info.world_to_voxel, sizeof light_frame->world_to_voxel);
    const double middle[3] = {0.5 * light_frame->size, 0.5 * light_frame->size,
                              0.5 * light_frame->size};
    double at[3];
    if (!solve(light_frame, middle, at)) {
        return umb_fail(error, UMB_E_ARGUMENT, "the matrix of frustum %u has no inverse", frustum);
    }
    invert_parallel(light_frame);
    measure(light_frame, &info);
    return UMB_OK;
}

int umbr_light_frame_local(const struct umbr_light_frame *light_frame, const double voxel[3],
                           double local[3])
{
    if (light_frame->parallel) {
        double along[3];
        for (int i = 0; i < 3; i++) {
            along[i] = voxel[i] - light_frame->world_to_voxel[i][3];
        }
        for (int k = 0; k < 3; k++) {
            local[k] = along[0] * light_frame->step[0][k] + along[1] * light_frame->step[1][k] +
                       along[2] * light_frame->step[2][k];
        }
        return isfinite(local[0]) && isfinite(local[1]) && isfinite(local[2]);
    }
    return solve(light_frame, voxel, local) && umbr_light_frame_w(light_frame, local) > 0;
}

int umbr_light_frame_world(const struct umbr_light_frame *light_frame, const double voxel[3],
                           double world[3])
{
    double local[3];
    const int inside = umbr_light_frame_local(light_frame, voxel, local);
    for (int k = 0; k < 3; k++) {
        world[k] = light_frame->origin[k] + local[k];
    }
    return inside;
}

void umbr_towards_light(const struct umb_light_info *light, const double point[3],
                        double direction[3], double *distance_m)
{
    double length = 0;
    for (int i = 0; i < 3; i++) {
        direction[i] = light->kind == UMB_LIGHT_DIRECTIONAL ? -light->direction[i]
                                                            : light->position[i] - point[i];
        length += direction[i] * direction[i];
    }
    length = sqrt(length);
    for (int i = 0; i < 3; i++) {
        direction[i] = length > 0 ? direction[i] / length : 0;
    }
    *distance_m = light->kind == UMB_LIGHT_DIRECTIONAL ? INFINITY : length * FREE_SHARE;
}

int umbr_light_frame_voxel(const struct umbr_light_frame *light_frame, const double local[3],
                           double voxel[3])
{
    const double w = light_frame->parallel ? 1 : umbr_light_frame_w(light_frame, local);
    for (int i = 0; i < 3; i++) {
        const double *m = light_frame->world_to_voxel[i];
        voxel[i] = m[3] + umb__dot(m, local);
        voxel[i] /= i < 2 ? w : 1; /* depth is linear */
    }
    return w > 0;
}
