/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_VALUE_SET_H
#define UMBRAGE_CORE_FORMAT_VALUE_SET_H
/*
 * Distinct 64-bit values, numbered as they are met, then ranked by size: the tables of a page.
 *
 *     umb__value_set_begin(&set, alloc, 1000);       empty; at most 1000 calls of add
 *     n = umb__value_set_add(&set, value);           equal values have equal numbers
 *     umb__value_set_sort(&set, alloc);              values ascending; rank[n] is n's place
 *     umb__value_set_finish(&set, alloc);
 *
 * A page holds some thousand references to a few hundred values. Hashing them and sorting only the
 * distinct ones is several times faster than sorting all and searching for each.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/alloc.h"

struct umb__value_set {
    size_t count;
    uint64_t *values; /* [count] Values by number; ascending after sort */
    uint32_t *rank;   /* [count] After sort: index in `values` of each number's value */
    /* Working memory, kept from one begin to the next: */
    uint32_t *slots; /* [1 << log2_slots] Number of a value plus one; 0: free */
    unsigned log2_slots;
    uint64_t *met;     /* [count] Values by number, for sort */
    uint32_t *numbers; /* [2 * count] Numbers under sort */
    size_t values_capacity, rank_capacity, slots_capacity, met_capacity, numbers_capacity;
};

/* Empties a set and makes room for `most` values. In: set: zeroed before the first use. Returns
 * false if out of memory. */
bool umb__value_set_begin(struct umb__value_set *set, const struct umb_alloc *alloc, size_t most);

/* Finds or adds a value; returns its number. */
uint32_t umb__value_set_add(struct umb__value_set *set, uint64_t value);

/* Sorts the values; none may be added afterwards. False: out of memory. */
bool umb__value_set_sort(struct umb__value_set *set, const struct umb_alloc *alloc);

void umb__value_set_finish(struct umb__value_set *set, const struct umb_alloc *alloc);

#endif
