/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PAGE_H
#define UMBRAGE_CORE_FORMAT_PAGE_H
/*
 * One page of a packed file, uncompressed. A page is decoded without other pages. A reference to
 * one of the page's n nodes of the level below is the position of that node. A reference of n + i
 * is item i of the page's table of nodes in other pages. The table names a page by its place in the
 * page's list of links, which stands in the directory: so equal trees give equal pages in every
 * version of an asset. Most references lead to the next node, as
 * defined below. These references are not written: the mask marks them. Numbers and lists are those
 * of base/numbers.h.
 *
 *   u8 encoding (3), u8 level_high, u8 level_low
 *   number node_count, for each level from high down to low
 *   for each level from high down to max(low, 4):
 *     number external_count                              nodes of the level below in other pages,
 *     number link difference[external_count]             ascending: link minus the link before;
 *     number position difference[external_count]         position, in the same page minus the
 *                                                        position before and 1
 *     u16 mask[node_count]                               states of the children; 3: mixed, and it
 *                                                        is the next node
 *     list references[children of state 2 in all masks]  below node_count of the level below (0 if
 *                                                        not in the page) + external_count
 *   if low is 3:
 *     number leaf_count
 *     u8 rows[leaf_count]      bit y: row y differs from row y of the leaf before, or, in the first
 *                              leaf, is not 0
 *     u8 row[set bits of all rows]   the rows that differ, of each leaf from bit 7 down
 *     u8 runs[node_count of level 3] bit z: slice z differs from slice z - 1; bit 0 is set
 *     list leaf numbers[set bits of all runs]   below leaf_count
 *
 * A list of links has a number for each link: the number of the page, less 1 and that of the link
 * before, folded (0, -1, 1, -2 ... as 0, 1, 2, 3 ...). The first link counts from -1.
 *
 * The next node is the one after the last of the page's own nodes of the level below to which a
 * mask or reference has led so far. At the beginning it is the first node.
 */
#include "base/bytes.h"
#include "base/numbers.h"
#include "format/pack_cut.h"
#include "format/value_set.h"

/* Where a node stands. */
struct umb__node_place {
    uint32_t page;
    uint32_t position; /* Position among the page's nodes of the level */
};

/* A parsed page, with pointers into its raw bytes. Arrays are indexed by level; levels that the
 * page does not have read as empty. */
struct umb__page {
    uint32_t level_high, level_low;
    uint32_t node_count[UMB_LEVEL_MAX + 1];
    uint32_t external_count[UMB_LEVEL_MAX + 1];
    uint32_t link_count;  /* Number of links that the levels refer to */
    const uint8_t *links; /* Folded differences of page numbers, from umb__page_set_links */
    const uint8_t *external_links[UMB_LEVEL_MAX + 1];     /* Differences of links */
    const uint8_t *external_positions[UMB_LEVEL_MAX + 1]; /* Differences of positions */
    const uint8_t *masks[UMB_LEVEL_MAX + 1];
    uint64_t child_count[UMB_LEVEL_MAX + 1]; /* Number of mixed children of all nodes */
    /* References that are written; [3]: leaf numbers. */
    struct umb__number_list references[UMB_LEVEL_MAX + 1];
    uint32_t leaf_count;
    const uint8_t *leaves; /* Bits for the rows that differ, then these rows */
    const uint8_t *runs;   /* [node_count[3]] Runs of each brick */
};

/*
 * Parses a raw page and checks everything inside it: lengths, numbers, masks, references, leaf
 * numbers. The reader of the whole file checks references to other pages. Trust: safe on hostile
 * bytes. Fails: E_CORRUPT, E_VERSION (another encoding).
 */
UMB_CHECKED enum umb_status umb__page_parse(const uint8_t *raw, size_t size, struct umb__page *page,
                                            struct umb_error *error);

/*
 * Checks the list of links of a parsed page, and gives it to the page, which keeps a pointer to it.
 * Trust: safe on hostile bytes. Fails: E_CORRUPT.
 */
UMB_CHECKED enum umb_status umb__page_set_links(struct umb__page *page, const uint8_t *links,
                                                size_t size, struct umb_error *error);

/*
 * Reading a parsed page, level by level, from the first item to the last. The nodes in other pages:
 *
 *     struct umb__page_others others = umb__page_others(&page, level);
 *     for each of external_count[level]: place = umb__page_others_next(&others);
 *
 * The nodes of a level. A reference r below n = node_count[level - 1] is the position of a node in
 * the page; any other is item r - n of the nodes in other pages:
 *
 *     struct umb__page_nodes nodes = umb__page_nodes(&page, level);
 *     for each of node_count[level]: count = umb__page_nodes_next(&nodes, &mask, references);
 *
 * The bricks, with the table of leaves:
 *
 *     umb__page_leaves(&page, leaves);
 *     struct umb__page_bricks bricks = umb__page_bricks(&page, leaves);
 *     for each of node_count[3]: umb__page_bricks_next(&bricks, slices);
 */
struct umb__page_others {
    const uint8_t *link_at, *position_at;
    const uint8_t *links;         /* The next link that was not read yet */
    struct umb__node_place place; /* Place of the node before */
    bool first;                   /* True before the first node */
};

static inline struct umb__page_others umb__page_others(const struct umb__page *page, uint32_t level)
{
    return (struct umb__page_others){.link_at = page->external_links[level],
                                     .position_at = page->external_positions[level],
                                     .links = page->links,
                                     .place = {.page = UINT32_MAX},
                                     .first = true};
}

static inline struct umb__node_place umb__page_others_next(struct umb__page_others *others)
{
    const uint32_t link = umb__next_number(&others->link_at);
    const uint32_t position = umb__next_number(&others->position_at);
    const bool same = link == 0 && !others->first;
    for (uint32_t left = link + (others->first ? 1 : 0); left > 0; left--) {
        others->place.page += 1 + (uint32_t)umb__unfold(umb__next_number(&others->links));
    }
    others->place.position = same ? others->place.position + 1 + position : position;
    others->first = false;
    return others->place;
}

struct umb__page_nodes {
    const uint8_t *masks;
    struct umb__list_reader references;
    uint32_t own;  /* Number of the page's own nodes of the level below */
    uint32_t next; /* Position of the next node among those */
};

static inline struct umb__page_nodes umb__page_nodes(const struct umb__page *page, uint32_t level)
{
    return (struct umb__page_nodes){.masks = page->masks[level],
                                    .references = umb__list_read(&page->references[level]),
                                    .own = page->node_count[level - 1]};
}

/* Returns which children in a mask are "the next node" (see the file's first comment): for each of
 * them the lower of the child's two bits. In: mask: as stored in a page. */
static inline unsigned umb__page_mask_next(unsigned mask)
{
    return mask & mask >> 1 & 0x5555U;
}

/* Reads the next node of a level. Out: mask: in the octree's form. Returns the number of mixed
 * children, which is the number of references. */
static inline unsigned umb__page_nodes_next(struct umb__page_nodes *nodes, uint16_t *mask,
                                            uint32_t references[8])
{
    const unsigned stored = umb__load16(nodes->masks), next = umb__page_mask_next(stored);
    unsigned count = 0;
    nodes->masks += 2;
    *mask = (uint16_t)(stored & ~next);
    for (unsigned mixed = stored >> 1 & 0x5555U; mixed != 0; mixed &= mixed - 1) {
        uint32_t reference;
        if ((mixed & -mixed & next) != 0) {
            reference = nodes->next++;
        } else {
            reference = umb__list_next(&nodes->references);
            const bool ahead = reference >= nodes->next && reference < nodes->own;
            nodes->next = ahead ? reference + 1 : nodes->next;
        }
        references[count++] = reference;
    }
    return count;
}

/* Decodes the leaves of a page. Out: leaves: uint64[leaf_count]. */
void umb__page_leaves(const struct umb__page *page, uint64_t *leaves);

struct umb__page_bricks {
    const uint8_t *runs;
    struct umb__list_reader numbers;
    const uint64_t *leaves;
};

static inline struct umb__page_bricks umb__page_bricks(const struct umb__page *page,
                                                       const uint64_t *leaves)
{
    return (struct umb__page_bricks){page->runs, umb__list_read(&page->references[UMB_LEVEL_BRICK]),
                                     leaves};
}

static inline void umb__page_bricks_next(struct umb__page_bricks *bricks, uint64_t slices[8])
{
    const unsigned runs = *bricks->runs++;
    uint64_t slice = 0;
    for (unsigned z = 0; z < 8; z++) {
        if (runs >> z & 1) {
            slice = bricks->leaves[umb__list_next(&bricks->numbers)];
        }
        slices[z] = slice;
    }
}

/* Node of the octree. */
struct umb__node_ref {
    uint32_t level;
    uint32_t index; /* Number in the octree */
};

#define UMB__PAGE_PARTS_MAX (4U * UMB_LEVEL_MAX)

/* Memory for encoding pages, kept from one page to the next. Start zeroed. */
struct umb__page_encoder {
    uint8_t *raw; /* [raw_size] Bytes of the page encoded last */
    size_t raw_size, raw_capacity;
    uint32_t node_count; /* Number of nodes and bricks in that page */
    /* Offsets in `raw` of the page's parts: of each level the nodes in other pages, masks, and
     * references; leaves, their rows, runs, leaf numbers. A list has two parts. */
    size_t parts[UMB__PAGE_PARTS_MAX];
    size_t part_count;
    /* The page's cut nodes in the order of their links: a link for each page of each cut node. */
    struct umb__node_ref *cuts; /* [cut_count] */
    size_t cut_count, cuts_capacity;
    uint32_t *references; /* References of a level */
    size_t references_capacity;
    struct umb__node_place *others; /* [other_count] A level's nodes in other pages; page: link */
    size_t other_count, others_capacity;
    uint32_t link_count; /* Number of links of the levels above */
    uint8_t *runs;       /* Runs of the bricks */
    size_t runs_capacity;
    struct umb__value_set table;    /* Leaves */
    struct umb__value_set nodes[2]; /* The page's nodes of an even and an odd level, by their number
                                       in the octree */
};

/*
 * Encodes a page of a cut octree into encoder->raw, and lists the cut nodes that it links to.
 * Threads: any number of encoders may work on one octree, if its allocator allows.
 */
UMB_CHECKED enum umb_status umb__page_encode(struct umb__page_encoder *encoder,
                                             const struct umb__pack_cuts *cuts,
                                             const struct umb__pack_page *page,
                                             struct umb_error *error);
void umb__page_encoder_finish(struct umb__page_encoder *encoder, const struct umb_alloc *alloc);

#endif
