/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_PAGES_H
#define UMBRAGE_CORE_FORMAT_PACK_PAGES_H
/*
 * All pages of a packed file, ordered, encoded, compressed and hashed. Compressed pages wait in
 * memory, because the head in front of them holds their hashes.
 *
 *     struct umb__pack_pages pages;
 *     umb__pack_pages(job, &pages, &error);
 *     ... pages.order, pages.stored, pages.entries ...
 *     umb__pack_pages_finish(&pages);
 */
#include "format/content.h"
#include "format/pack_ordering.h"

struct umb__page_worker;

struct umb__pack_pages {
    struct umb__pack_order order;
    uint8_t **stored; /* [order.page_count] Compressed pages, whose lengths are in the entries */
    uint8_t *entries; /* [order.page_count * UMB__PAGE_ENTRY] Entries of the directory, complete
                         except for the offsets of the pages in the file */
    struct umb__page_worker *workers; /* [worker_count] */
    unsigned worker_count;
    size_t stored_capacity, entries_capacity; /* Pages that the arrays have room for */
    const struct umb_alloc *alloc;
};

/*
 * Makes all pages.
 *
 * In:    job: octree, sha256, workers and cancelled are used, borrowed for the call.
 * Out:   pages: finish it, also after a failure.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range), E_TOO_LARGE (too many pages, or
 *        copies), E_CANCELLED.
 */
UMB_CHECKED enum umb_status umb__pack_pages(const struct umb__pack_job *job,
                                            struct umb__pack_pages *pages, struct umb_error *error);
void umb__pack_pages_finish(struct umb__pack_pages *pages);

#endif
