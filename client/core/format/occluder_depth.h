/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_OCCLUDER_DEPTH_H
#define UMBRAGE_CORE_FORMAT_OCCLUDER_DEPTH_H
/*
 * The occluder depth map of a closed asset: the depths of first occluders that the DAG does not
 * have.
 *
 * Let `lit` be the number of lit voxels of a texel's column before its first occluder, and `end`
 * the depth where the undefined region behind that occluder ends. Under the closed rule the column
 * of the DAG turns from lit to shadowed anywhere between `lit` and `end`. Where the two are equal,
 * the DAG has the answer. For the other texels `lit` is stored here, exact to the voxel. Most of
 * them belong to roofs and walls, so squares of texels are planes.
 *
 * The entry FRNT of the canonical block is a tree of squares over each frustum
 * (docs/reference/umb-format.md, section 3, has the layout of its words). A reference names a
 * record and the record's kind; the reference 0 means that the DAG answers for the whole square.
 * Squares of level 9 and up, 2^level texels a side, are divided into 8 x 8. A square of level 6 is
 * one plane, or several planes with a mask of blocks each. A block of level 3 is a plane with
 * residuals, or names a plane of its square for each texel.
 */
#include <stdbool.h>
#include <stdint.h>
#include "umbrage/asset.h"

#define UMB__OCCLUDER_DEPTH_OFFSET_BITS 26U /* Bits of a reference below its kind */
#define UMB__OCCLUDER_DEPTH_DIVIDED     63U /* Kinds; 0: one plane; up to 20: bits of residuals */
#define UMB__OCCLUDER_DEPTH_PLANES      62U
#define UMB__OCCLUDER_DEPTH_PLANES_MAX  15U
#define UMB__OCCLUDER_DEPTH_PLANE_WORDS 6U  /* Words of a plane with its mask of blocks */
#define UMB__OCCLUDER_DEPTH_CHOICE      24U /* Plus the bits of a plane's number */
#define UMB__OCCLUDER_DEPTH_MASKED      32U /* Plus bits of residuals; a mask comes first */
#define UMB__OCCLUDER_DEPTH_WIDTH_MAX   20U
#define UMB__OCCLUDER_DEPTH_SHIFT       12U /* Fraction bits of planes of level 3 */
#define UMB__OCCLUDER_DEPTH_WIDE_SHIFT  20U /* Fraction bits of level 6: 64 texels need more */
#define UMB__OCCLUDER_DEPTH_LEVEL_MAX   18U /* Largest level of a frustum: no sum overflows */

static inline uint32_t umb__occluder_depth_kind(uint32_t reference)
{
    return reference >> UMB__OCCLUDER_DEPTH_OFFSET_BITS;
}

static inline uint32_t umb__occluder_depth_offset(uint32_t reference)
{
    return reference & (((uint32_t)1 << UMB__OCCLUDER_DEPTH_OFFSET_BITS) - 1);
}

/* Returns the level of the square that holds a frustum of 2^log2_size texels. */
static inline uint32_t umb__occluder_depth_top(uint32_t log2_size)
{
    return (log2_size + 2) / 3 * 3;
}

static inline uint64_t umb__occluder_depth_mask(const uint32_t *words)
{
    return words[0] | (uint64_t)words[1] << 32;
}

/* Returns the height of a plane of level 6 at texel (x, y) of its square. */
static inline int64_t umb__occluder_depth_wide_plane(const uint32_t *record, uint32_t x, uint32_t y)
{
    const int64_t c = (int64_t)(record[0] | (uint64_t)record[1] << 32);
    const int64_t sum = c + (int64_t)(int32_t)record[2] * x + (int64_t)(int32_t)record[3] * y;
    return sum >> UMB__OCCLUDER_DEPTH_WIDE_SHIFT; /* gcc and clang shift towards minus infinity */
}

/* Returns the height of a plane of level 3 at texel (x, y) of its block. */
static inline int64_t umb__occluder_depth_plane(const uint32_t *record, uint32_t x, uint32_t y)
{
    const int64_t sum = (int64_t)(int32_t)record[0] + (int64_t)(int32_t)record[1] * x +
                        (int64_t)(int32_t)record[2] * y;
    return sum >> UMB__OCCLUDER_DEPTH_SHIFT;
}

/* Returns number `index` of an array of `width` bits each (1..20). */
static inline uint32_t umb__occluder_depth_residual(const uint32_t *words, uint32_t width,
                                                    uint32_t index)
{
    const uint32_t bit = index * width, word = bit / 32;
    uint64_t two = words[word];
    if (bit % 32 + width > 32) {
        two |= (uint64_t)words[word + 1] << 32;
    }
    return (uint32_t)(two >> bit % 32) & (((uint32_t)1 << width) - 1);
}

/* Reads the depth that a block's record gives at texel (x, y) of the block's square. In: planes:
 * planes of the square. Returns false if the DAG answers. */
static inline bool umb__occluder_depth_value(const uint32_t *record, uint32_t kind,
                                             const uint32_t *planes, uint32_t x, uint32_t y,
                                             int64_t *lit)
{
    const uint32_t texel = (x & 7) + 8 * (y & 7), width = kind % UMB__OCCLUDER_DEPTH_MASKED;
    if (kind < UMB__OCCLUDER_DEPTH_MASKED && kind > UMB__OCCLUDER_DEPTH_CHOICE) {
        const uint32_t plane =
            umb__occluder_depth_residual(record, kind - UMB__OCCLUDER_DEPTH_CHOICE, texel);
        if (plane > 0) {
            *lit = umb__occluder_depth_wide_plane(
                planes + (plane - 1) * UMB__OCCLUDER_DEPTH_PLANE_WORDS, x, y);
        }
        return plane > 0;
    }
    const uint32_t *next = record + 3;
    if (kind >= UMB__OCCLUDER_DEPTH_MASKED) {
        if (!(umb__occluder_depth_mask(next) >> texel & 1)) {
            return false;
        }
        next += 2;
    }
    *lit = umb__occluder_depth_plane(record, x & 7, y & 7);
    if (width > 0) {
        *lit -= umb__occluder_depth_residual(next, width, texel);
    }
    return true;
}

/* Reads the depth that a square of planes gives at texel (x, y) of the square. Returns false if the
 * DAG answers. */
static inline bool umb__occluder_depth_square_value(const uint32_t *words, const uint32_t *square,
                                                    uint32_t x, uint32_t y, int64_t *lit)
{
    const uint64_t bit = (uint64_t)1 << (x / 8 + y / 8 * 8);
    const uint32_t *planes = square + 1;
    for (uint32_t i = 0; i < square[0]; i++) {
        const uint32_t *plane = planes + i * UMB__OCCLUDER_DEPTH_PLANE_WORDS;
        if (umb__occluder_depth_mask(plane + 4) & bit) {
            *lit = umb__occluder_depth_wide_plane(plane, x, y);
            return true;
        }
    }
    const uint32_t *rest = planes + square[0] * UMB__OCCLUDER_DEPTH_PLANE_WORDS;
    const uint64_t mask = umb__occluder_depth_mask(rest);
    if (!(mask & bit)) {
        return false;
    }
    const uint32_t reference = rest[2 + __builtin_popcountll(mask & (bit - 1))];
    return umb__occluder_depth_value(words + umb__occluder_depth_offset(reference),
                                     umb__occluder_depth_kind(reference), planes, x, y, lit);
}

/*
 * Finds `lit` of a texel in a checked occluder depth map.
 *
 * In:    words: the whole entry. root: the frustum's reference. x, y: inside the frustum.
 * Returns false, with lit unchanged, if the DAG has the answer.
 */
static inline bool umb__occluder_depth_find(const uint32_t *words, uint32_t root,
                                            uint32_t log2_size, uint32_t x, uint32_t y,
                                            uint32_t *lit)
{
    uint32_t reference = root, level = umb__occluder_depth_top(log2_size);
    while (reference != 0 && umb__occluder_depth_kind(reference) == UMB__OCCLUDER_DEPTH_DIVIDED) {
        level -= 3;
        const uint32_t *node = words + umb__occluder_depth_offset(reference);
        const uint64_t mask = umb__occluder_depth_mask(node);
        const unsigned child = (x >> level & 7) + 8 * (y >> level & 7);
        if (!(mask >> child & 1)) {
            return false;
        }
        reference = node[2 + __builtin_popcountll(mask & (((uint64_t)1 << child) - 1))];
    }
    if (reference == 0) {
        return false;
    }
    const uint32_t *record = words + umb__occluder_depth_offset(reference);
    int64_t value;
    if (umb__occluder_depth_kind(reference) == 0) {
        value = umb__occluder_depth_wide_plane(record, x & 63, y & 63);
    } else if (!umb__occluder_depth_square_value(words, record, x & 63, y & 63, &value)) {
        return false;
    }
    *lit = (uint32_t)value;
    return true;
}

/*
 * Checks an occluder depth map: every reference leads to the next record, all values lie in
 * 0..2^log2_size, no texel is outside its frustum, every word is used, and frusta that are not
 * closed have no record.
 *
 * Fails: E_CORRUPT. Trust: safe on hostile words. Cost: linear, no allocation.
 */
UMB_CHECKED enum umb_status umb__occluder_depth_check(const uint32_t *words, uint64_t count,
                                                      const struct umb_frustum_info *frusta,
                                                      uint32_t frustum_count,
                                                      struct umb_error *error);

#endif
