/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_YARDSTICK_2014_H
#define UMBRAGE_TESTS_YARDSTICK_2014_H
/*
 * Computes the bytes of voxels in the encoding of Sintorn et al. 2014, with which the size rows
 * compare assets.
 *
 * A node is a 4-byte mask (two bits a child) and 4 bytes for each mixed child; the lowest nodes
 * have the eight 8x8x1 slices of a brick as children, and slices are shared 8-byte leaves. Equal
 * nodes and equal leaves exist once. The closed rule of 2014, for nodes and for slices: one that is
 * wholly undefined takes its neighbours' state; one that has only lit and undefined voxels becomes
 * lit; one that has only shadowed and undefined voxels becomes shadowed. In a slice with lit and
 * shadowed voxels the undefined ones are shadowed.
 *
 * Source: Sintorn, Kampe, Olsson, Assarsson, "Compact Precomputed Voxelized Shadows", 2014,
 * sections 5 and 6.1.
 */
#include "bench_scene.h"
#include "format/octree.h"

struct yardstick_2014 {
    uint64_t bytes;
    uint64_t nodes;  /* level 4 and up */
    uint64_t bricks; /* level 3 */
    uint64_t leaves;
};

/*
 * Builds the octree by plain recursion over each tile's bounds, apart from the product's builder,
 * and counts.
 */
struct yardstick_2014 yardstick_2014_count(const struct bench_scene *scene, int closed_rule);

/* Builds the octree alone; umb__octree_finish frees it. */
void yardstick_2014_octree(const struct bench_scene *scene, int closed_rule,
                           struct umb__octree *octree);

#endif
