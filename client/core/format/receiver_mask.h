/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_RECEIVER_MASK_H
#define UMBRAGE_CORE_FORMAT_RECEIVER_MASK_H
/*
 * Where receivers are, of assets baked under the static rule: the entry NEAR of the canonical block
 * (docs/reference/umb-format.md, section 3).
 *
 * The rule leaves voxels undefined that no point on a surface reads. So that a point elsewhere is
 * not answered as if it knew, the entry says cell by cell where surfaces are: a frustum has 64
 * cells a side, a bit each. A cell is marked if the look-up of some point on a surface may lie in
 * it, moved off the surface by any bias up to that of the widest window.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define UMB__RECEIVER_MASK_LOG2 6U /* cells a side, as a power of two */
#define UMB__RECEIVER_MASK_WORDS                                                                   \
    ((size_t)1 << (2 * UMB__RECEIVER_MASK_LOG2)) /* of 64 cells along x, a frustum */

/* The word of a row of cells, and in it bit x. */
static inline size_t umb__receiver_mask_word(uint32_t y, uint32_t z)
{
    return ((size_t)z << UMB__RECEIVER_MASK_LOG2) + y;
}

/* Whether a voxel lies in a marked cell. In: cells: of its frustum, of 1 << log2_size voxels a
 * side. */
static inline bool umb__receiver_mask_has(const uint64_t *cells, uint32_t log2_size,
                                          const uint32_t voxel[3])
{
    const uint32_t shift = log2_size - UMB__RECEIVER_MASK_LOG2;
    return (cells[umb__receiver_mask_word(voxel[1] >> shift, voxel[2] >> shift)] >>
                (voxel[0] >> shift) &
            1U) != 0;
}

#endif
