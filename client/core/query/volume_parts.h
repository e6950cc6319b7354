/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_VOLUME_PARTS_H
#define UMBRAGE_CORE_QUERY_VOLUME_PARTS_H
/* What struct umb_volume holds, and the transform that its questions share. */
#include <math.h>
#include <string.h>
#include "query/voxel_tree.h"

struct umb__volume {
    struct umb__tree tree;
    uint32_t light;
    int closed;
    int translucent; /* casters that are no voxels stand before the light */
    const uint32_t *front; /* format/front.h; NULL: not kept */
    uint32_t front_root;   /* of the frustum */
    double world_to_voxel[3][4]; /* from world minus origin */
    double voxel_step[3][3];     /* row i: world vector of one voxel along axis i */
    double origin[3];            /* the asset's */
};

_Static_assert(sizeof(struct umb__volume) <= sizeof(struct umb_volume), "opaque volume too small");

/* A copy, since the caller's storage has no type of its own. */
static inline struct umb__volume umb__volume_of(const struct umb_volume *volume)
{
    struct umb__volume v;
    memcpy(&v, volume->opaque, sizeof v);
    return v;
}

/* p: world minus the asset's origin. */
static inline void umb__volume_to_voxel(const struct umb__volume *volume, const double p[3],
                                        double v[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *m = volume->world_to_voxel[axis];
        v[axis] = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
    }
}

/* Number `index` of an unaligned array of floats or doubles. */
static inline double umb__scalar_at(const void *array, enum umb_point_format format, size_t index)
{
    if (format == UMB_POINT_F32) {
        float value;
        memcpy(&value, (const uint8_t *)array + index * sizeof value, sizeof value);
        return (double)value;
    }
    double value;
    memcpy(&value, (const uint8_t *)array + index * sizeof value, sizeof value);
    return value;
}

#endif
