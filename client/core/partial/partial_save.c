/* SPDX-License-Identifier: Apache-2.0 */
/* Partial files (docs/umb-format.md, section 7): the head as it is, then some of the pages. */
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "format/layout.h"
#include "partial/partial_parts.h"

/* The fixed part. */
enum {
    VERSION = 8,
    COUNT = 12,
    HEAD_LENGTH = 16,
    CHECK = 24, /* XXH3-64 of what follows the fixed part up to the pages: head and numbers */
    FIXED = 32,
};

enum umb_status umb_partial_save(const struct umb_partial *p, const struct umb_sink *sink,
                                 struct umb_error *error)
{
    const size_t head = (size_t)p->head.head_length, numbers = 4 * (size_t)p->held_count;
    uint8_t *bytes = umb__alloc(p->meter.inner, FIXED + head + numbers, 1);
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "partial asset: no memory for the file's head");
    }
    memcpy(bytes, UMB__MAGIC_PARTIAL, 8);
    umb__store32(bytes + VERSION, UMB__VERSION_PARTIAL);
    umb__store32(bytes + COUNT, p->held_count);
    umb__store64(bytes + HEAD_LENGTH, head);
    memcpy(bytes + FIXED, p->head_bytes, head);
    uint8_t *at = bytes + FIXED + head;
    for (uint32_t page = 0; page < p->head.directory_count; page++) {
        if (p->pages[page].stored) {
            umb__store32(at, page);
            at += 4;
        }
    }
    umb__store64(bytes + CHECK, XXH3_64bits(bytes + FIXED, head + numbers));
    enum umb_status status = sink->write(sink->user, bytes, FIXED + head + numbers);
    umb__free(p->meter.inner, bytes);
    for (uint32_t page = 0; page < p->head.directory_count && status == UMB_OK; page++) {
        if (p->pages[page].stored) {
            status = sink->write(sink->user, p->pages[page].stored,
                                 umb__directory_load(&p->head, page).stored_length);
        }
    }
    return status == UMB_OK
               ? UMB_OK
               : umb_fail(error, status, "partial asset: output: %s", umb_status_text(status));
}

/* Adds the pages of a file; beyond the memory budget the rest stays missing. */
static enum umb_status add_pages(struct umb_partial *p, const uint8_t *numbers, uint32_t count,
                                 const uint8_t *at, const uint8_t *end, struct umb_error *error)
{
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t page = umb__load32(numbers + 4 * (size_t)i);
        const uint8_t *stored;
        if (page >= p->head.directory_count) {
            return umb_fail(error, UMB_E_CORRUPT, "partial file: page %u, the asset has %u", page,
                            p->head.directory_count);
        }
        const uint32_t length = umb__directory_load(&p->head, page).stored_length;
        if (!umb__take(&at, end, length, 1, &stored)) {
            return umb_fail(error, UMB_E_TRUNCATED, "partial file: page %u is cut", page);
        }
        enum umb_status status = umb_partial_add(p, page, stored, length, error);
        if (status == UMB_E_NO_MEMORY) {
            p->dropped += count - i;
            return UMB_OK;
        }
        if (status != UMB_OK) {
            return status;
        }
    }
    return at == end ? UMB_OK
                     : umb_fail(error, UMB_E_CORRUPT, "partial file: bytes follow the last page");
}

enum umb_status umb_partial_open_saved(const void *bytes, size_t size,
                                       const struct umb_partial_options *options,
                                       struct umb_partial **out, struct umb_error *error)
{
    const uint8_t *file = bytes, *at = file + FIXED, *end = file + size, *head, *numbers;
    *out = NULL;
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
    const uint32_t count = umb__load32(file + COUNT);
    const uint64_t head_length = umb__load64(file + HEAD_LENGTH);
    if (!umb__take(&at, end, head_length, 1, &head) || !umb__take(&at, end, count, 4, &numbers)) {
        return umb_fail(error, UMB_E_TRUNCATED, "partial file: its head is cut");
    }
    if (XXH3_64bits(file + FIXED, (size_t)(at - file) - FIXED) != umb__load64(file + CHECK)) {
        return umb_fail(error, UMB_E_CORRUPT, "partial file: checksum does not match");
    }
    struct umb_partial *p;
    enum umb_status status = umb_partial_open(head, (size_t)head_length, options, &p, error);
    if (status != UMB_OK) {
        return status;
    }
    status = p->head.head_length == head_length
                 ? add_pages(p, numbers, count, at, end, error)
                 : umb_fail(error, UMB_E_CORRUPT, "partial file: its head is not that long");
    if (status == UMB_OK) {
        status = umb_partial_build(p, error);
    }
    if (status != UMB_OK) {
        umb_partial_close(p);
        return status;
    }
    *out = p;
    return UMB_OK;
}
