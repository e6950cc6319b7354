/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes the heads of files. Offsets: layout.h; normative text:
 * docs/reference/umb-format.md. */
#include "format/head.h"

#include <stdbool.h>
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/directory.h"
#include "format/layout.h"

static uint64_t head_checksum(const uint8_t *bytes, uint64_t head_length)
{
    uint64_t parts[2];
    parts[0] = XXH3_64bits(bytes, UMB__HEAD_CHECK);
    parts[1] = XXH3_64bits(bytes + UMB__HEAD_SIZE, (size_t)(head_length - UMB__HEAD_SIZE));
    uint8_t both[16];
    umb__store64(both, parts[0]);
    umb__store64(both + 8, parts[1]);
    return XXH3_64bits(both, sizeof both);
}

static size_t entry_size_of(enum umb_encoding encoding)
{
    return encoding == UMB_ENCODING_PACKED ? UMB__BLOCK_ENTRY : UMB__SECTION_ENTRY;
}

static unsigned version_of(enum umb_encoding encoding)
{
    return encoding == UMB_ENCODING_PACKED ? UMB__VERSION_PACKED : UMB__VERSION_MAPPED;
}

uint64_t umb__head_length(const struct umb__head *head)
{
    return UMB__HEAD_SIZE + head->canonical_length +
           (uint64_t)head->directory_count * entry_size_of(head->encoding) + head->info_length;
}

static enum umb_status parse_magic(const uint8_t *bytes, size_t size, struct umb__head *head,
                                   struct umb_error *error)
{
    size_t seen = size < 8 ? size : 8;
    if (seen > 0 && memcmp(bytes, UMB__MAGIC_PACKED, seen) == 0) {
        head->encoding = UMB_ENCODING_PACKED;
    } else if (seen > 0 && memcmp(bytes, UMB__MAGIC_MAPPED, seen) == 0) {
        head->encoding = UMB_ENCODING_MAPPED;
    } else if (seen == 8 && memcmp(bytes, UMB__MAGIC_PARTIAL, seen) == 0) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "magic: a partial file, which holds some pages only; `umbrage stream` "
                        "reads and completes it");
    } else {
        return umb_fail(error, UMB_E_FORMAT,
                        "magic: the file does not begin as an asset does; `umbrage bake` makes "
                        "an asset from a scene");
    }
    if (size < UMB__HEAD_SIZE) {
        return umb_fail(error, UMB_E_TRUNCATED, "file: %zu bytes, the head alone takes %d", size,
                        UMB__HEAD_SIZE);
    }
    unsigned major = umb__load16(bytes + UMB__HEAD_VERSION);
    if (major != version_of(head->encoding)) {
        return umb_fail(error, UMB_E_VERSION, "version: %u.%u, this reader knows version %u%s",
                        major, umb__load16(bytes + UMB__HEAD_MINOR), version_of(head->encoding),
                        head->encoding == UMB_ENCODING_MAPPED
                            ? " of mapped files; they are made from packed ones at any time"
                        : major < UMB__VERSION_PACKED
                            ? " of packed files; made by an earlier version: bake the scene again"
                            : " of packed files; made by a later version");
    }
    return UMB_OK;
}

/* Checks the number of pages and the place of their entries. */
static enum umb_status parse_blocks(const uint8_t *bytes, struct umb__head *head,
                                    struct umb_error *error)
{
    head->page_count = umb__load32(bytes + UMB__HEAD_PAGES);
    head->blocks_offset = umb__load64(bytes + UMB__HEAD_BLOCKS);
    const uint64_t pages = head->page_count, wanted = head->encoding == UMB_ENCODING_PACKED
                                                          ? umb__block_count(head->page_count)
                                                          : head->directory_count;
    if (head->encoding == UMB_ENCODING_MAPPED ? pages != 0 || head->blocks_offset != 0
                                              : wanted != head->directory_count) {
        return umb_fail(error, UMB_E_CORRUPT, "pages: %llu do not fit %u directory entries",
                        (unsigned long long)pages, head->directory_count);
    }
    const uint64_t first = head->head_length + umb__block_bytes(head->page_count, 0);
    const uint64_t others = umb__other_blocks_bytes(head->page_count);
    const bool fits = first <= head->file_length && others <= head->file_length - first;
    const bool placed = others == 0 ? head->blocks_offset == 0
                                    : head->blocks_offset >= first &&
                                          head->blocks_offset <= head->file_length - others;
    return fits && placed ? UMB_OK
                          : umb_fail(error, UMB_E_CORRUPT,
                                     "directory: the blocks of %llu pages do not fit the file",
                                     (unsigned long long)pages);
}

/* Parses and checks lengths. In: front: true if the bytes may be only the front of the file. */
static enum umb_status parse_lengths(const uint8_t *bytes, size_t size, bool front,
                                     struct umb__head *head, struct umb_error *error)
{
    head->file_length = umb__load64(bytes + UMB__HEAD_FILE_LENGTH);
    head->head_length = umb__load64(bytes + UMB__HEAD_LENGTH);
    head->canonical_length = umb__load64(bytes + UMB__HEAD_CANONICAL_LENGTH);
    head->directory_count = umb__load32(bytes + UMB__HEAD_DIRECTORY_COUNT);
    head->info_length = umb__load32(bytes + UMB__HEAD_INFO_LENGTH);
    if (head->canonical_length > UMB__CANONICAL_MAX || head->canonical_length % 8 != 0) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "canonical length: %llu, at most %u and a multiple of 8",
                        (unsigned long long)head->canonical_length, UMB__CANONICAL_MAX);
    }
    if (head->info_length > UMB__INFO_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "info length: %u, at most %u", head->info_length,
                        UMB__INFO_MAX);
    }
    if (head->head_length != umb__head_length(head)) {
        return umb_fail(error, UMB_E_CORRUPT, "head length: %llu does not fit its parts",
                        (unsigned long long)head->head_length);
    }
    if (!front && head->file_length != size) {
        return umb_fail(error, head->file_length > size ? UMB_E_TRUNCATED : UMB_E_CORRUPT,
                        "file: %zu bytes, its head says %llu", size,
                        (unsigned long long)head->file_length);
    }
    if (head->head_length > size) {
        return umb_fail(error, UMB_E_TRUNCATED, "head: %llu bytes, the file has %zu",
                        (unsigned long long)head->head_length, size);
    }
    return parse_blocks(bytes, head, error);
}

static enum umb_status parse(const uint8_t *bytes, size_t size, bool front, struct umb__head *head,
                             struct umb_error *error)
{
    memset(head, 0, sizeof *head);
    UMB__TRY(parse_magic(bytes, size, head, error));
    UMB__TRY(parse_lengths(bytes, size, front, head, error));
    if (head_checksum(bytes, head->head_length) != umb__load64(bytes + UMB__HEAD_CHECK)) {
        return umb_fail(error, UMB_E_CORRUPT, "head: checksum does not match");
    }
    static const uint8_t zeros[UMB__HEAD_CHECK - UMB__HEAD_ZERO];
    if (umb__load32(bytes + UMB__HEAD_FLAGS) != 0 || umb__load32(bytes + UMB__HEAD_ZERO_1) != 0 ||
        memcmp(bytes + UMB__HEAD_ZERO, zeros, sizeof zeros) != 0) {
        return umb_fail(error, UMB_E_VERSION, "head: reserved fields are used by a newer writer");
    }
    memcpy(head->id, bytes + UMB__HEAD_ID, UMB_ID_BYTES);
    head->canonical = bytes + UMB__HEAD_SIZE;
    head->directory = head->canonical + head->canonical_length;
    head->info = head->directory + (size_t)head->directory_count * entry_size_of(head->encoding);
    if (!front && head->page_count > 0) {
        head->entries[0] = bytes + head->head_length;
        head->entries[1] = bytes + head->blocks_offset;
    }
    return UMB_OK;
}

enum umb_status umb__head_parse(const uint8_t *bytes, size_t size, struct umb__head *head,
                                struct umb_error *error)
{
    return parse(bytes, size, false, head, error);
}

enum umb_status umb__head_parse_front(const uint8_t *bytes, size_t size, struct umb__head *head,
                                      struct umb_error *error)
{
    return parse(bytes, size, true, head, error);
}

enum umb_status umb_file_read_head(const void *front, size_t size, struct umb_file_head *facts,
                                   struct umb_error *error)
{
    const uint8_t *bytes = front;
    struct umb__head head = {0};
    memset(facts, 0, sizeof *facts);
    UMB__TRY(parse_magic(bytes, size, &head, error));
    const enum umb_status status = parse_lengths(bytes, size, true, &head, error);
    if (status != UMB_OK &&
        status != UMB_E_TRUNCATED) { /* Only the file's first bytes are needed */
        return status;
    }
    facts->encoding = head.encoding;
    memcpy(facts->id, bytes + UMB__HEAD_ID, UMB_ID_BYTES);
    facts->file_bytes = head.file_length;
    facts->open_bytes = head.head_length;
    if (head.encoding == UMB_ENCODING_PACKED) {
        facts->open_bytes += umb__block_bytes(umb__load32(bytes + UMB__HEAD_PAGES), 0);
    }
    return UMB_OK;
}

uint8_t *umb__head_make(const struct umb__head *head, const struct umb_alloc *alloc)
{
    const size_t directory_bytes = head->directory_count * entry_size_of(head->encoding);
    uint8_t *bytes = umb__alloc_zeroed(alloc, (size_t)head->head_length, 1);
    if (!bytes) {
        return NULL;
    }
    memcpy(bytes, head->encoding == UMB_ENCODING_PACKED ? UMB__MAGIC_PACKED : UMB__MAGIC_MAPPED, 8);
    umb__store16(bytes + UMB__HEAD_VERSION, (uint16_t)version_of(head->encoding));
    umb__store16(bytes + UMB__HEAD_MINOR, UMB__VERSION_MINOR);
    umb__store64(bytes + UMB__HEAD_FILE_LENGTH, head->file_length);
    umb__store64(bytes + UMB__HEAD_LENGTH, head->head_length);
    umb__store64(bytes + UMB__HEAD_CANONICAL_LENGTH, head->canonical_length);
    umb__store32(bytes + UMB__HEAD_DIRECTORY_COUNT, head->directory_count);
    umb__store32(bytes + UMB__HEAD_INFO_LENGTH, head->info_length);
    umb__store32(bytes + UMB__HEAD_PAGES, head->page_count);
    umb__store64(bytes + UMB__HEAD_BLOCKS, head->blocks_offset);
    memcpy(bytes + UMB__HEAD_ID, head->id, UMB_ID_BYTES);
    uint8_t *at = bytes + UMB__HEAD_SIZE;
    memcpy(at, head->canonical, (size_t)head->canonical_length);
    at += head->canonical_length;
    memcpy(at, head->directory, directory_bytes);
    if (head->info_length > 0) {
        memcpy(at + directory_bytes, head->info, head->info_length);
    }
    umb__store64(bytes + UMB__HEAD_CHECK, head_checksum(bytes, head->head_length));
    return bytes;
}
