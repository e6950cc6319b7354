/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_PARTIAL_EXTENTS_H
#define UMBRAGE_CORE_PARTIAL_EXTENTS_H
/*
 * Ranges of an array that its users take and give back. Neighbouring free ranges are one range.
 * Free ranges stand in lists by the logarithm of their length, so that taking and giving back cost
 * the same for any number of ranges.
 *
 *     struct umb__extents extents = {.alloc = alloc};
 *     umb__extents_take(&extents, count, &extent);   begins at umb__extents_begin
 *     umb__extents_give(&extents, extent);
 *     umb__extents_finish(&extents);
 *
 * Threads: one at a time.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/alloc.h"

/* No range. */
#define UMB__NO_EXTENT UINT32_MAX

struct umb__extent {
    uint32_t begin, count;         /* First item, and number of items */
    uint32_t before, after;        /* Neighbours in the array; or UMB__NO_EXTENT */
    uint32_t list_prev, list_next; /* Neighbours in the list of free ranges */
    bool free;
};

#define UMB__EXTENT_LISTS 32U

struct umb__extents {
    const struct umb_alloc *alloc;
    uint32_t end; /* Number of items in front of the end of the last range in use */
    struct umb__extent *items;
    size_t item_count, item_capacity;
    uint32_t last;                     /* Last range of the array, plus 1; 0: none */
    uint32_t spare;                    /* First unused record, plus 1; linked by list_next */
    uint32_t lists[UMB__EXTENT_LISTS]; /* First range of each list, plus 1 */
    uint32_t filled;                   /* Bit i: list i has a range */
};

/* Takes a range of `count` items, at least 1. The array may have to grow to extents->end. Returns
 * false if out of memory or beyond 2^32 - 1 items; `extent` then keeps its value. */
bool umb__extents_take(struct umb__extents *extents, uint32_t count, uint32_t *extent);

/* Gives a range back. */
void umb__extents_give(struct umb__extents *extents, uint32_t extent);

/* Returns the first item of a range in use. */
static inline uint32_t umb__extents_begin(const struct umb__extents *extents, uint32_t extent)
{
    return extents->items[extent].begin;
}

/* Frees the records. */
void umb__extents_finish(struct umb__extents *extents);

#endif
