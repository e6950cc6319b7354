/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_PARTIAL_PARTS_H
#define UMBRAGE_CORE_PARTIAL_PARTIAL_PARTS_H
/* What a partial asset consists of; private to client/core/partial. */
#include <stdbool.h>
#include "format/asset_parts.h"
#include "format/directory.h"
#include "umbrage/partial.h"

#define UMB__LEVELS (UMB_LEVEL_MAX + 1)

/* A child in the graph that stands in a page which is not here; the rest is the page's number. */
#define UMB__ABSENT 0x80000000U

/* What is known of a page's nodes, level by level. */
struct umb__links {
    uint32_t count[UMB__LEVELS];  /* nodes in the page, if it is here */
    uint32_t first[UMB__LEVELS];  /* number of its first node in the graph, if it was here then */
    uint32_t needed[UMB__LEVELS]; /* one more than the highest position anybody referred to */
};

struct umb__held {
    uint8_t *stored;          /* NULL: the page is not here */
    struct umb__links *links; /* NULL: the page is not here, and nobody referred to it */
    double benefit;           /* of the views asked for; 0: none */
};

/* Counts what is allocated and refuses what goes beyond a limit. */
struct umb__meter {
    const struct umb_alloc *inner;
    uint64_t used, peak, limit;
};

struct umb_partial {
    struct umb__meter meter;
    struct umb_alloc alloc; /* through the meter */
    const struct umb_sha256 *sha256;
    void *zstd;           /* ZSTD_DCtx */
    uint8_t *head_bytes;  /* [head.head_length] */
    uint8_t *entries;     /* [head.page_count * UMB__PAGE_ENTRY]; head.entries lead there */
    bool *blocks;         /* [head.directory_count] which blocks of entries are here */
    uint32_t block_count; /* of those */
    struct umb__head head;
    struct umb__canonical canonical;
    struct umb__held *pages; /* [head.page_count] */
    uint32_t *heap;          /* [heap_count] of [head.page_count]; see partial_worst.c */
    uint32_t heap_count;
    bool heap_fresh; /* False if pages or benefits have changed since the heap was built */
    uint32_t held_count;
    uint64_t held_bytes;
    uint64_t dropped, builds;

    /* The last build. */
    bool built;
    struct umb_octree graph; /* without bricks; children may be UMB__ABSENT | page, as may roots */
    uint32_t *order;         /* [order_count] pages in the graph, ascending */
    uint32_t order_count;
    float *seen[UMB__LEVELS];      /* Greatest benefit of a whole cube of each node; see mark() */
    uint64_t want_steps;           /* Number of cubes and nodes that the last want visited */
    struct umb_asset lower, upper; /* canonical and id are borrowed from here */
};

/* Sets the meter up; its address must stay. */
void umb__meter_init(struct umb__meter *meter, const struct umb_alloc *inner, uint64_t limit,
                     struct umb_alloc *alloc);

/* True if the block of a page's entry is here: umb__directory_load may be asked. */
static inline bool umb__partial_knows(const struct umb_partial *p, uint32_t page)
{
    return p->blocks[page / UMB__BLOCK_PAGES];
}

/* A page's links, made if need be; NULL: out of memory. */
struct umb__links *umb__partial_links(struct umb_partial *p, uint32_t page);

/* Frees the last build. */
void umb__partial_unbuild(struct umb_partial *p);

/* The page here that matters least; of equal ones the last in the file. UINT32_MAX: none is here.
 * Cost: logarithmic, but for the first time after benefits have changed (heap_fresh = false). */
uint32_t umb__partial_worst(struct umb_partial *p);

/* Adds a page that has arrived to the heap of umb__partial_worst. */
void umb__partial_note_page(struct umb_partial *p, uint32_t page);

/* The page a node of the graph stands in. */
uint32_t umb__partial_page_of(const struct umb_partial *p, uint32_t level, uint32_t index);

/* Nodes and bricks of the graph. */
uint64_t umb__partial_nodes(const struct umb_partial *p);

/* Calls visit for each reference of a page into another: the referring level, page, position. */
typedef enum umb_status (*umb__link_fn)(void *user, uint32_t level, uint32_t page,
                                        uint32_t position);
UMB_CHECKED enum umb_status umb__partial_each_link(const struct umb__page *page, umb__link_fn visit,
                                                   void *user);

/* What a box of voxels of one frustum misses. */
struct umb__lack {
    uint32_t level;   /* of the largest cube that is not there; 0: all is there */
    double occupancy; /* of the node that has it, absent parts counted half */
};

/* Looks a box of voxels up in the graph, bounds inside the frustum and inclusive. want: what it
 * misses gets a benefit of 1. */
struct umb__lack umb__partial_look(struct umb_partial *p, uint32_t frustum, const uint32_t low[3],
                                   const uint32_t high[3], bool want);

#endif
