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

static void list_add(struct umb__extents *x, uint32_t at)
{
    struct umb__extent *extent = &x->items[at];
    const uint32_t list = list_of(extent->count), head = x->lists[list];
    extent->free = true;
    extent->list_prev = UMB__NO_EXTENT;
    extent->list_next = head > 0 ? head - 1 : UMB__NO_EXTENT;
    if (head > 0) {
        x->items[head - 1].list_prev = at;
    }
    x->lists[list] = at + 1;
    x->filled |= 1U << list;
}

static void list_remove(struct umb__extents *x, uint32_t at)
{
    struct umb__extent *extent = &x->items[at];
    const uint32_t list = list_of(extent->count);
    if (extent->list_prev != UMB__NO_EXTENT) {
        x->items[extent->list_prev].list_next = extent->list_next;
    } else {
        x->lists[list] = extent->list_next == UMB__NO_EXTENT ? 0 : extent->list_next + 1;
        x->filled = x->lists[list] > 0 ? x->filled : x->filled & ~(1U << list);
    }
    if (extent->list_next != UMB__NO_EXTENT) {
        x->items[extent->list_next].list_prev = extent->list_prev;
    }
    extent->free = false;
}

/* Returns an unused record; UMB__NO_EXTENT: out of memory. */
static uint32_t new_record(struct umb__extents *x)
{
    if (x->spare > 0) {
        const uint32_t at = x->spare - 1;
        x->spare = x->items[at].list_next;
        return at;
    }
    if (x->item_count >= UMB__NO_EXTENT - 1 ||
        !umb__grow(x->alloc, &x->items, &x->item_capacity, x->item_count + 1, sizeof *x->items)) {
        return UMB__NO_EXTENT;
    }
    return (uint32_t)x->item_count++;
}

static void drop_record(struct umb__extents *x, uint32_t at)
{
    struct umb__extent *extent = &x->items[at];
    if (extent->before != UMB__NO_EXTENT) {
        x->items[extent->before].after = extent->after;
    }
    if (extent->after != UMB__NO_EXTENT) {
        x->items[extent->after].before = extent->before;
    } else {
        x->last = extent->before == UMB__NO_EXTENT ? 0 : extent->before + 1;
    }
    extent->list_next = x->spare;
    x->spare = at + 1;
}

/* Returns a free range of at least `count` items; UMB__NO_EXTENT: none was found. */
static uint32_t find(const struct umb__extents *x, uint32_t count)
{
    const uint32_t own = list_of(count);
    uint32_t at = x->lists[own] > 0 ? x->lists[own] - 1 : UMB__NO_EXTENT;
    for (uint32_t i = 0; i < TRIED && at != UMB__NO_EXTENT; i++) {
        if (x->items[at].count >= count) {
            return at;
        }
        at = x->items[at].list_next;
    }
    const uint32_t longer = own < 31 ? x->filled & ~((2U << own) - 1) : 0;
    return longer ? x->lists[__builtin_ctz(longer)] - 1 : UMB__NO_EXTENT;
}

/* Takes the first items of a free range; the rest becomes a free range of its own. */
static bool take_from(struct umb__extents *x, uint32_t at, uint32_t count)
{
    const uint32_t more = x->items[at].count - count;
    const uint32_t rest = more > 0 ? new_record(x) : 0;
    if (rest == UMB__NO_EXTENT) {
        return false;
    }
    list_remove(x, at);
    x->items[at].count = count;
    if (more > 0) {
        const uint32_t after = x->items[at].after;
        x->items[rest] = (struct umb__extent){
            .begin = x->items[at].begin + count, .count = more, .before = at, .after = after};
        x->items[at].after = rest;
        x->items[after].before = rest; /* There is one: no range is free at the end */
        list_add(x, rest);
    }
    return true;
}

bool umb__extents_take(struct umb__extents *x, uint32_t count, uint32_t *extent)
{
    const uint32_t found = find(x, count);
    if (found != UMB__NO_EXTENT) {
        *extent = found;
        return take_from(x, found, count);
    }
    const uint32_t at = count < UINT32_MAX - x->end ? new_record(x) : UMB__NO_EXTENT;
    if (at == UMB__NO_EXTENT) {
        return false;
    }
    const uint32_t before = x->last > 0 ? x->last - 1 : UMB__NO_EXTENT;
    x->items[at] = (struct umb__extent){
        .begin = x->end, .count = count, .before = before, .after = UMB__NO_EXTENT};
    if (before != UMB__NO_EXTENT) {
        x->items[before].after = at;
    }
    x->last = at + 1;
    x->end += count;
    *extent = at;
    return true;
}

void umb__extents_give(struct umb__extents *x, uint32_t at)
{
    const uint32_t before = x->items[at].before, after = x->items[at].after;
    if (after != UMB__NO_EXTENT && x->items[after].free) {
        list_remove(x, after);
        x->items[at].count += x->items[after].count;
        drop_record(x, after);
    }
    if (before != UMB__NO_EXTENT && x->items[before].free) {
        list_remove(x, before);
        x->items[before].count += x->items[at].count;
        drop_record(x, at);
        at = before;
    }
    if (x->last == at + 1) {
        x->end = x->items[at].begin;
        drop_record(x, at);
    } else {
        list_add(x, at);
    }
}

void umb__extents_finish(struct umb__extents *x)
{
    umb__free(x->alloc, x->items);
    memset(x, 0, sizeof *x);
}
