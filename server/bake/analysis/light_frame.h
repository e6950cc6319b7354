/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_LIGHT_FRAME_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_LIGHT_FRAME_H
/*
 * Light space of a directional light: position and size of the voxels of its frustum.
 *
 * The frame's axes are u, v across the light and w along it, right handed (u x v = w). The box of
 * all casters is fitted on each axis separately, so voxels are boxes, not cubes. Casters keep a
 * distance of about one voxel from the border. Only additions, multiplications, divisions and
 * square roots of doubles: the same bits on every machine.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"

/* Limit of coordinates (metres): a voxel must stay far above the resolution of doubles. */
#define UMBB_WORLD_MAX 1e12

/*
 * Computes sine and cosine of an angle, exact at multiples of 90. libm is not used: its last bit
 * differs between machines, and the direction enters an asset's id.
 */
void umbb_sin_cos_degrees(double degrees, double *sine, double *cosine);

/* Direction of the light from the sun: unit length. */
void umbb_sun_direction(double azimuth_deg, double elevation_deg, int z_up, double direction[3]);

/* Computes the unit direction of the light in the scene. east_north_up: vector towards the sun.
 * z_up: 1 if z is the scene's up axis, 0 if y is. */
void umbb_compass_direction(const double east_north_up[3], int z_up, double direction[3]);

/* Normalises a direction. Returns 0 if it has no usable length. */
int umbb_direction_normalise(double direction[3]);

/* Least length of a frustum's axis as a share of the longest one: a flat scene still gets voxels of
 * some depth. */
#define UMBB_EXTENT_SHARE_MIN (1.0 / 1024.0)

/* Least and greatest coordinate along an axis; an empty extent is {INFINITY, -INFINITY}. */
struct umbb_extent {
    double low, high;
};

static inline void umbb_extent_add(struct umbb_extent *extent, double value)
{
    extent->low = value < extent->low ? value : extent->low;
    extent->high = value > extent->high ? value : extent->high;
}

/* Returns the number of voxels per unit of length along an axis, with a margin of one voxel at both
 * ends. least: least length of the axis. size: number of voxels along the axis. offset: receives
 * the voxel coordinate of zero. */
double umbb_extent_scale(const struct umbb_extent *extent, double least, double size,
                         double *offset);

/* Makes unit axes u, v, w from w, right handed: u is perpendicular to w and to the world axis with
 * the smallest part in w. */
void umbb_light_axes(const double w[3], double axes[3][3]);

/* Checks that all corners are finite and within UMBB_WORLD_MAX. Fails: E_BAD_SCENE. */
UMB_CHECKED enum umb_status umbb_world_check(const double (*corners)[3][3], size_t count,
                                             struct umb_error *error);

/* World triangles that frusta are fitted to. */
struct umbb_fit {
    const double (*corners)[3][3]; /* [count] checked by umbb_world_check */
    size_t count;                  /* above 0 */
    const double *origin;          /* [3] metres, world: origin of the asset */
    uint32_t log2_size;            /* voxels a side of a frustum, log2 */
    unsigned threads;              /* threads that share the corners; 0 = 1 */
};

/*
 * Fits the frustum of a directional light. The result is the same for any number of threads.
 *
 * In:    direction: of unit length.
 * Out:   frustum: log2_size, world_to_voxel and voxel_step set, everything else zero.
 * Fails: E_BAD_SCENE (the casters have no extent).
 */
UMB_CHECKED enum umb_status umbb_light_frame_fit(const struct umbb_fit *fit,
                                                 const double direction[3],
                                                 struct umb_frustum_info *frustum,
                                                 struct umb_error *error);

/* Moves world triangles to voxel space in place. */
void umbb_light_frame_apply(const struct umb_frustum_info *frustum, const double origin[3],
                            double (*corners)[3][3], size_t count);

#endif
