/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_VOLUME_PARTS_H
#define UMBRAGE_CORE_QUERY_VOLUME_PARTS_H
/* What struct umb_volume holds, and the transform that its questions share. */
#include <math.h>
#include <string.h>
#include "query/voxel_tree.h"

#define UMB__FACES_MAX 6

struct umb__volume {
    struct umb__tree tree; /* of the first frustum */
    /* Spot and point lights; then what is of one frustum below is the first one's. */
    const struct umb_frustum_info *faces; /* [face_count] */
    const struct umb__top *tops;          /* [face_count] */
    const uint32_t *grid;                 /* of the asset */
    uint32_t face_count;                  /* 0: a directional light */
    double position[3];                   /* of the light, minus the asset's origin */
    uint32_t light;
    int closed;
    int translucent;                      /* casters that are no voxels stand before the light */
    const uint32_t *occluder_depth;       /* format/occluder_depth.h; NULL: not kept */
    const uint32_t *occluder_depth_roots; /* [faces] of the frusta */
    double world_to_voxel[3][4];          /* from world minus origin */
    double voxel_step[3][3];              /* row i: world vector of one voxel along axis i */
    double origin[3];                     /* the asset's */
};

_Static_assert(sizeof(struct umb__volume) <= sizeof(struct umb_volume), "opaque volume too small");

/* A copy, since the caller's storage has no type of its own. */
static inline struct umb__volume umb__volume_of(const struct umb_volume *volume)
{
    struct umb__volume v;
    memcpy(&v, volume->opaque, sizeof v);
    return v;
}

/* The tree of a face; 0 of a directional light. */
static inline struct umb__tree umb__volume_tree(const struct umb__volume *volume, uint32_t face)
{
    struct umb__tree tree = volume->tree;
    if (volume->face_count > 0) {
        tree.grid = volume->grid + volume->tops[face].first_cell;
        tree.log2_size = volume->faces[face].log2_size;
        tree.grid_log2 = volume->tops[face].grid_log2;
    }
    return tree;
}

/* Depth z of a face is linear in its W: W = scale z + offset. A scale of 0: it is not. */
static inline void umb__face_depth(const struct umb_frustum_info *face, double *scale,
                                   double *offset)
{
    const double *z = face->world_to_voxel[2], *w = face->world_to_voxel[3];
    const double along = w[0] * z[0] + w[1] * z[1] + w[2] * z[2];
    *scale = along > 0 ? (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) / along : 0;
    *offset = w[3] - *scale * z[3];
}

/* W where a face's frustum begins; next to nothing where that is at the light or behind it. */
static inline double umb__face_first_w(const struct umb_frustum_info *face)
{
    double scale, offset;
    umb__face_depth(face, &scale, &offset);
    const double least = (scale * (double)((uint64_t)1 << face->log2_size)) * 0x1p-40;
    return offset > least ? offset : least;
}

/* p: world minus the asset's origin; of a directional light. */
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

/* umb_segments_check for pairs of corners, named as boxes. */
UMB_CHECKED enum umb_status umb__corners_check(const struct umb_segments *corners,
                                               struct umb_error *error);

#endif
