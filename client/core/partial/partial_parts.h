/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_PARTIAL_PARTS_H
#define UMBRAGE_CORE_PARTIAL_PARTIAL_PARTS_H
/* The parts of a partial asset; private to client/core/partial. */
#include <stdbool.h>
#include "format/asset_parts.h"
#include "format/directory.h"
#include "umbrage/partial.h"

#define UMB__LEVELS (UMB_LEVEL_MAX + 1)

/* Flag of a graph's child that is in a missing page; the other bits are the page's number. */
#define UMB__ABSENT 0x80000000U

/* What is known about a page's nodes, level by level. */
struct umb__links {
    uint32_t count[UMB__LEVELS];  /* Number of nodes in the page, if the page is held */
    uint32_t first[UMB__LEVELS];  /* Number in the graph of the page's first node of each level, if
                                     the page was held at the last build */
    uint32_t needed[UMB__LEVELS]; /* Number of nodes that references require: one more than the
                                     highest position that a reference names */
};

struct umb__held {
    uint8_t *stored;          /* NULL: the page is not here */
    struct umb__links *links; /* NULL: the page is not held, and no page refers to it */
    double benefit;           /* Sum of the page's benefits for the wanted views; 0: none */
};

/* Counts of allocated bytes; an allocation beyond the limit is refused. */
struct umb__meter {
    const struct umb_alloc *inner;
    uint64_t used, peak, limit;
};

struct umb_partial {
    struct umb__meter meter;
    struct umb_alloc alloc; /* Allocator through the meter */
    const struct umb_sha256 *sha256;
    void *zstd;           /* Decoder, a ZSTD_DCtx */
    uint8_t *head_bytes;  /* [head.head_length] */
    uint8_t *entries;     /* [head.page_count * UMB__PAGE_ENTRY]; head.entries point there */
    bool *blocks;         /* [head.directory_count] True for each held block of entries */
    uint32_t block_count; /* Number of held blocks */
    struct umb__head head;
    struct umb__canonical canonical;
    struct umb__held *pages; /* [head.page_count] */
    uint32_t *heap;          /* [heap_count] Heap of pages, the worst first (umb__partial_worst) */
    uint32_t heap_count;
    bool heap_fresh; /* False if pages or benefits have changed since the heap was built */
    uint32_t held_count;
    uint64_t held_bytes;
    uint64_t dropped, builds;

    /* The last build. */
    bool built;
    struct umb__octree graph; /* Without bricks; children and roots may be UMB__ABSENT | page */
    uint32_t *order;          /* [order_count] Pages in the graph, ascending */
    uint32_t order_count;
    float *seen[UMB__LEVELS]; /* Greatest benefit of a whole cube of each node (partial_want.c) */
    uint64_t want_steps;      /* Number of cubes and nodes that the last want visited */
    struct umb_asset lower, upper; /* Assets for queries, which borrow `canonical` */
};

/* Returns true if the block of a page's entry is held: umb__directory_load may then be called. */
static inline bool umb__partial_knows(const struct umb_partial *p, uint32_t page)
{
    return p->blocks[page / UMB__BLOCK_PAGES];
}

/* Frees the last build. */
void umb__partial_unbuild(struct umb_partial *p);

/* Returns the held page of the least benefit; among equal ones the last in the file; UINT32_MAX if
 * none is held. Cost: logarithmic; linear in the first call after a change of benefits (heap_fresh
 * false). */
uint32_t umb__partial_worst(struct umb_partial *p);

/* Returns the page that holds a node of the graph. */
uint32_t umb__partial_page_of(const struct umb_partial *p, uint32_t level, uint32_t index);

/* Returns the number of nodes and bricks of the graph. */
uint64_t umb__partial_nodes(const struct umb_partial *p);

/* The missing cubes in a box of voxels of one frustum. */
struct umb__lack {
    uint32_t level; /* Level of the largest missing cube; 0: none is missing */
    /* Lit share of the node above the largest missing cube; mixed and missing children count one
     * half */
    double occupancy;
};

/* Looks a box of voxels up in the graph. In: low, high: bounds, inclusive and inside the frustum.
 * want: true adds a benefit of 1 to each missing page found. */
struct umb__lack umb__partial_look(struct umb_partial *p, uint32_t frustum, const uint32_t low[3],
                                   const uint32_t high[3], bool want);

#endif
