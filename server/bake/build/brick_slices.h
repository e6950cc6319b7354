/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_BRICK_SLICES_H
#define UMBRAGE_SERVER_BAKE_BUILD_BRICK_SLICES_H
/*
 * Bricks from texels: eight masks of 8x8 bits, one for each slice in depth, with the texel (x, y)
 * in bit x + 8 * y.
 *
 *     const struct umbb_slicer *slicer = umbb_slicer(umbb_vectors_best());
 *     slicer->above(lit, 8 * z, slices);                      a brick of a column
 *     z = slicer->least_from(lit, 8 * (z + 1)) / 8;           the next brick that differs
 */
#include <stdint.h>
#include "bake/base/vectors.h"

/* Two functions of the 64 integers of a block, row by row (lit or end of 8x8 texels). All
 * implementations give the same bits. In: 0 <= values, z0 <= 2^20. */
struct umbb_slicer {
    /* slices[z]: bit i is 1 where values[i] > z0 + z. */
    void (*above)(const int32_t values[64], int32_t z0, uint64_t slices[8]);
    /* Returns the least of the values that are at least z0; INT32_MAX if there is none. */
    int32_t (*least_from)(const int32_t values[64], int32_t z0);
};

/* Returns the slicer of a set of vector instructions; NULL if this build or this processor lacks
 * the set. */
const struct umbb_slicer *umbb_slicer(enum umbb_vectors vectors);

/* Plain C: the definition. */
extern const struct umbb_slicer umbb_slicer_plain;

/* Vector forms, on x86-64 only. */
extern const struct umbb_slicer umbb__slicer_avx2, umbb__slicer_avx512;

/*
 * Chooses undefined voxels so that neighbouring slices become equal.
 *
 * In:  visible[z]: voxels that must be 1. allowed[z]: voxels that may be 1 (visible or undefined);
 *      visible[z] is a subset of allowed[z].
 * Out: slices: visible[z] <= slices[z] <= allowed[z]. May be the same array as visible. The choice
 *      is greedy: a run of slices grows while one mask fits all of them, and takes the least such
 *      mask.
 */
void umbb_slices_fill(const uint64_t visible[8], const uint64_t allowed[8], uint64_t slices[8]);

#endif
