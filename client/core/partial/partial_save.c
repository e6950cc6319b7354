/* SPDX-License-Identifier: Apache-2.0 */
/* Partial files (docs/reference/umb-format.md, section 7): the unchanged head, then some of the
 * pages. */
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"
#include "partial/partial_parts.h"

/* Offsets in bytes of the fixed part of a partial file, and its length. */
enum {
    VERSION = 8,
    PAGES = 12,
    HEAD_LENGTH = 16,
    CHECK = 24, /* XXH3-64 of the bytes from BLOCKS up to the first block */
    BLOCKS = 32,
    FIXED = 40,
};

/* Returns true if a page is held as its asset's file has it. A partial file has no room for a page
 * of another version whose zstd frame differs; it is fetched again. */
static bool is_saved(const struct umb_partial *p, uint32_t page)
{
    return p->pages[page].stored && !p->pages[page].foreign;
}

static uint32_t count_saved(const struct umb_partial *p)
{
    uint32_t count = 0;
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        count += is_saved(p, page);
    }
    return count;
}

/* Writes the numbers of the saved pages, then those of the held blocks. */
static void write_numbers(const struct umb_partial *p, uint8_t *at)
{
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        if (is_saved(p, page)) {
            umb__store32(at, page);
            at += 4;
        }
    }
    for (uint32_t block = 0; block < p->head.directory_count; block++) {
        if (p->blocks[block]) {
            umb__store32(at, block);
            at += 4;
        }
    }
}

enum umb_status umb_partial_save(const struct umb_partial *p, const struct umb_sink *sink,
                                 struct umb_error *error)
{
    const size_t head = (size_t)p->head.head_length;
    const uint32_t pages = count_saved(p);
    const size_t numbers = 4 * ((size_t)pages + p->block_count);
    uint8_t *bytes = umb__alloc(p->meter.inner, FIXED + head + numbers, 1);
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "partial asset: no memory for the file's head");
    }
    memset(bytes, 0, FIXED);
    memcpy(bytes, UMB__MAGIC_PARTIAL, 8);
    umb__store32(bytes + VERSION, UMB__VERSION_PARTIAL);
    umb__store32(bytes + PAGES, pages);
    umb__store64(bytes + HEAD_LENGTH, head);
    umb__store32(bytes + BLOCKS, p->block_count);
    memcpy(bytes + FIXED, p->head_bytes, head);
    write_numbers(p, bytes + FIXED + head);
    umb__store64(bytes + CHECK, XXH3_64bits(bytes + BLOCKS, FIXED - BLOCKS + head + numbers));
    enum umb_status status = sink->write(sink->user, bytes, FIXED + head + numbers);
    umb__free(p->meter.inner, bytes);
    for (uint32_t block = 0; block < p->head.directory_count && status == UMB_OK; block++) {
        if (p->blocks[block]) {
            status = sink->write(sink->user, p->blocks[block], umb__block_bytes(&p->head, block));
        }
    }
    for (uint32_t page = 0; page < p->head.page_count && status == UMB_OK; page++) {
        if (is_saved(p, page)) {
            status = sink->write(sink->user, p->pages[page].stored, p->pages[page].stored_length);
        }
    }
    return status == UMB_OK
               ? UMB_OK
               : umb_fail(error, status, "partial asset: output: %s", umb_status_text(status));
}

/* A partial file, split into its parts. */
struct saved {
    const uint8_t *head, *page_numbers, *block_numbers;
    uint64_t head_length;
    uint32_t pages, blocks;
    const uint8_t *at, *end; /* Bytes not read yet: blocks, then pages */
};

static enum umb_status add_blocks(struct umb_partial *p, struct saved *s, struct umb_error *error)
{
    for (uint32_t i = 0; i < s->blocks; i++) {
        const uint32_t block = umb__load32(s->block_numbers + 4 * (size_t)i);
        const uint8_t *bytes;
        if (block >= p->head.directory_count) {
            return umb_fail(error, UMB_E_CORRUPT, "partial file: block %u, the asset has %u", block,
                            p->head.directory_count);
        }
        const uint32_t length = umb__block_bytes(&p->head, block);
        if (!umb__take(&s->at, s->end, length, 1, &bytes)) {
            return umb_fail(error, UMB_E_TRUNCATED, "partial file: block %u is cut", block);
        }
        UMB__TRY(umb_partial_add_block(p, block, bytes, length, error));
    }
    return UMB_OK;
}

/* Adds the pages of a partial file. Pages beyond the memory budget stay missing. */
static enum umb_status add_pages(struct umb_partial *p, struct saved *s, struct umb_error *error)
{
    for (uint32_t i = 0; i < s->pages; i++) {
        const uint32_t page = umb__load32(s->page_numbers + 4 * (size_t)i);
        const uint8_t *stored;
        if (page >= p->head.page_count || !umb__partial_knows(p, page)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "partial file: page %u, the asset has %u and the file must have the "
                            "block of its entry",
                            page, p->head.page_count);
        }
        const uint32_t length = umb__directory_load(&p->head, page).stored_length;
        if (!umb__take(&s->at, s->end, length, 1, &stored)) {
            return umb_fail(error, UMB_E_TRUNCATED, "partial file: page %u is cut", page);
        }
        const enum umb_status status = umb_partial_add(p, page, stored, length, error);
        if (status == UMB_E_NO_MEMORY) {
            p->dropped += s->pages - i;
            return UMB_OK;
        }
        UMB__TRY(status);
    }
    return s->at == s->end
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "partial file: bytes follow the last page");
}

static enum umb_status parse_saved(const uint8_t *file, size_t size, struct saved *s,
                                   struct umb_error *error)
{
    if (size < 8 || memcmp(file, UMB__MAGIC_PARTIAL, 8) != 0) {
        return umb_fail(error, UMB_E_FORMAT, "magic: the file does not begin as a partial asset");
    }
    if (size < FIXED) {
        return umb_fail(error, UMB_E_TRUNCATED, "partial file: %zu bytes", size);
    }
    if (umb__load32(file + VERSION) != UMB__VERSION_PARTIAL) {
        return umb_fail(error, UMB_E_VERSION, "partial file: version %u, this reader knows %u",
                        umb__load32(file + VERSION), UMB__VERSION_PARTIAL);
    }
    *s = (struct saved){.head_length = umb__load64(file + HEAD_LENGTH),
                        .pages = umb__load32(file + PAGES),
                        .blocks = umb__load32(file + BLOCKS),
                        .at = file + FIXED,
                        .end = file + size};
    if (!umb__take(&s->at, s->end, s->head_length, 1, &s->head) ||
        !umb__take(&s->at, s->end, s->pages, 4, &s->page_numbers) ||
        !umb__take(&s->at, s->end, s->blocks, 4, &s->block_numbers)) {
        return umb_fail(error, UMB_E_TRUNCATED, "partial file: its head is cut");
    }
    if (XXH3_64bits(file + BLOCKS, (size_t)(s->at - file) - BLOCKS) != umb__load64(file + CHECK)) {
        return umb_fail(error, UMB_E_CORRUPT, "partial file: checksum does not match");
    }
    return umb__load32(file + BLOCKS + 4) == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_VERSION, "partial file: uses fields of a newer writer");
}

static enum umb_status add_all(struct umb_partial *p, struct saved *s, struct umb_error *error)
{
    if (p->head.head_length != s->head_length) {
        return umb_fail(error, UMB_E_CORRUPT, "partial file: its head is not that long");
    }
    UMB__TRY(add_blocks(p, s, error));
    UMB__TRY(add_pages(p, s, error));
    return umb_partial_build(p, error);
}

enum umb_status umb_partial_open_saved(const void *bytes, size_t size,
                                       const struct umb_partial_options *options,
                                       struct umb_partial **out, struct umb_error *error)
{
    struct saved saved = {0};
    struct umb_partial *p;
    *out = NULL;
    UMB__TRY(parse_saved(bytes, size, &saved, error));
    UMB__TRY(umb_partial_open(saved.head, (size_t)saved.head_length, options, &p, error));
    const enum umb_status status = add_all(p, &saved, error);
    if (status != UMB_OK) {
        umb_partial_close(p);
        return status;
    }
    *out = p;
    return UMB_OK;
}
