/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_VERIFY_LIGHT_FRAME_H
#define UMBRAGE_SERVER_RAYS_VERIFY_LIGHT_FRAME_H
/*
 * From voxels back to the world, and from there to the light.
 *
 * Places are local: metres relative to the asset's origin. A voxel next to a lamp may be smaller
 * than the resolution of doubles at a coordinate of 1e7 m, but not at the scene's extent.
 */
#include "umbrage/asset.h"

struct umbr_light_frame {
    double world_to_voxel[4][4]; /* row major, as the asset's frustum has it */
    double origin[3];            /* metres, world */
    double size;                 /* number of voxels a side */
    int closed;                  /* baked under the closed rule */
    int parallel;                /* 1 for a directional light: the matrix is affine */
    double step[3][3];      /* parallel: world vectors of a voxel's edges along x, y, z, metres */
    double w_first, w_last; /* else: W at z = 0 (below 0 if the eye lies within) and at z = size */
    double least_edge;      /* least edge of all its voxels, metres; 0 if the eye lies within */
};

/*
 * Reads a frustum of an asset and inverts its matrix in doubles.
 * Fails: E_ARGUMENT (no such frustum, or a matrix that has no inverse).
 */
UMB_CHECKED enum umb_status umbr_light_frame_init(struct umbr_light_frame *light_frame,
                                                  const struct umb_asset *asset, uint32_t frustum,
                                                  struct umb_error *error);

/* Computes a point's place from voxel space. Returns 0 if the point is at or behind the eye. */
int umbr_light_frame_local(const struct umbr_light_frame *light_frame, const double voxel[3],
                           double local[3]);

/* Computes a point's absolute world position from voxel space; 0 at or behind the eye. */
int umbr_light_frame_world(const struct umbr_light_frame *light_frame, const double voxel[3],
                           double world[3]);

/* Voxel space point of a place; 0 as above. */
int umbr_light_frame_voxel(const struct umbr_light_frame *light_frame, const double local[3],
                           double voxel[3]);

/* Returns W of a place: 1 for directional lights, the distance along the axis for others. */
double umbr_light_frame_w(const struct umbr_light_frame *light_frame, const double local[3]);

/* Computes the unit direction from a point to the light, and the distance along it in which a ray
 * must meet no caster for the point to be lit. For directional lights the distance is infinite. For
 * lamps it is (1 - 2^-16) of the way to the lamp: a lamp may stand exactly on a surface, which rays
 * in floats meet or miss by rounding. point: relative to the origin of the light's position. */
void umbr_towards_light(const struct umb_light_info *light, const double point[3],
                        double direction[3], double *distance_m);

#endif
