/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_ORDERING_H
#define UMBRAGE_CORE_FORMAT_PACK_ORDERING_H
/*
 * Makes the order of a packed file (pack_order.h). Independent pages are made step by step: each
 * can be encoded as soon as it is closed, while another thread goes on ordering.
 */
#include "format/pack_order.h"
#include "umbrage/workers.h"

struct umb__pack_ordering; /* opaque */

/*
 * Orders everything before the first independent page; the whole octree if no page is independent.
 *
 * In:    workers: helpers for the sample that decides on independent pages; or NULL.
 * Out:   order: filled by the steps; finish it after `out`. Finish both also after a failure.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range), E_TOO_LARGE (too many pages,
 *        or copies).
 */
UMB_CHECKED enum umb_status umb__pack_order_begin(const struct umb__octree *octree,
                                                  const struct umb_workers *workers,
                                                  struct umb__pack_order *order,
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
