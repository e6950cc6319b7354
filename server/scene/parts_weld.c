/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Welding by an open-addressing hash table with linear probing.
 *
 * A slot has 64 bits. The upper half is a hash of the position. The lower half is the number of the
 * vertex's first corner plus one; 0 means that the slot is empty. The hash decides nearly all
 * comparisons without reading the position, also when the table grows. Nearly every probe of a
 * large table waits for memory, so corners are hashed in small groups and their slots prefetched.
 */
#include "scene/parts_weld.h"

#include <string.h>

#include "base/memory.h"
#include "tool/clock.h"

enum {
    GROUP = 48,         /* corners hashed and prefetched before they are looked up */
    FIRST_SLOTS = 1024, /* smallest table, a power of two */
};

struct table {
    uint64_t *slots;
    size_t mask; /* slots - 1 */
    size_t used;
    size_t limit; /* grow beyond this many: two thirds */
};

struct key {
    uint64_t bits[3];
};

static struct key key_of(const double position[3])
{
    /* Adding +0.0 turns -0.0 into +0.0 and leaves all other values equal. */
    const double clean[3] = {position[0] + 0.0, position[1] + 0.0, position[2] + 0.0};
    struct key key;
    memcpy(key.bits, clean, sizeof key.bits);
    return key;
}

/* Mixes the key's bits by three rounds of multiply and xor-shift. Coordinates are often small
 * multiples of one step, so all bits of each word must reach all bits of the hash. */
static uint32_t hash_of(const struct key *key, uint64_t seed)
{
    uint64_t h = seed;
    for (int i = 0; i < 3; i++) {
        h ^= key->bits[i];
        h *= UINT64_C(0xff51afd7ed558ccd);
        h ^= h >> 32;
        h *= UINT64_C(0xc4ceb9fe1a85ec53);
        h ^= h >> 29;
    }
    return (uint32_t)(h >> 16);
}

static uint64_t run_seed(const void *block)
{
    return (uint64_t)(uintptr_t)block * UINT64_C(0x9e3779b97f4a7c15) ^ umbu_clock_ns() << 20;
}

static int table_init(struct table *table, size_t slots)
{
    table->slots = umb__alloc_zeroed(NULL, slots, sizeof *table->slots);
    table->mask = slots - 1;
    table->used = 0;
    table->limit = slots - slots / 3;
    return table->slots != NULL;
}

static int table_double(struct table *table)
{
    struct table larger;
    size_t slots = table->mask + 1;
    if (slots > SIZE_MAX / 2 || !table_init(&larger, slots * 2)) {
        return 0;
    }
    for (size_t i = 0; i < slots; i++) {
        uint64_t slot = table->slots[i];
        if (slot == 0) {
            continue;
        }
        size_t at = (size_t)(slot >> 32) & larger.mask;
        while (larger.slots[at] != 0) {
            at = (at + 1) & larger.mask;
        }
        larger.slots[at] = slot;
    }
    larger.used = table->used;
    umb__free(NULL, table->slots);
    *table = larger;
    return 1;
}

/* Returns the first corner with the position of `corner`, which may be itself. The table is never
 * full, so the loop meets an empty slot. */
static uint32_t table_find_or_add(struct table *table, const double (*positions)[3],
                                  uint32_t corner, const struct key *key, uint32_t hash)
{
    size_t at = (size_t)hash & table->mask;
    for (;;) {
        uint64_t slot = table->slots[at];
        if (slot == 0) {
            table->slots[at] = (uint64_t)hash << 32 | ((uint64_t)corner + 1);
            table->used++;
            return corner;
        }
        if ((uint32_t)(slot >> 32) == hash) {
            uint32_t other = (uint32_t)slot - 1;
            struct key other_key = key_of(positions[other]);
            if (memcmp(key, &other_key, sizeof other_key) == 0) {
                return other;
            }
        }
        at = (at + 1) & table->mask;
    }
}

/* First size: a closed mesh has half as many vertices as triangles. */
static size_t first_slots(size_t count)
{
    size_t slots = FIRST_SLOTS;
    while (slots < count) {
        slots *= 2;
    }
    return slots;
}

static int weld_all(struct table *table, const double (*positions)[3], uint32_t corner_count,
                    uint32_t *vertex_of, uint32_t *vertex_count)
{
    uint64_t seed = run_seed(table->slots);
    struct key keys[GROUP];
    uint32_t hashes[GROUP];
    uint32_t vertices = 0;
    for (uint32_t base = 0; base < corner_count;) {
        uint32_t n = corner_count - base < GROUP ? corner_count - base : GROUP;
        if (table->used + n > table->limit && !table_double(table)) {
            return 0;
        }
        for (uint32_t i = 0; i < n; i++) {
            keys[i] = key_of(positions[base + i]);
            hashes[i] = hash_of(&keys[i], seed);
            __builtin_prefetch(&table->slots[(size_t)hashes[i] & table->mask], 1);
        }
        for (uint32_t i = 0; i < n; i++) {
            uint32_t corner = base + i;
            uint32_t first = table_find_or_add(table, positions, corner, &keys[i], hashes[i]);
            vertex_of[corner] = first == corner ? vertices++ : vertex_of[first];
        }
        base += n;
    }
    *vertex_count = vertices;
    return 1;
}

enum umb_status umbs_weld(const double (*corners)[3][3], size_t count, uint32_t **vertex_of,
                          uint32_t *vertex_count, struct umb_error *error)
{
    *vertex_of = NULL;
    *vertex_count = 0;
    if (count == 0) {
        return UMB_OK;
    }
    uint32_t *numbers = umb__alloc(NULL, count * 3, sizeof *numbers);
    struct table table = {0};
    int good = numbers != NULL && table_init(&table, first_slots(count)) &&
               weld_all(&table, corners[0], (uint32_t)(count * 3), numbers, vertex_count);
    umb__free(NULL, table.slots);
    if (!good) {
        umb__free(NULL, numbers);
        *vertex_count = 0;
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory to weld the corners of %zu triangles",
                        count);
    }
    *vertex_of = numbers;
    return UMB_OK;
}
