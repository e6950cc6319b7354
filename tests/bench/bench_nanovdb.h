/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_NANOVDB_H
#define UMBRAGE_TESTS_BENCH_NANOVDB_H
/*
 * The rows that race a sparse volume (study/nanovdb_peer.h): an asset's voxels in a mask grid of
 * NanoVDB, the same points, one tap and 9 x 9. Named pcf9_vs_nanovdb is the grid used as its
 * interface offers, tap by tap through an accessor; pcf9_vs_nanovdb_leaves counts in its leaves.
 */
#include "bench_points.h"
#include "bench_scene.h"

/* `name` is that of the case. The scene has 4096 voxels a side at most. */
void bench_nanovdb(const char *name, const struct bench_scene *scene,
                   const struct bench_asset *asset, const struct bench_points *points);

#endif
