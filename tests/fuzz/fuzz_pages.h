/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FUZZ_PAGES_H
#define UMBRAGE_TESTS_FUZZ_PAGES_H
/* A packed file around pages that a fuzzer made, with right checksums, so that readers do not
 * refuse it at once. */
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "base/bytes.h"
#include "format/canonical.h"
#include "format/directory.h"
#include "format/layout.h"
#include "fuzz.h"
#include "make_asset.h"

enum {
    FUZZ_PAGES_MAX = 8
};

/* Adds one page to the file under construction. */
static inline void fuzz_add_page(const uint8_t *raw, size_t size, struct bytes *stored,
                                 struct bytes *links, uint8_t *entry,
                                 uint64_t counts[UMB_LEVEL_MAX + 1])
{
    static const uint8_t to_pages[UMB__PAGE_LINKS_MAX]; /* Link i leads to page i */
    struct umb__page page;
    uint8_t compressed[1 << 17];
    size_t length = ZSTD_compress(compressed, sizeof compressed, raw, size, 1);
    FUZZ_DEMAND(!ZSTD_isError(length));
    umb__store64(entry + UMB__PAGE_OFFSET, stored->size);
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, (uint32_t)length);
    umb__store32(entry + UMB__PAGE_RAW_LENGTH, (uint32_t)size);
    umb__store64(entry + UMB__PAGE_CHECK, XXH3_64bits(compressed, length));
    const void *part = raw;
    test_digest.digest(test_digest.user, &part, &size, 1, entry + UMB__PAGE_HASH);
    if (umb__page_parse(raw, size, &page, NULL) == UMB_OK) {
        uint64_t records = 0;
        for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
            counts[level] += page.node_count[level];
            records += page.node_count[level];
        }
        entry[UMB__PAGE_LEVEL_HIGH] = (uint8_t)page.level_high;
        entry[UMB__PAGE_LEVEL_LOW] = (uint8_t)page.level_low;
        umb__store32(entry + UMB__PAGE_RECORDS, (uint32_t)records);
        umb__store16(entry + UMB__PAGE_LINKS, (uint16_t)page.link_count);
        struct umb_sink to_links = bytes_sink(links);
        FUZZ_DEMAND(page.link_count == 0 ||
                    to_links.write(to_links.user, to_pages, page.link_count) == UMB_OK);
    }
    struct umb_sink sink = bytes_sink(stored);
    FUZZ_DEMAND(sink.write(sink.user, compressed, length) == UMB_OK);
}

/*
 * Makes a file from the input: a byte that picks the frustum's size, then raw pages (u16 length,
 * bytes, ...). The file's lengths, checksums, hashes and id are right, whatever the pages hold.
 */
static inline struct bytes fuzz_file_of_pages(const uint8_t *data, size_t size)
{
    static const double origin[3] = {0, 0, 0};
    struct bytes stored = {0}, links = {0};
    uint8_t entries[FUZZ_PAGES_MAX * UMB__PAGE_ENTRY] = {0}, block_entry[UMB__BLOCK_ENTRY];
    struct umb__packed_root root = {UMB__NODE_MIXED, 0, 0};
    struct umb__canonical canonical = {.roots = &root};
    uint32_t log2_size = size > 0 ? 6 + data[0] % 5 : 6, pages = 0;
    struct voxels voxels = {NULL, NULL, log2_size, 1};
    size_t at = 1;
    while (pages < FUZZ_PAGES_MAX && at + 2 <= size) {
        size_t length = umb__load16(data + at);
        at += 2;
        length = length < size - at ? length : size - at;
        fuzz_add_page(data + at, length, &stored, &links, entries + pages * UMB__PAGE_ENTRY,
                      canonical.counts);
        at += length;
        pages++;
    }
    make_content(&voxels, 1, origin, &canonical.content);
    struct umb__head head = {
        .encoding = UMB_ENCODING_PACKED,
        .directory = block_entry,
        .directory_count = umb__block_count(pages),
        .page_count = pages,
    };
    uint8_t *block;
    FUZZ_DEMAND(umb__canonical_encode(&canonical, NULL, &block, &head.canonical_length, NULL) ==
                UMB_OK);
    head.canonical = block;
    head.head_length = umb__head_length(&head);
    const size_t entries_size = pages * UMB__PAGE_ENTRY, block_size = entries_size + links.size;
    const uint64_t first_page = head.head_length + block_size;
    head.first_block = (uint32_t)block_size;
    head.file_length = first_page + stored.size;
    for (uint32_t i = 0; i < pages; i++) {
        uint8_t *entry = entries + i * UMB__PAGE_ENTRY;
        umb__store64(entry, umb__load64(entry) + first_page);
    }
    uint8_t *whole = malloc(block_size + 1);
    FUZZ_DEMAND(whole != NULL);
    memcpy(whole, entries, entries_size);
    if (links.size > 0) {
        memcpy(whole + entries_size, links.data, links.size);
    }
    FUZZ_DEMAND(umb__block_seal(whole, (uint32_t)block_size, pages, &test_digest, block_entry));
    umb__store64(block_entry + UMB__BLOCK_END, block_size);
    FUZZ_DEMAND(umb__directory_identify(&head, &test_digest, NULL, head.id));
    struct bytes file = {.data = malloc((size_t)head.file_length),
                         .size = (size_t)head.file_length,
                         .capacity = (size_t)head.file_length};
    uint8_t *front = umb__head_make(&head, NULL);
    FUZZ_DEMAND(file.data != NULL && front != NULL);
    memcpy(file.data, front, (size_t)head.head_length);
    memcpy(file.data + head.head_length, whole, block_size);
    if (stored.size > 0) {
        memcpy(file.data + first_page, stored.data, stored.size);
    }
    free(block);
    free(front);
    free(whole);
    bytes_finish(&links);
    bytes_finish(&stored);
    return file;
}

#endif
