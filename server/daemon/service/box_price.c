/* SPDX-License-Identifier: Apache-2.0 */
/* See box_price.h. */
#include "daemon/service/box_price.h"

#include <math.h>

double umbd_box_bricks(const struct umb_frustum_info *frustum, const struct umb_box *box)
{
    const double across = (double)((uint64_t)1 << frustum->log2_size) / UMBD_BRICK_VOXELS;
    const double most = 6 * across * across;
    /* density: number of bricks cut by each unit of area, for a plane across each world axis. */
    double volume = 1, cut = 0, edge[3], density[3] = {0};
    for (size_t i = 0; i < 3; i++) {
        const double *step = frustum->voxel_step[i];
        volume *=
            UMBD_BRICK_VOXELS * sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
        edge[i] = box->max[i] - box->min[i];
    }
    for (size_t i = 0; i < 3; i++) {
        for (size_t k = 0; k < 3; k++) {
            density[k] += fabs(frustum->voxel_step[i][k]) * UMBD_BRICK_VOXELS / volume;
        }
    }
    for (size_t k = 0; k < 3; k++) {
        cut += 2 * edge[(k + 1) % 3] * edge[(k + 2) % 3] * density[k];
    }
    return cut < most ? cut : most; /* NaN too gives most; it is refused later */
}
