/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_ORDER_H
#define UMBRAGE_CORE_FORMAT_PACK_ORDER_H
/*
 * The canonical order of a packed file: which pages each node stands in, and at which position.
 * Independent pages are ordered step by step: each can be encoded as soon as it is closed, while
 * another thread goes on ordering.
 *
 * Levels are cut into bands (13 and up, 8 to 12, 3 to 7). Band after band, from the top, the nodes
 * are visited depth first from the roots of the band, in the order in which the band above first
 * met those roots. A node is written where it is first visited, and a page is closed when its
 * estimated size reaches the target. So the first pages hold all coarse levels.
 *
 * Pages of the lowest band are independent: they refer to no other page. Each holds whole trees of
 * 128^3 voxels, and a node that trees of several pages share is copied to each of them. A copy
 * takes hardly more room than a reference, and a client that needs one tree needs one page. If a
 * sample shows that the copies would make the file more than about a quarter larger, nodes of the
 * lowest band stand only once too, where they are first visited. The order depends on the tree's
 * content, not on its numbering: equal trees give equal files.
 */
#include <stdbool.h>
#include <stddef.h>
#include "format/octree.h"
#include "umbrage/workers.h"

#define UMB__LOWEST_END 8U /* First level above the lowest band */

struct umb__node_ref {
    uint32_t level;
    uint32_t index; /* Number in the octree */
};

/* Where a node stands. */
struct umb__node_place {
    uint32_t page;
    uint32_t position; /* Position among the page's nodes of the level */
};

#define UMB__PACK_HINT 16U

/* The order of each level's nodes in the file. An ordinal is a node's number in this order, in
 * which each copy of a node counts. */
struct umb__pack_order {
    uint32_t *nodes[UMB_LEVEL_MAX + 1]; /* [ordinal] Number of the node in the octree */
    size_t node_capacity[UMB_LEVEL_MAX + 1];
    /* [count of the level] Ordinal of each reached node. In independent pages only the roots have
     * one. But if a frustum's root lies below these roots, every node has one: that of its last
     * copy. */
    uint32_t *ordinals[UMB_LEVEL_MAX + 1];
    uint32_t page_count;
    uint32_t alone_from; /* First independent page; all later ones are independent too */
    uint32_t *begins[UMB_LEVEL_MAX + 1]; /* [page_count + 1] Each page's first ordinal */
    size_t page_capacity;
    /* [ordinal / UMB__PACK_HINT] Page of every 16th ordinal, and of the last. */
    uint32_t *hints[UMB_LEVEL_MAX + 1];
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* Number of distinct reached nodes of each level */
    double copies; /* Estimated bytes of the lowest band with copies, over those without */
    const struct umb_alloc *alloc;
};

/* Finds the page and position of an ordinal of a level. Cost: a search among the pages of 16
 * ordinals. */
struct umb__node_place umb__pack_place(const struct umb__pack_order *order, uint32_t level,
                                       uint32_t ordinal);

void umb__pack_order_finish(struct umb__pack_order *order);

struct umb__pack_ordering; /* opaque */

/*
 * Orders everything before the first independent page; the whole octree if no page is independent.
 *
 * In:    workers: helpers for the sample that decides on independent pages; or NULL. never_copies:
 *        true: no page is independent, whatever the sample says.
 * Out:   order: filled by the steps; finish it after `out`. Finish both also after a failure.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range), E_TOO_LARGE (too many pages,
 *        or copies).
 */
UMB_CHECKED enum umb_status umb__pack_order_begin(const struct umb__octree *octree,
                                                  const struct umb_workers *workers,
                                                  bool never_copies, struct umb__pack_order *order,
                                                  struct umb__pack_ordering **out,
                                                  struct umb_error *error);

/* True if all nodes are ordered: page_count, ordinals and hints are final. */
bool umb__pack_order_complete(const struct umb__pack_ordering *ordering);

/*
 * Makes room for a step of `pages` pages. Fails: E_NO_MEMORY.
 * Threads: closed pages from alone_from on can be encoded during the step, which moves no memory.
 */
UMB_CHECKED enum umb_status umb__pack_order_reserve(struct umb__pack_ordering *ordering,
                                                    uint32_t pages);

/* Closes `pages` further pages, or all that are left if these are fewer. In: an order that is not
 * complete. Fails: as umb__pack_order_begin. */
UMB_CHECKED enum umb_status umb__pack_order_step(struct umb__pack_ordering *ordering,
                                                 uint32_t pages);
void umb__pack_ordering_destroy(struct umb__pack_ordering *ordering); /* NULL is allowed */

#endif
