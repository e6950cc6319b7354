/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BAKE_RACE_H
#define UMBRAGE_TESTS_BAKE_RACE_H
/*
 * Whole bakes, from triangles in voxel space to packed bytes, against Embree's rays:
 *
 *   bake_vs_embree_rays  seconds of Embree for one ray a covered texel (embree_peer.h, at the rate
 *                        of 512 random windows of 256 x 256 texels; the covered share of the map is
 *                        that at 4096) over seconds of the bake, both of one thread's CPU time
 *   threads2_vs_1        wall seconds of one thread over those of two
 *   peak_mib             resident memory over that before the bake, one thread
 *
 * Each figure is the median of three rounds: Embree, a bake by one thread, one by two, Embree
 * again; a round's Embree is the better of the two around the bake. Each runs in a process of its
 * own, so that none finds memory that another left.
 */
#include "bench_scene.h"

/* Prints the rows of a scene under a rule. with_threads: also threads2_vs_1. */
void bake_race(const struct bench_scene *scene, int closed_rule, const char *name,
               int with_threads);

#endif
