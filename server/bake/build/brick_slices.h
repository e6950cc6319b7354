/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_BRICK_SLICES_H
#define UMBRAGE_SERVER_BAKE_BUILD_BRICK_SLICES_H
/*
 * Bricks from texels: eight masks of 8x8 bits, one a depth slice, bit x + 8 * y.
 */
#include <stdint.h>

/*
 * Compares 64 integers with eight depths.
 *
 * In:  values: int32[64], row by row (lit or end of an 8x8 block). z0: first voxel of the brick.
 * Out: slices[z]: bit i is 1 where values[i] > z0 + z.
 */
void umbb_slices_above(const int32_t values[64], int32_t z0, uint64_t slices[8]);

/* The same in plain C: the definition, and what processors without vectors of 16 bytes run. */
void umbb_slices_above_plain(const int32_t values[64], int32_t z0, uint64_t slices[8]);

/*
 * Chooses undefined voxels so that neighbouring slices become equal.
 *
 * In:  visible[z]: voxels that must be 1. allowed[z]: voxels that may be 1 (visible or undefined);
 *      visible[z] is a subset of allowed[z].
 * Out: slices[z], visible[z] <= slices[z] <= allowed[z]. May be the same array as visible.
 * Greedy: a run of slices is extended while some mask fits them all; it takes the least such mask.
 */
void umbb_slices_fill(const uint64_t visible[8], const uint64_t allowed[8], uint64_t slices[8]);

#endif
