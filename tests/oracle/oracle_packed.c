/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: directory, identity and pages of a packed file; what a page holds is in
 * oracle_page.c. Source: docs/reference/umb-format.md, sections 4 and 5.
 *
 * There are two passes. The first verifies and expands every page and reads how many nodes it has;
 * nodes of a level are numbered page after page. The second decodes, and a reference to a later
 * page finds its number there.
 */
#include "oracle_page.h"

#include <inttypes.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

enum {
    HEAD_FIXED = 128,
    ENTRY_SIZE = 64,
    BLOCK_ENTRY_SIZE = 48,
    BLOCK_PAGES = 32,
    PAGE_LIMIT = 1 << 20,
};

static void free_pages(struct oracle_page *pages, uint32_t count)
{
    for (uint32_t i = 0; pages != NULL && i < count; i++) {
        free(pages[i].bytes);
    }
    free(pages);
}

/* Bytes of the blocks up to and including a block. */
static uint64_t block_end(const struct oracle *oracle, uint32_t block)
{
    return oracle_number(oracle->bytes + HEAD_FIXED + oracle->block_size +
                             (uint64_t)block * BLOCK_ENTRY_SIZE + 8,
                         8);
}

/* Where a block of the directory stands; oracle_read_head has found all of them inside the file. */
static const uint8_t *block_at(const struct oracle *oracle, uint32_t block, uint64_t *size)
{
    *size = block_end(oracle, block) - (block > 0 ? block_end(oracle, block - 1) : 0);
    return oracle->bytes +
           (block == 0 ? oracle->head_size
                       : oracle->blocks_at + block_end(oracle, block - 1) - oracle->first_block);
}

static uint32_t pages_of(const struct oracle *oracle, uint32_t block)
{
    const uint32_t rest = oracle->page_count - block * BLOCK_PAGES;
    return rest < BLOCK_PAGES ? rest : BLOCK_PAGES;
}

/* Finds the links of a page: behind the entries, and behind the links of the pages before. */
static int find_links(const struct oracle *oracle, uint32_t number, struct oracle_page *page,
                      char error[ORACLE_ERROR_SIZE])
{
    uint64_t size;
    const uint32_t block = number / BLOCK_PAGES, pages = pages_of(oracle, block);
    const uint8_t *bytes = block_at(oracle, block, &size);
    uint64_t at = (uint64_t)pages * ENTRY_SIZE;
    for (uint32_t i = 0; i < pages; i++) {
        if (i == number % BLOCK_PAGES) {
            page->links = (struct oracle_cursor){
                .data = bytes + at, .size = oracle_number(bytes + i * ENTRY_SIZE + 26, 2)};
        }
        at += oracle_number(bytes + (uint64_t)i * ENTRY_SIZE + 26, 2);
    }
    return at == size || oracle_refuse(error, "block %" PRIu32 ": %" PRIu64 " bytes, not %" PRIu64,
                                       block, size, at);
}

static int read_entry(const struct oracle *oracle, uint32_t number, struct oracle_page *page,
                      char error[ORACLE_ERROR_SIZE])
{
    uint64_t size;
    const uint8_t *entry = block_at(oracle, number / BLOCK_PAGES, &size) +
                           (uint64_t)(number % BLOCK_PAGES) * ENTRY_SIZE;
    page->stored_at = oracle_number(entry, 8);
    page->stored_size = (uint32_t)oracle_number(entry + 8, 4);
    page->size = (uint32_t)oracle_number(entry + 12, 4);
    page->stored_hash = oracle_number(entry + 16, 8);
    page->high = entry[24];
    page->low = entry[25];
    page->nodes = (uint32_t)oracle_number(entry + 28, 4);
    page->hash = entry + 32;
    if (page->size > PAGE_LIMIT) {
        return oracle_refuse(error, "page %" PRIu32 ": %" PRIu32 " bytes, limit 1 MiB", number,
                             page->size);
    }
    if (page->low < 3 || page->high < page->low || page->high > 20) {
        return oracle_refuse(error, "page %" PRIu32 ": levels %" PRIu32 " to %" PRIu32, number,
                             page->high, page->low);
    }
    return find_links(oracle, number, page, error);
}

static int digest(const uint8_t *bytes, size_t size, uint8_t out[32])
{
    return EVP_Digest(bytes, size, out, NULL, EVP_sha256(), NULL) == 1;
}

static int expand(const struct oracle *oracle, uint32_t number, struct oracle_page *page,
                  char error[ORACLE_ERROR_SIZE])
{
    const uint8_t *stored = oracle->bytes + page->stored_at;
    uint8_t hash[32];
    if (XXH3_64bits(stored, page->stored_size) != page->stored_hash) {
        return oracle_refuse(error, "page %" PRIu32 ": XXH3 of the stored bytes differs", number);
    }
    if (ZSTD_findFrameCompressedSize(stored, page->stored_size) != page->stored_size) {
        return oracle_refuse(error, "page %" PRIu32 ": not one zstd frame", number);
    }
    page->bytes = malloc(page->size > 0 ? page->size : 1);
    if (page->bytes == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    if (ZSTD_decompress(page->bytes, page->size, stored, page->stored_size) != page->size) {
        return oracle_refuse(error, "page %" PRIu32 ": does not expand to %" PRIu32 " bytes",
                             number, page->size);
    }
    if (!digest(page->bytes, page->size, hash) || memcmp(hash, page->hash, 32) != 0) {
        return oracle_refuse(error, "page %" PRIu32 ": SHA-256 differs", number);
    }
    return 1;
}

/* A block's XXH3, and its hash of the hashes of its pages. */
static int check_block(const struct oracle *oracle, const struct oracle_page *pages, uint32_t block,
                       char error[ORACLE_ERROR_SIZE])
{
    const uint8_t *stated =
        oracle->bytes + HEAD_FIXED + oracle->block_size + (uint64_t)block * BLOCK_ENTRY_SIZE;
    uint64_t size;
    const uint8_t *bytes = block_at(oracle, block, &size);
    const uint32_t first = block * BLOCK_PAGES, count = pages_of(oracle, block);
    const size_t links = (size_t)size - (size_t)count * ENTRY_SIZE;
    uint8_t *hashed = malloc((size_t)count * 34 + links), hash[32];
    if (hashed == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    for (uint32_t i = 0; i < count; i++) {
        memcpy(hashed + 32 * (size_t)i, pages[first + i].hash, 32);
        memcpy(hashed + 32 * (size_t)count + 2 * (size_t)i, bytes + (size_t)i * ENTRY_SIZE + 26, 2);
    }
    memcpy(hashed + 34 * (size_t)count, bytes + (size_t)count * ENTRY_SIZE, links);
    const int hashes = digest(hashed, 34 * (size_t)count + links, hash);
    free(hashed);
    if (XXH3_64bits(bytes, (size_t)size) != oracle_number(stated, 8)) {
        return oracle_refuse(error, "block %" PRIu32 ": XXH3 differs", block);
    }
    if (!hashes || memcmp(hash, stated + 16, 32) != 0) {
        return oracle_refuse(error, "block %" PRIu32 ": SHA-256 differs", block);
    }
    return 1;
}

static int check_id(const struct oracle *oracle, const struct oracle_page *pages,
                    char error[ORACLE_ERROR_SIZE])
{
    uint8_t id[32];
    const uint8_t *table = oracle->bytes + HEAD_FIXED + oracle->block_size;
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    int good = context != NULL && EVP_DigestInit_ex(context, EVP_sha256(), NULL) == 1 &&
               EVP_DigestUpdate(context, oracle->bytes + HEAD_FIXED, (size_t)oracle->block_size);
    for (uint32_t i = 0; good && i < oracle->directory_count; i++) {
        good = EVP_DigestUpdate(context, table + (size_t)i * BLOCK_ENTRY_SIZE + 16, 32) == 1;
    }
    good = good && EVP_DigestFinal_ex(context, id, NULL) == 1;
    EVP_MD_CTX_free(context);
    if (!good) {
        return oracle_refuse(error, "OpenSSL has no SHA-256");
    }
    if (memcmp(id, oracle->id, 32) != 0) {
        return oracle_refuse(error, "id: not the hash of the canonical block and block hashes");
    }
    for (uint32_t i = 0; i < oracle->directory_count; i++) {
        if (!check_block(oracle, pages, i, error)) {
            return 0;
        }
    }
    return 1;
}

static int find_roots(struct oracle *oracle, const struct oracle_page *pages,
                      char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        struct oracle_frustum *frustum = &oracle->frusta[i];
        if (frustum->root_state != 2) {
            continue;
        }
        if (frustum->root_page >= oracle->page_count ||
            frustum->root_position >= pages[frustum->root_page].count[frustum->n]) {
            return oracle_refuse(error,
                                 "ROOT: frustum %" PRIu32 ": no node %" PRIu32 " of level %" PRIu32
                                 " in page %" PRIu32,
                                 i, frustum->root_position, frustum->n, frustum->root_page);
        }
        frustum->root =
            (uint32_t)(pages[frustum->root_page].base[frustum->n] + frustum->root_position);
    }
    return 1;
}

static int read_all_counts(struct oracle *oracle, struct oracle_page *pages,
                           char error[ORACLE_ERROR_SIZE])
{
    uint64_t at = oracle->head_size + oracle->first_block;
    for (uint32_t i = 0; i < oracle->page_count; i++) {
        if (!read_entry(oracle, i, &pages[i], error)) {
            return 0;
        }
        if (i == BLOCK_PAGES) {
            if (at != oracle->blocks_at) {
                return oracle_refuse(error, "directory: its second block is not behind page 31");
            }
            at += block_end(oracle, oracle->directory_count - 1) - oracle->first_block;
        }
        if (pages[i].stored_at != at || pages[i].stored_size > oracle->size - at) {
            return oracle_refuse(error,
                                 "page %" PRIu32 ": %" PRIu32 " bytes at %" PRIu64
                                 ", the page before ends at %" PRIu64,
                                 i, pages[i].stored_size, pages[i].stored_at, at);
        }
        at += pages[i].stored_size;
        if (!expand(oracle, i, &pages[i], error) ||
            !oracle_read_counts(oracle, i, &pages[i], error)) {
            return 0;
        }
    }
    if (at != oracle->size) {
        return oracle_refuse(error, "file: the pages end at %" PRIu64 " of %zu", at, oracle->size);
    }
    return 1;
}

static int allocate_levels(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    oracle->bricks = calloc((size_t)oracle->counts[3] + 1, sizeof *oracle->bricks);
    int good = oracle->bricks != NULL;
    for (uint32_t l = 4; l < ORACLE_LEVELS; l++) {
        oracle->nodes[l] = calloc((size_t)oracle->counts[l] + 1, sizeof *oracle->nodes[l]);
        good = good && oracle->nodes[l] != NULL;
    }
    return good || oracle_refuse(error, "out of memory");
}

int oracle_read_pages(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    struct oracle_page *pages = calloc((size_t)oracle->page_count + 1, sizeof *pages);
    if (pages == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    int good = read_all_counts(oracle, pages, error) && check_id(oracle, pages, error) &&
               allocate_levels(oracle, error);
    for (uint32_t i = 0; good && i < oracle->page_count; i++) {
        good = oracle_decode_page(oracle, pages, i, error);
    }
    good = good && find_roots(oracle, pages, error);
    free_pages(pages, oracle->page_count);
    return good;
}
