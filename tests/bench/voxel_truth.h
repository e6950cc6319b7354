/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_VOXEL_TRUTH_H
#define UMBRAGE_TESTS_VOXEL_TRUTH_H
/*
 * Counts wrong voxels of an asset near the boundaries, where voxels can be wrong.
 *
 * The truth is the oracle's (tests/oracle/oracle_depth.h): lit and end of every texel of random
 * rows, in long double, without a line of the product. The asset is read through its public query,
 * one tap, no bias, at the centres of all voxels within eight of lit or of end. Texels that the
 * oracle calls a tie, and undefined voxels, are left out.
 */
#include "bench_scene.h"

struct voxel_truth_result {
    uint64_t samples, wrong, ties;
};

/* Compares at least `samples` voxels of each asset: 0 open (left out if its asset is NULL), 1
 * closed. */
void voxel_truth_compare(const struct bench_scene *scene, const struct bench_asset assets[2],
                         uint64_t samples, struct voxel_truth_result results[2]);

#endif
