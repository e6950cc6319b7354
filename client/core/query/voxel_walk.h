/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_VOXEL_WALK_H
#define UMBRAGE_CORE_QUERY_VOXEL_WALK_H
/* Functions that start from a voxel: one goes along the light to the next shadow, one goes back to
 * world space. They serve calibration and sampling, which look for points of their own. */
#include <string.h>

#include "base/vec.h"
#include "format/content.h"
#include "query/voxel_tree.h"

/* Returns the first shadowed voxel of column (x, y) at depth z or behind; -1 if `steps` uniform
 * cubes and single voxels from z on are lit. In: x, y: inside the frustum. */
static inline int64_t umb__first_shadow(const struct umb__tree *tree, uint32_t x, uint32_t y,
                                        uint32_t z, int steps)
{
    const uint32_t size = 1U << tree->log2_size;
    struct umb_volume_stats ignored = {0};
    for (int step = 0; step < steps && z < size; step++) {
        const struct umb__place place = umb__tree_locate(tree, x, y, z, &ignored);
        if (place.brick ? !umb__brick_voxel(place.brick, x, y, z) : !place.lit) {
            return z;
        }
        z = place.brick ? z + 1 : ((z >> place.level) + 1) << place.level;
    }
    return -1;
}

/*
 * Computes the world position, relative to the asset's origin, of a position in voxel space.
 *
 * In a perspective frustum depth depends on W alone and is linear in it, so depth gives W. Then X
 * and Y are linear in the position, too. Let m0 and m1 be the first two rows of world_to_voxel: a
 * move along m0 x m1 changes only W.
 */
static inline void umb__voxel_to_world(const struct umb_frustum_info *frustum,
                                       const double voxel[3], double p[3])
{
    const double(*m)[4] = frustum->world_to_voxel;
    double w = 1, behind = voxel[2] - m[2][3], along[3];
    if (umb__is_perspective(frustum)) {
        behind *= umb__dot(m[3], m[3]) / umb__dot(m[2], m[3]);
        w = m[3][3] + behind;
        umb__cross(m[0], m[1], along);
        umb__scale(1 / umb__dot(m[3], along), along);
    } else {
        memcpy(along, frustum->voxel_step[2], sizeof along);
    }
    const double right = voxel[0] * w - m[0][3], down = voxel[1] * w - m[1][3];
    for (unsigned k = 0; k < 3; k++) {
        p[k] = right * frustum->voxel_step[0][k] + down * frustum->voxel_step[1][k] +
               behind * along[k];
    }
}

#endif
