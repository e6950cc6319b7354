/* SPDX-License-Identifier: Apache-2.0 */
/* Pages of a partial asset: each is verified by its hash and its links, and kept within the memory
 * budget, for which pages of less benefit give way; see partial.h. */
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "partial/partial_parts.h"

/* Bytes kept free for links when a page is added: for the page's own links, and for those of
 * missing pages to which it is the first to refer. */
#define ROOM_FOR_LINKS 4096U

enum umb_status umb__partial_no_memory(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "partial asset: no memory within the budget for %s",
                    what);
}

/* --- the page of least benefit ---------------------------------------------------------------- */

/* The page of least benefit is found by a heap, without a scan. The heap is rebuilt when benefits
 * have changed. Entries of dropped pages stay in it until they reach the top. */

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

static void note_page(struct umb_partial *p, uint32_t page)
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

/* --- pages ------------------------------------------------------------------------------------ */

/* Returns a page's links, made at the first call; NULL: out of memory. */
static struct umb__links *links_of(struct umb_partial *p, uint32_t page)
{
    struct umb__held *held = &p->pages[page];
    if (!held->links) {
        held->links = umb__alloc_zeroed(&p->alloc, 1, sizeof *held->links);
    }
    return held->links;
}

bool umb__partial_note_link(struct umb_partial *p, uint32_t level, uint32_t page, uint32_t position)
{
    struct umb__links *links = links_of(p, page);
    if (links && links->needed[level] <= position) {
        links->needed[level] = position + 1;
    }
    return links != NULL;
}

/* --- pages ------------------------------------------------------------------------------------ */

/* Checks that a link from a node of `level` can be right: it names an existing page and a possible
 * position of a node of the level below. */
static enum umb_status check_link(struct umb_partial *p, const struct umb__page *page,
                                  uint32_t number, uint32_t level, struct umb__node_place to,
                                  struct umb_error *error)
{
    bool there = to.page < p->head.page_count && to.position < p->canonical.counts[level - 1];
    if (there && to.page == number) {
        there = to.position < page->node_count[level - 1];
    } else if (there && p->pages[to.page].stored) {
        there = to.position < p->pages[to.page].links->count[level - 1];
    } else if (there && umb__partial_knows(p, to.page)) {
        const struct umb__page_entry entry = umb__directory_load(&p->head, to.page);
        there = to.position < entry.records && level - 1 <= entry.level_high &&
                level - 1 >= entry.level_low;
    }
    return there ? UMB_OK
                 : umb_fail(error, UMB_E_CORRUPT,
                            "page %u of the file: refers to node %u of level %u in page %u, which "
                            "is not there",
                            number, to.position, level - 1, to.page);
}

/* Checks the references of a page to nodes in other pages. With `note` it does not check: it
 * records that those pages must hold the nodes. */
static enum umb_status visit_links(struct umb_partial *p, const struct umb__page *page,
                                   uint32_t number, bool note, struct umb_error *error)
{
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        struct umb__page_others others = umb__page_others(page, level);
        for (size_t i = 0; i < page->external_count[level]; i++) {
            const struct umb__node_place to = umb__page_others_next(&others);
            if (!note) {
                UMB__TRY(check_link(p, page, number, level, to, error));
            } else if (!umb__partial_note_link(p, level - 1, to.page, to.position)) {
                return umb__partial_no_memory(error, "a page's links");
            }
        }
    }
    return UMB_OK;
}

/* Checks that the page has the nodes to which other pages refer. Also checks that it has no more
 * nodes than the asset: a page has at most one copy of a node. */
static enum umb_status check_counts(const struct umb_partial *p, uint32_t number,
                                    const struct umb__page *page, struct umb_error *error)
{
    const struct umb__links *links = p->pages[number].links;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        if (links && links->needed[level] > page->node_count[level]) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "page %u of the file: has %u nodes of level %u, others refer to %u",
                            number, page->node_count[level], level, links->needed[level]);
        }
        if (page->node_count[level] > p->canonical.counts[level]) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "page %u of the file: more nodes of level %u than the asset has",
                            number, level);
        }
    }
    return UMB_OK;
}

static enum umb_status prove(const struct umb_partial *p, const struct umb__page_entry *entry,
                             const uint8_t *raw, struct umb_error *error)
{
    const void *part = raw;
    const size_t size = entry->raw_length;
    uint8_t hash[UMB_ID_BYTES];
    p->sha256->digest(p->sha256->user, &part, &size, 1, hash);
    if (!umb__digest_made(hash)) {
        return umb__partial_no_memory(error, "a hash");
    }
    return memcmp(hash, umb__directory_hash(&p->head, entry->page), sizeof hash) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "page %u of the file: not what its hash says",
                          entry->page);
}

/* Stores a page. In: stored, raw: its stored and its uncompressed bytes, taken over. */
static enum umb_status keep(struct umb_partial *p, const struct umb__page *page,
                            const struct umb__page_entry *entry, uint8_t *stored, uint8_t *raw,
                            struct umb_error *error)
{
    struct umb__held *held = &p->pages[entry->page];
    struct umb__links *links = links_of(p, entry->page);
    if (!links) {
        return umb__partial_no_memory(error, "a page");
    }
    UMB__TRY(visit_links(p, page, entry->page, true, error));
    memcpy(links->count, page->node_count, sizeof links->count);
    held->stored = stored;
    held->stored_length = entry->stored_length;
    held->foreign = false;
    held->raw = raw;
    p->held_count++;
    p->held_bytes += entry->stored_length;
    note_page(p, entry->page);
    umb__partial_note_change(p, entry->page);
    return UMB_OK;
}

/* Proves a page by its hash, checks its links to and from other pages, and stores it. In: stored:
 * uint8[entry->stored_length]. raw: room for the uncompressed page. Both are taken over if the page
 * is stored. */
static enum umb_status check_and_keep(struct umb_partial *p, const struct umb__page_entry *entry,
                                      uint8_t *stored, uint8_t *raw, struct umb_error *error)
{
    struct umb__page page;
    struct umb__page_entry linked = *entry;
    umb__directory_links(&p->head, &linked, NULL);
    UMB__TRY(umb__page_expand(p->zstd, stored, entry, raw, error));
    UMB__TRY(prove(p, entry, raw, error));
    UMB__TRY(umb__page_open(raw, &linked, &page, error));
    UMB__TRY(check_counts(p, entry->page, &page, error));
    UMB__TRY(visit_links(p, &page, entry->page, false, error));
    return keep(p, &page, entry, stored, raw, error);
}

bool umb__spares_drop(struct umb_partial *p)
{
    const bool any = p->spares != NULL;
    for (uint32_t block = 0; p->spare_blocks && block < p->head.directory_count; block++) {
        umb__free(&p->alloc, p->spare_blocks[block]);
    }
    umb__free(&p->alloc, (void *)p->spare_blocks);
    p->spare_blocks = NULL;
    for (uint32_t i = 0; i < p->spare_count; i++) {
        umb__free(&p->alloc, p->spares[i].stored);
    }
    umb__free(&p->alloc, p->spares);
    p->spares = NULL;
    p->spare_count = 0;
    p->spare_bytes = 0;
    return any;
}

bool umb__partial_give_way(struct umb_partial *p, double benefit)
{
    if (umb__partial_free_raw(p) || umb__spares_drop(p)) {
        return true;
    }
    const uint32_t worst = umb__partial_worst(p);
    if (worst == UINT32_MAX || p->pages[worst].benefit >= benefit) {
        return false;
    }
    umb_partial_drop(p, worst);
    p->dropped++;
    return true;
}

/* Drops spares of another version, then pages of less benefit than a new one, until the new one
 * fits. */
static bool make_room(struct umb_partial *p, const struct umb__page_entry *entry)
{
    const uint64_t needed = (uint64_t)entry->raw_length + entry->stored_length + ROOM_FOR_LINKS;
    while (p->meter.limit - p->meter.used < needed) {
        if (!umb__partial_give_way(p, p->pages[entry->page].benefit)) {
            return false;
        }
    }
    return true;
}

/* Adds a page from its stored bytes, which are taken over if the page is stored. */
static enum umb_status add_stored(struct umb_partial *p, const struct umb__page_entry *entry,
                                  uint8_t *stored, struct umb_error *error)
{
    uint8_t *raw = umb__alloc(&p->alloc, entry->raw_length, 1);
    const enum umb_status status = raw ? check_and_keep(p, entry, stored, raw, error)
                                       : umb__partial_no_memory(error, "a page");
    if (status != UMB_OK) {
        umb__free(&p->alloc, raw);
    }
    return status;
}

void umb__partial_add_spare(struct umb_partial *p, uint32_t page, uint8_t *stored, uint32_t length)
{
    struct umb__page_entry entry = umb__directory_load(&p->head, page);
    const bool foreign =
        entry.stored_length != length || XXH3_64bits(stored, length) != entry.check;
    entry.stored_length = length;
    if (!make_room(p, &entry) || add_stored(p, &entry, stored, NULL) != UMB_OK) {
        umb__free(&p->alloc, stored);
        return;
    }
    p->pages[page].foreign = foreign;
    p->inherited++;
}

enum umb_status umb_partial_add(struct umb_partial *p, uint32_t page, const void *stored,
                                size_t size, struct umb_error *error)
{
    if (page >= p->head.page_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "page: %u, the asset has %u", page,
                        p->head.page_count);
    }
    if (!umb__partial_knows(p, page)) {
        return umb_fail(error, UMB_E_STATE,
                        "page %u of the file: block %u of the directory is missing; add it", page,
                        page / UMB__BLOCK_PAGES);
    }
    const struct umb__page_entry entry = umb__directory_load(&p->head, page);
    if (p->pages[page].stored) {
        return umb_fail(error, UMB_E_EXISTS, "page %u of the file: is held already", page);
    }
    if (size != entry.stored_length) {
        return umb_fail(error, UMB_E_CORRUPT, "page %u of the file: %zu bytes came, it has %u",
                        page, size, entry.stored_length);
    }
    if (XXH3_64bits(stored, size) != entry.check) {
        return umb_fail(error, UMB_E_CORRUPT, "page %u of the file: checksum does not match", page);
    }
    if (!make_room(p, &entry)) {
        return umb__partial_no_memory(error, "a page that matters less than those here");
    }
    uint8_t *copy = umb__alloc(&p->alloc, size, 1);
    if (!copy) {
        return umb__partial_no_memory(error, "a page");
    }
    memcpy(copy, stored, size);
    const enum umb_status status = add_stored(p, &entry, copy, error);
    if (status != UMB_OK) {
        umb__free(&p->alloc, copy);
    }
    return status;
}

uint8_t *umb__partial_release(struct umb_partial *p, uint32_t page)
{
    struct umb__held *held = &p->pages[page];
    uint8_t *stored = held->stored;
    if (stored) {
        p->held_bytes -= held->stored_length;
        p->held_count--;
        umb__free(&p->alloc, held->raw);
        held->stored = held->raw = NULL;
        umb__partial_note_change(p, page);
    }
    return stored;
}

void umb_partial_drop(struct umb_partial *p, uint32_t page)
{
    if (page < p->head.page_count) {
        umb__free(&p->alloc, umb__partial_release(p, page));
    }
}

int umb_partial_has(const struct umb_partial *p, uint32_t page)
{
    return page < p->head.page_count && p->pages[page].stored;
}

enum umb_status umb_partial_locate(const struct umb_partial *p, uint32_t page, uint64_t *offset,
                                   uint32_t *length)
{
    const struct umb__page_entry entry = umb__directory_load(&p->head, page);
    const bool known = umb__partial_knows(p, page);
    *offset = known ? entry.offset : 0;
    *length = known ? entry.stored_length : 0;
    return known ? UMB_OK : UMB_E_NOT_FOUND;
}

enum umb_status umb_partial_get_page(const struct umb_partial *p, uint32_t page,
                                     struct umb_partial_page *info)
{
    *info = (struct umb_partial_page){0};
    if (!umb__partial_knows(p, page)) {
        return UMB_E_NOT_FOUND;
    }
    const struct umb__page_entry entry = umb__directory_load(&p->head, page);
    *info = (struct umb_partial_page){.offset = entry.offset,
                                      .stored_bytes = entry.stored_length,
                                      .raw_bytes = entry.raw_length,
                                      .level_high = entry.level_high,
                                      .level_low = entry.level_low,
                                      .node_count = entry.records,
                                      .held = umb_partial_has(p, page)};
    memcpy(info->hash, umb__directory_hash(&p->head, page), sizeof info->hash);
    return UMB_OK;
}
