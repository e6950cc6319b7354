/* SPDX-License-Identifier: Apache-2.0 */
/* Opens partial assets, and adds pages: each page is verified by its hash and kept within a budget
 * of memory; see partial.h. */
#include "umbrage/partial.h"

#include <float.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/reserved.h"
#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "partial/partial_parts.h"

#define DEFAULT_MAX_MEMORY ((uint64_t)1 << 30)

/* Bytes kept free for links when a page is added: for the page's own links, and for those of
 * missing pages to which it is the first to refer. */
#define ROOM_FOR_LINKS 4096U

/* --- memory budget ---------------------------------------------------------------------------- */

/* The size of each block is stored before it, in 16 bytes, which keep the block aligned. */
#define PREFIX 16U

static void *resize(void *user, void *block, size_t bytes)
{
    struct umb__meter *meter = user;
    uint8_t *old = block ? (uint8_t *)block - PREFIX : NULL;
    uint64_t had = 0;
    if (old) {
        memcpy(&had, old, sizeof had);
    }
    if (bytes == 0) {
        umb__free(meter->inner, old);
        meter->used -= had;
        return NULL;
    }
    const uint64_t all = (uint64_t)bytes + PREFIX;
    if (all < bytes || all > meter->limit || meter->used - had > meter->limit - all) {
        return NULL;
    }
    uint8_t *made = umb__resize(meter->inner, old, (size_t)all);
    if (!made) {
        return NULL;
    }
    memcpy(made, &all, sizeof all);
    meter->used += all - had;
    meter->peak = meter->used > meter->peak ? meter->used : meter->peak;
    return made + PREFIX;
}

bool umb__partial_move(struct umb_partial *to, struct umb_partial *from, const void *block)
{
    uint64_t all;
    memcpy(&all, (const uint8_t *)block - PREFIX, sizeof all);
    if (all > to->meter.limit - to->meter.used) {
        return false;
    }
    from->meter.used -= all;
    to->meter.used += all;
    to->meter.peak = to->meter.used > to->meter.peak ? to->meter.used : to->meter.peak;
    return true;
}

/* Starts a meter of allocated bytes, and makes an allocator that counts with it. In: meter: must
 * stay at its address. */
static void meter_init(struct umb__meter *meter, const struct umb_alloc *inner, uint64_t limit,
                       struct umb_alloc *alloc)
{
    *meter = (struct umb__meter){.inner = inner, .limit = limit};
    *alloc = (struct umb_alloc){.resize = resize, .user = meter};
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

/* --- opening ---------------------------------------------------------------------------------- */

static enum umb_status no_memory(struct umb_error *error, const char *what)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "partial asset: no memory within the budget for %s",
                    what);
}

/* Returns a page's links, made at the first call; NULL: out of memory. */
static struct umb__links *links_of(struct umb_partial *p, uint32_t page)
{
    struct umb__held *held = &p->pages[page];
    if (!held->links) {
        held->links = umb__alloc_zeroed(&p->alloc, 1, sizeof *held->links);
    }
    return held->links;
}

/* Records that a page must have the node at a given position of a level. False: out of memory. */
static bool note_link(struct umb_partial *p, uint32_t level, uint32_t page, uint32_t position)
{
    struct umb__links *links = links_of(p, page);
    if (links && links->needed[level] <= position) {
        links->needed[level] = position + 1;
    }
    return links != NULL;
}

/* Checks that the head has the required id, and that the head's content hashes to this id. */
static enum umb_status check_id(struct umb_partial *p, const uint8_t *wanted,
                                struct umb_error *error)
{
    uint8_t id[UMB_ID_BYTES];
    if (wanted && memcmp(wanted, p->head.id, sizeof id) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: the head is that of another asset");
    }
    if (!umb__directory_identify(&p->head, p->sha256, &p->alloc, id)) {
        return no_memory(error, "the block hashes");
    }
    if (memcmp(id, p->head.id, sizeof id) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: does not match the canonical block and hashes");
    }
    return UMB_OK;
}

/* Makes room for the blocks. Adds the first one if the front holds all of it. */
static enum umb_status prepare_blocks(struct umb_partial *p, const uint8_t *front, size_t size,
                                      struct umb_error *error)
{
    p->blocks = umb__alloc_zeroed(&p->alloc, p->head.directory_count, sizeof *p->blocks);
    if (!p->blocks) {
        return umb_fail(error, UMB_E_TOO_LARGE, "directory: %u pages, the budget is %llu bytes",
                        p->head.page_count, (unsigned long long)p->meter.limit);
    }
    p->head.blocks = (const uint8_t *const *)p->blocks;
    const uint32_t first = p->head.first_block;
    return p->head.page_count > 0 && size - p->head.head_length >= first
               ? umb_partial_add_block(p, 0, front + p->head.head_length, first, error)
               : UMB_OK;
}

/* Finds the pages of the roots, and records which nodes these pages must have. */
static enum umb_status link_roots(struct umb_partial *p, struct umb_error *error)
{
    for (uint32_t i = 0; i < p->canonical.content.frustum_count; i++) {
        const struct umb__packed_root *root = &p->canonical.roots[i];
        const uint32_t level = p->canonical.content.frusta[i].log2_size;
        if (root->state != UMB__NODE_MIXED) {
            continue;
        }
        if (root->page >= p->head.page_count || root->position == UINT32_MAX) {
            return umb_fail(error, UMB_E_CORRUPT, "root %u: page %u is not there", i, root->page);
        }
        if (!note_link(p, level, root->page, root->position)) {
            return no_memory(error, "the roots");
        }
    }
    return UMB_OK;
}

static enum umb_status open_front(struct umb_partial *p, const void *front, size_t size,
                                  const uint8_t *id, struct umb_error *error)
{
    struct umb__head head;
    UMB__TRY(umb__head_parse_front(front, size, &head, error));
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "encoding: a mapped file has no pages");
    }
    p->head_bytes = umb__alloc(&p->alloc, (size_t)head.head_length, 1);
    if (!p->head_bytes) {
        return umb_fail(error, UMB_E_TOO_LARGE, "head: %llu bytes, the budget is %llu",
                        (unsigned long long)head.head_length, (unsigned long long)p->meter.limit);
    }
    memcpy(p->head_bytes, front, (size_t)head.head_length);
    UMB__TRY(umb__head_parse_front(p->head_bytes, (size_t)head.head_length, &p->head, error));
    UMB__TRY(check_id(p, id, error));
    UMB__TRY(umb__canonical_decode(p->head.canonical, p->head.canonical_length, &p->alloc,
                                   &p->canonical, error));
    p->zstd = ZSTD_createDCtx();
    p->pages = umb__alloc_zeroed(&p->alloc, p->head.page_count, sizeof *p->pages);
    p->heap = umb__alloc(&p->alloc, p->head.page_count, sizeof *p->heap);
    p->changed = umb__alloc(&p->alloc, p->head.page_count, sizeof *p->changed);
    if (!p->zstd || !p->pages || !p->heap || !p->changed) {
        return no_memory(error, "the list of pages");
    }
    UMB__TRY(link_roots(p, error));
    return prepare_blocks(p, front, size, error);
}

enum umb_status umb_partial_open(const void *front, size_t size,
                                 const struct umb_partial_options *options,
                                 struct umb_partial **out, struct umb_error *error)
{
    *out = NULL;
    if (UMB__UNKNOWN(options, "options", error)) {
        return UMB_E_ARGUMENT;
    }
    struct umb_partial *p = umb__alloc_zeroed(options->alloc, 1, sizeof *p);
    if (!p) {
        return no_memory(error, "itself");
    }
    meter_init(&p->meter, options->alloc,
               options->max_memory_bytes ? options->max_memory_bytes : DEFAULT_MAX_MEMORY,
               &p->alloc);
    p->meter.used = sizeof *p;
    p->node_extents.alloc = p->brick_extents.alloc = &p->alloc;
    p->sha256 = options->sha256;
    enum umb_status status = open_front(p, front, size, options->id, error);
    if (status != UMB_OK) {
        umb_partial_close(p);
        return status;
    }
    *out = p;
    return UMB_OK;
}

void umb_partial_close(struct umb_partial *p)
{
    if (!p) {
        return;
    }
    umb__partial_unbuild(p);
    (void)umb__spares_drop(p);
    for (uint32_t page = 0; p->pages && page < p->head.page_count; page++) {
        umb__free(&p->alloc, p->pages[page].stored);
        umb__free(&p->alloc, p->pages[page].raw);
        umb__free(&p->alloc, p->pages[page].links);
    }
    umb__free(&p->alloc, p->pages);
    umb__free(&p->alloc, p->changed);
    umb__free(&p->alloc, p->heap);
    for (uint32_t block = 0; p->blocks && block < p->head.directory_count; block++) {
        umb__free(&p->alloc, p->blocks[block]);
    }
    umb__free(&p->alloc, (void *)p->blocks);
    umb__canonical_finish(&p->canonical, &p->alloc);
    umb__free(&p->alloc, p->head_bytes);
    ZSTD_freeDCtx(p->zstd);
    umb__free(p->meter.inner, p);
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
            } else if (!note_link(p, level - 1, to.page, to.position)) {
                return no_memory(error, "a page's links");
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
        return no_memory(error, "a hash");
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
        return no_memory(error, "a page");
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

/* Frees uncompressed pages, else the spares of another version, else the page of the least benefit,
 * if that is below `benefit`. Returns false if there is none. */
static bool give_way(struct umb_partial *p, double benefit)
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
        if (!give_way(p, p->pages[entry->page].benefit)) {
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
    const enum umb_status status =
        raw ? check_and_keep(p, entry, stored, raw, error) : no_memory(error, "a page");
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
        return no_memory(error, "a page that matters less than those here");
    }
    uint8_t *copy = umb__alloc(&p->alloc, size, 1);
    if (!copy) {
        return no_memory(error, "a page");
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

enum umb_status umb_partial_add_block(struct umb_partial *p, uint32_t block, const void *bytes,
                                      size_t size, struct umb_error *error)
{
    if (block >= p->head.directory_count) {
        return umb_fail(error, UMB_E_ARGUMENT, "directory: block %u, the asset has %u", block,
                        p->head.directory_count);
    }
    if (p->blocks[block]) {
        return umb_fail(error, UMB_E_EXISTS, "directory: block %u is held already", block);
    }
    const uint32_t length = umb__block_bytes(&p->head, block);
    if (size != length) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: block %u: %zu bytes came, it has %u",
                        block, size, length);
    }
    UMB__TRY(umb__block_check(&p->head, block, bytes, length, NULL, error));
    UMB__TRY(umb__block_prove(&p->head, block, bytes, length, p->sha256, error));
    uint8_t *copy;
    do { /* Pages without benefit give way. Ends: each step frees something */
        copy = umb__alloc(&p->alloc, size, 1);
    } while (!copy && give_way(p, DBL_MIN));
    if (!copy) {
        return no_memory(error, "a block of the directory");
    }
    memcpy(copy, bytes, size);
    p->blocks[block] = copy;
    p->block_count++;
    umb__spares_use(p, block);
    return UMB_OK;
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

void umb_partial_locate_block(const struct umb_partial *p, uint32_t block, uint64_t *offset,
                              uint32_t *length)
{
    *offset = umb__block_offset(&p->head, block);
    *length = umb__block_bytes(&p->head, block);
}

const uint8_t *umb_partial_head(const struct umb_partial *p)
{
    return p->head_bytes;
}

const struct umb_asset *umb_partial_lower(const struct umb_partial *p)
{
    return p->built ? &p->lower : NULL;
}

void umb_partial_get_stats(const struct umb_partial *p, struct umb_partial_stats *stats)
{
    *stats = (struct umb_partial_stats){
        .page_count = p->head.page_count,
        .pages_held = p->held_count,
        .asset_bytes = p->head.file_length,
        .head_bytes = p->head.head_length,
        .held_bytes = p->held_bytes,
        .block_count = p->head.directory_count,
        .blocks_held = p->block_count,
        .memory_bytes = p->meter.used,
        .memory_peak_bytes = p->meter.peak,
        .pages_dropped = p->dropped,
        .builds = p->builds,
        .pages_inherited = p->inherited,
        .spare_bytes = p->spare_bytes,
    };
}
