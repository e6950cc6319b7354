/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pages of another version of an asset. A page's bytes do not name other pages, so a page whose
 * nodes did not change has the same hash in both versions. Such pages wait as spares, sorted by
 * hash. When a block of the directory comes, its entries are looked up. A found spare passes the
 * checks of every page: its SHA-256 is made again, and its links are those of the new block.
 *
 * Each spare is tried once. So all tries together cost one pass over the pages that the other
 * version held, whatever a directory claims, and a look-up an entry.
 */
#include <stdlib.h>
#include <string.h>

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

void umb__spares_use(struct umb_partial *p, uint32_t block)
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

bool umb__spares_drop(struct umb_partial *p)
{
    const bool any = p->spares != NULL;
    for (uint32_t i = 0; i < p->spare_count; i++) {
        umb__free(&p->alloc, p->spares[i].stored);
    }
    umb__free(&p->alloc, p->spares);
    p->spares = NULL;
    p->spare_count = 0;
    p->spare_bytes = 0;
    return any;
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
    (void)umb__spares_drop(from);
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
    if (!p->spares) {
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "partial asset: no memory within the budget for a list of %zu pages", most);
    }
    move_all(p, from);
    qsort(p->spares, p->spare_count, sizeof *p->spares, by_hash);
    for (uint32_t block = 0; block < p->head.directory_count && p->spares; block++) {
        if (p->blocks[block]) {
            umb__spares_use(p, block);
        }
    }
    return UMB_OK;
}
