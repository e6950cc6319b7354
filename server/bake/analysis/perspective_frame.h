/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_PERSPECTIVE_FRAME_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_PERSPECTIVE_FRAME_H
/*
 * Light space of spot and point lights: position and size of the voxels of one face.
 *
 * A face looks along w and sees |u| <= t W, |v| <= t W, W being the distance along w. The frustum
 * keeps the part of the face with casters. That part is fitted on each of three axes separately:
 * the tangents u / W and v / W, and W. Depth is linear in W. The range of W is at least so wide
 * that coordinates can resolve its voxels (UMBB_VOXEL_SHARE). Part of a widened range may lie
 * behind the light, where nothing is.
 *
 * Guard band: t is widened so that at least UMBB_GUARD_TEXELS texels lie beyond the face's edge. A
 * filter window of a point inside the face then has all its texels in the face's own frustum. A
 * face that sees no caster, guard band included, is left out: no window could meet a shadow in it.
 *
 * Only additions, multiplications, divisions and square roots of doubles.
 */
#include "bake/analysis/light_frame.h"
#include "bake/depth/tile.h"

/* Half of the widest window, and some for rounding. */
#define UMBB_GUARD_TEXELS 10

/*
 * Near distance of a face, as a share of its reach along the face's axis. Casters nearer than this
 * are left out, because the division by their distance loses precision. umbb_lamp_contact finds
 * lamps with such casters.
 *
 * Why 2^-26: in a frustum of 2^18 voxels a side, rounding then moves a caster by at most 2^-8 of a
 * voxel. Across the axis, the coordinate is X / W. X has an error of about 2^-52 of `size` times
 * the reach, and W is at least 2^-26 of the reach. So the error is 2^-26 of `size` texels. Along
 * the axis, the ratio near / W runs from 1 down to 2^-26 with an error of 2^-52. So the error of W
 * is 2^-26 of W. A power of two leaves the bits of farther casters unchanged.
 */
#define UMBB_NEAR_SHARE 0x1p-26

/*
 * Least depth of a voxel, as a share of half the longest side of the casters' box. A coordinate in
 * floats, relative to the middle of the scene, has an error of 2^-25 of that half side. So a point
 * of a surface, given in floats, lies within one voxel of the surface, as the automatic bias
 * expects. In doubles the error is 2^-28 of such a voxel.
 */
#define UMBB_VOXEL_SHARE 0x1p-22

/* One face of a light. */
struct umbb_eye {
    double position[3];      /* position of the light: metres, world */
    double axes[3][3];       /* u, v, w: unit, right handed */
    double tangent;          /* t without the guard band */
    double reach;            /* metres: distance of the farthest caster, or more */
    double voxel_min;        /* metres: least depth of a voxel */
    const double *direction; /* [3] unit: direction of a spot light; NULL: a point light */
    double cone_sine;        /* sine of half the angle of a spot light's cone */
};

/* The tangent t with the guard band. */
static inline double umbb_guarded_tangent(double tangent, uint32_t log2_size)
{
    const double size = (double)((uint32_t)1 << log2_size);
    return tangent * size / (size - 2.0 * UMBB_GUARD_TEXELS - 2.0);
}

/*
 * Fits the frustum of a face.
 *
 * Out: frustum: log2_size, world_to_voxel and voxel_step set, everything else zero.
 *      Returns 1 if the face sees a caster; else 0, and the frustum is an arbitrary one.
 */
int umbb_perspective_fit(const struct umbb_fit *fit, const struct umbb_eye *eye,
                         struct umb_frustum_info *frustum);

/* Computes X, Y and W of the corners of a world triangle with the rows of a frustum's matrix. W is
 * 1 for parallel light. */
void umbb_eye_corners(const struct umb_frustum_info *frustum, const double origin[3],
                      const double triangle[3][3], double corners[3][3]);

/* World triangles as a perspective frustum's casters. */
struct umbb_projected {
    double (*corners)[3][3]; /* [count] x, y in voxels; depth as in umbb_casters with depth_scale */
    uint8_t *kinds;          /* [count] enum umbb_caster */
    uint32_t *cuts;          /* [count] index of the caster's cut; NULL if the world has none */
    size_t count, capacity;
    double depth_scale, depth_offset; /* see umbb_casters */
};

/* A fitted face that casters are projected to. */
struct umbb_eye_view {
    const struct umb_frustum_info *frustum;
    const double *origin; /* [3] metres, world: origin of the asset */
    double reach;         /* metres: as in the struct umbb_eye that the frustum was fitted to */
    size_t max_bytes;     /* limit of the projected triangles */
};

/*
 * Cuts triangles to a frustum with a margin of one voxel around it, and projects them.
 *
 * In:    world: only corners, kinds and the cuts' table of casters are read.
 * Out:   projected: to be finished after any result.
 * Fails: E_NO_MEMORY, E_LIMIT (max_bytes).
 */
UMB_CHECKED enum umb_status umbb_perspective_project(const struct umbb_casters *world,
                                                     const struct umbb_eye_view *view,
                                                     struct umbb_projected *projected,
                                                     struct umb_error *error);
void umbb_projected_finish(struct umbb_projected *projected);

#endif
