/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See pack_read.h. There are two passes. The first uncompresses and parses all pages, which gives
 * the number of their nodes. The second adds the nodes to a pool, level by level from the bricks
 * up, so that copies of a node in several pages become one again. Numbers follow the order of the
 * file. The counts in the canonical block must be those found, or larger if the writer merged less.
 *
 * Another process may overwrite a mapped file at any time. So an entry of the directory is loaded
 * once a use and checked against the memory held, and nodes are read only from private copies of
 * the pages.
 */
#include "format/pack_read.h"

#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/directory.h"
#include "format/layout.h"
#include "format/node_pool_parts.h"

enum {
    BRICK_BYTES = 64,
    NODE_BYTES_MAX = 2 + 4 + 8 * 4, /* mask, first, children */
};

typedef uint32_t page_numbers[UMB_LEVEL_MAX + 1];

struct reader {
    const uint8_t *file;
    const struct umb__head *head;
    const struct umb_alloc *alloc;
    struct umb_error *error;
    ZSTD_DCtx *zstd;
    uint8_t *raw;            /* All pages, uncompressed and contiguous */
    struct umb__page *pages; /* [page count], pointing into raw */
    page_numbers *first;     /* [page count], first number of a page's nodes of each level */
    uint32_t *numbers[UMB_LEVEL_MAX + 1]; /* Pool numbers of the nodes of all pages */
    uint32_t *others; /* Pool numbers of the nodes in other pages that a level of a page leads to */
    uint64_t *leaves; /* Leaves of a page; both arrays have room for those of any page */
    struct umb__pool pool;
};

/* True if an entry still lies in the file and its page fits the `room` bytes left for it. */
static bool entry_fits(const struct umb__head *head, const struct umb__page_entry *entry,
                       uint64_t room)
{
    return entry->raw_length <= room && entry->offset <= head->file_length &&
           entry->stored_length <= head->file_length - entry->offset;
}

static enum umb_status entry_changed(const struct umb__page_entry *entry, struct umb_error *error)
{
    return umb_fail(error, UMB_E_CORRUPT, "directory: page %u changed while it was read",
                    entry->page);
}

/* False if a page's compressed bytes do not match the checksum of its entry. The decoder ignores
 * some of their bits, so no other check detects a flip of these. */
static bool stored_as_written(const uint8_t *file, const struct umb__page_entry *entry)
{
    return XXH3_64bits(file + entry->offset, entry->stored_length) == entry->check;
}

static enum umb_status wrong_checksum(const struct umb__page_entry *entry, struct umb_error *error)
{
    return umb_fail(error, UMB_E_CORRUPT, "page %u of the file: checksum does not match",
                    entry->page);
}

static enum umb_status parse_one(struct reader *r, const struct umb__page_entry *entry, int check,
                                 uint8_t *raw, uint64_t room)
{
    if (!entry_fits(r->head, entry, room)) {
        return entry_changed(entry, r->error);
    }
    if (check && !stored_as_written(r->file, entry)) {
        return wrong_checksum(entry, r->error);
    }
    enum umb_status status =
        umb__page_expand(r->zstd, r->file + entry->offset, entry, raw, r->error);
    return status == UMB_OK ? umb__page_open(raw, entry, &r->pages[entry->page], r->error) : status;
}

/* First pass. Afterwards totals[level] nodes are known to exist, backed by real bytes. */
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
        UMB__TRY(parse_one(r, &entry, check, r->raw + used, raw_total - used));
        used += entry.raw_length;
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

/* Checks the counts. In: totals: nodes of all pages, copies included: the counts cannot be
 * larger. */
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

/* Returns the pool's number of a node in any page; all nodes of its level are in the pool. */
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

/* Finds the numbers of the nodes in other pages that a level of a page leads to. */
static enum umb_status read_others(struct reader *r, uint32_t p, uint32_t l)
{
    const struct umb__page *page = &r->pages[p];
    struct umb__page_others others = umb__page_others(page, l);
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < page->external_count[l] && status == UMB_OK; i++) {
        const struct umb__node_place place = umb__page_others_next(&others);
        status = resolve(r, l - 1, place.page, place.position, &r->others[i]);
    }
    return status == UMB_OK ? UMB_OK : umb__in_page(r->error, p, status);
}

/* Reads the keys of a page's next nodes of a level; the nodes in other pages are known. */
static void read_keys(const struct reader *r, const uint32_t *own, struct umb__page_nodes *nodes,
                      uint32_t count, struct umb__node_group *group)
{
    for (uint32_t i = 0; i < count; i++) {
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
    struct umb__node_group group;
    const struct umb__page *page = &r->pages[p];
    const uint32_t count = page->node_count[l];
    const uint32_t *own = r->numbers[l - 1] + r->first[p][l - 1];
    uint32_t *numbers = r->numbers[l] + r->first[p][l];
    struct umb__page_nodes nodes = umb__page_nodes(page, l);
    enum umb_status status = read_others(r, p, l);
    for (uint32_t i = 0; i < count && status == UMB_OK; i += UMB__POOL_GROUP) {
        const uint32_t left = count - i, some = left < UMB__POOL_GROUP ? left : UMB__POOL_GROUP;
        read_keys(r, own, &nodes, some, &group);
        status = umb__pool_find_nodes(&r->pool, l, &group, some, numbers + i, r->error);
    }
    return status;
}

static enum umb_status add_bricks(struct reader *r, uint32_t p)
{
    const struct umb__page *page = &r->pages[p];
    const uint32_t count = page->node_count[UMB_LEVEL_BRICK];
    uint32_t *numbers = r->numbers[UMB_LEVEL_BRICK] + r->first[p][UMB_LEVEL_BRICK];
    struct umb__page_bricks bricks = umb__page_bricks(page, r->leaves);
    uint64_t group[UMB__POOL_GROUP][8];
    enum umb_status status = UMB_OK;
    umb__page_leaves(page, r->leaves);
    for (uint32_t i = 0; i < count && status == UMB_OK; i += UMB__POOL_GROUP) {
        const uint32_t left = count - i, some = left < UMB__POOL_GROUP ? left : UMB__POOL_GROUP;
        for (uint32_t k = 0; k < some; k++) {
            umb__page_bricks_next(&bricks, group[k]);
        }
        status = umb__pool_find_bricks(&r->pool, (const uint64_t(*)[8])group, some, numbers + i,
                                       r->error);
    }
    return status;
}

/*
 * In: most: nodes that the canonical block counts. All nodes of a canonical tree differ, so there
 * are as many; of another tree, which readers accept as well, there may be fewer.
 */
static enum umb_status add_page(struct reader *r, uint32_t p, uint32_t l, uint64_t most)
{
    enum umb_status status = l == UMB_LEVEL_BRICK ? add_bricks(r, p) : add_nodes(r, p, l);
    const uint64_t found = l == UMB_LEVEL_BRICK ? r->pool.brick_count : r->pool.level[l].count;
    if (status == UMB_E_LIMIT) {
        return umb_fail(r->error, UMB_E_TOO_LARGE,
                        "asset: expanding its nodes takes more than the %zu bytes left, the limit "
                        "is on pages and nodes together",
                        r->pool.max_bytes);
    }
    return status == UMB_OK && found > most ? wrong_counts(r->error) : status;
}

/* Second pass. For any pages, the pool never holds more than the counts and one page. */
static enum umb_status fill_pool(struct reader *r, const struct umb__canonical *canonical)
{
    enum umb_status status = UMB_OK;
    for (uint32_t l = UMB_LEVEL_BRICK; l <= UMB_LEVEL_MAX; l++) {
        for (uint32_t p = 0; p < r->head->page_count && status == UMB_OK; p++) {
            status = add_page(r, p, l, canonical->counts[l]);
        }
    }
    return status;
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

/* Returns the bytes of everything but the pool: the pages, parsed, the numbers of their nodes, the
 * tables of the longest page, whose leaves and nodes in other pages take at least a byte each, and
 * the roots. */
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

/* Returns the bytes of nodes of eight children each, the most. The counts are below 2^32 each, so
 * no sum overflows. */
static uint64_t node_bytes(const struct umb__canonical *canonical)
{
    uint64_t bytes = canonical->counts[UMB_LEVEL_BRICK] * BRICK_BYTES;
    for (size_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        bytes += canonical->counts[level] * NODE_BYTES_MAX + sizeof(uint32_t);
    }
    return bytes;
}

/* Refuses a file that cannot fit; sets the pool's budget. */
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

enum umb_status umb__pack_read(const uint8_t *file, const struct umb__head *head,
                               const struct umb__canonical *canonical, int check,
                               uint64_t max_memory_bytes, const struct umb_alloc *alloc,
                               struct umb__octree *octree, struct umb_error *error)
{
    struct reader r = {
        .file = file, .head = head, .alloc = alloc, .error = error, .pool = {.alloc = alloc}};
    uint64_t raw_total, totals[UMB_LEVEL_MAX + 1];
    memset(octree, 0, sizeof *octree);
    enum umb_status status = umb__directory_check(head, &raw_total, error);
    if (status == UMB_OK) {
        status = plan_memory(&r, canonical, raw_total, max_memory_bytes);
    }
    if (status == UMB_OK) {
        status = parse_pages(&r, check, raw_total, totals);
    }
    if (status == UMB_OK) {
        status = allocate_numbers(&r, canonical, totals);
    }
    if (status == UMB_OK) {
        status = fill_pool(&r, canonical);
    }
    if (status == UMB_OK) {
        status = take_octree(&r, canonical, octree);
    }
    reader_finish(&r);
    return status;
}

/* Uncompressed consecutive pages, to be hashed together. */
struct batch {
    uint8_t *raw; /* [UMB__PAGE_RAW_MAX] */
    size_t raw_size;
    uint32_t first, count; /* pages */
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
        if (!entry_fits(head, &entry, UMB__PAGE_RAW_MAX)) {
            return entry_changed(&entry, error);
        }
        if (entry.raw_length > UMB__PAGE_RAW_MAX - batch->raw_size) {
            break;
        }
        if (!stored_as_written(file, &entry)) {
            return wrong_checksum(&entry, error);
        }
        uint8_t *raw = batch->raw + batch->raw_size;
        UMB__TRY(umb__page_expand(zstd, file + entry.offset, &entry, raw, error));
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

enum umb_status umb__pages_prove(const uint8_t *file, const struct umb__head *head,
                                 const struct umb_sha256 *sha256, struct umb_error *error)
{
    uint64_t raw_total;
    enum umb_status status = umb__directory_check(head, &raw_total, error);
    for (uint32_t block = 0; status == UMB_OK && block < head->directory_count; block++) {
        status = umb__block_prove(head, block, umb__block_view(head, block), sha256, error);
    }
    if (status != UMB_OK) {
        return status;
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
