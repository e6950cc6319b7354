/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: directory, identity and pages of a packed file. Source: docs/umb-format.md,
 * sections 4 and 5.
 *
 * Two passes: the first proves and expands every page and reads how many nodes it has, which
 * numbers all nodes of a level through (page after page); the second decodes, so that a reference
 * to a page further on has its number already.
 */
#include "oracle_parts.h"

#include <inttypes.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

enum {
    HEAD_FIXED = 128,
    ENTRY_SIZE = 64,
    BLOCK_ENTRY_SIZE = 40,
    BLOCK_PAGES = 64,
    PAGE_LIMIT = 1 << 20,
};

struct page {
    uint64_t stored_at;
    uint32_t stored_size, size, nodes;
    uint64_t stored_hash;
    uint32_t high, low;
    const uint8_t *hash;            /* SHA-256 stated by the directory */
    uint8_t *bytes;                 /* expanded */
    uint32_t count[ORACLE_LEVELS];  /* N[l] */
    uint32_t others[ORACLE_LEVELS]; /* E[l] */
    uint64_t base[ORACLE_LEVELS];   /* number of its first node among all of level l */
    struct oracle_cursor cursor;    /* what stands after the counts */
    uint32_t leaves;                /* F */
};

static void free_pages(struct page *pages, uint32_t count)
{
    for (uint32_t i = 0; pages != NULL && i < count; i++) {
        free(pages[i].bytes);
    }
    free(pages);
}

/* Where a block of the directory stands; oracle_read_head has found all of them inside the file. */
static const uint8_t *block_at(const struct oracle *oracle, uint32_t block)
{
    return oracle->bytes +
           (block == 0 ? oracle->head_size
                       : oracle->blocks_at + (uint64_t)(block - 1) * BLOCK_PAGES * ENTRY_SIZE);
}

static int read_entry(const struct oracle *oracle, uint32_t number, struct page *page,
                      char error[ORACLE_ERROR_SIZE])
{
    const uint8_t *entry =
        block_at(oracle, number / BLOCK_PAGES) + (uint64_t)(number % BLOCK_PAGES) * ENTRY_SIZE;
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
    if (!oracle_all_zero(entry + 26, 2)) {
        return oracle_refuse(error, "page %" PRIu32 ": a zero field is set", number);
    }
    return 1;
}

static int digest(const uint8_t *bytes, size_t size, uint8_t out[32])
{
    return EVP_Digest(bytes, size, out, NULL, EVP_sha256(), NULL) == 1;
}

static int expand(const struct oracle *oracle, uint32_t number, struct page *page,
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
static int check_block(const struct oracle *oracle, const struct page *pages, uint32_t block,
                       char error[ORACLE_ERROR_SIZE])
{
    const uint8_t *stated =
        oracle->bytes + HEAD_FIXED + oracle->block_size + (uint64_t)block * BLOCK_ENTRY_SIZE;
    uint32_t first = block * BLOCK_PAGES, rest = oracle->page_count - first;
    uint32_t count = rest < BLOCK_PAGES ? rest : BLOCK_PAGES;
    uint8_t hashes[BLOCK_PAGES * 32], hash[32];
    for (uint32_t i = 0; i < count; i++) {
        memcpy(hashes + 32 * (size_t)i, pages[first + i].hash, 32);
    }
    if (XXH3_64bits(block_at(oracle, block), (size_t)count * ENTRY_SIZE) !=
        oracle_number(stated, 8)) {
        return oracle_refuse(error, "block %" PRIu32 ": XXH3 differs", block);
    }
    if (!digest(hashes, 32 * (size_t)count, hash) || memcmp(hash, stated + 8, 32) != 0) {
        return oracle_refuse(error, "block %" PRIu32 ": SHA-256 differs", block);
    }
    return 1;
}

static int check_id(const struct oracle *oracle, const struct page *pages,
                    char error[ORACLE_ERROR_SIZE])
{
    uint8_t id[32];
    const uint8_t *table = oracle->bytes + HEAD_FIXED + oracle->block_size;
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    int good = context != NULL && EVP_DigestInit_ex(context, EVP_sha256(), NULL) == 1 &&
               EVP_DigestUpdate(context, oracle->bytes + HEAD_FIXED, (size_t)oracle->block_size);
    for (uint32_t i = 0; good && i < oracle->directory_count; i++) {
        good = EVP_DigestUpdate(context, table + (size_t)i * BLOCK_ENTRY_SIZE + 8, 32) == 1;
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

/* The fixed part and the counts of a page, and where its nodes get their numbers. */
static int read_counts(struct oracle *oracle, uint32_t number, struct page *page,
                       char error[ORACLE_ERROR_SIZE])
{
    struct oracle_cursor *cursor = &page->cursor;
    *cursor = (struct oracle_cursor){.data = page->bytes, .size = page->size};
    uint64_t encoding = oracle_take(cursor, 1);
    uint64_t high = oracle_take(cursor, 1);
    uint64_t low = oracle_take(cursor, 1);
    uint64_t zero = oracle_take(cursor, 1);
    if (encoding != 1 || high != page->high || low != page->low || zero != 0) {
        return oracle_refuse(
            error, "page %" PRIu32 ": encoding %" PRIu64 ", levels %" PRIu64 " to %" PRIu64, number,
            encoding, high, low);
    }
    uint64_t total = 0;
    for (uint32_t l = page->high; l >= page->low; l--) {
        page->count[l] = (uint32_t)oracle_take(cursor, 4);
        page->base[l] = oracle->counts[l];
        oracle->counts[l] += page->count[l];
        total += page->count[l];
    }
    for (uint32_t l = page->high; l >= page->low && l >= 4; l--) {
        page->others[l] = (uint32_t)oracle_take(cursor, 4);
    }
    if (page->low == 3) {
        page->leaves = (uint32_t)oracle_take(cursor, 4);
    }
    /* A node takes at least two bytes and a brick one, so that counts beyond the page are lies. */
    if (cursor->overrun || total != page->nodes || total > page->size) {
        return oracle_refuse(error,
                             "page %" PRIu32 ": %" PRIu64 " nodes, the directory says "
                             "%" PRIu32,
                             number, total, page->nodes);
    }
    return 1;
}

static uint32_t width_for(uint64_t count)
{
    if (count <= (uint64_t)1 << 8) {
        return 1;
    }
    if (count <= (uint64_t)1 << 16) {
        return 2;
    }
    return count <= (uint64_t)1 << 24 ? 3 : 4;
}

/* The pages as a whole, and the one being decoded. */
struct decoder {
    struct oracle *oracle;
    const struct page *pages;
    uint32_t number;
    struct page *page;
    char *error;
};

/* Number of reference r of level l among all nodes of level l - 1, or -1. */
static int64_t resolve(const struct decoder *decoder, uint32_t l, uint64_t r, const uint8_t *others)
{
    const struct page *page = decoder->page;
    if (r < page->count[l - 1]) {
        return (int64_t)(page->base[l - 1] + r);
    }
    uint64_t k = r - page->count[l - 1];
    if (k >= page->others[l]) {
        return -1;
    }
    uint64_t other = oracle_number(others + 4 * k, 4);
    uint64_t position = oracle_number(others + 4 * ((uint64_t)page->others[l] + k), 4);
    if (other >= decoder->oracle->page_count || other == decoder->number ||
        position >= decoder->pages[other].count[l - 1]) {
        return -1;
    }
    return (int64_t)(decoder->pages[other].base[l - 1] + position);
}

static int decode_node(const struct decoder *decoder, uint32_t l, struct oracle_node *node,
                       const uint8_t *others, uint8_t *used)
{
    const struct page *page = decoder->page;
    uint32_t width = width_for((uint64_t)page->count[l - 1] + page->others[l]);
    for (uint32_t c = 0; c < 8; c++) {
        uint32_t state = (node->mask >> (2 * c)) & 3;
        if (state == 3) {
            return oracle_refuse(decoder->error,
                                 "page %" PRIu32 ": level %" PRIu32 ": a child has state 3",
                                 decoder->number, l);
        }
        if (state != 2) {
            continue;
        }
        uint64_t r = oracle_take(&decoder->page->cursor, width);
        int64_t child = resolve(decoder, l, r, others);
        if (child < 0 || child > UINT32_MAX) {
            return oracle_refuse(decoder->error,
                                 "page %" PRIu32 ": level %" PRIu32 ": reference %" PRIu64
                                 " leads nowhere",
                                 decoder->number, l, r);
        }
        node->child[c] = (uint32_t)child;
        if (r >= page->count[l - 1]) {
            used[r - page->count[l - 1]] = 1;
        }
    }
    return 1;
}

static int decode_level(const struct decoder *decoder, uint32_t l)
{
    struct page *page = decoder->page;
    uint64_t other_count = page->others[l];
    const uint8_t *others = oracle_take_bytes(&page->cursor, 8 * other_count);
    const uint8_t *masks = oracle_take_bytes(&page->cursor, 2 * (uint64_t)page->count[l]);
    if (page->cursor.overrun) {
        return oracle_refuse(decoder->error,
                             "page %" PRIu32 ": level %" PRIu32 " runs over its end",
                             decoder->number, l);
    }
    uint8_t *used = calloc((size_t)other_count + 1, 1);
    if (used == NULL) {
        return oracle_refuse(decoder->error, "out of memory");
    }
    int good = 1;
    for (uint32_t i = 0; good && i < page->count[l]; i++) {
        struct oracle_node *node = &decoder->oracle->nodes[l][page->base[l] + i];
        node->mask = (uint16_t)oracle_number(masks + 2 * (uint64_t)i, 2);
        good = decode_node(decoder, l, node, others, used);
    }
    for (uint64_t k = 0; good && k < other_count; k++) {
        good = used[k] || oracle_refuse(decoder->error,
                                        "page %" PRIu32 ": level %" PRIu32 ": other %" PRIu64
                                        " is not referred to",
                                        decoder->number, l, k);
    }
    free(used);
    return good;
}

/* A brick's eight slices from its runs. */
static int decode_brick(const struct decoder *decoder, const uint8_t *leaves, uint32_t runs,
                        struct oracle_brick *brick)
{
    struct page *page = decoder->page;
    uint64_t leaf = 0;
    for (uint32_t z = 0; z < 8; z++) {
        if ((runs >> z) & 1) {
            uint64_t number = oracle_take(&page->cursor, width_for(page->leaves));
            if (page->cursor.overrun || number >= page->leaves) {
                return oracle_refuse(decoder->error,
                                     "page %" PRIu32 ": leaf %" PRIu64 " of %" PRIu32,
                                     decoder->number, number, page->leaves);
            }
            uint64_t next = oracle_number(leaves + 8 * number, 8);
            if (z > 0 && next == leaf) {
                return oracle_refuse(decoder->error,
                                     "page %" PRIu32 ": a run begins with the "
                                     "slice before it",
                                     decoder->number);
            }
            leaf = next;
        }
        brick->slice[z] = leaf;
    }
    return 1;
}

static int decode_bricks(const struct decoder *decoder)
{
    struct page *page = decoder->page;
    const uint8_t *leaves = oracle_take_bytes(&page->cursor, 8 * (uint64_t)page->leaves);
    const uint8_t *runs = oracle_take_bytes(&page->cursor, page->count[3]);
    if (page->cursor.overrun) {
        return oracle_refuse(decoder->error, "page %" PRIu32 ": leaves or runs run over its end",
                             decoder->number);
    }
    for (uint32_t i = 0; i < page->count[3]; i++) {
        if ((runs[i] & 1) == 0) {
            return oracle_refuse(decoder->error,
                                 "page %" PRIu32 ": runs of brick %" PRIu32 " lack bit 0",
                                 decoder->number, i);
        }
        if (!decode_brick(decoder, leaves, runs[i], &decoder->oracle->bricks[page->base[3] + i])) {
            return 0;
        }
    }
    return 1;
}

static int decode_page(const struct decoder *decoder)
{
    for (uint32_t l = decoder->page->high; l >= decoder->page->low && l >= 4; l--) {
        if (!decode_level(decoder, l)) {
            return 0;
        }
    }
    if (decoder->page->low == 3 && !decode_bricks(decoder)) {
        return 0;
    }
    const struct oracle_cursor *cursor = &decoder->page->cursor;
    if (cursor->overrun || cursor->at != cursor->size) {
        return oracle_refuse(decoder->error, "page %" PRIu32 ": %" PRIu64 " bytes used of %" PRIu64,
                             decoder->number, cursor->at, cursor->size);
    }
    return 1;
}

static int find_roots(struct oracle *oracle, const struct page *pages,
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

static int read_all_counts(struct oracle *oracle, struct page *pages, char error[ORACLE_ERROR_SIZE])
{
    uint32_t first = oracle->page_count < BLOCK_PAGES ? oracle->page_count : BLOCK_PAGES;
    uint64_t at = oracle->head_size + (uint64_t)first * ENTRY_SIZE;
    for (uint32_t i = 0; i < oracle->page_count; i++) {
        if (!read_entry(oracle, i, &pages[i], error)) {
            return 0;
        }
        if (i == BLOCK_PAGES) {
            if (at != oracle->blocks_at) {
                return oracle_refuse(error, "directory: its second block is not behind page 63");
            }
            at += (uint64_t)(oracle->page_count - BLOCK_PAGES) * ENTRY_SIZE;
        }
        if (pages[i].stored_at != at || pages[i].stored_size > oracle->size - at) {
            return oracle_refuse(error,
                                 "page %" PRIu32 ": %" PRIu32 " bytes at %" PRIu64
                                 ", the page before ends at %" PRIu64,
                                 i, pages[i].stored_size, pages[i].stored_at, at);
        }
        at += pages[i].stored_size;
        if (!expand(oracle, i, &pages[i], error) || !read_counts(oracle, i, &pages[i], error)) {
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
    struct page *pages = calloc((size_t)oracle->page_count + 1, sizeof *pages);
    if (pages == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    int good = read_all_counts(oracle, pages, error) && check_id(oracle, pages, error) &&
               allocate_levels(oracle, error);
    for (uint32_t i = 0; good && i < oracle->page_count; i++) {
        const struct decoder decoder = {oracle, pages, i, &pages[i], error};
        good = decode_page(&decoder);
    }
    good = good && find_roots(oracle, pages, error);
    free_pages(pages, oracle->page_count);
    return good;
}
