/* SPDX-License-Identifier: Apache-2.0 */
/* The directory of a packed file; see directory.h. Each entry is loaded once for each use, since
 * another process may overwrite a mapped file at any time. */
#include "format/directory.h"

#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"

static const uint8_t *table_entry(const struct umb__head *head, uint32_t block)
{
    return head->directory + (size_t)block * UMB__BLOCK_ENTRY;
}

/* Returns the bytes of the blocks before a block. */
static uint64_t end_before(const struct umb__head *head, uint32_t block)
{
    return block == 0 ? 0 : umb__load64(table_entry(head, block - 1) + UMB__BLOCK_END);
}

uint64_t umb__block_offset(const struct umb__head *head, uint32_t block)
{
    return block == 0 ? head->head_length
                      : head->blocks_offset + end_before(head, block) - head->first_block;
}

uint32_t umb__block_bytes(const struct umb__head *head, uint32_t block)
{
    return (uint32_t)(end_before(head, block + 1) - end_before(head, block));
}

const uint8_t *umb__block_view(const struct umb__head *head, uint32_t block, uint32_t *size)
{
    const uint64_t offset = umb__block_offset(head, block);
    *size = umb__block_bytes(head, block);
    if (head->blocks) {
        *size = head->blocks[block] ? *size : 0;
        return head->blocks[block];
    }
    *size = *size <= head->file_length && offset <= head->file_length - *size ? *size : 0;
    return head->file + (*size > 0 ? offset : 0);
}

/* Loads a page's entry. In: at: the entry in its block. */
static struct umb__page_entry load(const uint8_t *at, uint32_t page)
{
    struct umb__page_entry entry = {
        .page = page,
        .offset = umb__load64(at + UMB__PAGE_OFFSET),
        .stored_length = umb__load32(at + UMB__PAGE_STORED_LENGTH),
        .raw_length = umb__load32(at + UMB__PAGE_RAW_LENGTH),
        .check = umb__load64(at + UMB__PAGE_CHECK),
        .level_high = at[UMB__PAGE_LEVEL_HIGH],
        .level_low = at[UMB__PAGE_LEVEL_LOW],
        .records = umb__load32(at + UMB__PAGE_RECORDS),
        .links_length = umb__load16(at + UMB__PAGE_LINKS),
    };
    return entry;
}

static const uint8_t *entry_at(const struct umb__head *head, uint32_t page)
{
    static const uint8_t none[UMB__PAGE_ENTRY];
    uint32_t size;
    const uint8_t *block = umb__block_view(head, page / UMB__BLOCK_PAGES, &size);
    const uint32_t at = page % UMB__BLOCK_PAGES * UMB__PAGE_ENTRY;
    return size >= at + UMB__PAGE_ENTRY ? block + at : none;
}

struct umb__page_entry umb__directory_load(const struct umb__head *head, uint32_t page)
{
    return load(entry_at(head, page), page);
}

const uint8_t *umb__directory_hash(const struct umb__head *head, uint32_t page)
{
    return entry_at(head, page) + UMB__PAGE_HASH;
}

void umb__directory_links(const struct umb__head *head, struct umb__page_entry *entry,
                          uint8_t *copy)
{
    uint32_t size;
    const uint32_t number = entry->page / UMB__BLOCK_PAGES;
    const uint8_t *block = umb__block_view(head, number, &size);
    uint64_t at = umb__block_entry_bytes(head->page_count, number);
    for (uint32_t i = 0; i < entry->page % UMB__BLOCK_PAGES && at <= size; i++) {
        at += umb__load16(block + (size_t)i * UMB__PAGE_ENTRY + UMB__PAGE_LINKS);
    }
    if (at > size || entry->links_length > size - at) { /* The block has changed */
        entry->links_length = 0;
        at = 0;
    }
    entry->links = block + at;
    if (copy) {
        memcpy(copy, entry->links, entry->links_length);
        entry->links = copy;
    }
}

static enum umb_status check_entry(const struct umb__head *head,
                                   const struct umb__page_entry *entry, uint64_t expected,
                                   struct umb_error *error)
{
    if (entry->offset != expected || expected > head->file_length ||
        entry->stored_length > head->file_length - expected) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: page %u is not where it should be",
                        entry->page);
    }
    if (entry->raw_length > UMB__PAGE_RAW_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: page %u takes %u bytes, at most %u",
                        entry->page, entry->raw_length, UMB__PAGE_RAW_MAX);
    }
    return UMB_OK;
}

enum umb_status umb__block_check(const struct umb__head *head, uint32_t block, const uint8_t *bytes,
                                 uint32_t size, struct umb__block_extent *extent,
                                 struct umb_error *error)
{
    const uint32_t entries = umb__block_entry_bytes(head->page_count, block);
    const uint32_t first = block * UMB__BLOCK_PAGES;
    if (size < entries ||
        XXH3_64bits(bytes, size) != umb__load64(table_entry(head, block) + UMB__BLOCK_CHECK)) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: checksum of block %u does not match",
                        block);
    }
    const uint64_t begin = umb__load64(bytes + UMB__PAGE_OFFSET);
    struct umb__block_extent seen = {begin, begin, 0};
    uint64_t links = 0;
    for (uint32_t i = 0; i < entries / UMB__PAGE_ENTRY; i++) {
        const struct umb__page_entry entry = load(bytes + (size_t)i * UMB__PAGE_ENTRY, first + i);
        UMB__TRY(check_entry(head, &entry, seen.end, error));
        seen.end += entry.stored_length;
        seen.raw_bytes += (uint64_t)entry.raw_length + entry.links_length;
        links += entry.links_length;
    }
    if (entries + links != size) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "directory: block %u has %u bytes, its entries and links %llu", block, size,
                        (unsigned long long)(entries + links));
    }
    if (extent) {
        *extent = seen;
    }
    return UMB_OK;
}

/* Computes the SHA-256 of the hashes and links of a block's pages. Returns false without a digest.
 */
static bool hash_block(const uint8_t *bytes, uint32_t size, uint32_t pages,
                       const struct umb_sha256 *sha256, uint8_t hash[UMB_ID_BYTES])
{
    const void *parts[UMB__BLOCK_PAGES + 2];
    size_t sizes[UMB__BLOCK_PAGES + 2];
    uint8_t lengths[2 * UMB__BLOCK_PAGES];
    const uint32_t entries = pages * UMB__PAGE_ENTRY;
    for (uint32_t i = 0; i < pages; i++) {
        const uint8_t *entry = bytes + (size_t)i * UMB__PAGE_ENTRY;
        parts[i] = entry + UMB__PAGE_HASH;
        sizes[i] = UMB_ID_BYTES;
        memcpy(lengths + 2 * (size_t)i, entry + UMB__PAGE_LINKS, 2);
    }
    parts[pages] = lengths;
    sizes[pages] = 2 * (size_t)pages;
    parts[pages + 1] = bytes + entries;
    sizes[pages + 1] = size - entries;
    sha256->digest(sha256->user, parts, sizes, (size_t)pages + 2, hash);
    return umb__digest_made(hash);
}

enum umb_status umb__block_prove(const struct umb__head *head, uint32_t block, const uint8_t *bytes,
                                 uint32_t size, const struct umb_sha256 *sha256,
                                 struct umb_error *error)
{
    uint8_t hash[UMB_ID_BYTES];
    const uint32_t entries = umb__block_entry_bytes(head->page_count, block);
    if (size < entries) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: block %u is cut", block);
    }
    if (!hash_block(bytes, size, entries / UMB__PAGE_ENTRY, sha256, hash)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "directory: block %u could not be hashed", block);
    }
    return memcmp(hash, table_entry(head, block) + UMB__BLOCK_HASH, sizeof hash) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "directory: block %u is not what its hash says",
                          block);
}

bool umb__block_seal(const uint8_t *bytes, uint32_t size, uint32_t pages,
                     const struct umb_sha256 *sha256, uint8_t entry[UMB__BLOCK_ENTRY])
{
    umb__store64(entry + UMB__BLOCK_CHECK, XXH3_64bits(bytes, size));
    return hash_block(bytes, size, pages, sha256, entry + UMB__BLOCK_HASH);
}

enum umb_status umb__directory_check(const struct umb__head *head, uint64_t *raw_total,
                                     struct umb_error *error)
{
    uint64_t expected = head->head_length;
    *raw_total = 0;
    for (uint32_t block = 0; block < head->directory_count; block++) {
        struct umb__block_extent extent;
        uint32_t size;
        const uint8_t *bytes = umb__block_view(head, block, &size);
        UMB__TRY(umb__block_check(head, block, bytes, size, &extent, error));
        /* The first block precedes its pages. All other blocks stand together before their
         * pages. */
        const uint64_t others = end_before(head, head->directory_count) - head->first_block;
        const bool placed = block > 1 || umb__block_offset(head, block) == expected;
        expected += block == 0 ? head->first_block : block == 1 ? others : 0;
        if (!placed || extent.begin != expected) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "directory: block %u or its pages are not where they should be", block);
        }
        expected = extent.end;
        *raw_total += extent.raw_bytes;
    }
    if (expected != head->file_length) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: %llu bytes follow the last page",
                        (unsigned long long)(head->file_length - expected));
    }
    return UMB_OK;
}

enum umb_status umb__page_expand(ZSTD_DCtx *zstd, const uint8_t *stored,
                                 const struct umb__page_entry *entry, uint8_t *raw,
                                 struct umb_error *error)
{
    if (ZSTD_findFrameCompressedSize(stored, entry->stored_length) != entry->stored_length) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "page %u of the file: %u bytes are not one zstd frame", entry->page,
                        entry->stored_length);
    }
    size_t got = ZSTD_decompressDCtx(zstd, raw, entry->raw_length, stored, entry->stored_length);
    if (ZSTD_isError(got) || got != entry->raw_length) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "page %u of the file: does not uncompress to %u bytes", entry->page,
                        entry->raw_length);
    }
    return UMB_OK;
}

enum umb_status umb__in_page(struct umb_error *error, uint32_t page, enum umb_status status)
{
    if (error) {
        char inner[sizeof error->message];
        memcpy(inner, error->message, sizeof inner);
        return umb_fail(error, status, "page %u of the file: %.250s", page, inner);
    }
    return status;
}

enum umb_status umb__page_open(const uint8_t *raw, const struct umb__page_entry *entry,
                               struct umb__page *page, struct umb_error *error)
{
    enum umb_status status = umb__page_parse(raw, entry->raw_length, page, error);
    status = status == UMB_OK ? umb__page_set_links(page, entry->links, entry->links_length, error)
                              : status;
    if (status != UMB_OK) {
        return umb__in_page(error, entry->page, status);
    }
    uint64_t records = 0;
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        records += page->node_count[level];
    }
    if (page->level_high != entry->level_high || page->level_low != entry->level_low ||
        records != entry->records) {
        return umb_fail(error, UMB_E_CORRUPT, "page %u of the file: not what the directory says",
                        entry->page);
    }
    return UMB_OK;
}

bool umb__directory_identify(const struct umb__head *head, const struct umb_sha256 *sha256,
                             const struct umb_alloc *alloc, uint8_t id[UMB_ID_BYTES])
{
    size_t parts = (size_t)head->directory_count + 1;
    const void **pointers = umb__alloc(alloc, parts, sizeof *pointers);
    size_t *sizes = umb__alloc(alloc, parts, sizeof *sizes);
    bool made = pointers && sizes;
    if (made) {
        pointers[0] = head->canonical;
        sizes[0] = (size_t)head->canonical_length;
        for (uint32_t block = 0; block + 1 < parts; block++) {
            pointers[block + 1] = table_entry(head, block) + UMB__BLOCK_HASH;
            sizes[block + 1] = UMB_ID_BYTES;
        }
        sha256->digest(sha256->user, pointers, sizes, parts, id);
        made = umb__digest_made(id);
    }
    umb__free(alloc, (void *)pointers);
    umb__free(alloc, sizes);
    return made;
}

void umb__digest_many(const struct umb_sha256 *sha256, const uint8_t *const *messages,
                      const size_t *sizes, size_t count, uint8_t (*digests)[UMB_ID_BYTES])
{
    if (sha256->digest_many) {
        sha256->digest_many(sha256->user, messages, sizes, count, digests);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        const void *part = messages[i];
        sha256->digest(sha256->user, &part, &sizes[i], 1, digests[i]);
    }
}

bool umb__digest_made(const uint8_t hash[UMB_ID_BYTES])
{
    static const uint8_t zeros[UMB_ID_BYTES];
    return memcmp(hash, zeros, sizeof zeros) != 0;
}
