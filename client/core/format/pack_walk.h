/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_WALK_H
#define UMBRAGE_CORE_FORMAT_PACK_WALK_H
/*
 * The two passes over an octree from which the order of a packed file (pack_order.h) is made.
 *
 * A survey finds the nodes that the roots reach, checks these nodes, and estimates their bytes in
 * the file. It goes level by level from the top and reads each array once from end to end. That is
 * much faster than a walk through the tree, whose reads are scattered over memory.
 *
 * A walk fills pages: depth first from the roots of a band. The pages are added to an order, or are
 * only measured, as for a sample.
 */
#include <stdbool.h>
#include "format/pack_order.h"

struct umb__pack_survey {
    uint8_t *brick_bytes;               /* [brick_count] Estimated bytes of each brick */
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* Number of reached nodes of each level */
    uint64_t bytes[UMB_LEVEL_MAX + 1];  /* Estimated bytes of the reached nodes, each node once */
    const struct umb_alloc *alloc;
};

/*
 * Surveys an octree. Unreached nodes are not checked, except bricks, of which any bytes are valid.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range, an impossible mask).
 */
UMB_CHECKED enum umb_status umb__pack_survey(const struct umb__octree *octree,
                                             struct umb__pack_survey *survey,
                                             struct umb_error *error);
void umb__pack_survey_finish(struct umb__pack_survey *survey);

/* A growing list of nodes. */
struct umb__node_list {
    struct umb__node_ref *nodes;
    size_t count, capacity;
};

struct umb__pack_walk {
    const struct umb__octree *octree;
    const struct umb__pack_survey *survey;
    struct umb__pack_order *order;
    struct umb_error *error;
    uint64_t *states[UMB_LEVEL_MAX + 1]; /* State of each node, two bits */
    uint32_t next[UMB_LEVEL_MAX + 1];    /* Next ordinal of each level */
    size_t page_bytes;                   /* Estimated bytes of the open page */
    uint64_t closed_bytes;               /* Estimated bytes of the pages closed so far */
    struct umb__node_list waiting;       /* Roots of the next band */
    uint32_t band_low;                   /* Lowest level of the band */
    bool alone;                          /* The band's pages are independent */
    bool numbers_roots; /* Only roots get ordinals: no page refers to another node */
    bool sample;        /* Pages are only measured: the order gets no page, and keeps its
                           ordinals */
};

/* Begins the order's first page, and allocates the states of the levels up to `high`. False: out of
 * memory. */
bool umb__pack_walk_begin(struct umb__pack_walk *walk, uint32_t high);
void umb__pack_walk_finish(struct umb__pack_walk *walk);

/* Adds a node to a list. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__node_list_add(const struct umb__pack_walk *walk,
                                               struct umb__node_list *list,
                                               struct umb__node_ref node);

/* Visits the tree below a root of the band. Does nothing if the root was written before, as a part
 * of another tree or as the root of another frustum. Fails: E_NO_MEMORY, E_TOO_LARGE (too many
 * pages, or copies). */
UMB_CHECKED enum umb_status umb__pack_visit_root(struct umb__pack_walk *walk,
                                                 struct umb__node_ref root);

/* Ends the open page, if it holds anything. Fails: as umb__pack_visit_root. */
UMB_CHECKED enum umb_status umb__pack_close_page(struct umb__pack_walk *walk);

/* Undoes all visits to nodes of levels below `end` that were made since the order had `page_count`
 * pages. */
void umb__pack_rewind(struct umb__pack_walk *walk, uint32_t page_count, uint32_t end);

/* Makes room for the first ordinals of `needed` pages. Returns false if out of memory. */
bool umb__pack_grow_pages(struct umb__pack_order *order, size_t needed);

/* Fills error with E_NO_MEMORY for ordering, and returns that status. */
enum umb_status umb__pack_no_memory(struct umb_error *error);

#endif
