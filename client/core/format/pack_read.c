/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See pack_read.h. Two passes: all pages are uncompressed and parsed, which gives every node its
 * number (level by level, in the order of the file); then nodes are filled in and references to
 * other pages resolved. The counts announced in the canonical block must be those found.
 *
 * The file may be a map that somebody else overwrites meanwhile: an entry of the directory is
 * loaded once for a use and checked against the memory there is; nodes are only taken from the
 * pages' private copies.
 */
#include "format/pack_read.h"

#include <stdbool.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "format/directory.h"
#include "format/layout.h"

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
    uint8_t *raw;            /* all pages, uncompressed, one after the other */
    struct umb__page *pages; /* [page count], pointing into raw */
    page_numbers *first;     /* [page count], number of a page's first node of a level */
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

static enum umb_status parse_one(struct reader *r, const struct umb__page_entry *entry, int check,
                                 uint8_t *raw, uint64_t room)
{
    if (!entry_fits(r->head, entry, room)) {
        return entry_changed(entry, r->error);
    }
    if (check && XXH3_64bits(r->file + entry->offset, entry->stored_length) != entry->check) {
        return umb_fail(r->error, UMB_E_CORRUPT, "page %u of the file: checksum does not match",
                        entry->page);
    }
    enum umb_status status =
        umb__page_expand(r->zstd, r->file + entry->offset, entry, raw, r->error);
    return status == UMB_OK ? umb__page_open(raw, entry, &r->pages[entry->page], r->error) : status;
}

/* First pass. Afterwards totals[level] nodes are known to be there, backed by real bytes. */
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
        enum umb_status status = parse_one(r, &entry, check, r->raw + used, raw_total - used);
        if (status != UMB_OK) {
            return status;
        }
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

static enum umb_status allocate_octree(const struct reader *r, const uint64_t *totals,
                                       uint32_t root_count, struct umb_octree *octree)
{
    octree->alloc = r->alloc;
    octree->brick_count = (uint32_t)totals[UMB_LEVEL_BRICK];
    octree->bricks = umb__alloc_large(r->alloc, octree->brick_count, sizeof *octree->bricks);
    octree->root_count = root_count;
    octree->roots = umb__alloc_zeroed(r->alloc, root_count, sizeof *octree->roots);
    bool ok = octree->bricks && octree->roots;
    for (size_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
        struct umb_octree_level *level = &octree->level[l];
        uint64_t references = 0;
        for (uint32_t page = 0; page < r->head->page_count; page++) {
            references += r->pages[page].reference_count[l];
        }
        if (references >= UINT32_MAX) {
            return umb_fail(r->error, UMB_E_CORRUPT, "level %zu: too many children", l);
        }
        level->count = (uint32_t)totals[l];
        level->masks = umb__alloc(r->alloc, level->count, sizeof *level->masks);
        level->first = umb__alloc(r->alloc, (size_t)level->count + 1, sizeof *level->first);
        level->children = umb__alloc(r->alloc, (size_t)references, sizeof *level->children);
        ok = ok && level->masks && level->first && level->children;
        if (ok) {
            level->first[0] = 0;
        }
    }
    return ok ? UMB_OK : umb_fail(r->error, UMB_E_NO_MEMORY, "opening: no memory for the nodes");
}

/* The number of a node in another page. */
static enum umb_status resolve(const struct reader *r, uint32_t level, uint32_t page,
                               uint32_t position, uint32_t *number)
{
    if (page >= r->head->page_count || position >= r->pages[page].node_count[level]) {
        return umb_fail(r->error, UMB_E_CORRUPT, "node %u of level %u in page %u: not there",
                        position, level, page);
    }
    *number = r->first[page][level] + position;
    return UMB_OK;
}

static enum umb_status fill_nodes(const struct reader *r, uint32_t p, uint32_t l,
                                  struct umb_octree_level *level)
{
    const struct umb__page *page = &r->pages[p];
    uint32_t at = level->first[r->first[p][l]];
    uint32_t local = page->node_count[l - 1];
    for (uint32_t i = 0; i < page->node_count[l]; i++) {
        uint16_t mask = umb__load16(page->masks[l] + 2 * (size_t)i);
        uint32_t node = r->first[p][l] + i;
        level->masks[node] = mask;
        level->first[node + 1] = level->first[node] + umb_mask_mixed_count(mask);
    }
    for (uint64_t i = 0; i < page->reference_count[l]; i++) {
        unsigned width = page->width[l];
        uint32_t reference = umb__load_narrow(page->references[l] + i * width, width);
        uint32_t number = r->first[p][l - 1] + reference;
        if (reference >= local) {
            size_t k = reference - local;
            enum umb_status status =
                resolve(r, l - 1, umb__load32(page->external_pages[l] + 4 * k),
                        umb__load32(page->external_positions[l] + 4 * k), &number);
            if (status != UMB_OK) {
                return umb__in_page(r->error, p, status);
            }
        }
        level->children[at + i] = number;
    }
    return UMB_OK;
}

static void fill_bricks(const struct reader *r, uint32_t p, uint64_t (*bricks)[8])
{
    const struct umb__page *page = &r->pages[p];
    const uint8_t *number = page->leaf_numbers;
    for (uint32_t i = 0; i < page->node_count[UMB_LEVEL_BRICK]; i++) {
        umb__page_brick(page, i, &number, bricks[r->first[p][UMB_LEVEL_BRICK] + i]);
    }
}

static enum umb_status fill_octree(const struct reader *r, const struct umb__canonical *canonical,
                                   struct umb_octree *octree)
{
    for (uint32_t p = 0; p < r->head->page_count; p++) {
        for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= UMB_LEVEL_MAX; l++) {
            enum umb_status status = fill_nodes(r, p, l, &octree->level[l]);
            if (status != UMB_OK) {
                return status;
            }
        }
        fill_bricks(r, p, octree->bricks);
    }
    for (uint32_t i = 0; i < octree->root_count; i++) {
        const struct umb__packed_root *packed = &canonical->roots[i];
        struct umb_octree_root *root = &octree->roots[i];
        root->state = (enum umb_node_state)packed->state;
        root->level = canonical->content.frusta[i].log2_size;
        if (root->state == UMB_NODE_MIXED) {
            enum umb_status status =
                resolve(r, root->level, packed->page, packed->position, &root->index);
            if (status != UMB_OK) {
                return status;
            }
        }
    }
    return UMB_OK;
}

/* Bytes that expanding takes at its peak: the pages, parsed, and the octree, whose nodes have at
 * most eight children each. The counts are below 2^32 each, so that nothing overflows. */
static uint64_t peak_bytes(const struct umb__canonical *canonical, uint64_t page_count,
                           uint64_t raw_total)
{
    uint64_t bytes = raw_total + page_count * (sizeof(struct umb__page) + sizeof(page_numbers));
    bytes += (uint64_t)canonical->content.frustum_count * sizeof(struct umb_octree_root);
    bytes += canonical->counts[UMB_LEVEL_BRICK] * BRICK_BYTES;
    for (size_t level = UMB_LEVEL_BRICK + 1; level <= UMB_LEVEL_MAX; level++) {
        bytes += canonical->counts[level] * NODE_BYTES_MAX + sizeof(uint32_t);
    }
    return bytes;
}

enum umb_status umb__pack_read(const uint8_t *file, const struct umb__head *head,
                               const struct umb__canonical *canonical, int check,
                               uint64_t max_memory_bytes, const struct umb_alloc *alloc,
                               struct umb_octree *octree, struct umb_error *error)
{
    struct reader r = {.file = file, .head = head, .alloc = alloc, .error = error};
    uint64_t raw_total, totals[UMB_LEVEL_MAX + 1];
    memset(octree, 0, sizeof *octree);
    enum umb_status status = umb__directory_check(head, &raw_total, error);
    if (status == UMB_OK) {
        uint64_t peak = peak_bytes(canonical, head->page_count, raw_total);
        if (peak > max_memory_bytes) {
            status = umb_fail(error, UMB_E_TOO_LARGE,
                              "asset: expanding takes up to %llu bytes, the limit is %llu",
                              (unsigned long long)peak, (unsigned long long)max_memory_bytes);
        }
    }
    if (status == UMB_OK) {
        status = parse_pages(&r, check, raw_total, totals);
    }
    if (status == UMB_OK && memcmp(totals, canonical->counts, sizeof totals) != 0) {
        status = umb_fail(error, UMB_E_CORRUPT, "counts: not the nodes that the pages hold");
    }
    if (status == UMB_OK) {
        status = allocate_octree(&r, totals, canonical->content.frustum_count, octree);
    }
    if (status == UMB_OK) {
        status = fill_octree(&r, canonical, octree);
    }
    ZSTD_freeDCtx(r.zstd);
    umb__free(alloc, r.raw);
    umb__free(alloc, r.pages);
    umb__free(alloc, r.first);
    if (status != UMB_OK) {
        octree->alloc = alloc;
        umb_octree_finish(octree);
    }
    return status;
}

/* Hashes one page and compares; raw: room for the longest. */
static enum umb_status prove_page(ZSTD_DCtx *zstd, const uint8_t *file,
                                  const struct umb__head *head, uint32_t page, uint8_t *raw,
                                  const struct umb_sha256 *sha256, struct umb_error *error)
{
    struct umb__page_entry entry = umb__directory_load(head, page);
    enum umb_status status = entry_fits(head, &entry, UMB__PAGE_RAW_MAX)
                                 ? umb__page_expand(zstd, file + entry.offset, &entry, raw, error)
                                 : entry_changed(&entry, error);
    if (status != UMB_OK) {
        return status;
    }
    const uint8_t *wanted = umb__directory_hash(head, page);
    const void *part = raw;
    size_t part_size = entry.raw_length;
    uint8_t hash[UMB_ID_BYTES];
    sha256->digest(sha256->user, &part, &part_size, 1, hash);
    if (!umb__digest_made(hash)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "proving: page %u could not be hashed", page);
    }
    return memcmp(hash, wanted, sizeof hash) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "page %u of the file: not what its hash says",
                          page);
}

enum umb_status umb__pages_prove(const uint8_t *file, const struct umb__head *head, int check_pages,
                                 const struct umb_sha256 *sha256, struct umb_error *error)
{
    uint64_t raw_total;
    enum umb_status status = umb__directory_check(head, &raw_total, error);
    for (uint32_t block = 0; status == UMB_OK && block < head->directory_count; block++) {
        status = umb__block_prove(head, block, umb__block_view(head, block), sha256, error);
    }
    if (status != UMB_OK || !check_pages) {
        return status;
    }
    ZSTD_DCtx *zstd = ZSTD_createDCtx();
    uint8_t *raw = umb__alloc(NULL, UMB__PAGE_RAW_MAX, 1);
    if (!zstd || !raw) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "proving: out of memory");
    }
    for (uint32_t page = 0; page < head->page_count && status == UMB_OK; page++) {
        status = prove_page(zstd, file, head, page, raw, sha256, error);
    }
    ZSTD_freeDCtx(zstd);
    umb__free(NULL, raw);
    return status;
}
