/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_NANOVDB_H
#define UMBRAGE_TESTS_BENCH_NANOVDB_H
/*
 * The rows that race queries of an asset against the same voxels in a mask grid of NanoVDB
 * (study/nanovdb_peer.h), on the same points, with one tap and with 9 x 9. In pcf9_vs_nanovdb the
 * grid is read tap by tap through an accessor, as its interface offers; in pcf9_vs_nanovdb_leaves
 * lit voxels are counted in its leaves.
 */
#include "bench_points.h"
#include "bench_scene.h"

/* `name` is that of the case. The scene has 4096 voxels a side at most. */
void bench_nanovdb(const char *name, const struct bench_scene *scene,
                   const struct bench_asset *asset, const struct bench_points *points);

#endif
