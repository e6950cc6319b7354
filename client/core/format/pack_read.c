/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reading all pages of a packed file, in two passes. The first pass uncompresses and parses all
 * pages, which gives the number of their nodes. The second pass adds the nodes to a pool, level by
 * level from the bricks up, so that copies of a node in several pages become one again. Numbers
 * follow the order of the file. No level may have more different nodes than the canonical block
 * counts.
 *
 * Another process may overwrite a mapped file at any time. So an entry of the directory is loaded
 * once for each use and checked against the memory allocated for its page, and nodes are read only
 * from private copies of the pages.
 */
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/compat.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/asset_parts.h"
#include "format/directory.h"
#include "format/layout.h"
#include "format/node_pool_parts.h"

enum {
    BRICK_BYTES = 64,
    NODE_BYTES_MAX = 2 + 4 + 8 * 4, /* Mask, first, children */
};

typedef uint32_t page_numbers[UMB_LEVEL_MAX + 1];

struct reader {
    const uint8_t *file;
    const struct umb__head *head;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    ZSTD_DCtx *zstd;
    uint8_t *raw;            /* All pages, uncompressed and contiguous */
    struct umb__page *pages; /* [page count] Parsed pages, which point into raw */
    page_numbers *first; /* [page count] Index in `numbers` of a page's first node of each level */
    uint32_t *numbers[UMB_LEVEL_MAX + 1]; /* Pool numbers of the nodes of all pages */
    uint32_t *others; /* Numbers in the pool of the nodes in other pages to which one level of a
                         page refers */
    uint64_t *leaves; /* Leaves of a page; `others` and `leaves` have room for any page */
    struct umb__pool pool;
};

/* Uncompresses a page. Checks the page's place first and, with `check`, the page's checksum. In:
 * raw: uint8[room]. */
static enum umb_status expand(ZSTD_DCtx *zstd, const uint8_t *file, const struct umb__head *head,
                              const struct umb__page_entry *entry, int check, uint8_t *raw,
                              uint64_t room, struct umb_error *error)
{
    /* Another process may have changed the entry. */
    if (entry->raw_length > room || entry->offset > head->file_length ||
        entry->stored_length > head->file_length - entry->offset) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: page %u changed while it was read",
                        entry->page);
    }
    const uint8_t *stored = file + entry->offset;
    /* The decoder ignores some bits of a page, so no other check detects a flip of those bits. */
    if (check && XXH3_64bits(stored, entry->stored_length) != entry->check) {
        return umb_fail(error, UMB_E_CORRUPT, "page %u of the file: checksum does not match",
                        entry->page);
    }
    return umb__page_expand(zstd, stored, entry, raw, error);
}

/* Makes the first pass: expands and parses all pages. Out: totals: number of nodes of each level in
 * all pages. */
static enum umb_status parse_pages(struct reader *r, int check, uint64_t raw_total,
                                   uint64_t totals[UMB_LEVEL_MAX + 1])
{
    uint32_t count = r->head->page_count;
    r->zstd = ZSTD_createDCtx();
    r->raw = umb__alloc(r->alloc, (size_t)raw_total, 1);
    r->pages = umb__alloc(r->alloc, count, sizeof *r->pages);
    r->first = umb__alloc(r->alloc, count, sizeof *r->first);
    if (!r->zstd || !r->raw || !r->pages || !r->first) {
        return umb_fail(r->error, UMB_E_NO_MEMORY, "opening: no memory for %u pages", count);
    }
    memset(totals, 0, (UMB_LEVEL_MAX + 1) * sizeof *totals);
    uint64_t used = 0;
    for (uint32_t page = 0; page < count; page++) {
        struct umb__page_entry entry = umb__directory_load(r->head, page);
        UMB__TRY(expand(r->zstd, r->file, r->head, &entry, check, r->raw + used, raw_total - used,
                        r->error));
        /* The room behind a page is that of its links, as umb__directory_check counted them. */
        if (entry.links_length > raw_total - used - entry.raw_length) {
            return umb_fail(r->error, UMB_E_CORRUPT, "directory: page %u changed while it was read",
                            page);
        }
        umb__directory_links(r->head, &entry, r->raw + used + entry.raw_length);
        UMB__TRY(umb__page_open(r->raw + used, &entry, &r->pages[page], r->error));
        used += entry.raw_length + entry.links_length;
        for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
            r->first[page][level] = (uint32_t)totals[level];
            totals[level] += r->pages[page].node_count[level];
            if (totals[level] >= UINT32_MAX) {
                return umb_fail(r->error, UMB_E_CORRUPT, "level %zu: too many nodes", level);
            }
        }
    }
    return UMB_OK;
}

static enum umb_status wrong_counts(struct umb_error *error)
{
    return umb_fail(error, UMB_E_CORRUPT, "counts: not the nodes that the pages hold");
}

/* Allocates the tables, large enough for any page. */
static bool allocate_tables(struct reader *r)
{
    uint32_t others = 0, leaves = 0;
    for (uint32_t p = 0; p < r->head->page_count; p++) {
        const struct umb__page *page = &r->pages[p];
        leaves = page->leaf_count > leaves ? page->leaf_count : leaves;
        for (size_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
            others = page->external_count[l] > others ? page->external_count[l] : others;
        }
    }
    r->others = umb__alloc(r->alloc, (size_t)others + 1, sizeof *r->others);
    r->leaves = umb__alloc(r->alloc, (size_t)leaves + 1, sizeof *r->leaves);
    return r->others && r->leaves;
}

/* Checks the canonical block's counts of nodes, and allocates numbers and tables. In: totals: nodes
 * of each level in all pages, copies included; no count may exceed the total of its level. */
static enum umb_status allocate_numbers(struct reader *r, const struct umb__canonical *canonical,
                                        const uint64_t *totals)
{
    for (size_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        if (canonical->counts[level] > totals[level]) {
            return wrong_counts(r->error);
        }
        r->numbers[level] =
            umb__alloc_large(r->alloc, (size_t)totals[level], sizeof *r->numbers[level]);
        if (!r->numbers[level]) {
            return umb_fail(r->error, UMB_E_NO_MEMORY, "opening: no memory for the nodes");
        }
    }
    return allocate_tables(r)
               ? UMB_OK
               : umb_fail(r->error, UMB_E_NO_MEMORY, "opening: no memory for a page's tables");
}

/* Returns the pool's number of a node in any page. The pool must have the node's level. */
static enum umb_status resolve(const struct reader *r, uint32_t level, uint32_t page,
                               uint32_t position, uint32_t *number)
{
    if (page >= r->head->page_count || position >= r->pages[page].node_count[level]) {
        return umb_fail(r->error, UMB_E_CORRUPT, "node %u of level %u in page %u: not there",
                        position, level, page);
    }
    *number = r->numbers[level][r->first[page][level] + position];
    return UMB_OK;
}

/* Finds the pool's numbers of the nodes in other pages to which one level of a page refers. */
static enum umb_status read_others(struct reader *r, uint32_t p, uint32_t l)
{
    const struct umb__page *page = &r->pages[p];
    struct umb__page_others others = umb__page_others(page, l);
    for (uint32_t i = 0; i < page->external_count[l]; i++) {
        const struct umb__node_place place = umb__page_others_next(&others);
        const enum umb_status status = resolve(r, l - 1, place.page, place.position, &r->others[i]);
        if (status != UMB_OK) {
            return umb__in_page(r->error, p, status);
        }
    }
    return UMB_OK;
}

/* Reads the next group of nodes of one level of a page, as keys for the node pool. The nodes of
 * other pages to which they refer are in the node pool already. */
static void read_keys(const struct reader *r, const uint32_t *own, struct umb__page_nodes *nodes,
                      struct umb__pool_group *group)
{
    for (uint32_t i = 0; i < group->count; i++) {
        struct umb__node_key *key = &group->keys[i];
        *key = (struct umb__node_key){0};
        uint32_t *children = key->words + 1;
        uint16_t mask;
        key->child_count = umb__page_nodes_next(nodes, &mask, children);
        key->words[0] = mask;
        for (uint32_t c = 0; c < key->child_count; c++) {
            children[c] =
                children[c] < nodes->own ? own[children[c]] : r->others[children[c] - nodes->own];
        }
    }
}

static enum umb_status add_nodes(struct reader *r, uint32_t p, uint32_t l)
{
    UMB__UNSET struct umb__pool_group group;
    const struct umb__page *page = &r->pages[p];
    const uint32_t count = page->node_count[l];
    const uint32_t *own = r->numbers[l - 1] + r->first[p][l - 1];
    uint32_t *numbers = r->numbers[l] + r->first[p][l];
    struct umb__page_nodes nodes = umb__page_nodes(page, l);
    UMB__TRY(read_others(r, p, l));
    for (uint32_t i = 0; i < count; i += UMB__POOL_GROUP) {
        group.count = count - i < UMB__POOL_GROUP ? count - i : UMB__POOL_GROUP;
        read_keys(r, own, &nodes, &group);
        UMB__TRY(umb__pool_find(&r->pool, l, &group, numbers + i, r->error));
    }
    return UMB_OK;
}

static enum umb_status add_bricks(struct reader *r, uint32_t p)
{
    const struct umb__page *page = &r->pages[p];
    const uint32_t count = page->node_count[UMB_LEVEL_BRICK];
    uint32_t *numbers = r->numbers[UMB_LEVEL_BRICK] + r->first[p][UMB_LEVEL_BRICK];
    struct umb__page_bricks bricks = umb__page_bricks(page, r->leaves);
    UMB__UNSET uint64_t slices[UMB__POOL_GROUP][8];
    UMB__UNSET struct umb__pool_group group;
    group.bricks = (const uint64_t(*)[8])slices;
    umb__page_leaves(page, r->leaves);
    for (uint32_t i = 0; i < count; i += UMB__POOL_GROUP) {
        group.count = count - i < UMB__POOL_GROUP ? count - i : UMB__POOL_GROUP;
        for (uint32_t k = 0; k < group.count; k++) {
            umb__page_bricks_next(&bricks, slices[k]);
        }
        UMB__TRY(umb__pool_find(&r->pool, UMB_LEVEL_BRICK, &group, numbers + i, r->error));
    }
    return UMB_OK;
}

/* Adds a page's nodes of level l to the pool. In: most: number of the level's nodes that the
 * canonical block counts. A canonical tree has as many different nodes; other trees, which readers
 * accept too, may have fewer. */
static enum umb_status add_page(struct reader *r, uint32_t p, uint32_t l, uint64_t most)
{
    enum umb_status status = l == UMB_LEVEL_BRICK ? add_bricks(r, p) : add_nodes(r, p, l);
    const uint64_t found = r->pool.level[l].count;
    if (status == UMB_E_LIMIT) {
        return umb_fail(r->error, UMB_E_TOO_LARGE,
                        "asset: expanding its nodes takes more than the %zu bytes left, the limit "
                        "is on pages and nodes together",
                        r->pool.max_bytes);
    }
    return status == UMB_OK && found > most ? wrong_counts(r->error) : status;
}

/* Makes the second pass. Even for a hostile file the pool never holds more than the counted nodes
 * and those of one page. */
static enum umb_status fill_pool(struct reader *r, const struct umb__canonical *canonical)
{
    for (uint32_t l = UMB_LEVEL_BRICK; l <= UMB_LEVEL_MAX; l++) {
        for (uint32_t p = 0; p < r->head->page_count; p++) {
            UMB__TRY(add_page(r, p, l, canonical->counts[l]));
        }
    }
    return UMB_OK;
}

/* Turns the pool into the octree with its roots. */
static enum umb_status take_octree(struct reader *r, const struct umb__canonical *canonical,
                                   struct umb__octree *octree)
{
    const uint32_t count = canonical->content.frustum_count;
    enum umb_status status = UMB_OK;
    uint32_t *refs = umb__alloc(r->alloc, count, 2 * sizeof *refs);
    if (!refs) {
        return umb_fail(r->error, UMB_E_NO_MEMORY, "opening: no memory for the roots");
    }
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        const struct umb__packed_root *root = &canonical->roots[i];
        refs[count + i] = canonical->content.frusta[i].log2_size;
        refs[i] = root->state == UMB__NODE_LIT ? UMB__REF_LIT : UMB__REF_SHADOWED;
        if (root->state == UMB__NODE_MIXED) {
            status = resolve(r, refs[count + i], root->page, root->position, &refs[i]);
        }
    }
    if (status == UMB_OK) {
        status = umb__pool_take(&r->pool, refs, refs + count, count, octree, r->error);
    }
    umb__free(r->alloc, refs);
    return status;
}

/* Returns the bytes of everything but the node pool: raw and parsed pages, numbers of nodes,
 * tables, roots. Each leaf, and each node in another page, takes at least one byte of a page, so
 * the length of the longest page limits both tables. */
static uint64_t page_bytes(const struct umb__head *head, uint32_t root_count, uint64_t raw_total)
{
    uint64_t bytes =
        raw_total + head->page_count * (uint64_t)(sizeof(struct umb__page) + sizeof(page_numbers));
    uint32_t longest = 0;
    for (uint32_t page = 0; page < head->page_count; page++) {
        const struct umb__page_entry entry = umb__directory_load(head, page);
        bytes += sizeof(uint32_t) * (uint64_t)entry.records;
        longest = entry.raw_length > longest ? entry.raw_length : longest;
    }
    bytes += (sizeof(uint32_t) + sizeof(uint64_t)) * (uint64_t)longest;
    return bytes + root_count * (sizeof(struct umb__octree_root) + 2 * (uint64_t)sizeof(uint32_t));
}

/* Returns the bytes that the counted nodes take if each has eight children, the most possible. No
 * sum overflows, since each count is below 2^32. */
static uint64_t node_bytes(const struct umb__canonical *canonical)
{
    uint64_t bytes = canonical->counts[UMB_LEVEL_BRICK] * BRICK_BYTES;
    for (size_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        bytes += canonical->counts[level] * NODE_BYTES_MAX + sizeof(uint32_t);
    }
    return bytes;
}

/* Refuses a file that could exceed the memory limit. Otherwise starts the pool with the remaining
 * bytes as its budget. */
static enum umb_status plan_memory(struct reader *r, const struct umb__canonical *canonical,
                                   uint64_t raw_total, uint64_t max_memory_bytes)
{
    const uint64_t pages = page_bytes(r->head, canonical->content.frustum_count, raw_total);
    const uint64_t nodes = node_bytes(canonical);
    if (pages + nodes > max_memory_bytes) {
        return umb_fail(r->error, UMB_E_TOO_LARGE,
                        "asset: expanding takes up to %llu bytes, the limit is %llu",
                        (unsigned long long)(pages + nodes), (unsigned long long)max_memory_bytes);
    }
    umb__pool_init(&r->pool, r->alloc, (size_t)(max_memory_bytes - pages));
    return UMB_OK;
}

static void reader_finish(struct reader *r)
{
    umb__pool_finish(&r->pool);
    ZSTD_freeDCtx(r->zstd);
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(r->alloc, r->numbers[level]);
    }
    umb__free(r->alloc, r->others);
    umb__free(r->alloc, r->leaves);
    umb__free(r->alloc, r->raw);
    umb__free(r->alloc, r->pages);
    umb__free(r->alloc, r->first);
}

static enum umb_status read_pages(struct reader *r, const struct umb__canonical *canonical,
                                  int check, uint64_t max_memory_bytes, struct umb__octree *octree)
{
    uint64_t raw_total, totals[UMB_LEVEL_MAX + 1];
    UMB__TRY(umb__directory_check(r->head, &raw_total, r->error));
    UMB__TRY(plan_memory(r, canonical, raw_total, max_memory_bytes));
    UMB__TRY(parse_pages(r, check, raw_total, totals));
    UMB__TRY(allocate_numbers(r, canonical, totals));
    UMB__TRY(fill_pool(r, canonical));
    return take_octree(r, canonical, octree);
}

enum umb_status umb__pack_read(const uint8_t *file, const struct umb__head *head,
                               const struct umb__canonical *canonical, int check,
                               uint64_t max_memory_bytes, const struct umb_alloc *alloc,
                               struct umb__octree *octree, struct umb_error *error)
{
    struct reader r = {
        .file = file, .head = head, .alloc = alloc, .error = error, .pool = {.alloc = alloc}};
    memset(octree, 0, sizeof *octree);
    const enum umb_status status = read_pages(&r, canonical, check, max_memory_bytes, octree);
    reader_finish(&r);
    return status;
}

/* Consecutive pages, uncompressed, which are hashed together. */
struct batch {
    uint8_t *raw; /* [UMB__PAGE_RAW_MAX] */
    size_t raw_size;
    uint32_t first, count; /* First page and number of pages */
    const uint8_t *messages[UMB__DIGESTS];
    size_t sizes[UMB__DIGESTS];
};

/* Uncompresses as many pages as fit, at least one. */
static enum umb_status batch_fill(struct batch *batch, ZSTD_DCtx *zstd, const uint8_t *file,
                                  const struct umb__head *head, struct umb_error *error)
{
    batch->first += batch->count;
    batch->count = 0;
    batch->raw_size = 0;
    while (batch->count < UMB__DIGESTS && batch->first + batch->count < head->page_count) {
        const struct umb__page_entry entry = umb__directory_load(head, batch->first + batch->count);
        const size_t room = UMB__PAGE_RAW_MAX - batch->raw_size;
        if (batch->count > 0 && entry.raw_length > room) {
            break;
        }
        uint8_t *raw = batch->raw + batch->raw_size;
        UMB__TRY(expand(zstd, file, head, &entry, 1, raw, room, error));
        batch->messages[batch->count] = raw;
        batch->sizes[batch->count++] = entry.raw_length;
        batch->raw_size += entry.raw_length;
    }
    return UMB_OK;
}

/* Compares the pages' hashes with the directory's. */
static enum umb_status batch_prove(const struct batch *batch, const struct umb__head *head,
                                   const struct umb_sha256 *sha256, struct umb_error *error)
{
    uint8_t hashes[UMB__DIGESTS][UMB_ID_BYTES];
    umb__digest_many(sha256, batch->messages, batch->sizes, batch->count, hashes);
    for (uint32_t i = 0; i < batch->count; i++) {
        const uint32_t page = batch->first + i;
        if (!umb__digest_made(hashes[i])) {
            return umb_fail(error, UMB_E_NO_MEMORY, "proving: page %u could not be hashed", page);
        }
        if (memcmp(hashes[i], umb__directory_hash(head, page), sizeof hashes[i]) != 0) {
            return umb_fail(error, UMB_E_CORRUPT, "page %u of the file: not what its hash says",
                            page);
        }
    }
    return UMB_OK;
}

/* Compares each block of the directory with its hash in the head, and each page's uncompressed
 * bytes with its hash in the block. */
static enum umb_status prove_pages(const uint8_t *file, const struct umb__head *head,
                                   const struct umb_sha256 *sha256, struct umb_error *error)
{
    uint64_t raw_total;
    enum umb_status status = UMB_OK;
    UMB__TRY(umb__directory_check(head, &raw_total, error));
    for (uint32_t block = 0; block < head->directory_count; block++) {
        uint32_t size;
        const uint8_t *bytes = umb__block_view(head, block, &size);
        UMB__TRY(umb__block_prove(head, block, bytes, size, sha256, error));
    }
    ZSTD_DCtx *zstd = ZSTD_createDCtx();
    struct batch batch = {.raw = umb__alloc(NULL, UMB__PAGE_RAW_MAX, 1)};
    if (!zstd || !batch.raw) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "proving: out of memory");
    }
    while (status == UMB_OK && batch.first + batch.count < head->page_count) {
        status = batch_fill(&batch, zstd, file, head, error);
        status = status == UMB_OK ? batch_prove(&batch, head, sha256, error) : status;
    }
    ZSTD_freeDCtx(zstd);
    umb__free(NULL, batch.raw);
    return status;
}

enum umb_status umb_packed_prove(const void *bytes, size_t size, const uint8_t *id,
                                 const struct umb_sha256 *sha256, struct umb_error *error)
{
    struct umb__head head;
    uint8_t made[UMB_ID_BYTES];
    if (!sha256) {
        return umb_fail(error, UMB_E_ARGUMENT, "sha256: NULL, a proof needs one");
    }
    UMB__TRY(umb__head_parse(bytes, size, &head, error));
    if (head.encoding != UMB_ENCODING_PACKED) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "encoding: a mapped file is a cache and proves nothing");
    }
    if (id && memcmp(id, head.id, UMB_ID_BYTES) != 0) {
        char has[UMB_ID_TEXT_SIZE], wanted[UMB_ID_TEXT_SIZE];
        umb_id_to_text(head.id, has);
        umb_id_to_text(id, wanted);
        return umb_fail(error, UMB_E_CORRUPT, "id: the file is of asset %s, asked for was %s", has,
                        wanted);
    }
    if (!umb__directory_identify(&head, sha256, NULL, made)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proving: out of memory");
    }
    if (memcmp(made, head.id, sizeof made) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "id: does not match the canonical block and hashes");
    }
    return prove_pages(bytes, &head, sha256, error);
}
