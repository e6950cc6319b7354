/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_DIRECTORY_H
#define UMBRAGE_CORE_FORMAT_DIRECTORY_H
/* The directory of a packed file: where each page stands, and opening one from its stored bytes. */
#include <stdbool.h>
#include "format/head.h"
#include "format/page.h"

struct ZSTD_DCtx_s;

/* One page's entry of the directory. */
struct umb__page_entry {
    uint32_t page;
    uint64_t offset; /* of the stored bytes in the file */
    uint32_t stored_length, raw_length;
    uint64_t check; /* XXH3-64 of the stored bytes */
    uint32_t level_high, level_low, records;
    uint32_t reserved;
};

/* In: page: below head->directory_count. */
struct umb__page_entry umb__directory_load(const struct umb__head *head, uint32_t page);

/* A page's SHA-256 in the directory: uint8[UMB_ID_BYTES]. */
const uint8_t *umb__directory_hash(const struct umb__head *head, uint32_t page);

/*
 * Pages must follow one another without gap or overlap, from the head to the end of the file.
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

/* Puts the page's number in front of the sentence of an error inside it; returns status. */
enum umb_status umb__in_page(struct umb_error *error, uint32_t page, enum umb_status status);

/* Parses an uncompressed page and compares it with its entry. Fails: E_CORRUPT, E_VERSION. */
UMB_CHECKED enum umb_status umb__page_open(const uint8_t *raw, const struct umb__page_entry *entry,
                                           struct umb__page *page, struct umb_error *error);

/* Writes brick `index` of a parsed page after another: call with index 0, 1, ... in order; *number
 * starts at page->leaf_numbers. */
void umb__page_brick(const struct umb__page *page, uint32_t index, const uint8_t **number,
                     uint64_t brick[8]);

/*
 * The identity that canonical block and page hashes have. False: out of memory.
 * In: alloc: for a list of the hashes.
 */
bool umb__directory_identify(const struct umb__head *head, const struct umb_sha256 *sha256,
                             const struct umb_alloc *alloc, uint8_t id[UMB_ID_BYTES]);

/* False for the all-zero digest of a hasher that failed (struct umb_sha256). */
bool umb__digest_made(const uint8_t hash[UMB_ID_BYTES]);

#endif
