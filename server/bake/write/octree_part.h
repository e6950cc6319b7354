/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_OCTREE_PART_H
#define UMBRAGE_SERVER_BAKE_WRITE_OCTREE_PART_H
/*
 * The part of an octree that a self-check of a few tiles reads.
 *
 * After an edit the self-check compares the voxels of the tiles that were baked again. To lay the
 * whole octree out for this would take as long as to bake them.
 */
#include "bake/tiles/proofs.h"
#include "format/octree.h"

/* Returns 1 if the part is small enough to be worth its copy: at most a quarter of all tiles. */
int umbb_octree_part_pays(const struct umbb_proofs *proofs);

/*
 * Copies the part of an octree over the tiles that were not inherited, and over the eight tiles
 * around each of them, whose voxels the judgement of a boundary may read.
 *
 * In:    octree: canonical, one root a frustum of the records. proofs: after the bake.
 * Out:   part: with the octree's roots and allocator; voxels of other tiles are shadowed or as
 *        in the octree. Finish it also after a failure.
 * Fails: E_NO_MEMORY.
 * Cost:  linear in the nodes copied, and 4 bytes of address space a node of the octree.
 */
UMB_CHECKED enum umb_status umbb_octree_part(const struct umb__octree *octree,
                                             const struct umbb_proofs *proofs,
                                             struct umb__octree *part, struct umb_error *error);

#endif
