/* SPDX-License-Identifier: Apache-2.0 */
/* See directory.h. An entry is loaded once for a use: the file may be a map that somebody else
 * overwrites meanwhile. */
#include "format/directory.h"

#include <string.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "format/layout.h"

struct umb__page_entry umb__directory_load(const struct umb__head *head, uint32_t page)
{
    const uint8_t *at = head->directory + (size_t)page * UMB__PAGE_ENTRY;
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

const uint8_t *umb__directory_hash(const struct umb__head *head, uint32_t page)
{
    return head->directory + (size_t)page * UMB__PAGE_ENTRY + UMB__PAGE_HASH;
}

enum umb_status umb__directory_check(const struct umb__head *head, uint64_t *raw_total,
                                     struct umb_error *error)
{
    uint64_t expected = head->head_length;
    *raw_total = 0;
    for (uint32_t page = 0; page < head->directory_count; page++) {
        struct umb__page_entry entry = umb__directory_load(head, page);
        if (entry.offset != expected || entry.stored_length > head->file_length - expected) {
            return umb_fail(error, UMB_E_CORRUPT, "directory: page %u is not where it should be",
                            page);
        }
        if (entry.raw_length > UMB__PAGE_RAW_MAX) {
            return umb_fail(error, UMB_E_CORRUPT, "directory: page %u takes %u bytes, at most %u",
                            page, entry.raw_length, UMB__PAGE_RAW_MAX);
        }
        if (entry.reserved != 0) {
            return umb_fail(error, UMB_E_VERSION,
                            "directory: page %u uses reserved fields of a newer writer", page);
        }
        expected += entry.stored_length;
        *raw_total += entry.raw_length;
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

void umb__page_brick(const struct umb__page *page, uint32_t index, const uint8_t **number,
                     uint64_t brick[8])
{
    unsigned width = page->width[UMB_LEVEL_BRICK];
    uint64_t slice = 0;
    for (unsigned z = 0; z < 8; z++) {
        if (page->runs[index] >> z & 1) {
            slice = umb__load64(page->leaves + 8 * (size_t)umb__load_narrow(*number, width));
            *number += width;
        }
        brick[z] = slice;
    }
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
        for (uint32_t page = 0; page + 1 < parts; page++) {
            pointers[page + 1] = umb__directory_hash(head, page);
            sizes[page + 1] = UMB_ID_BYTES;
        }
        sha256->digest(sha256->user, pointers, sizes, parts, id);
        made = umb__digest_made(id);
    }
    umb__free(alloc, (void *)pointers);
    umb__free(alloc, sizes);
    return made;
}

bool umb__digest_made(const uint8_t hash[UMB_ID_BYTES])
{
    static const uint8_t zeros[UMB_ID_BYTES];
    return memcmp(hash, zeros, sizeof zeros) != 0;
}
