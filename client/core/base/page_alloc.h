/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_PAGE_ALLOC_H
#define UMBRAGE_CORE_BASE_PAGE_ALLOC_H
/*
 * An allocator for arrays that grow to gigabytes.
 *
 * A large block is a mapping of its own on large pages. When it grows, the system moves its pages
 * to another address by their tables: nothing is copied, no page is cleared twice, and at no time
 * do an old and a new block both take memory. (realloc moves pages as well, but to an address
 * where large ones fall apart.)
 *
 * Large blocks begin a cache line after a large page does, and are zero when they are new. They
 * take whole large pages of address space, of which the system backs those that are touched. Small
 * blocks are malloc's. Where the system cannot move pages, all are. Threads: any.
 */
#include "umbrage/alloc.h"

/* Blocks from here on are mappings. */
#define UMB__PAGE_ALLOC_LARGE ((size_t)4 << 20)

extern const struct umb_alloc umb__page_alloc;

#endif
