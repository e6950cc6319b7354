/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_EXPANDED_PAGE_H
#define UMBRAGE_CORE_PARTIAL_EXPANDED_PAGE_H
/*
 * The nodes of one page, expanded: the only form in which a partial asset reads a page's octree. A
 * child is a node of the same page, or a node of another page by the page's number and the position
 * there. The format of pages is known to expanded_page.c alone.
 */
#include "format/directory.h"
#include "format/octree.h"

#define UMB__LEVELS (UMB_LEVEL_MAX + 1)

/* The nodes of one level, 4 and up. */
struct umb__expanded_level {
    uint32_t count;
    uint16_t *masks;    /* [count] States of the children, 2 bits each */
    uint32_t *first;    /* [count + 1] Index in `children` of a node's first mixed child */
    uint32_t *children; /* [first[count]] Position below node_count of the level below: a node of
                           this page; otherwise that number plus an index in `others` */
    struct umb__node_place *others; /* Nodes of other pages */
    uint8_t *closed;                /* [count] 1: everything below the node is in this page */
};

struct umb__expanded {
    uint32_t brick_count;
    struct umb__expanded_level level[UMB__LEVELS]; /* 0 to 3 unused */
    float *seen[UMB__LEVELS]; /* [count] Working memory of umb_partial_want: greatest benefit of a
                                 whole cube of each node */
};

/* Returns the number of nodes, or bricks, of a level. */
static inline uint32_t umb__expanded_count(const struct umb__expanded *nodes, uint32_t level)
{
    return level == UMB_LEVEL_BRICK ? nodes->brick_count : nodes->level[level].count;
}

/* Returns the place of a child of a level's node. In: page: number of the page of that node. */
static inline struct umb__node_place umb__expanded_child(const struct umb__expanded *nodes,
                                                         uint32_t page, uint32_t level,
                                                         uint32_t child)
{
    const uint32_t own = umb__expanded_count(nodes, level - 1);
    return child < own ? (struct umb__node_place){page, child}
                       : nodes->level[level].others[child - own];
}

/* Expands a parsed page in one block of memory; umb__free frees it. Returns NULL if out of
 * memory. Cost: linear in the page. */
struct umb__expanded *umb__expand_nodes(const struct umb__page *page,
                                        const struct umb_alloc *alloc);

/* Expands the bricks of a parsed page. In: leaves: working memory, uint64[page->leaf_count]. Out:
 * bricks: [node_count[3]]. */
void umb__expand_bricks(const struct umb__page *page, uint64_t *leaves, uint64_t (*bricks)[8]);

#endif
