/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ranges of an array; see extents.h. List i has the free ranges of 2^i to 2^(i+1) - 1 items. A
 * range is taken from the first few ranges of the list of its own length, or from the next list
 * that has any: every range there is long enough. No range is free at the end of the array.
 */
#include "partial/extents.h"

#include <string.h>

#include "base/memory.h"

#define TRIED 8U /* Ranges of the own list that are tried */

static uint32_t list_of(uint32_t count)
{
    return 31U - (uint32_t)__builtin_clz(count);
}

static void list_add(struct umb__extents *extents, uint32_t at)
{
    struct umb__extent *extent = &extents->items[at];
    const uint32_t list = list_of(extent->count), head = extents->lists[list];
    extent->free = true;
    extent->list_prev = UMB__NO_EXTENT;
    extent->list_next = head > 0 ? head - 1 : UMB__NO_EXTENT;
    if (head > 0) {
        extents->items[head - 1].list_prev = at;
    }
    extents->lists[list] = at + 1;
    extents->filled |= 1U << list;
}

static void list_remove(struct umb__extents *extents, uint32_t at)
{
    struct umb__extent *extent = &extents->items[at];
    const uint32_t list = list_of(extent->count);
    if (extent->list_prev != UMB__NO_EXTENT) {
        extents->items[extent->list_prev].list_next = extent->list_next;
    } else {
        extents->lists[list] = extent->list_next == UMB__NO_EXTENT ? 0 : extent->list_next + 1;
        extents->filled =
            extents->lists[list] > 0 ? extents->filled : extents->filled & ~(1U << list);
    }
    if (extent->list_next != UMB__NO_EXTENT) {
        extents->items[extent->list_next].list_prev = extent->list_prev;
    }
    extent->free = false;
}

/* Returns an unused record; UMB__NO_EXTENT: out of memory. */
static uint32_t new_record(struct umb__extents *extents)
{
    if (extents->spare > 0) {
        const uint32_t at = extents->spare - 1;
        extents->spare = extents->items[at].list_next;
        return at;
    }
    if (extents->item_count >= UMB__NO_EXTENT - 1 ||
        !umb__grow(extents->alloc, &extents->items, &extents->item_capacity,
                   extents->item_count + 1, sizeof *extents->items)) {
        return UMB__NO_EXTENT;
    }
    return (uint32_t)extents->item_count++;
}

static void drop_record(struct umb__extents *extents, uint32_t at)
{
    struct umb__extent *extent = &extents->items[at];
    if (extent->before != UMB__NO_EXTENT) {
        extents->items[extent->before].after = extent->after;
    }
    if (extent->after != UMB__NO_EXTENT) {
        extents->items[extent->after].before = extent->before;
    } else {
        extents->last = extent->before == UMB__NO_EXTENT ? 0 : extent->before + 1;
    }
    extent->list_next = extents->spare;
    extents->spare = at + 1;
}

/* Returns a free range of at least `count` items; UMB__NO_EXTENT: none was found. */
static uint32_t find(const struct umb__extents *extents, uint32_t count)
{
    const uint32_t own = list_of(count);
    uint32_t at = extents->lists[own] > 0 ? extents->lists[own] - 1 : UMB__NO_EXTENT;
    for (uint32_t i = 0; i < TRIED && at != UMB__NO_EXTENT; i++) {
        if (extents->items[at].count >= count) {
            return at;
        }
        at = extents->items[at].list_next;
    }
    const uint32_t longer = own < 31 ? extents->filled & ~((2U << own) - 1) : 0;
    return longer ? extents->lists[__builtin_ctz(longer)] - 1 : UMB__NO_EXTENT;
}

/* Takes the first items of a free range; the rest becomes a free range of its own. */
static bool take_from(struct umb__extents *extents, uint32_t at, uint32_t count)
{
    const uint32_t more = extents->items[at].count - count;
    const uint32_t rest = more > 0 ? new_record(extents) : 0;
    if (rest == UMB__NO_EXTENT) {
        return false;
    }
    list_remove(extents, at);
    extents->items[at].count = count;
    if (more > 0) {
        const uint32_t after = extents->items[at].after;
        extents->items[rest] = (struct umb__extent){
            .begin = extents->items[at].begin + count, .count = more, .before = at, .after = after};
        extents->items[at].after = rest;
        extents->items[after].before = rest; /* There is one: no range is free at the end */
        list_add(extents, rest);
    }
    return true;
}

bool umb__extents_take(struct umb__extents *extents, uint32_t count, uint32_t *extent)
{
    const uint32_t found = find(extents, count);
    if (found != UMB__NO_EXTENT) {
        const bool taken = take_from(extents, found, count);
        *extent = taken ? found : *extent; /* A range that is still free must not be given back */
        return taken;
    }
    const uint32_t at = count < UINT32_MAX - extents->end ? new_record(extents) : UMB__NO_EXTENT;
    if (at == UMB__NO_EXTENT) {
        return false;
    }
    const uint32_t before = extents->last > 0 ? extents->last - 1 : UMB__NO_EXTENT;
    extents->items[at] = (struct umb__extent){
        .begin = extents->end, .count = count, .before = before, .after = UMB__NO_EXTENT};
    if (before != UMB__NO_EXTENT) {
        extents->items[before].after = at;
    }
    extents->last = at + 1;
    extents->end += count;
    *extent = at;
    return true;
}

void umb__extents_give(struct umb__extents *extents, uint32_t extent)
{
    uint32_t at = extent;
    const uint32_t before = extents->items[at].before, after = extents->items[at].after;
    if (after != UMB__NO_EXTENT && extents->items[after].free) {
        list_remove(extents, after);
        extents->items[at].count += extents->items[after].count;
        drop_record(extents, after);
    }
    if (before != UMB__NO_EXTENT && extents->items[before].free) {
        list_remove(extents, before);
        extents->items[before].count += extents->items[at].count;
        drop_record(extents, at);
        at = before;
    }
    if (extents->last == at + 1) {
        extents->end = extents->items[at].begin;
        drop_record(extents, at);
    } else {
        list_add(extents, at);
    }
}

void umb__extents_finish(struct umb__extents *extents)
{
    umb__free(extents->alloc, extents->items);
    memset(extents, 0, sizeof *extents);
}
