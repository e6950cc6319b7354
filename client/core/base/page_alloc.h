/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_PAGE_ALLOC_H
#define UMBRAGE_CORE_BASE_PAGE_ALLOC_H
/*
 * An allocator for arrays that grow to gigabytes.
 *
 * A large block is a mapping of its own on large pages. When the block grows, the system moves its
 * pages to another address. Nothing is copied, no page is cleared twice, and an old and a new block
 * never take memory at the same time. realloc moves pages as well, but to an address where large
 * pages are split.
 *
 * Large blocks begin a cache line behind the start of a large page, and are zero when new. They
 * take whole large pages of address space; the system backs a page with memory when it is first
 * touched. Small blocks come from malloc.
 * Threads: any.
 */
#include "umbrage/alloc.h"

/* Size in bytes from which blocks are mappings. */
#define UMB__PAGE_ALLOC_LARGE ((size_t)4 << 20)

extern const struct umb_alloc umb__page_alloc;

#endif
