/* SPDX-License-Identifier: Apache-2.0 */
/* Inverse frustum transforms, by Gauss-Jordan elimination with partial pivoting. */
#include "rays/verify_frame.h"

#include <math.h>
#include <string.h>

static int invert(const double matrix[4][4], double inverse[4][4])
{
    double work[4][8];
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < 4; k++) {
            work[i][k] = matrix[i][k];
            work[i][k + 4] = i == k;
        }
    }
    for (int column = 0; column < 4; column++) {
        int best = column;
        for (int i = column + 1; i < 4; i++) {
            best = fabs(work[i][column]) > fabs(work[best][column]) ? i : best;
        }
        double pivot = work[best][column];
        if (!(fabs(pivot) > 0) || !isfinite(pivot)) {
            return 0;
        }
        for (int k = 0; k < 8; k++) {
            double keep = work[best][k];
            work[best][k] = work[column][k];
            work[column][k] = keep / pivot;
        }
        for (int i = 0; i < 4; i++) {
            double factor = work[i][column];
            for (int k = 0; k < 8 && i != column; k++) {
                work[i][k] -= factor * work[column][k];
            }
        }
    }
    for (int i = 0; i < 4; i++) {
        memcpy(inverse[i], &work[i][4], 4 * sizeof(double));
    }
    return 1;
}

enum umb_status umbr_frame_init(struct umbr_frame *frame, const struct umb_asset *asset,
                                uint32_t frustum, struct umb_error *error)
{
    struct umb_frustum_info info;
    struct umb_asset_info about;
    if (umb_asset_get_frustum(asset, frustum, &info) != UMB_OK) {
        return umb_fail(error, UMB_E_ARGUMENT, "frustum %u is not in the asset", frustum);
    }
    umb_asset_get_info(asset, &about);
    memcpy(frame->origin, about.origin, sizeof frame->origin);
    frame->size = (double)(UINT64_C(1) << info.log2_size);
    frame->closed = info.closed;
    if (!invert((const double(*)[4])info.world_to_voxel, frame->voxel_to_world)) {
        return umb_fail(error, UMB_E_ARGUMENT, "the matrix of frustum %u has no inverse", frustum);
    }
    return UMB_OK;
}

int umbr_frame_world(const struct umbr_frame *frame, const double voxel[3], double world[3])
{
    double out[4];
    for (int i = 0; i < 4; i++) {
        const double *row = frame->voxel_to_world[i];
        out[i] = row[0] * voxel[0] + row[1] * voxel[1] + row[2] * voxel[2] + row[3];
    }
    for (int i = 0; i < 3; i++) {
        world[i] = frame->origin[i] + out[i] / out[3];
        if (!isfinite(world[i])) {
            return 0;
        }
    }
    return out[3] > 0;
}

void umbr_towards_light(const struct umb_light_info *light, const double world[3],
                        double direction[3], double *distance_m)
{
    double length = 0;
    for (int i = 0; i < 3; i++) {
        direction[i] = light->kind == UMB_LIGHT_DIRECTIONAL ? -light->direction[i]
                                                            : light->position[i] - world[i];
        length += direction[i] * direction[i];
    }
    length = sqrt(length);
    for (int i = 0; i < 3; i++) {
        direction[i] = length > 0 ? direction[i] / length : 0;
    }
    *distance_m = light->kind == UMB_LIGHT_DIRECTIONAL ? INFINITY : length;
}
