/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_KEPT_H
#define UMBRAGE_CORE_FORMAT_PACK_KEPT_H
/*
 * Cuts and pages of an octree, kept for a later octree that begins with the same nodes. What is
 * below a node decides its cuts and its pages (pack_cut.h), so those of kept nodes are the same in
 * every asset.
 *
 * Bytes, little-endian, no padding:
 *
 *     uint32 page_bytes                    most estimated bytes of a page
 *     uint32 nodes                         for each level from 4 to UMB_LEVEL_MAX
 *     for each of these levels: uint32 sum for each node; from level 5 on also
 *       uint32 parts for each node, uint32 bytes of the cut for each node
 *     uint32 pages, cuts                   of all pages below a cut node
 *     for each page: uint32 level, node, part, cuts; its entry (layout.h) without place and links
 *     for each cut of each page: uint32 level, node
 *     the stored bytes of each page
 */
#include "format/octree_image.h"
#include "format/page.h"

/* A page that was made, or is kept. */
struct umb__kept_page {
    struct umb__pack_page page;       /* level: of the cut node, at least 5 */
    const uint8_t *entry;             /* [UMB__PAGE_ENTRY] Entry; place and links are not read */
    const uint8_t *stored;            /* Compressed page */
    const struct umb__node_ref *cuts; /* [cut_count] Cut nodes that it links to */
    uint32_t cut_count;
};

/* What is kept. Nodes have the numbers of the octree to be packed. Start zeroed: nothing. */
struct umb__pack_kept {
    uint32_t page_bytes;                /* Most estimated bytes of a page */
    uint32_t counts[UMB_LEVEL_MAX + 1]; /* Number of nodes kept: the first ones of each level */
    uint32_t *sums[UMB_LEVEL_MAX + 1];  /* As in struct umb__pack_cuts */
    uint32_t *parts[UMB_LEVEL_MAX + 1];
    uint32_t *bytes[UMB_LEVEL_MAX + 1];
    struct umb__kept_page *pages; /* [page_count] ascending by level, node, part */
    uint32_t page_count;
    struct umb__node_ref *cuts;
};

/* Returns the bytes that the cuts and pages take. In: pages: in any order; those of roots are left
 * out. */
uint64_t umb__pack_kept_bytes(const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                              uint32_t page_count);

/* Writes them. In: to: uint8[umb__pack_kept_bytes()]. */
void umb__pack_kept_write(const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                          uint32_t page_count, uint8_t *to);

/*
 * Reads what was kept.
 *
 * In:    bytes: borrowed by `kept`. counts: numbers of nodes of the octree that was packed then.
 *        map: from its numbers to those of the new octree, or NULL: they are the same. Removed
 *        nodes are left out.
 * Out:   kept: finish it also after a failure.
 * Fails: E_CORRUPT, E_NO_MEMORY.
 * Trust: reads no byte outside, and every number is that of a node. Sums and pages are trusted.
 */
UMB_CHECKED enum umb_status umb__pack_kept_read(const uint8_t *bytes, size_t size,
                                                const uint32_t counts[UMB_LEVEL_MAX + 1],
                                                const struct umb__octree_map *map,
                                                struct umb__pack_kept *kept,
                                                struct umb_error *error);
void umb__pack_kept_finish(struct umb__pack_kept *kept);

/* Returns a kept page; NULL: there is none. */
const struct umb__kept_page *umb__pack_kept_find(const struct umb__pack_kept *kept,
                                                 const struct umb__pack_page *page);

#endif
