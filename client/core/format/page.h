/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PAGE_H
#define UMBRAGE_CORE_FORMAT_PAGE_H
/*
 * One page of a packed file, uncompressed. Decodes alone: references are narrow numbers into the
 * page's own nodes of the level below, then into its table of nodes in other pages.
 *
 *   u8 encoding (1), u8 level_high, u8 level_low, u8 0
 *   u32 node_count, for each level from high down to low
 *   u32 external_count, for each level from high down to max(low, 4)
 *   u32 leaf_count, if low is 3
 *   for each level from high down to max(low, 4):
 *     u32 page[external_count], u32 position[external_count]   nodes of the level below
 *     u16 mask[node_count]
 *     u8[w] reference[mixed children of all masks], w bytes each: 1..4, the least that holds
 *           node_count of the level below (0 if not in the page) + external_count - 1
 *   if low is 3:
 *     u64 leaf[leaf_count]
 *     u8 runs[node_count of level 3]   bit z: slice z differs from slice z - 1; bit 0 is set
 *     u8[w] leaf number[set bits of all runs], w: the least that holds leaf_count - 1
 */
#include "format/pack_order.h"
#include "format/value_set.h"

/* A parsed page; pointers into its raw bytes. Level arrays are indexed by level. */
struct umb__page {
    uint32_t level_high, level_low;
    uint32_t node_count[UMB_LEVEL_MAX + 1];
    uint32_t external_count[UMB_LEVEL_MAX + 1];
    const uint8_t *external_pages[UMB_LEVEL_MAX + 1];
    const uint8_t *external_positions[UMB_LEVEL_MAX + 1];
    const uint8_t *masks[UMB_LEVEL_MAX + 1];
    const uint8_t *references[UMB_LEVEL_MAX + 1];
    uint64_t reference_count[UMB_LEVEL_MAX + 1];
    unsigned width[UMB_LEVEL_MAX + 1]; /* of references; [3] of leaf numbers */
    uint32_t leaf_count;
    const uint8_t *leaves;
    const uint8_t *runs;
    const uint8_t *leaf_numbers;
};

/*
 * Parses a raw page and checks all that can be checked inside it: lengths, masks, references,
 * leaf numbers. References to other pages are checked by the reader of the whole file.
 * Trust: safe on hostile bytes. Fails: E_CORRUPT.
 */
UMB_CHECKED enum umb_status umb__page_parse(const uint8_t *raw, size_t size, struct umb__page *page,
                                            struct umb_error *error);

/* What encoding a page needs, kept from one page to the next. Start zeroed. */
struct umb__page_encoder {
    uint8_t *raw; /* [raw_size] the page encoded last */
    size_t raw_size, raw_capacity;
    uint32_t node_count;  /* nodes and bricks in it */
    uint32_t *references; /* of a level */
    size_t references_capacity;
    uint8_t *runs; /* of the bricks */
    size_t runs_capacity;
    struct umb__value_set table; /* a level's nodes in other pages, or leaves */
    struct umb__value_set own;   /* the page's nodes of a level, by their number in the octree */
};

/*
 * Encodes page number `page` of an order.
 * Out: encoder->raw.
 * Threads: any number of encoders may work on one order, if its allocator allows.
 */
UMB_CHECKED enum umb_status umb__page_encode(struct umb__page_encoder *encoder,
                                             const struct umb_octree *octree,
                                             const struct umb__pack_order *order, uint32_t page,
                                             struct umb_error *error);
void umb__page_encoder_finish(struct umb__page_encoder *encoder, const struct umb_alloc *alloc);

#endif
