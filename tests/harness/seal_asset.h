/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_SEAL_ASSET_H
#define UMBRAGE_TESTS_SEAL_ASSET_H
/* Makes the checksums of a spoilt packed or mapped file right again, so that only its content is
 * wrong. */
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "format/directory.h"
#include "format/layout.h"
#include "make_asset.h"

/* Makes the checksums of a packed file's directory blocks right and, if asked, their hashes. Blocks
 * beyond the end of the file are skipped. */
static inline void seal_blocks(struct bytes *file, bool with_hashes)
{
    uint8_t *entry =
        file->data + UMB__HEAD_SIZE + umb__load64(file->data + UMB__HEAD_CANONICAL_LENGTH);
    const struct umb__head head = {
        .head_length = umb__load64(file->data + UMB__HEAD_LENGTH),
        .directory = entry,
        .first_block = umb__load32(file->data + UMB__HEAD_FIRST_BLOCK),
        .blocks_offset = umb__load64(file->data + UMB__HEAD_BLOCKS),
    };
    const uint32_t pages = umb__load32(file->data + UMB__HEAD_PAGES);
    const uint32_t blocks = umb__load32(file->data + UMB__HEAD_DIRECTORY_COUNT);
    for (uint32_t block = 0; block < umb__block_count(pages) && block < blocks; block++) {
        const uint64_t at = umb__block_offset(&head, block);
        const uint32_t size = umb__block_bytes(&head, block);
        const uint32_t entries = umb__block_entry_bytes(pages, block);
        uint8_t sealed[UMB__BLOCK_ENTRY];
        if (at > file->size || size > file->size - at || size < entries) {
            return;
        }
        (void)umb__block_seal(file->data + at, size, entries / UMB__PAGE_ENTRY, &test_digest,
                              sealed);
        memcpy(entry, sealed, 8);
        if (with_hashes) {
            memcpy(entry + UMB__BLOCK_HASH, sealed + UMB__BLOCK_HASH, UMB_ID_BYTES);
        }
        entry += UMB__BLOCK_ENTRY;
    }
}

/* Makes all checksums of blocks and head right. In: with_id: the blocks' hashes and the id, too. */
static inline void seal_asset(struct bytes *file, bool with_id)
{
    uint8_t both[16];
    struct umb__head head;
    const bool packed = memcmp(file->data, UMB__MAGIC_PACKED, 8) == 0;
    if (packed) {
        seal_blocks(file, with_id);
    }
    for (int pass = 0; pass < 2; pass++) {
        const uint64_t length = umb__load64(file->data + UMB__HEAD_LENGTH);
        umb__store64(both, XXH3_64bits(file->data, UMB__HEAD_CHECK));
        umb__store64(both + 8, XXH3_64bits(file->data + UMB__HEAD_SIZE, length - UMB__HEAD_SIZE));
        umb__store64(file->data + UMB__HEAD_CHECK, XXH3_64bits(both, sizeof both));
        if (pass == 0 && with_id &&
            umb__head_parse_front(file->data, file->size, &head, NULL) == UMB_OK) {
            (void)umb__directory_identify(&head, &test_digest, NULL, file->data + UMB__HEAD_ID);
        }
    }
}

/* The checks of a mapped file's sections, and of its head. */
static inline void seal_sections(struct bytes *file)
{
    uint8_t *entry =
        file->data + UMB__HEAD_SIZE + umb__load64(file->data + UMB__HEAD_CANONICAL_LENGTH);
    const uint32_t count = umb__load32(file->data + UMB__HEAD_DIRECTORY_COUNT);
    for (uint32_t i = 0; i < count; i++, entry += UMB__SECTION_ENTRY) {
        const uint8_t *section = file->data + umb__load64(entry + UMB__SECTION_OFFSET);
        const size_t length = (size_t)umb__load64(entry + UMB__SECTION_LENGTH);
        umb__store64(entry + UMB__SECTION_CHECK, XXH3_64bits(section, length));
    }
    seal_asset(file, false);
}

#endif
