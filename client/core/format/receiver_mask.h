/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_RECEIVER_MASK_H
#define UMBRAGE_CORE_FORMAT_RECEIVER_MASK_H
/*
 * The receiver mask of an asset baked under the static rule: the cells that hold receivers. It is
 * the entry NEAR of the canonical block (docs/reference/umb-format.md, section 3).
 *
 * The static rule leaves voxels undefined that no point on a surface reads. With the mask, queries
 * count points elsewhere as undefined. A frustum has 64 cells a side, each of which is one bit of
 * the mask. A cell is marked if the look-up of some point on a surface may lie in it, with any bias
 * up to that of the widest window.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define UMB__RECEIVER_MASK_LOG2 6U /* Logarithm of the cells a side: 64 */
/* Words of a frustum's mask, each for a row of 64 cells along x. */
#define UMB__RECEIVER_MASK_WORDS ((size_t)1 << (2 * UMB__RECEIVER_MASK_LOG2))

/* Returns the index of the word for the row of cells at (y, z); cell x is bit x of that word. */
static inline size_t umb__receiver_mask_word(uint32_t y, uint32_t z)
{
    return ((size_t)z << UMB__RECEIVER_MASK_LOG2) + y;
}

/* Returns true if a voxel lies in a marked cell. In: cells: mask of a frustum of 1 << log2_size
 * voxels a side. */
static inline bool umb__receiver_mask_has(const uint64_t *cells, uint32_t log2_size,
                                          const uint32_t voxel[3])
{
    const uint32_t shift = log2_size - UMB__RECEIVER_MASK_LOG2;
    return (cells[umb__receiver_mask_word(voxel[1] >> shift, voxel[2] >> shift)] >>
                (voxel[0] >> shift) &
            1U) != 0;
}

#endif
