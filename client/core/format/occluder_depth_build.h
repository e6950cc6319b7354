/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_OCCLUDER_DEPTH_BUILD_H
#define UMBRAGE_CORE_FORMAT_OCCLUDER_DEPTH_BUILD_H
/*
 * Making an occluder depth map (format/occluder_depth.h) from texels, 64x64 at a time and in any
 * order.
 *
 *     umb__occluder_depth_init(&depths, NULL, log2_size, max_bytes, &error);   one a frustum
 *     umb__occluder_depth_add(&depths, x, y, lit, end, &error);    each square with end > lit
 *     umb__occluder_depth_join(all, count, &words, &word_count, &error);
 *     umb__occluder_depth_finish(&depths);                         also after a failure
 *
 * The words of a coded square can be kept, and added to another occluder depth map of the same
 * size:
 *
 *     umb__occluder_depth_square(&depths, x, y)                    -> words, words[0] of them
 *     if (umb__occluder_depth_square_fits(log2_size, words, count))
 *         umb__occluder_depth_add_square(&other, x, y, words, &error);
 *
 * Equal texels give equal words, whatever the order.
 */
#include "format/occluder_depth.h"

#define UMB__OCCLUDER_DEPTH_SIDE 64U /* Texels a side of the squares that are added */

struct umb__occluder_depth {
    const struct umb_alloc *alloc;
    uint32_t log2_size;
    size_t max_words;
    uint32_t *square; /* Index in words of each square plus 1, row by row; 0: no record */
    uint32_t *words;  /* Words of all squares; see umb__occluder_depth_square */
    size_t count, capacity;
};

/*
 * Starts an empty map.
 *
 * In:    log2_size: 6 .. 18. max_bytes: limit of all words, the joined tree's included.
 * Fails: E_NO_MEMORY, E_UNSUPPORTED (log2_size).
 */
UMB_CHECKED enum umb_status umb__occluder_depth_init(struct umb__occluder_depth *occluder_depth,
                                                     const struct umb_alloc *alloc,
                                                     uint32_t log2_size, size_t max_bytes,
                                                     struct umb_error *error);
void umb__occluder_depth_finish(struct umb__occluder_depth *occluder_depth);

/* Returns the bytes that an occluder depth map takes now. */
size_t umb__occluder_depth_bytes(const struct umb__occluder_depth *occluder_depth);

/*
 * Adds the square at (x, y), counted in squares of 64 texels; does nothing if end = lit everywhere.
 *
 * In:    lit, end: int32[64][64]: 8x8 blocks row by row, a block's texels row by row;
 *        0 <= lit <= end <= 2^log2_size.
 * Fails: E_NO_MEMORY, E_LIMIT (max_bytes).
 */
UMB_CHECKED enum umb_status umb__occluder_depth_add(struct umb__occluder_depth *occluder_depth,
                                                    uint32_t x, uint32_t y,
                                                    const int32_t (*lit)[64],
                                                    const int32_t (*end)[64],
                                                    struct umb_error *error);

/* Returns the words of a square: their number, the square's reference, and the square's records.
 * References count from the first record. NULL: the square has none. Borrowed until the map
 * changes. */
const uint32_t *umb__occluder_depth_square(const struct umb__occluder_depth *occluder_depth,
                                           uint32_t x, uint32_t y);

/*
 * Returns 1 if the words are a possible result of umb__occluder_depth_square for an occluder depth
 * map of 2^log2_size texels a side, else 0.
 *
 * In:    words: uint32[count].
 * Trust: safe on hostile words. Cost: linear, no allocation.
 */
int umb__occluder_depth_square_fits(uint32_t log2_size, const uint32_t *words, size_t count);

/*
 * Adds the words of a square (umb__occluder_depth_square). The square must not have any yet.
 *
 * In:    words: uint32[words[0]] that umb__occluder_depth_square_fits accepts.
 * Fails: as umb__occluder_depth_add.
 */
UMB_CHECKED enum umb_status
umb__occluder_depth_add_square(struct umb__occluder_depth *occluder_depth, uint32_t x, uint32_t y,
                               const uint32_t *words, struct umb_error *error);

/*
 * Joins the occluder depth maps of all frusta.
 *
 * Out:   words: of the first map's allocator; the caller frees them with
 *        umb__occluder_depth_words_free.
 * Fails: E_NO_MEMORY, E_LIMIT (more than the max_bytes of all maps, or more words than references
 *        reach).
 */
UMB_CHECKED enum umb_status
umb__occluder_depth_join(const struct umb__occluder_depth *occluder_depths, uint32_t count,
                         uint32_t **words, uint64_t *word_count, struct umb_error *error);
void umb__occluder_depth_words_free(const struct umb_alloc *alloc, uint32_t *words);

#endif
