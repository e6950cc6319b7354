/* SPDX-License-Identifier: Apache-2.0 */
/* Open addressing, at most half full; sorting by bytes from the lowest up, as each pass is stable.
 */
#include "format/value_set.h"

#include <string.h>

#include "base/memory.h"

/* Below this many values, inserting one after the other is quicker. */
#define INSERTION_MAX 48

struct umb__value_pair {
    uint64_t value;
    uint32_t number;
};

bool umb__value_set_begin(struct umb__value_set *set, const struct umb_alloc *alloc, size_t most)
{
    unsigned log2 = 4;
    while (((size_t)1 << log2) < 2 * most) {
        log2++;
    }
    const size_t slots = (size_t)1 << log2;
    if (!umb__grow(alloc, &set->slots, &set->slots_capacity, slots, sizeof *set->slots) ||
        !umb__grow(alloc, &set->values, &set->values_capacity, most + 1, sizeof *set->values)) {
        return false;
    }
    memset(set->slots, 0, slots * sizeof *set->slots);
    set->log2_slots = log2;
    set->count = 0;
    return true;
}

uint32_t umb__value_set_add(struct umb__value_set *set, uint64_t value)
{
    /* Fibonacci hashing of a value folded once: masks differ in few and far bits. */
    const uint64_t mixed = (value ^ (value >> 29)) * 0x9e3779b97f4a7c15ULL;
    const size_t last = ((size_t)1 << set->log2_slots) - 1;
    size_t at = (size_t)(mixed >> (64 - set->log2_slots));
    for (; set->slots[at] != 0; at = (at + 1) & last) {
        const uint32_t number = set->slots[at] - 1;
        if (set->values[number] == value) {
            return number;
        }
    }
    set->values[set->count++] = value;
    set->slots[at] = (uint32_t)set->count;
    return (uint32_t)set->count - 1;
}

static void sort_few(struct umb__value_pair *pairs, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        const struct umb__value_pair pair = pairs[i];
        size_t at = i;
        for (; at > 0 && pairs[at - 1].value > pair.value; at--) {
            pairs[at] = pairs[at - 1];
        }
        pairs[at] = pair;
    }
}

/* Sorts by one byte from `from` into `to`; false, and nothing done, if all have the same byte. */
static bool sort_by_byte(const struct umb__value_pair *from, size_t count, unsigned shift,
                         struct umb__value_pair *to)
{
    size_t place[256] = {0};
    for (size_t i = 0; i < count; i++) {
        place[from[i].value >> shift & 0xff]++;
    }
    if (place[from[0].value >> shift & 0xff] == count) {
        return false;
    }
    size_t next = 0;
    for (size_t byte = 0; byte < 256; byte++) {
        const size_t here = place[byte];
        place[byte] = next;
        next += here;
    }
    for (size_t i = 0; i < count; i++) {
        to[place[from[i].value >> shift & 0xff]++] = from[i];
    }
    return true;
}

bool umb__value_set_sort(struct umb__value_set *set, const struct umb_alloc *alloc)
{
    const size_t count = set->count;
    if (!umb__grow(alloc, &set->rank, &set->rank_capacity, count + 1, sizeof *set->rank) ||
        !umb__grow(alloc, &set->pairs, &set->pairs_capacity, 2 * count + 1, sizeof *set->pairs)) {
        return false;
    }
    struct umb__value_pair *from = set->pairs, *to = set->pairs + count;
    for (size_t i = 0; i < count; i++) {
        from[i] = (struct umb__value_pair){set->values[i], (uint32_t)i};
    }
    if (count <= INSERTION_MAX) {
        sort_few(from, count);
    } else {
        for (unsigned shift = 0; shift < 64; shift += 8) {
            if (sort_by_byte(from, count, shift, to)) {
                struct umb__value_pair *swap = from;
                from = to;
                to = swap;
            }
        }
    }
    for (size_t i = 0; i < count; i++) {
        set->values[i] = from[i].value;
        set->rank[from[i].number] = (uint32_t)i;
    }
    return true;
}

void umb__value_set_finish(struct umb__value_set *set, const struct umb_alloc *alloc)
{
    umb__free(alloc, set->slots);
    umb__free(alloc, set->values);
    umb__free(alloc, set->rank);
    umb__free(alloc, set->pairs);
    memset(set, 0, sizeof *set);
}
