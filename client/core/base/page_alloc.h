/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_PAGE_ALLOC_H
#define UMBRAGE_CORE_BASE_PAGE_ALLOC_H
/*
 * An allocator for arrays that grow to gigabytes.
 *
 * A large block is a mapping of its own on large pages. When it grows, the system moves its page
 * tables to another address. Nothing is copied, no page is cleared twice, and an old and a new
 * block never both take memory. (realloc moves pages as well, but to an address where large pages
 * are split.)
 *
 * Large blocks begin a cache line behind the start of a large page, and are zero when new. They
 * take whole large pages of address space, of which the system backs the touched ones. Small blocks
 * come from malloc; where the system cannot move pages, all do. Threads: any.
 */
#include "umbrage/alloc.h"

/* Size in bytes from which blocks are mappings. */
#define UMB__PAGE_ALLOC_LARGE ((size_t)4 << 20)

extern const struct umb_alloc umb__page_alloc;

#endif
