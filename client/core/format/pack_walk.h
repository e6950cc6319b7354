/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_WALK_H
#define UMBRAGE_CORE_FORMAT_PACK_WALK_H
/*
 * The walk through an octree that fills pages: depth first from the roots of a band, as
 * pack_order.h explains. The pages are added to an order, or are only measured, as for a sample.
 */
#include <stdbool.h>
#include "format/pack_order.h"
#include "format/pack_survey.h"
#include "umbrage/workers.h"

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

/* Allocates the states of the levels [low, high]. False: out of memory. */
bool umb__pack_walk_begin(struct umb__pack_walk *walk, uint32_t low, uint32_t high);
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

/* Undoes all visits of levels below `end` since the order had `page_count` pages. */
void umb__pack_rewind(struct umb__pack_walk *walk, uint32_t page_count, uint32_t end);

/*
 * The decision about copies (pack_copies.c). Pages of the lowest band may be independent, with
 * copies of the nodes that they share, if such pages take little more bytes than pages with
 * references.
 */

/* True if the roots are so few that the sample is all of them. */
bool umb__pack_copies_asks_all(const struct umb__node_list *roots);

/* Returns the most bytes that the sampled roots may take with copies. In: asked: number of roots,
 * at most 2^15. */
uint64_t umb__pack_copies_most(const struct umb__pack_survey *survey,
                               const struct umb__node_list *roots, uint64_t asked);

/*
 * Visits some runs of the lowest band's roots with copies. Compares the estimated bytes of their
 * pages with their share of all nodes, each taken once. The result is the same for any workers.
 *
 * In:    walk: at the beginning of the lowest band; only read. workers: or NULL.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__pack_copies(const struct umb__pack_walk *walk,
                                             const struct umb__node_list *roots,
                                             const struct umb_workers *workers, bool *worth);

#endif
