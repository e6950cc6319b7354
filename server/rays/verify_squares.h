/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_VERIFY_SQUARES_H
#define UMBRAGE_SERVER_RAYS_VERIFY_SQUARES_H
/*
 * Comparing all voxels of some squares of a frustum with traced rays.
 *
 * umbr_verify draws points at random, and one wrong voxel among 10^12 escapes it. Here every column
 * of a square has rays of its own, and every voxel of the column is compared, so one wrong voxel
 * farther than a voxel from a true boundary is always found. A self-check uses this for the part of
 * an asset that an edit changed (bake/write/self_check.h).
 *
 * A ray through a column's centre finds the first surface, and behind it the end of the first
 * closed solid. Voxels before the first must be lit, voxels behind the second shadowed. Uniform
 * cubes and bricks are compared as a whole with the extremes of 8 x 8 columns. A voxel that
 * contradicts its column is judged like any point of verify.h, by its centre: it may lie in a later
 * solid, or within a voxel of a boundary beside it.
 */
#include "rays/verify.h"

/* Texels a side of a square. */
#define UMBR_SQUARE 64

struct umbr_square {
    uint32_t frustum; /* number in the asset, one of the light's */
    uint32_t x, y;    /* first texel, multiples of UMBR_SQUARE */
};

struct umbr_squares_result {
    struct umbr_verify_result found; /* records: columns traced; points: voxels judged one by one */
    /* 1: too many voxels had to be judged one by one, and some were left out. The squares are then
     * not proven. */
    int gave_up;
};

/*
 * Verifies squares of one light.
 *
 * In:    rays: all casters that may meet a column of the squares or of the texels beside them.
 *        options: closed, threads and cancelled are read.
 * Out:   result: zeroed on failure. After the first disagreement outside the band the rest is left
 *        out.
 * Fails: as umbr_verify; E_UNSUPPORTED also for frusta smaller than a square.
 * Cost:  0.3 to 1 us a column on one processor.
 */
UMB_CHECKED enum umb_status
umbr_verify_squares(const struct umb_asset *asset, uint32_t light, const struct umbr_rays *rays,
                    const struct umbr_verify_options *options, const struct umbr_square *squares,
                    size_t count, struct umbr_squares_result *result, struct umb_error *error);

/*
 * Verifies all squares of one light, row by row of squares.
 *
 * In:    options: as for umbr_verify_squares; progress gets columns.
 * Out:   result: records: columns; points: voxels that were judged one by one. After the first row
 *        with a disagreement outside the band the rest of its face is left out.
 * Fails: as umbr_verify_squares; E_UNSUPPORTED also for an asset under the static rule; E_LIMIT
 *        (too many voxels of a row must be judged one by one).
 */
UMB_CHECKED enum umb_status umbr_verify_voxels(const struct umb_asset *asset, uint32_t light,
                                               const struct umbr_rays *rays,
                                               const struct umbr_verify_options *options,
                                               struct umbr_verify_result *result,
                                               struct umb_error *error);

/* Number of columns of all faces of a light. */
uint64_t umbr_columns_of(const struct umb_asset *asset, uint32_t light);

#endif
