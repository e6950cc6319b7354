/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_ORDER_H
#define UMBRAGE_CORE_FORMAT_PACK_ORDER_H
/*
 * The canonical order of a packed file: which pages each node stands in, and at which position.
 *
 * Levels are cut into bands (13 and up, 8 to 12, 3 to 7). Band after band, from the top, the nodes
 * are visited depth first from the roots of the band in the order in which the band above first met
 * them; a node is written where it is first visited, and a page is closed when its estimated size
 * reaches the target. So a reader of the first pages has all coarse levels.
 *
 * Pages of the lowest band refer to no other page: each holds whole trees of 128^3 voxels, and a
 * node that trees of several pages share stands in each of them. A copy takes hardly more room than
 * a reference to another page would, and whoever needs one tree needs one page. Only where trees
 * share so much that the file would grow by more than about a quarter (as a sample of them says),
 * nodes of the lowest band stand once, too, where they are first visited. The order depends on the
 * tree's content only, never on its numbering: equal trees give equal files.
 */
#include <stdbool.h>
#include "format/octree.h"
#include "umbrage/workers.h"

#define UMB__LOWEST_END 8U /* levels of the lowest band are below */

struct umb__node_ref {
    uint32_t level;
    uint32_t index; /* in the octree's numbering */
};

/* Where a node stands. */
struct umb__node_place {
    uint32_t page;
    uint32_t position; /* among the page's nodes of the level */
};

#define UMB__PACK_HINT 16U

/* Numbers of one level's nodes in the order of the file, copies included, are its ordinals. */
struct umb__pack_order {
    uint32_t *nodes[UMB_LEVEL_MAX + 1]; /* [ordinal], in the octree's numbering */
    size_t node_capacity[UMB_LEVEL_MAX + 1];
    /* [count of the level] the ordinal of what is reached. Pages that stand alone have ordinals of
     * their roots only, unless a frustum's root is below those: then of each node's last copy. */
    uint32_t *ordinals[UMB_LEVEL_MAX + 1];
    uint32_t page_count;
    uint32_t alone_from; /* pages from here on refer to no other: the lowest band, if at all */
    uint32_t *begins[UMB_LEVEL_MAX + 1]; /* [page_count + 1] a page's first ordinal */
    size_t page_capacity;
    /* [ordinal / UMB__PACK_HINT] the page of every 16th ordinal, and of the last. */
    uint32_t *hints[UMB_LEVEL_MAX + 1];
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* distinct reached nodes of each level */
    const struct umb_alloc *alloc;
};

/* Orders an octree's nodes, step by step if their pages stand alone: such a page can be encoded as
 * soon as it is closed, while another thread goes on ordering. */
struct umb__pack_ordering; /* opaque */

/*
 * Orders what has to be known before the first page that stands alone; everything, if none does.
 *
 * In:    workers: help to find out whether pages are to stand alone; or NULL.
 * Out:   order: filled as steps are taken; finish it after `out`. Both also after a failure.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range), E_TOO_LARGE (too many pages,
 *        or copies).
 */
UMB_CHECKED enum umb_status umb__pack_order_begin(const struct umb_octree *octree,
                                                  const struct umb_workers *workers,
                                                  struct umb__pack_order *order,
                                                  struct umb__pack_ordering **out,
                                                  struct umb_error *error);

/* True if all is ordered: page_count, ordinals and hints are final. */
bool umb__pack_order_complete(const struct umb__pack_ordering *ordering);

/*
 * Makes room for a step of so many pages. Threads: pages from alone_from on that are closed by now
 * can be encoded while the step is taken: it moves nothing. Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__pack_order_reserve(struct umb__pack_ordering *ordering,
                                                    uint32_t pages);

/* Closes so many pages more, if there are as many. Fails: as begin. In: it is not complete. */
UMB_CHECKED enum umb_status umb__pack_order_step(struct umb__pack_ordering *ordering,
                                                 uint32_t pages);
void umb__pack_ordering_destroy(struct umb__pack_ordering *ordering); /* NULL is allowed */

void umb__pack_order_finish(struct umb__pack_order *order);

/* Finds where an ordinal of a level stands. Cost: a search among the pages of 16 ordinals. */
struct umb__node_place umb__pack_place(const struct umb__pack_order *order, uint32_t level,
                                       uint32_t ordinal);

#endif
