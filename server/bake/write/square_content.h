/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_SQUARE_CONTENT_H
#define UMBRAGE_SERVER_BAKE_WRITE_SQUARE_CONTENT_H
/*
 * Digest of the voxels of one square of a frustum, as an opened asset has them. Equal voxels give
 * equal digests, whatever stands beside the square and however nodes are numbered.
 */
#include "bake/tiles/proofs.h"
#include "query/voxel_tree.h"

/*
 * Computes the digest of a square's casters and voxels.
 *
 * In:    tree: the frustum's. x, y: first texel, a multiple of the square's side, which is
 *        1 << log2 texels, at least 64. casters: digest of the square's casters (caster_bytes.h).
 * Cost:  linear in the cubes and bricks of the square.
 */
void umbb_square_digest(const struct umb__tree *tree, uint32_t x, uint32_t y, uint32_t log2,
                        const uint8_t casters[UMBB_SQUARE_DIGEST],
                        uint8_t digest[UMBB_SQUARE_DIGEST]);

#endif
