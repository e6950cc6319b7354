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

uint64_t umb__block_offset(const struct umb__head *head, uint32_t block)
{
    return block == 0
               ? head->head_length
               : head->blocks_offset + (uint64_t)(block - 1) * UMB__BLOCK_PAGES * UMB__PAGE_ENTRY;
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
        .reserved = umb__load16(at + UMB__PAGE_ZERO),
    };
    return entry;
}

static const uint8_t *entry_at(const struct umb__head *head, uint32_t page)
{
    return page < UMB__BLOCK_PAGES
               ? head->entries[0] + (size_t)page * UMB__PAGE_ENTRY
               : head->entries[1] + (size_t)(page - UMB__BLOCK_PAGES) * UMB__PAGE_ENTRY;
}

struct umb__page_entry umb__directory_load(const struct umb__head *head, uint32_t page)
{
    return load(entry_at(head, page), page);
}

const uint8_t *umb__directory_hash(const struct umb__head *head, uint32_t page)
{
    return entry_at(head, page) + UMB__PAGE_HASH;
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
    if (entry->reserved != 0) {
        return umb_fail(error, UMB_E_VERSION,
                        "directory: page %u uses reserved fields of a newer writer", entry->page);
    }
    return UMB_OK;
}

static const uint8_t *table_entry(const struct umb__head *head, uint32_t block)
{
    return head->directory + (size_t)block * UMB__BLOCK_ENTRY;
}

const uint8_t *umb__block_view(const struct umb__head *head, uint32_t block)
{
    return entry_at(head, block * UMB__BLOCK_PAGES);
}

enum umb_status umb__block_check(const struct umb__head *head, uint32_t block, const uint8_t *bytes,
                                 struct umb__block_extent *extent, struct umb_error *error)
{
    const uint32_t size = umb__block_bytes(head->page_count, block);
    const uint32_t first = block * UMB__BLOCK_PAGES;
    if (XXH3_64bits(bytes, size) != umb__load64(table_entry(head, block) + UMB__BLOCK_CHECK)) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: checksum of block %u does not match",
                        block);
    }
    const uint64_t begin = umb__load64(bytes + UMB__PAGE_OFFSET);
    struct umb__block_extent seen = {begin, begin, 0};
    for (uint32_t i = 0; i < size / UMB__PAGE_ENTRY; i++) {
        const struct umb__page_entry entry = load(bytes + (size_t)i * UMB__PAGE_ENTRY, first + i);
        UMB__TRY(check_entry(head, &entry, seen.end, error));
        seen.end += entry.stored_length;
        seen.raw_bytes += entry.raw_length;
    }
    if (extent) {
        *extent = seen;
    }
    return UMB_OK;
}

/* Computes the SHA-256 of the hashes of a block's pages. Returns false without a digest. */
static bool hash_block(const uint8_t *bytes, size_t size, const struct umb_sha256 *sha256,
                       uint8_t hash[UMB_ID_BYTES])
{
    const void *parts[UMB__BLOCK_PAGES];
    size_t sizes[UMB__BLOCK_PAGES];
    const size_t count = size / UMB__PAGE_ENTRY;
    for (size_t i = 0; i < count; i++) {
        parts[i] = bytes + i * UMB__PAGE_ENTRY + UMB__PAGE_HASH;
        sizes[i] = UMB_ID_BYTES;
    }
    sha256->digest(sha256->user, parts, sizes, count, hash);
    return umb__digest_made(hash);
}

enum umb_status umb__block_prove(const struct umb__head *head, uint32_t block, const uint8_t *bytes,
                                 const struct umb_sha256 *sha256, struct umb_error *error)
{
    uint8_t hash[UMB_ID_BYTES];
    if (!hash_block(bytes, umb__block_bytes(head->page_count, block), sha256, hash)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "directory: block %u could not be hashed", block);
    }
    return memcmp(hash, table_entry(head, block) + UMB__BLOCK_HASH, sizeof hash) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "directory: block %u is not what its hash says",
                          block);
}

bool umb__block_seal(const uint8_t *bytes, size_t size, const struct umb_sha256 *sha256,
                     uint8_t entry[UMB__BLOCK_ENTRY])
{
    umb__store64(entry + UMB__BLOCK_CHECK, XXH3_64bits(bytes, size));
    return hash_block(bytes, size, sha256, entry + UMB__BLOCK_HASH);
}

enum umb_status umb__directory_check(const struct umb__head *head, uint64_t *raw_total,
                                     struct umb_error *error)
{
    uint64_t expected = head->head_length;
    *raw_total = 0;
    for (uint32_t block = 0; block < head->directory_count; block++) {
        struct umb__block_extent extent;
        UMB__TRY(umb__block_check(head, block, umb__block_view(head, block), &extent, error));
        /* The first block precedes its pages. All other blocks stand together before their
         * pages. */
        const bool placed = block > 1 || umb__block_offset(head, block) == expected;
        expected += block == 0   ? umb__block_bytes(head->page_count, 0)
                    : block == 1 ? umb__other_blocks_bytes(head->page_count)
                                 : 0;
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
