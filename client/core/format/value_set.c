/* SPDX-License-Identifier: Apache-2.0 */
/* Sets of values: open addressing, at most half full; then a radix sort by bytes, lowest first. */
#include "format/value_set.h"

#include <string.h>

#include "base/memory.h"

/* Number of values below which insertion sort is faster. */
#define INSERTION_MAX 48

/* Slots of an empty set: few, so that they stay in the L1 cache. */
#define LOG2_SLOTS_FIRST 10U

static void clear_slots(struct umb__value_set *set, unsigned log2)
{
    memset(set->slots, 0, sizeof *set->slots << log2);
    set->log2_slots = log2;
}

bool umb__value_set_begin(struct umb__value_set *set, const struct umb_alloc *alloc, size_t most)
{
    unsigned log2 = LOG2_SLOTS_FIRST;
    while (((size_t)1 << log2) < 2 * most) {
        log2++;
    }
    if (!umb__grow(alloc, &set->slots, &set->slots_capacity, (size_t)1 << log2,
                   sizeof *set->slots) ||
        !umb__grow(alloc, &set->values, &set->values_capacity, most + 1, sizeof *set->values)) {
        return false;
    }
    clear_slots(set, LOG2_SLOTS_FIRST);
    set->count = 0;
    return true;
}

/* Returns the first slot of a value: Fibonacci hashing. The value is folded first, since masks
 * often differ in a few distant bits only. */
static size_t first_slot(const struct umb__value_set *set, uint64_t value)
{
    return (size_t)(((value ^ (value >> 29)) * 0x9e3779b97f4a7c15ULL) >> (64 - set->log2_slots));
}

/* Doubles the slots, for which umb__value_set_begin has made room. */
static void double_slots(struct umb__value_set *set)
{
    clear_slots(set, set->log2_slots + 1);
    const size_t last = ((size_t)1 << set->log2_slots) - 1;
    for (uint32_t number = 0; number < set->count; number++) {
        size_t at = first_slot(set, set->values[number]);
        while (set->slots[at] != 0) {
            at = (at + 1) & last;
        }
        set->slots[at] = number + 1;
    }
}

uint32_t umb__value_set_add(struct umb__value_set *set, uint64_t value)
{
    const size_t last = ((size_t)1 << set->log2_slots) - 1;
    size_t at = first_slot(set, value);
    for (; set->slots[at] != 0; at = (at + 1) & last) {
        const uint32_t number = set->slots[at] - 1;
        if (set->values[number] == value) {
            return number;
        }
    }
    set->values[set->count++] = value;
    set->slots[at] = (uint32_t)set->count;
    if (2 * set->count > last + 1) {
        double_slots(set);
    }
    return (uint32_t)set->count - 1;
}

static void sort_few(const uint64_t *values, uint32_t *numbers, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        const uint32_t number = numbers[i];
        size_t at = i;
        for (; at > 0 && values[numbers[at - 1]] > values[number]; at--) {
            numbers[at] = numbers[at - 1];
        }
        numbers[at] = number;
    }
}

/* Sorts numbers by one byte of their values, from `from` into `to`. */
static void sort_by_byte(const uint64_t *values, const uint32_t *from, size_t count, unsigned shift,
                         uint32_t *to)
{
    uint32_t place[256] = {0};
    for (size_t i = 0; i < count; i++) {
        place[values[i] >> shift & 0xff]++;
    }
    uint32_t next = 0;
    for (size_t byte = 0; byte < 256; byte++) {
        const uint32_t here = place[byte];
        place[byte] = next;
        next += here;
    }
    for (size_t i = 0; i < count; i++) {
        to[place[values[from[i]] >> shift & 0xff]++] = from[i];
    }
}

/* Sorts the numbers 0 .. count - 1 by the values that they name. In: numbers: room for 2 * count.
 * Returns the half of `numbers` that holds the result. */
static const uint32_t *sort_numbers(const uint64_t *values, uint32_t *numbers, size_t count)
{
    uint32_t *from = numbers, *to = numbers + count;
    uint64_t differ = 0; /* Bits in which values differ */
    for (size_t i = 0; i < count; i++) {
        from[i] = (uint32_t)i;
        differ |= values[i] ^ values[0];
    }
    if (count <= INSERTION_MAX) {
        sort_few(values, from, count);
        return from;
    }
    for (unsigned shift = 0; shift < 64; shift += 8) {
        if ((differ >> shift & 0xff) != 0) {
            sort_by_byte(values, from, count, shift, to);
            uint32_t *swap = from;
            from = to;
            to = swap;
        }
    }
    return from;
}

bool umb__value_set_sort(struct umb__value_set *set, const struct umb_alloc *alloc)
{
    const size_t count = set->count;
    if (!umb__grow(alloc, &set->rank, &set->rank_capacity, count + 1, sizeof *set->rank) ||
        !umb__grow(alloc, &set->met, &set->met_capacity, count + 1, sizeof *set->met) ||
        !umb__grow(alloc, &set->numbers, &set->numbers_capacity, 2 * count + 1,
                   sizeof *set->numbers)) {
        return false;
    }
    memcpy(set->met, set->values, count * sizeof *set->met);
    const uint32_t *numbers = sort_numbers(set->met, set->numbers, count);
    for (size_t i = 0; i < count; i++) {
        set->values[i] = set->met[numbers[i]];
        set->rank[numbers[i]] = (uint32_t)i;
    }
    return true;
}

void umb__value_set_finish(struct umb__value_set *set, const struct umb_alloc *alloc)
{
    umb__free(alloc, set->slots);
    umb__free(alloc, set->values);
    umb__free(alloc, set->rank);
    umb__free(alloc, set->met);
    umb__free(alloc, set->numbers);
    memset(set, 0, sizeof *set);
}
