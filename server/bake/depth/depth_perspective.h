/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_PERSPECTIVE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_PERSPECTIVE_H
/*
 * Depth of spot and point lights by scan conversion.
 *
 * The predicate of coverage.h with one change: over a projected triangle 1 / W is linear, not the
 * distance W. So the casters' third coordinate is q = c / W, with a constant c. The predicate
 * interpolates q as it does any depth (from the canonical first corner, clamped to the corners'
 * values), and z = depth_scale / q + depth_offset follows. The greatest q is at most 2^26 times the
 * least. So q is accurate to about 2^-52 of its greatest value, and z to 2^-26 of the frustum's
 * depth, far below a voxel.
 *
 * Slivers: cutting a triangle to the frustum can leave corners that differ by rounding alone. The
 * area and the gradients of such a triangle are rounding errors. A sliver as long as the frustum
 * may run through thousands of texel centres (the diagonal of a floor below a lamp).
 * umbb_perspective_prepare gives triangles narrower than 2^-49 size^2 texels the gradient along
 * their longest edge. Wider triangles have gradients accurate to an eighth of a voxel. Across a
 * sliver depth is off by its slope times 2^-49 size^2 texels, which is 2^-21 texels at 16384 voxels
 * a side.
 *
 * Order: every operation from q to lit, rounded or not, is monotone, and lit never grows with q. So
 * the greatest q of several fragments gives the least lit, and the q of a square's corner texels
 * bounds the lit of all its texels. Vector kernels therefore compare q, and divide once a texel.
 */
#include "bake/depth/coverage.h"
#include "bake/depth/tile.h"

/* The light's rays: how depth follows from a corner's third coordinate. All zeros: parallel rays,
 * the coordinate is the depth. */
struct umbb_rays {
    double scale, offset; /* z = scale / q + offset; scale is 0 for parallel rays */
    double size;          /* voxels a side of the frustum */
};

static inline struct umbb_rays umbb_rays_of(const struct umbb_casters *casters)
{
    return (struct umbb_rays){casters->depth_scale, casters->depth_offset, (double)casters->size};
}

/* Returns 1 if the rays start in one point. */
static inline int umbb_rays_meet(const struct umbb_rays *rays)
{
    return rays->scale > 0.0;
}

/* Does umbb_coverage_prepare for a caster under any kind of light. Slivers get the depth that the
 * top of this file describes. */
int umbb_perspective_prepare(const struct umbb_casters *casters, size_t triangle,
                             struct umbb_coverage *coverage);

/* If a prepared triangle is a sliver, gives it the depth that the top of this file describes.
 * corners: those from which the triangle was prepared. rays: meet in one point. */
void umbb_perspective_steady(const struct umbb_rays *rays, const double corners[3][3],
                             struct umbb_coverage *coverage);

/* Returns the number of voxels whose centre lies before a fragment with reciprocal distance q,
 * 0..size. rays: meet in one point. */
static inline int32_t umbb_reciprocal_lit(const struct umbb_rays *rays, double q)
{
    double z = rays->scale / q + rays->offset;
    z = z > 0.0 ? z : 0.0;
    return umbb_coverage_round(z < rays->size ? z : rays->size);
}

/* Returns the number of voxels of column x whose centre lies before the triangle, 0..size. row_z:
 * third coordinate of the row at the anchor's x. */
static inline int32_t umbb_rays_lit(const struct umbb_rays *rays,
                                    const struct umbb_coverage *coverage, double row_z, int32_t x)
{
    if (!umbb_rays_meet(rays)) {
        return umbb_coverage_lit(coverage, row_z, x);
    }
    double q = row_z + coverage->gradient_x * (((double)x + 0.5) - coverage->x[0]);
    q = q > coverage->z_min ? q : coverage->z_min; /* NaN becomes z_min too */
    q = q < coverage->z_max ? q : coverage->z_max;
    return umbb_reciprocal_lit(rays, q);
}

/* Returns the least lit that a fragment of a triangle can have. */
static inline int32_t umbb_rays_nearest(const struct umbb_rays *rays,
                                        const struct umbb_coverage *coverage)
{
    return umbb_rays_meet(rays) ? umbb_reciprocal_lit(rays, coverage->z_max)
                                : umbb_coverage_round(coverage->z_min);
}

/* Returns 1 if a fragment's lit never falls where the third coordinate grows along a gradient. */
static inline int umbb_rays_grow(const struct umbb_rays *rays, double gradient)
{
    return (gradient > 0.0) != umbb_rays_meet(rays);
}

#endif
