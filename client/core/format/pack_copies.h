/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_COPIES_H
#define UMBRAGE_CORE_FORMAT_PACK_COPIES_H
/* Decides whether the lowest band's pages may be independent, with copies of the nodes they share:
 * whether they take little more bytes than pages with references. */
#include "format/pack_walk.h"
#include "umbrage/workers.h"

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
