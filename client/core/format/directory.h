/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_DIRECTORY_H
#define UMBRAGE_CORE_FORMAT_DIRECTORY_H
/*
 * The directory of a packed file: an entry for each page, in blocks of UMB__BLOCK_PAGES entries.
 * The head has the checksum and the hash of each block, so a client proves a page with the head,
 * one block and the page. The file also uncompresses and parses pages.
 *
 * A page names other pages by their places in its list of links. The list stands in the block, not
 * in the page: a page's bytes stay when other pages get other numbers.
 */
#include <stdbool.h>
#include "format/head.h"
#include "format/layout.h"
#include "format/page.h"

struct ZSTD_DCtx_s;

/* One page's entry of the directory. */
struct umb__page_entry {
    uint32_t page;
    uint64_t offset; /* Offset of the stored bytes in the file */
    uint32_t stored_length, raw_length;
    uint64_t check; /* XXH3-64 of the stored bytes */
    uint32_t level_high, level_low, records;
    const uint8_t *links; /* [links_length] Links in the block (page.h), from umb__directory_links;
                             NULL from umb__directory_load */
    uint32_t links_length;
};

/* Returns the number of blocks of a directory for `page_count` pages. */
static inline uint32_t umb__block_count(uint32_t page_count)
{
    return page_count / UMB__BLOCK_PAGES + (page_count % UMB__BLOCK_PAGES != 0);
}

/* Returns the length in bytes of a block's entries. In: block: 0, or a number below the block
 * count. */
static inline uint32_t umb__block_entry_bytes(uint32_t page_count, uint32_t block)
{
    const uint32_t rest = page_count - block * UMB__BLOCK_PAGES;
    return (rest < UMB__BLOCK_PAGES ? rest : UMB__BLOCK_PAGES) * UMB__PAGE_ENTRY;
}

/* Returns the length in bytes of a block. In: block: a number below the block count. */
uint32_t umb__block_bytes(const struct umb__head *head, uint32_t block);

/* Returns the offset in bytes of a block in the file. */
uint64_t umb__block_offset(const struct umb__head *head, uint32_t block);

/* Loads a page's entry. In: head: a head with the page's block. page: a number below
 * head->page_count. */
struct umb__page_entry umb__directory_load(const struct umb__head *head, uint32_t page);

/* Finds the links of an entry, where no other process can change the block or `copy` has room for
 * links_length bytes: then entry->links is there. */
void umb__directory_links(const struct umb__head *head, struct umb__page_entry *entry,
                          uint8_t *copy);

/* Returns the SHA-256 of a page in the directory: uint8[UMB_ID_BYTES]. */
const uint8_t *umb__directory_hash(const struct umb__head *head, uint32_t page);

/* Returns a block's bytes. Out: size: their number; 0 if the block changed since the head was
 * parsed, and is not in the file any more. */
const uint8_t *umb__block_view(const struct umb__head *head, uint32_t block, uint32_t *size);

/* Byte range in the file of a block's pages, and the length in bytes of these pages
 * uncompressed. */
struct umb__block_extent {
    uint64_t begin, end, raw_bytes;
};

/*
 * Checks one block: its XXH3, and its pages, which must follow one another in the file.
 *
 * In:    bytes: uint8[size], the block as stored in the file. The head may have no blocks.
 * Out:   extent: may be NULL.
 * Fails: E_CORRUPT, E_VERSION.
 * Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umb__block_check(const struct umb__head *head, uint32_t block,
                                             const uint8_t *bytes, uint32_t size,
                                             struct umb__block_extent *extent,
                                             struct umb_error *error);

/*
 * Compares a block's hash in the head with the hash of its pages' hashes and links.
 * In: bytes: as for umb__block_check. Fails: E_CORRUPT, E_NO_MEMORY (no digest could be made).
 */
UMB_CHECKED enum umb_status umb__block_prove(const struct umb__head *head, uint32_t block,
                                             const uint8_t *bytes, uint32_t size,
                                             const struct umb_sha256 *sha256,
                                             struct umb_error *error);

/* Writes the checksum and the hash of a block into its entry of the head's table. In: bytes: block
 * with complete entries of pages. pages: number of its pages. Returns false if no digest could be
 * made. */
bool umb__block_seal(const uint8_t *bytes, uint32_t size, uint32_t pages,
                     const struct umb_sha256 *sha256, uint8_t entry[UMB__BLOCK_ENTRY]);

/*
 * Checks all blocks of a whole file. Pages and blocks must fill the file from the head to its end,
 * without gap or overlap.
 *
 * Out:   raw_total: bytes of all pages, uncompressed.
 * Fails: E_CORRUPT, E_VERSION.
 */
UMB_CHECKED enum umb_status umb__directory_check(const struct umb__head *head, uint64_t *raw_total,
                                                 struct umb_error *error);

/*
 * Uncompresses a page.
 *
 * In:    stored: uint8[entry->stored_length]. Out: raw: uint8[entry->raw_length].
 * Fails: E_CORRUPT.
 * Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umb__page_expand(struct ZSTD_DCtx_s *zstd, const uint8_t *stored,
                                             const struct umb__page_entry *entry, uint8_t *raw,
                                             struct umb_error *error);

/* Puts a page's number before the message of an error; returns status. */
enum umb_status umb__in_page(struct umb_error *error, uint32_t page, enum umb_status status);

/* Parses an uncompressed page and compares it with its entry. Fails: E_CORRUPT, E_VERSION. */
UMB_CHECKED enum umb_status umb__page_open(const uint8_t *raw, const struct umb__page_entry *entry,
                                           struct umb__page *page, struct umb_error *error);

/* Computes an asset's id from the canonical block and the hashes of the blocks. In: alloc:
 * allocator for a list of the hashes. Returns false if out of memory. */
bool umb__directory_identify(const struct umb__head *head, const struct umb_sha256 *sha256,
                             const struct umb_alloc *alloc, uint8_t id[UMB_ID_BYTES]);

/* Number of pages that are hashed together: the lanes of a vector register. */
#define UMB__DIGESTS 16U

/* Hashes `count` messages, each in one piece: together by the hasher's `digest_many`, or one by one
 * by `digest`. Out: digests: [count]. */
void umb__digest_many(const struct umb_sha256 *sha256, const uint8_t *const *messages,
                      const size_t *sizes, size_t count, uint8_t (*digests)[UMB_ID_BYTES]);

/* Returns false for an all-zero digest, which means that the hasher failed (struct umb_sha256). */
bool umb__digest_made(const uint8_t hash[UMB_ID_BYTES]);

#endif
