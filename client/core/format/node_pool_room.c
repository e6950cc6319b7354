/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Makes room in a pool for one more brick or node, within its budget.
 *
 * A table doubles when it is three quarters full, and an array when it is full. Near the budget,
 * tables fill to seven eighths and arrays grow by an eighth, so that most of the budget can be
 * used. Large arrays always grow by an eighth if the allocator moves pages instead of copying.
 */
#include <string.h>

#include "base/memory.h"
#include "base/page_alloc.h"
#include "base/try.h"
#include "format/node_pool_parts.h"

#define SLOTS_LOG2_MIN 10U
#define SLOTS_LOG2_MAX 32U /* As many bits as a tag has */
#define ITEMS_MIN      1024U
#define LARGE_BYTES    ((size_t)4 << 20) /* Size from which arrays are worth large pages */

/* Charges `more` bytes to the budget. Fails: E_LIMIT. */
static enum umb_status charge(struct umb__pool *pool, size_t more, struct umb_error *error)
{
    size_t total;
    if (__builtin_add_overflow(pool->bytes, more, &total) || total > pool->max_bytes) {
        return umb_fail(error, UMB_E_LIMIT,
                        "memory: the shadow octree needs %zu bytes more than the %zu it has of "
                        "the %zu allowed; give more or lower the resolution",
                        more, pool->bytes, pool->max_bytes);
    }
    pool->bytes = total;
    return UMB_OK;
}

/* Returns true if the pool's allocator grows large blocks without a copy. */
static int grows_by_pages(const struct umb__pool *pool)
{
    return pool->alloc == &umb__page_alloc;
}

/* Resizes a block. A large block moves to large pages of memory, since look-ups are scattered. */
static void *resize(const struct umb_alloc *alloc, void *block, size_t old_bytes, size_t bytes)
{
    if (bytes < LARGE_BYTES || alloc == &umb__page_alloc) {
        return umb__resize(alloc, block, bytes);
    }
    void *moved = umb__alloc_large(alloc, bytes, 1);
    if (moved != NULL && block != NULL) {
        memcpy(moved, block, old_bytes);
        umb__free(alloc, block);
    }
    return moved;
}

/* Grows *array of items from old_count to new_count. During a copy both blocks are charged. */
static enum umb_status grow(struct umb__pool *pool, void *array, size_t item, size_t old_count,
                            size_t new_count, struct umb_error *error)
{
    const size_t copied = grows_by_pages(pool) ? 0 : old_count * item;
    const size_t more = (new_count - old_count) * item + copied;
    void *block;
    memcpy(&block, array, sizeof block);
    UMB__TRY(charge(pool, more, error));
    block = resize(pool->alloc, block, old_count * item, new_count * item);
    if (block == NULL) {
        pool->bytes -= more;
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu bytes refused",
                        new_count * item);
    }
    memcpy(array, &block, sizeof block);
    pool->bytes -= copied;
    return UMB_OK;
}

static int can_afford(const struct umb__pool *pool, uint64_t more)
{
    return pool->bytes <= pool->max_bytes && more <= pool->max_bytes - pool->bytes;
}

/* Returns the capacity of a grown array, at most `most`. In: item: bytes of an item. */
static uint32_t grown(const struct umb__pool *pool, uint32_t capacity, size_t item, uint32_t most)
{
    const uint64_t twice = capacity == 0 ? ITEMS_MIN : 2 * (uint64_t)capacity;
    const uint64_t more = (uint64_t)capacity + capacity / 8 + 8;
    const int is_cheap = grows_by_pages(pool) && twice * item >= LARGE_BYTES;
    const uint64_t wanted = !is_cheap && can_afford(pool, twice * item) ? twice : more;
    return wanted > most ? most : (uint32_t)wanted;
}

/* True if a table must grow before it takes one more. */
static int slots_full(const struct umb__pool *pool, const struct umb__hash_slots *slots,
                      uint32_t count)
{
    if (slots->words == NULL || pool->is_loose) {
        return slots->words == NULL;
    }
    const uint64_t size = (uint64_t)1 << slots->log2_size, wanted = (uint64_t)count + 1;
    return wanted > size / 4 * 3 &&
           (wanted > size / 8 * 7 || can_afford(pool, 2 * size * sizeof *slots->words));
}

/* Replaces a table by one twice as large. Words keep their order, so the new table is filled from
 * end to end. */
static enum umb_status slots_grow(struct umb__pool *pool, struct umb__hash_slots *slots,
                                  struct umb_error *error)
{
    const uint32_t log2_size = slots->words == NULL ? SLOTS_LOG2_MIN : slots->log2_size + 1;
    if (log2_size > SLOTS_LOG2_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "shadow octree: hash table over 2^%u slots",
                        SLOTS_LOG2_MAX);
    }
    const size_t old_count = slots->words == NULL ? 0 : (size_t)1 << slots->log2_size;
    const size_t bytes = ((size_t)1 << log2_size) * sizeof *slots->words;
    UMB__TRY(charge(pool, bytes, error));
    struct umb__hash_slots larger = {umb__alloc_large(pool->alloc, bytes, 1), log2_size};
    if (larger.words == NULL) {
        pool->bytes -= bytes;
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu bytes refused", bytes);
    }
    if (!grows_by_pages(pool) || bytes < UMB__PAGE_ALLOC_LARGE) { /* Else the pages are fresh */
        memset(larger.words, 0, bytes);
    }
    for (size_t i = 0; i < old_count; i++) {
        const uint64_t word = slots->words[i];
        if (word != UMB__SLOT_EMPTY) {
            larger.words[umb__slot_free(&larger, umb__slot_tag(word))] = word;
        }
    }
    umb__free(pool->alloc, slots->words);
    pool->bytes -= old_count * sizeof *slots->words;
    *slots = larger;
    return UMB_OK;
}

/* Grows the arrays for bricks. */
static enum umb_status bricks_grow(struct umb__pool *pool, struct umb_error *error)
{
    const uint32_t old = pool->brick_capacity;
    const uint32_t capacity = grown(pool, old, sizeof *pool->bricks, UMB__REF_INDEX_MAX + 1U);
    UMB__TRY(grow(pool, &pool->bricks, sizeof *pool->bricks, old, capacity, error));
    if (pool->is_loose) {
        const enum umb_status status =
            grow(pool, &pool->brick_tags, sizeof *pool->brick_tags, old, capacity, error);
        if (status != UMB_OK) { /* The bricks keep their larger block, charged as the old one */
            pool->bytes -= (size_t)(capacity - old) * sizeof *pool->bricks;
            return status;
        }
    }
    pool->brick_capacity = capacity;
    return UMB_OK;
}

enum umb_status umb__pool_brick_room(struct umb__pool *pool, struct umb_error *error)
{
    struct umb__hash_slots *slots = &pool->brick_slots;
    if (pool->brick_count > UMB__REF_INDEX_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "shadow octree: more than %u unique bricks",
                        UMB__REF_INDEX_MAX);
    }
    if (pool->is_loose && slots->words == NULL) {
        /* The table of a loose pool is allocated before its array, since each pool with room for a
         * brick must have a table. */
        UMB__TRY(slots_grow(pool, slots, error));
    }
    if (pool->brick_count == pool->brick_capacity) {
        UMB__TRY(bricks_grow(pool, error));
    }
    return slots_full(pool, slots, pool->brick_count) ? slots_grow(pool, slots, error) : UMB_OK;
}

static enum umb_status nodes_grow(struct umb__pool *pool, struct umb__pool_level *level,
                                  struct umb_error *error)
{
    const uint32_t old = level->capacity;
    const uint32_t capacity =
        grown(pool, old, sizeof *level->masks + sizeof *level->first, UMB__REF_INDEX_MAX + 1U);
    UMB__TRY(grow(pool, &level->masks, sizeof *level->masks, old, capacity, error));
    const enum umb_status status =
        grow(pool, &level->first, sizeof *level->first, level->first == NULL ? 0 : (size_t)old + 1,
             (size_t)capacity + 1, error);
    if (status != UMB_OK) { /* The masks keep their larger block, charged as the old one */
        pool->bytes -= (size_t)(capacity - old) * sizeof *level->masks;
        return status;
    }
    if (old == 0) {
        level->first[0] = 0;
    }
    level->capacity = capacity;
    return UMB_OK;
}

/* Grows the array for children. */
static enum umb_status children_grow(struct umb__pool *pool, struct umb__pool_level *level,
                                     struct umb_error *error)
{
    const uint32_t capacity =
        grown(pool, level->child_capacity, sizeof *level->children, UINT32_MAX);
    UMB__TRY(grow(pool, &level->children, sizeof *level->children, level->child_capacity, capacity,
                  error));
    level->child_capacity = capacity;
    return UMB_OK;
}

enum umb_status umb__pool_node_room(struct umb__pool *pool, struct umb__pool_level *level,
                                    struct umb_error *error)
{
    if (level->count > UMB__REF_INDEX_MAX || level->child_count > UINT32_MAX - 8U) {
        return umb_fail(error, UMB_E_LIMIT,
                        "shadow octree: more than %u nodes or children in one level",
                        UMB__REF_INDEX_MAX);
    }
    if (level->count == level->capacity) {
        UMB__TRY(nodes_grow(pool, level, error));
    }
    if (level->child_capacity - level->child_count < 8) {
        UMB__TRY(children_grow(pool, level, error));
    }
    return !pool->is_loose && slots_full(pool, &level->slots, level->count)
               ? slots_grow(pool, &level->slots, error)
               : UMB_OK;
}
