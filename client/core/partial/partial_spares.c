/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pages of another version of an asset. A page's bytes do not name other pages, so a page whose
 * nodes did not change has the same hash in both versions. Such pages wait as spares, sorted by
 * hash. When a block of the directory comes, its entries are looked up. A found spare passes the
 * checks of every page: its SHA-256 is made again, and its links are those of the new block.
 *
 * Blocks of the directory wait too, where both heads have the same hash of a block: its entries
 * differ only in the places of the pages, which follow from the block before or behind. The head's
 * checksum proves the result.
 *
 * Each spare is tried once. So all tries together cost one pass over the pages and blocks that the
 * other version held, whatever a directory claims, and a look-up an entry.
 */
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "partial/partial_parts.h"

static int by_hash(const void *a, const void *b)
{
    return memcmp(((const struct umb__spare *)a)->hash, ((const struct umb__spare *)b)->hash,
                  UMB_ID_BYTES);
}

/* Takes a spare with a given hash out of the list. Returns its bytes; NULL: there is none. */
static uint8_t *take_spare(struct umb_partial *p, const uint8_t hash[UMB_ID_BYTES],
                           uint32_t *length)
{
    uint32_t low = 0, high = p->spare_count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (memcmp(p->spares[middle].hash, hash, UMB_ID_BYTES) < 0) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    /* Of equal hashes the first entry counts how many are gone. */
    const uint32_t at = low < p->spare_count ? low + p->spares[low].gone : low;
    if (at >= p->spare_count || memcmp(p->spares[at].hash, hash, UMB_ID_BYTES) != 0) {
        return NULL;
    }
    uint8_t *stored = p->spares[at].stored;
    p->spares[at].stored = NULL;
    p->spares[low].gone++;
    *length = p->spares[at].length;
    p->spare_bytes -= *length;
    return stored;
}

/* Adds the missing pages of a held block for which there is a spare. */
static void use_pages(struct umb_partial *p, uint32_t block)
{
    const uint32_t first = block * UMB__BLOCK_PAGES;
    for (uint32_t i = 0; i < UMB__BLOCK_PAGES && i < p->head.page_count - first; i++) {
        uint32_t length;
        if (p->pages[first + i].stored) {
            continue;
        }
        uint8_t *stored = take_spare(p, umb__directory_hash(&p->head, first + i), &length);
        if (stored) {
            umb__partial_add_spare(p, first + i, stored, length);
        }
    }
}

/* Returns a hash of a block in the head's table. */
static const uint8_t *block_hash(const struct umb__head *head, uint32_t block)
{
    return head->directory + (size_t)block * UMB__BLOCK_ENTRY + UMB__BLOCK_HASH;
}

static uint32_t pages_of_block(const struct umb__head *head, uint32_t block)
{
    return umb__block_entry_bytes(head->page_count, block) / UMB__PAGE_ENTRY;
}

/* Finds the place of a block's first page, from the head or from the neighbours of the block. In:
 * stored: stored bytes of the block's pages. Returns false if it does not follow yet. */
static bool find_place(const struct umb_partial *p, uint32_t block, uint64_t stored,
                       uint64_t *place)
{
    const struct umb__head *head = &p->head;
    const uint32_t first = block * UMB__BLOCK_PAGES, last = head->directory_count - 1;
    if (block < 2) { /* behind the first block, or behind the last */
        const uint32_t before = block == 0 ? 0 : last;
        *place = umb__block_offset(head, before) + umb__block_bytes(head, before);
    } else if (p->blocks[block - 1]) {
        const struct umb__page_entry entry = umb__directory_load(head, first - 1);
        *place = entry.offset + entry.stored_length;
    } else if (block == last) {
        *place = head->file_length - stored;
    } else if (p->blocks[block + 1]) {
        *place = umb__directory_load(head, first + UMB__BLOCK_PAGES).offset - stored;
    } else {
        return false;
    }
    return true;
}

/* Adds a missing block from the spare one, if the places of its pages follow from what is held.
 * Returns false if it stays missing. */
static bool place_block(struct umb_partial *p, uint32_t block)
{
    uint8_t *bytes = p->spare_blocks && !p->blocks[block] ? p->spare_blocks[block] : NULL;
    const uint32_t size = umb__block_bytes(&p->head, block);
    const uint32_t pages = pages_of_block(&p->head, block);
    uint64_t stored = 0, place;
    for (uint32_t i = 0; bytes && i < pages; i++) {
        stored += umb__load32(bytes + (size_t)i * UMB__PAGE_ENTRY + UMB__PAGE_STORED_LENGTH);
    }
    if (!bytes || !find_place(p, block, stored, &place)) {
        return false;
    }
    p->spare_blocks[block] = NULL;
    for (uint32_t i = 0; i < pages; i++) {
        uint8_t *entry = bytes + (size_t)i * UMB__PAGE_ENTRY;
        umb__store64(entry + UMB__PAGE_OFFSET, place);
        place += umb__load32(entry + UMB__PAGE_STORED_LENGTH);
    }
    if (umb__block_check(&p->head, block, bytes, size, NULL, NULL) != UMB_OK ||
        umb__block_prove(&p->head, block, bytes, size, p->sha256, NULL) != UMB_OK) {
        umb__free(&p->alloc, bytes);
        return false;
    }
    p->blocks[block] = bytes;
    p->block_count++;
    use_pages(p, block);
    return true;
}

void umb__spares_use(struct umb_partial *p, uint32_t block)
{
    use_pages(p, block);
    for (uint32_t next = block + 1; next < p->head.directory_count && place_block(p, next);) {
        next++;
    }
    for (uint32_t before = block; before > 0 && place_block(p, before - 1);) {
        before--;
    }
}

uint32_t umb__spares_before(const struct umb_partial *p, uint32_t block)
{
    uint32_t before = block;
    while (before > 0 && p->spare_blocks && p->spare_blocks[before]) {
        before--;
    }
    return p->blocks[before] ? block : before;
}

/* Moves a page's bytes into the list of spares, as far as the memory budget allows; else they are
 * freed. */
static void move(struct umb_partial *p, struct umb_partial *from, const uint8_t *hash,
                 uint8_t *stored, uint32_t length)
{
    if (!umb__partial_move(p, from, stored)) {
        umb__free(&from->alloc, stored);
        return;
    }
    struct umb__spare *spare = &p->spares[p->spare_count++];
    *spare = (struct umb__spare){.stored = stored, .length = length};
    memcpy(spare->hash, hash, UMB_ID_BYTES);
    p->spare_bytes += length;
}

static void move_all(struct umb_partial *p, struct umb_partial *from)
{
    for (uint32_t page = 0; page < from->head.page_count; page++) {
        const uint32_t length = from->pages[page].stored_length;
        uint8_t *stored = umb__partial_release(from, page);
        if (stored) {
            move(p, from, umb__directory_hash(&from->head, page), stored, length);
        }
    }
    for (uint32_t i = 0; i < from->spare_count; i++) {
        struct umb__spare *old = &from->spares[i];
        if (old->stored) {
            move(p, from, old->hash, old->stored, old->length);
            old->stored = NULL;
        }
    }
}

/* Moves the blocks that both versions have at the same place of their directories. */
static void move_blocks(struct umb_partial *p, struct umb_partial *from)
{
    for (uint32_t b = 0; b < p->head.directory_count && b < from->head.directory_count; b++) {
        uint8_t **old =
            from->blocks[b] || !from->spare_blocks ? &from->blocks[b] : &from->spare_blocks[b];
        if (*old && !p->blocks[b] &&
            umb__block_bytes(&p->head, b) == umb__block_bytes(&from->head, b) &&
            pages_of_block(&p->head, b) == pages_of_block(&from->head, b) &&
            memcmp(block_hash(&p->head, b), block_hash(&from->head, b), UMB_ID_BYTES) == 0 &&
            umb__partial_move(p, from, *old)) {
            from->block_count -= old == &from->blocks[b];
            p->spare_blocks[b] = *old;
            *old = NULL;
        }
    }
}

enum umb_status umb_partial_inherit(struct umb_partial *p, struct umb_partial *from,
                                    struct umb_error *error)
{
    if (p == from || p->meter.inner != from->meter.inner) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "inherit: give another partial asset with the same allocator");
    }
    if (p->spares) {
        return umb_fail(error, UMB_E_STATE,
                        "inherit: this partial asset has inherited %u pages already",
                        p->spare_count);
    }
    const size_t most = (size_t)from->held_count + from->spare_count;
    p->spares = umb__alloc(&p->alloc, most + 1, sizeof *p->spares);
    p->spare_blocks =
        umb__alloc_zeroed(&p->alloc, p->head.directory_count + 1, sizeof *p->spare_blocks);
    if (!p->spares || !p->spare_blocks) {
        (void)umb__spares_drop(p);
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "partial asset: no memory within the budget for a list of %zu pages", most);
    }
    move_all(p, from);
    move_blocks(p, from);
    (void)umb__spares_drop(from);
    qsort(p->spares, p->spare_count, sizeof *p->spares, by_hash);
    for (uint32_t block = 0; block < p->head.directory_count; block++) {
        if (p->blocks[block] || place_block(p, block)) {
            umb__spares_use(p, block);
        }
    }
    if (p->head.directory_count > 0 && place_block(p, p->head.directory_count - 1)) {
        umb__spares_use(p, p->head.directory_count - 1);
    }
    return UMB_OK;
}
