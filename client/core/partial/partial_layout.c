/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pages in the layout. Each page has a range of the array of wide nodes and one of the array of
 * bricks. A page that comes is expanded once and written into its ranges; one that goes gives its
 * ranges back. No other page moves.
 */
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/node_places.h"
#include "partial/partial_parts.h"

#define BRICK_BYTES 64U
#define LINE_BYTES  (UMB__LINE_WORDS * 8U)

/* Most items of an array: numbers of words, and of bricks, fit 32 bits with room for
 * UMB__CELL_FIRST and one node. */
#define LINES_MOST  ((UINT32_MAX - 64U) / UMB__LINE_WORDS)
#define BRICKS_MOST (UINT32_MAX - 64U)

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY,
                    "partial asset: the pages at hand do not fit the memory budget");
}

/* --- arrays ----------------------------------------------------------------------------------- */

/* Resizes an array; its content stays. Returns false if out of memory. */
static bool arena_resize(const struct umb_partial *p, struct umb__arena *arena, uint64_t bytes)
{
    const size_t offset = arena->block ? (size_t)(arena->base - arena->block) : 0;
    uint8_t *block = bytes < SIZE_MAX - LINE_BYTES
                         ? umb__resize(&p->alloc, arena->block, (size_t)bytes + LINE_BYTES)
                         : NULL;
    if (!block) {
        return false;
    }
    uint8_t *base = block + (LINE_BYTES - (uintptr_t)block % LINE_BYTES) % LINE_BYTES;
    if (arena->block && base != block + offset) {
        memmove(base, block + offset, arena->bytes < bytes ? arena->bytes : (size_t)bytes);
    }
    *arena = (struct umb__arena){block, base, (size_t)bytes};
    return true;
}

/* Makes room for so many bytes; a quarter more, if possible. */
static bool arena_fit(const struct umb_partial *p, struct umb__arena *arena, uint64_t bytes)
{
    return bytes <= arena->bytes || arena_resize(p, arena, bytes + bytes / 4) ||
           arena_resize(p, arena, bytes);
}

/* Shrinks an array that is twice as long as needed. */
static void arena_trim(const struct umb_partial *p, struct umb__arena *arena, uint64_t bytes)
{
    if (arena->bytes / 2 > bytes + LINE_BYTES) {
        (void)arena_resize(p, arena, bytes + LINE_BYTES);
    }
}

void umb__partial_trim(struct umb_partial *p)
{
    for (size_t i = 0; i < 2; i++) {
        arena_trim(p, &p->nodes[i], (uint64_t)p->node_extents.end * LINE_BYTES);
    }
    arena_trim(p, &p->bricks, (uint64_t)p->brick_extents.end * BRICK_BYTES);
}

/* --- one page --------------------------------------------------------------------------------- */

/* Makes the record of a page, with its lists of words and watches in the same block. */
static struct umb__laid *make_laid(const struct umb_partial *p, struct umb__expanded *nodes)
{
    uint64_t count = 0;
    for (uint32_t l = UMB__WIDE_FIRST; l <= p->level_highest; l += 2) {
        count += nodes->level[l].count;
    }
    struct umb__laid *laid =
        umb__alloc(&p->alloc, 1, sizeof *laid + (size_t)(2 * count * sizeof(uint32_t)));
    if (!laid) {
        return NULL;
    }
    memset(laid, 0, sizeof *laid);
    laid->nodes = nodes;
    laid->node_extent = laid->brick_extent = UMB__NO_EXTENT;
    uint32_t *at = (uint32_t *)(void *)(laid + 1);
    memset(at, 0, (size_t)(2 * count * sizeof *at));
    for (uint32_t l = UMB__WIDE_FIRST; l <= p->level_highest; l += 2) {
        laid->words[l] = at;
        laid->watches[l] = at + nodes->level[l].count;
        at += 2 * (size_t)nodes->level[l].count;
    }
    return laid;
}

/* Places the page's wide nodes one behind the other. Returns their lines. */
static uint64_t place_words(const struct umb_partial *p, uint32_t page, struct umb__laid *laid)
{
    uint64_t end = 0;
    for (uint32_t l = UMB__WIDE_FIRST; l <= p->level_highest; l += 2) {
        struct umb__node_places places = {.end = end};
        for (uint32_t i = 0; i < laid->nodes->level[l].count; i++) {
            const uint64_t words = umb__wide_words_most(p, page, laid->nodes, l, i);
            laid->words[l][i] = (uint32_t)umb__place_node(&places, words);
        }
        end = places.end;
    }
    return (end + UMB__LINE_WORDS - 1) / UMB__LINE_WORDS;
}

/* Takes a range of an array. In: count: 0 takes none. Returns false if out of memory. */
static bool take(struct umb__extents *extents, uint64_t count, uint32_t most, uint32_t *extent)
{
    return count == 0 || (count <= most && umb__extents_take(extents, (uint32_t)count, extent) &&
                          extents->end <= most);
}

static void move_words(const struct umb_partial *p, struct umb__laid *laid)
{
    const uint32_t begin =
        umb__extents_begin(&p->node_extents, laid->node_extent) * UMB__LINE_WORDS;
    for (uint32_t l = UMB__WIDE_FIRST; l <= p->level_highest; l += 2) {
        for (uint32_t i = 0; i < laid->nodes->level[l].count; i++) {
            laid->words[l][i] += begin;
        }
    }
}

/* Finds the places of a page's wide nodes and bricks. Returns false if out of memory. */
static bool place_page(struct umb_partial *p, uint32_t page, struct umb__laid *laid)
{
    const uint64_t lines = place_words(p, page, laid);
    if (!take(&p->node_extents, lines, LINES_MOST, &laid->node_extent) ||
        !take(&p->brick_extents, laid->nodes->brick_count, BRICKS_MOST, &laid->brick_extent)) {
        return false;
    }
    if (laid->node_extent != UMB__NO_EXTENT) {
        move_words(p, laid);
    }
    if (laid->brick_extent != UMB__NO_EXTENT) {
        laid->first_brick = umb__extents_begin(&p->brick_extents, laid->brick_extent);
    }
    const uint64_t bytes = (uint64_t)p->node_extents.end * LINE_BYTES;
    return arena_fit(p, &p->nodes[0], bytes) && arena_fit(p, &p->nodes[1], bytes) &&
           arena_fit(p, &p->bricks, (uint64_t)p->brick_extents.end * BRICK_BYTES);
}

static void free_laid(struct umb_partial *p, struct umb__laid *laid)
{
    if (laid->node_extent != UMB__NO_EXTENT) {
        umb__extents_give(&p->node_extents, laid->node_extent);
    }
    if (laid->brick_extent != UMB__NO_EXTENT) {
        umb__extents_give(&p->brick_extents, laid->brick_extent);
    }
    umb__free(&p->alloc, laid->nodes);
    umb__free(&p->alloc, laid);
}

static bool expand_bricks(struct umb_partial *p, const struct umb__page *page,
                          const struct umb__laid *laid)
{
    if (laid->nodes->brick_count == 0) {
        return true;
    }
    uint64_t *leaves = umb__alloc(&p->alloc, page->leaf_count, sizeof *leaves);
    if (!leaves) {
        return false;
    }
    uint64_t(*bricks)[8] = (uint64_t(*)[8])(void *)p->bricks.base;
    umb__expand_bricks(page, leaves, bricks + laid->first_brick);
    umb__changes_note_bricks(p, laid->first_brick, laid->nodes->brick_count);
    umb__free(&p->alloc, leaves);
    return true;
}

/* Returns the page's record, with its bricks in their places; NULL: out of memory. */
static struct umb__laid *lay_parsed(struct umb_partial *p, uint32_t number,
                                    const struct umb__page *page)
{
    struct umb__expanded *nodes = umb__expand_nodes(page, &p->alloc);
    if (!nodes) {
        return NULL;
    }
    struct umb__laid *laid = make_laid(p, nodes);
    if (!laid) {
        umb__free(&p->alloc, nodes);
        return NULL;
    }
    if (!place_page(p, number, laid) || !expand_bricks(p, page, laid)) {
        free_laid(p, laid);
        return NULL;
    }
    return laid;
}

bool umb__partial_free_raw(struct umb_partial *p)
{
    bool any = false;
    for (uint32_t i = 0; i < p->changed_count; i++) {
        struct umb__held *held = &p->pages[p->changed[i]];
        any = any || held->raw;
        umb__free(&p->alloc, held->raw);
        held->raw = NULL;
    }
    return any;
}

/* Uncompresses a page again, if its uncompressed bytes were given up. */
static enum umb_status find_raw(struct umb_partial *p, const struct umb__page_entry *entry,
                                struct umb_error *error)
{
    struct umb__held *held = &p->pages[entry->page];
    if (held->raw) {
        return UMB_OK;
    }
    held->raw = umb__alloc(&p->alloc, entry->raw_length, 1);
    struct umb__page_entry own = *entry;
    own.stored_length = held->stored_length;
    return held->raw ? umb__page_expand(p->zstd, held->stored, &own, held->raw, error)
                     : no_memory(error);
}

/* Counts the nodes of a page that came or goes. */
static void count_nodes(struct umb_partial *p, const struct umb__expanded *nodes, bool came)
{
    for (uint32_t l = UMB_LEVEL_BRICK; l <= UMB_LEVEL_MAX; l++) {
        const uint64_t count = umb__expanded_count(nodes, l);
        p->node_count += came ? count : 0 - count;
        p->tops_stale = p->tops_stale || (count > 0 && l >= p->level_lowest);
    }
}

enum umb_status umb__partial_lay(struct umb_partial *p, uint32_t number, struct umb_error *error)
{
    struct umb__held *held = &p->pages[number];
    struct umb__page_entry entry = umb__directory_load(&p->head, number);
    struct umb__page page;
    umb__directory_links(&p->head, &entry, NULL);
    enum umb_status status = find_raw(p, &entry, error);
    status = status == UMB_OK ? umb__page_open(held->raw, &entry, &page, error) : status;
    struct umb__laid *laid = status == UMB_OK ? lay_parsed(p, number, &page) : NULL;
    umb__free(&p->alloc, held->raw);
    held->raw = NULL;
    if (!laid) {
        return status == UMB_OK ? no_memory(error) : status;
    }
    held->laid = laid;
    count_nodes(p, laid->nodes, true);
    umb__wide_mark_watchers(p, number);
    return UMB_OK;
}

void umb__partial_unlay(struct umb_partial *p, uint32_t page)
{
    struct umb__laid *laid = p->pages[page].laid;
    umb__wide_forget(p, laid);
    count_nodes(p, laid->nodes, false);
    free_laid(p, laid);
    p->pages[page].laid = NULL;
    umb__wide_mark_watchers(p, page);
}

/* --- the whole layout ------------------------------------------------------------------------- */

void umb__partial_note_change(struct umb_partial *p, uint32_t page)
{
    struct umb__held *held = &p->pages[page];
    if (!held->changed) {
        held->changed = true;
        p->changed[p->changed_count++] = page;
    }
}

void umb__partial_unbuild(struct umb_partial *p)
{
    for (uint32_t page = 0; p->pages && p->changed && page < p->head.page_count; page++) {
        struct umb__held *held = &p->pages[page];
        if (held->laid) {
            umb__free(&p->alloc, held->laid->nodes);
            umb__free(&p->alloc, held->laid);
            held->laid = NULL;
            umb__partial_note_change(p, page);
        }
        held->watchers = 0;
    }
    struct umb__arena *const arenas[] = {&p->nodes[0], &p->nodes[1], &p->bricks};
    for (size_t i = 0; i < 3; i++) {
        umb__free(&p->alloc, arenas[i]->block);
        *arenas[i] = (struct umb__arena){0};
    }
    umb__extents_finish(&p->node_extents);
    umb__extents_finish(&p->brick_extents);
    p->node_extents.alloc = p->brick_extents.alloc = &p->alloc;
    umb__free(&p->alloc, p->watches);
    umb__free(&p->alloc, p->dirty);
    p->watches = NULL;
    p->dirty = NULL;
    p->watch_count = p->watch_capacity = p->dirty_count = p->dirty_capacity = 0;
    p->watch_spare = 0;
    umb__tops_finish(p);
    umb__changes_note_all(p);
    p->node_count = 0;
    p->broken = false;
    p->built = false;
}
