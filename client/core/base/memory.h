/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_MEMORY_H
#define UMBRAGE_CORE_BASE_MEMORY_H
/*
 * Allocation through a struct umb_alloc (NULL = malloc). Products of sizes are checked for
 * overflow. The file also has the core's growing array.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/alloc.h"

/* Grows or shrinks a block as realloc does; 0 bytes frees it and gives NULL. */
void *umb__resize(const struct umb_alloc *alloc, void *block, size_t bytes);

/* Returns count * size bytes, not zeroed, or NULL (also if the product overflows). */
void *umb__alloc(const struct umb_alloc *alloc, size_t count, size_t size);

/*
 * Allocates an array that queries read at random: advises the system to use large pages, since a
 * look-up in 200 MB of small pages misses the TLB at every node. With malloc (alloc NULL) the array
 * begins at a cache line.
 */
void *umb__alloc_large(const struct umb_alloc *alloc, size_t count, size_t size);

/* Returns count * size zeroed bytes, or NULL (also if the product overflows). */
void *umb__alloc_zeroed(const struct umb_alloc *alloc, size_t count, size_t size);

/* Frees a block of umb__alloc; NULL is allowed. */
void umb__free(const struct umb_alloc *alloc, void *block);

/*
 * Grows *array so that `needed` elements of `size` bytes fit. In: array: address of a pointer of
 * any type. In and out: capacity: number of elements, at least doubled if the array grows. Returns
 * false and changes nothing if memory is short.
 */
bool umb__grow(const struct umb_alloc *alloc, void *array, size_t *capacity, size_t needed,
               size_t size);

#endif
