/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Finds the held page of least benefit without a scan, by a heap. The heap is rebuilt when benefits
 * have changed. Entries of dropped pages stay in it until they reach the top.
 */
#include "partial/partial_parts.h"

/* Returns true if page a is dropped before page b: a has less benefit, or the same benefit and a
 * later place in the file. */
static bool is_worse(const struct umb_partial *p, uint32_t a, uint32_t b)
{
    const double x = p->pages[a].benefit, y = p->pages[b].benefit;
    return x < y || (!(y < x) && a > b);
}

/* Moves an entry of the heap down until none below it is worse. */
static void sift_down(struct umb_partial *p, uint32_t at)
{
    for (;;) {
        uint32_t worst = at;
        for (uint32_t child = 2 * at + 1; child < p->heap_count && child <= 2 * at + 2; child++) {
            worst = is_worse(p, p->heap[child], p->heap[worst]) ? child : worst;
        }
        if (worst == at) {
            return;
        }
        const uint32_t page = p->heap[at];
        p->heap[at] = p->heap[worst];
        p->heap[worst] = page;
        at = worst;
    }
}

static void make_heap(struct umb_partial *p)
{
    p->heap_count = 0;
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        if (p->pages[page].stored) {
            p->heap[p->heap_count++] = page;
        }
    }
    for (uint32_t at = p->heap_count / 2; at-- > 0;) {
        sift_down(p, at);
    }
    p->heap_fresh = true;
}

void umb__partial_note_page(struct umb_partial *p, uint32_t page)
{
    if (!p->heap_fresh || p->heap_count == p->head.page_count) {
        p->heap_fresh = false;
        return;
    }
    uint32_t at = p->heap_count++;
    p->heap[at] = page;
    while (at > 0 && is_worse(p, page, p->heap[(at - 1) / 2])) {
        p->heap[at] = p->heap[(at - 1) / 2];
        p->heap[(at - 1) / 2] = page;
        at = (at - 1) / 2;
    }
}

uint32_t umb__partial_worst(struct umb_partial *p)
{
    if (!p->heap_fresh) {
        make_heap(p);
    }
    while (p->heap_count > 0 && !p->pages[p->heap[0]].stored) {
        p->heap[0] = p->heap[--p->heap_count];
        sift_down(p, 0);
    }
    return p->heap_count > 0 ? p->heap[0] : UINT32_MAX;
}
