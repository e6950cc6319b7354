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
 * The code is plain C with one division for each covered texel.
 */
#include "bake/depth/coverage.h"
#include "bake/depth/tile.h"

/* umbb_coverage_prepare for a caster of any kind of light, with the depth of slivers as above. */
int umbb_perspective_prepare(const struct umbb_casters *casters, size_t triangle,
                             struct umbb_coverage *coverage);

/* Returns the number of voxels of column x whose centre lies before the triangle, 0..size. row_z:
 * depth of the row at the anchor's x. casters->depth_scale must be above 0. */
static inline int32_t umbb_perspective_lit(const struct umbb_casters *casters,
                                           const struct umbb_coverage *coverage, double row_z,
                                           int32_t x)
{
    double q = row_z + coverage->gradient_x * (((double)x + 0.5) - coverage->x[0]);
    q = q > coverage->z_min ? q : coverage->z_min; /* NaN becomes z_min too */
    q = q < coverage->z_max ? q : coverage->z_max;
    const double size = (double)casters->size;
    double z = casters->depth_scale / q + casters->depth_offset;
    z = z > 0.0 ? z : 0.0;
    return umbb_coverage_round(z < size ? z : size);
}

/* Calls umbb_perspective_lit or umbb_coverage_lit, as the casters' kind of light demands. */
static inline int32_t umbb_caster_lit(const struct umbb_casters *casters,
                                      const struct umbb_coverage *coverage, double row_z, int32_t x)
{
    return casters->depth_scale > 0.0 ? umbb_perspective_lit(casters, coverage, row_z, x)
                                      : umbb_coverage_lit(coverage, row_z, x);
}

#endif
