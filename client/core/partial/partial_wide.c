/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Wide nodes of the lower and the upper asset. A wide node spans two octree levels, so its content
 * depends on its octree node, on that node's children, and on whether each grandchild's page is
 * held. Children and grandchildren may be in other pages. The wide node then watches those pages,
 * and is written again in its place when one of them comes or goes. Its place has room for the most
 * mixed grandchildren that it can have.
 *
 * Both assets have their wide nodes at the same words: a missing subtree is never mixed, so only
 * the words of lit children differ.
 *
 * Bounds: writing one wide node takes at most 64 grandchildren and 72 watches. A page that comes or
 * goes makes each wide node that watches it be written once, and each of these has a reference into
 * the page, or into a page between the two.
 */
#include <string.h>

#include "base/memory.h"
#include "partial/partial_parts.h"

/* Most pages that a wide node watches: of its children, and of their children. */
#define WATCHES_MOST 72U

uint64_t umb__wide_words_most(const struct umb_partial *p, uint32_t page,
                              const struct umb__expanded *nodes, uint32_t level, uint32_t position)
{
    const struct umb__expanded_level *own = &nodes->level[level];
    uint64_t mixed = 0;
    for (uint32_t c = own->first[position]; c < own->first[position + 1]; c++) {
        const struct umb__node_place place =
            umb__expanded_child(nodes, page, level, own->children[c]);
        const struct umb__laid *laid = p->pages[place.page].laid;
        const struct umb__expanded *at = place.page == page ? nodes : laid ? laid->nodes : NULL;
        mixed += at ? umb__mask_mixed_count(at->level[level - 1].masks[place.position]) : 8;
    }
    return umb__wide_words(mixed);
}

/* --- watches ---------------------------------------------------------------------------------- */

static uint32_t *watches_of(const struct umb__laid *laid, uint32_t wide)
{
    return &laid->watches[wide >> 24][wide & 0xffffff];
}

static void unlink_watch(struct umb_partial *p, uint32_t at)
{
    struct umb__watch *watch = &p->watches[at];
    if (watch->previous > 0) {
        p->watches[watch->previous - 1].next = watch->next;
    } else {
        p->pages[watch->watched].watchers = watch->next;
    }
    if (watch->next > 0) {
        p->watches[watch->next - 1].previous = watch->previous;
    }
    watch->next_of_wide = p->watch_spare;
    p->watch_spare = at + 1;
}

/* Removes the watches of one wide node. In: list: its entry in `watches`, which becomes 0. */
static void forget(struct umb_partial *p, uint32_t *list)
{
    uint32_t at = *list & ~UMB__WIDE_DIRTY;
    *list = 0;
    while (at > 0) {
        const uint32_t next = p->watches[at - 1].next_of_wide;
        unlink_watch(p, at - 1);
        at = next;
    }
}

void umb__wide_forget(struct umb_partial *p, const struct umb__laid *laid)
{
    for (uint32_t l = UMB__WIDE_FIRST; l <= p->level_highest; l += 2) {
        for (uint32_t i = 0; i < laid->nodes->level[l].count; i++) {
            forget(p, &laid->watches[l][i]);
        }
    }
}

static bool new_watch(struct umb_partial *p, uint32_t *at)
{
    if (p->watch_spare > 0) {
        *at = p->watch_spare - 1;
        p->watch_spare = p->watches[*at].next_of_wide;
        return true;
    }
    if (p->watch_count >= UMB__WIDE_DIRTY - 1 ||
        !umb__grow(&p->alloc, &p->watches, &p->watch_capacity, p->watch_count + 1,
                   sizeof *p->watches)) {
        return false;
    }
    *at = (uint32_t)p->watch_count++;
    return true;
}

/* Makes a wide node watch a page. In: list: the wide node's entry in `watches`. */
static bool watch_page(struct umb_partial *p, struct umb__wide_ref ref, uint32_t watched,
                       uint32_t *list)
{
    uint32_t at;
    if (!new_watch(p, &at)) {
        return false;
    }
    uint32_t *first = &p->pages[watched].watchers;
    p->watches[at] = (struct umb__watch){.page = ref.page,
                                         .wide = ref.wide,
                                         .watched = watched,
                                         .next_of_wide = *list,
                                         .next = *first};
    if (*first > 0) {
        p->watches[*first - 1].previous = at + 1;
    }
    *first = at + 1;
    *list = at + 1;
    return true;
}

void umb__wide_mark_watchers(struct umb_partial *p, uint32_t page)
{
    for (uint32_t at = p->pages[page].watchers; at > 0; at = p->watches[at - 1].next) {
        const struct umb__watch *watch = &p->watches[at - 1];
        uint32_t *list = watches_of(p->pages[watch->page].laid, watch->wide);
        if (*list & UMB__WIDE_DIRTY) {
            continue;
        }
        if (!umb__grow(&p->alloc, &p->dirty, &p->dirty_capacity, p->dirty_count + 1,
                       sizeof *p->dirty)) {
            p->broken = true;
            return;
        }
        *list |= UMB__WIDE_DIRTY;
        p->dirty[p->dirty_count++] = (struct umb__wide_ref){watch->page, watch->wide};
    }
}

/* --- writing ---------------------------------------------------------------------------------- */

/* A wide node under construction. */
struct wide {
    uint64_t mixed;
    uint64_t lit[2];        /* Of the lower and of the upper asset */
    uint32_t number_at[64]; /* Numbers of the mixed grandchildren, by bit */
    uint32_t watched[WATCHES_MOST];
    uint32_t watched_count;
};

/* Notes that the wide node depends on another page. */
static void note_page(struct wide *wide, uint32_t page)
{
    for (uint32_t i = wide->watched_count; i-- > 0;) {
        if (wide->watched[i] == page) {
            return;
        }
    }
    wide->watched[wide->watched_count++] = page;
}

static uint32_t number_of(const struct umb__laid *laid, uint32_t level, uint32_t position)
{
    return level == UMB_LEVEL_BRICK ? laid->first_brick + position : laid->words[level][position];
}

/* Adds the children of one child. In: bits: bit of each grandchild. at: page of the child. */
static void widen_child(const struct umb_partial *p, uint32_t own, uint32_t level, unsigned c,
                        struct umb__node_place at, struct wide *wide)
{
    const struct umb__expanded *nodes = p->pages[at.page].laid->nodes;
    const struct umb__expanded_level *from = &nodes->level[level];
    const uint32_t *child = from->children + from->first[at.position];
    for (unsigned g = 0; g < 8; g++) {
        const enum umb__node_state state = umb__mask_state(from->masks[at.position], g);
        const unsigned bit = umb__wide_bit(c, g);
        if (state != UMB__NODE_MIXED) {
            wide->lit[0] |= (uint64_t)state << bit;
            wide->lit[1] |= (uint64_t)state << bit;
            continue;
        }
        const struct umb__node_place place = umb__expanded_child(nodes, at.page, level, *child++);
        const struct umb__laid *laid = p->pages[place.page].laid;
        if (place.page != own) {
            note_page(wide, place.page);
        }
        if (laid) {
            wide->mixed |= (uint64_t)1 << bit;
            wide->number_at[bit] = number_of(laid, level - 1, place.position);
        } else {
            wide->lit[1] |= (uint64_t)1 << bit;
        }
    }
}

/* Bits of the grandchildren of child 0; those of child c begin at umb__wide_bit(c, 0). */
#define CHILD_BITS UINT64_C(0x330033)

static void widen(const struct umb_partial *p, uint32_t page, uint32_t level, uint32_t position,
                  struct wide *wide)
{
    const struct umb__expanded *nodes = p->pages[page].laid->nodes;
    const struct umb__expanded_level *from = &nodes->level[level];
    const uint32_t *child = from->children + from->first[position];
    wide->mixed = wide->lit[0] = wide->lit[1] = 0;
    wide->watched_count = 0;
    for (unsigned c = 0; c < 8; c++) {
        const enum umb__node_state state = umb__mask_state(from->masks[position], c);
        const uint64_t bits = CHILD_BITS << umb__wide_bit(c, 0);
        if (state != UMB__NODE_MIXED) {
            wide->lit[0] |= state == UMB__NODE_LIT ? bits : 0;
            wide->lit[1] |= state == UMB__NODE_LIT ? bits : 0;
            continue;
        }
        const struct umb__node_place place = umb__expanded_child(nodes, page, level, *child++);
        if (place.page != page) {
            note_page(wide, place.page);
        }
        if (p->pages[place.page].laid) {
            widen_child(p, page, level - 1, c, place, wide);
        } else {
            wide->lit[1] |= bits;
        }
    }
}

static bool write_wide(struct umb_partial *p, uint32_t page, uint32_t level, uint32_t position)
{
    const struct umb__laid *laid = p->pages[page].laid;
    uint32_t *list = &laid->watches[level][position];
    const uint32_t word = laid->words[level][position];
    struct wide wide;
    widen(p, page, level, position, &wide);
    uint64_t *lower = (uint64_t *)(void *)p->nodes[0].base + word;
    uint64_t *upper = (uint64_t *)(void *)p->nodes[1].base + word;
    lower[0] = upper[0] = wide.mixed;
    lower[1] = wide.lit[0];
    upper[1] = wide.lit[1];
    uint64_t pair = 0;
    unsigned count = 0;
    for (uint64_t rest = wide.mixed; rest; rest &= rest - 1, count++) {
        pair |= (uint64_t)wide.number_at[__builtin_ctzll(rest)] << 32 * (count & 1);
        lower[2 + count / 2] = upper[2 + count / 2] = pair;
        pair = count & 1 ? 0 : pair;
    }
    for (uint64_t i = 2 + (count + 1) / 2; i < umb__wide_words(count); i++) {
        lower[i] = upper[i] = 0;
    }
    umb__changes_note_nodes(p, word, umb__wide_words(count));
    forget(p, list);
    for (uint32_t i = 0; i < wide.watched_count; i++) {
        const struct umb__wide_ref ref = {page, umb__wide_name(level, position)};
        if (!watch_page(p, ref, wide.watched[i], list)) {
            return false;
        }
    }
    return true;
}

bool umb__wide_write_page(struct umb_partial *p, uint32_t page)
{
    struct umb__laid *laid = p->pages[page].laid;
    for (uint32_t l = UMB__WIDE_FIRST; l <= p->level_highest; l += 2) {
        for (uint32_t i = 0; i < laid->nodes->level[l].count; i++) {
            if (!write_wide(p, page, l, i)) {
                return false;
            }
        }
    }
    laid->written = true;
    return true;
}

bool umb__wide_write_marked(struct umb_partial *p)
{
    for (size_t i = 0; i < p->dirty_count; i++) {
        const struct umb__wide_ref ref = p->dirty[i];
        const struct umb__laid *laid = p->pages[ref.page].laid;
        if (laid && (*watches_of(laid, ref.wide) & UMB__WIDE_DIRTY) &&
            !write_wide(p, ref.page, ref.wide >> 24, ref.wide & 0xffffff)) {
            return false;
        }
    }
    p->dirty_count = 0;
    return true;
}
