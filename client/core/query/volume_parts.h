/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_VOLUME_PARTS_H
#define UMBRAGE_CORE_QUERY_VOLUME_PARTS_H
/* Content of struct umb_volume, and the transform that volume queries share. */
#include "query/query_parts.h"

#define UMB__FACES_MAX 6

struct umb__volume {
    struct umb__tree tree; /* Tree of the first frustum */
    /* Faces of spot and point lights. The fields about a frustum are those of the first. */
    const struct umb_frustum_info *faces; /* [face_count] */
    const struct umb__top *tops;          /* [face_count] */
    const uint32_t *grid;                 /* Grid section of the asset */
    uint32_t face_count;                  /* Number of faces; 0: a directional light */
    double position[3];                   /* Position of the light, minus the asset's origin */
    uint32_t light;
    int closed;
    int translucent;                      /* 1: the light has translucent casters, which are not
                                             voxels */
    const uint32_t *occluder_depth;       /* Occluder depth map, format/occluder_depth.h; NULL:
                                             none */
    const uint32_t *occluder_depth_roots; /* Roots of the frusta in that map, one a face */
    double world_to_voxel[3][4];          /* Transform from world minus origin to voxels */
    double voxel_step[3][3];              /* World vector of one voxel; row i: along axis i */
    double origin[3];                     /* Origin of the asset */
};

_Static_assert(sizeof(struct umb__volume) <= sizeof(struct umb_volume), "opaque volume too small");

/* Returns a copy of the content: the caller's storage is plain words, which cannot be read as this
 * struct. */
static inline struct umb__volume umb__volume_of(const struct umb_volume *volume)
{
    struct umb__volume v;
    memcpy(&v, volume->opaque, sizeof v);
    return v;
}

/* Returns the tree of a face; face 0 of a directional light. */
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

/* Computes the linear relation of depth z and W in a face: W = scale z + offset. A scale of 0 means
 * that it is not linear. */
static inline void umb__face_depth(const struct umb_frustum_info *face, double *scale,
                                   double *offset)
{
    const double *z = face->world_to_voxel[2], *w = face->world_to_voxel[3];
    const double along = umb__dot(w, z);
    *scale = along > 0 ? umb__dot(w, w) / along : 0;
    *offset = w[3] - *scale * z[3];
}

/* Returns W at a face's near plane. If that plane is at the light or behind it, returns a tiny
 * positive number. */
static inline double umb__face_first_w(const struct umb_frustum_info *face)
{
    double scale, offset;
    umb__face_depth(face, &scale, &offset);
    const double least = (scale * (double)((uint64_t)1 << face->log2_size)) * 0x1p-40;
    return offset > least ? offset : least;
}

/* Transforms p to voxel space under a directional light. In: p: metres from the asset's origin. */
static inline void umb__volume_to_voxel(const struct umb__volume *volume, const double p[3],
                                        double v[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        v[axis] = umb__affine(volume->world_to_voxel[axis], p);
    }
}

/* Does what umb_segments_check does, for pairs of corners; error messages say "boxes". */
UMB_CHECKED enum umb_status umb__corners_check(const struct umb_segments *corners,
                                               struct umb_error *error);

#endif
