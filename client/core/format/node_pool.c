/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hash-consing of bricks and nodes, level by level.
 *
 * Slots are one 64-bit word, tag above number, so that most probes that miss touch one cache line
 * only. Tables double at three quarters full and are refilled from the old ones; arrays double.
 * Where the budget does not allow that, tables fill to seven eighths and arrays grow by an eighth,
 * so that most of the budget can be used; large arrays always do where that copies nothing.
 */
#define XXH_INLINE_ALL
#include "format/node_pool_parts.h"

#include <string.h>
#include <sys/auxv.h>
#include <xxhash.h>

#include "base/memory.h"
#include "base/page_alloc.h"

#define EMPTY          UMB__SLOT_EMPTY
#define SLOTS_LOG2_MIN 10U
#define SLOTS_LOG2_MAX 32U /* as many bits of a hash are in a slot */
#define ITEMS_MIN      1024U
#define LARGE_BYTES    ((size_t)4 << 20) /* arrays from here on are worth large pages */

/* Of the random bytes that the kernel hands a process with its arguments. */
static uint64_t secret_seed(void)
{
    const void *bytes = (const void *)(uintptr_t)getauxval(AT_RANDOM); /* 16, or NULL */
    return bytes != NULL ? XXH3_64bits(bytes, 16) : (uint64_t)(uintptr_t)getauxval;
}

void umb_pool_init(struct umb_pool *pool, const struct umb_alloc *alloc, size_t max_bytes)
{
    memset(pool, 0, sizeof *pool);
    pool->alloc = alloc;
    pool->seed = secret_seed();
    pool->max_bytes = max_bytes;
}

void umb_pool_init_loose(struct umb_pool *pool, const struct umb_alloc *alloc, size_t max_bytes)
{
    umb_pool_init(pool, alloc, max_bytes);
    pool->is_loose = 1;
}

void umb_pool_finish(struct umb_pool *pool)
{
    umb__free(pool->alloc, pool->brick_slots.words);
    umb__free(pool->alloc, pool->bricks);
    for (uint32_t i = 0; i <= UMB_LEVEL_MAX; i++) {
        umb__free(pool->alloc, pool->level[i].slots.words);
        umb__free(pool->alloc, pool->level[i].masks);
        umb__free(pool->alloc, pool->level[i].first);
        umb__free(pool->alloc, pool->level[i].children);
    }
    memset(pool, 0, sizeof *pool);
}

static void slots_clear(struct umb_hash_slots *slots)
{
    if (slots->words != NULL) {
        memset(slots->words, 0, ((size_t)1 << slots->log2_size) * sizeof *slots->words);
    }
}

void umb_pool_clear(struct umb_pool *pool)
{
    slots_clear(&pool->brick_slots);
    pool->brick_count = 0;
    for (uint32_t i = 0; i <= UMB_LEVEL_MAX; i++) {
        struct umb_pool_level *level = &pool->level[i];
        if (level->count > 0) {
            slots_clear(&level->slots);
        }
        level->count = level->child_count = 0;
    }
}

/* Reserves bytes of the budget. */
static enum umb_status charge(struct umb_pool *pool, size_t more, struct umb_error *error)
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

/* Whether arrays grow without a copy. */
static int grows_by_pages(const struct umb_pool *pool)
{
    return pool->alloc == &umb__page_alloc;
}

/* Resizes a block; a large one by moving it to large pages, as look-ups go all over it. */
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

/* Grows an array of items to new_count; an old block that is copied is charged until it is gone. */
static enum umb_status grow(struct umb_pool *pool, void **block, size_t item, size_t old_count,
                            size_t new_count, struct umb_error *error)
{
    const size_t copied = grows_by_pages(pool) ? 0 : old_count * item;
    const size_t more = (new_count - old_count) * item + copied;
    const enum umb_status status = charge(pool, more, error);
    if (status != UMB_OK) {
        return status;
    }
    void *grown = resize(pool->alloc, *block, old_count * item, new_count * item);
    if (grown == NULL) {
        pool->bytes -= more;
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu bytes refused",
                        new_count * item);
    }
    *block = grown;
    pool->bytes -= copied;
    return UMB_OK;
}

static int can_afford(const struct umb_pool *pool, uint64_t more)
{
    return pool->bytes <= pool->max_bytes && more <= pool->max_bytes - pool->bytes;
}

/* Capacity after growth, at most `most`. In: item: bytes that it takes of each. */
static uint32_t grown(const struct umb_pool *pool, uint32_t capacity, size_t item, uint32_t most)
{
    const uint64_t twice = capacity == 0 ? ITEMS_MIN : 2 * (uint64_t)capacity;
    const uint64_t more = (uint64_t)capacity + capacity / 8 + 8;
    const int is_cheap = grows_by_pages(pool) && twice * item >= LARGE_BYTES;
    const uint64_t wanted = !is_cheap && can_afford(pool, twice * item) ? twice : more;
    return wanted > most ? most : (uint32_t)wanted;
}

/* Puts a word whose number is known not to be there. */
static void slots_put(struct umb_hash_slots *slots, uint64_t word)
{
    const size_t last = ((size_t)1 << slots->log2_size) - 1;
    size_t at = umb__slot_place(slots, word);
    while (slots->words[at] != EMPTY) {
        at = (at + 1) & last;
    }
    slots->words[at] = word;
}

/* Puts the word of what was just added. */
static void slots_add(const struct umb_pool *pool, struct umb_hash_slots *slots, uint64_t word)
{
    if (pool->is_loose) {
        slots->words[umb__slot_place(slots, word)] = word;
    } else {
        slots_put(slots, word);
    }
}

/* Whether a table must grow before it takes one more. */
static int slots_full(const struct umb_pool *pool, const struct umb_hash_slots *slots,
                      uint32_t count)
{
    if (slots->words == NULL || pool->is_loose) {
        return slots->words == NULL;
    }
    const uint64_t size = (uint64_t)1 << slots->log2_size, wanted = (uint64_t)count + 1;
    return wanted > size / 4 * 3 &&
           (wanted > size / 8 * 7 || can_afford(pool, 2 * size * sizeof *slots->words));
}

/* Replaces a table by one twice as large. Words stand in the order of their places in both, so
 * that the new one is filled from end to end. */
static enum umb_status slots_grow(struct umb_pool *pool, struct umb_hash_slots *slots,
                                  struct umb_error *error)
{
    const uint32_t log2_size = slots->words == NULL ? SLOTS_LOG2_MIN : slots->log2_size + 1;
    if (log2_size > SLOTS_LOG2_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "shadow octree: hash table over 2^%u slots",
                        SLOTS_LOG2_MAX);
    }
    const size_t old_count = slots->words == NULL ? 0 : (size_t)1 << slots->log2_size;
    const size_t bytes = ((size_t)1 << log2_size) * sizeof *slots->words;
    const enum umb_status status = charge(pool, bytes, error);
    if (status != UMB_OK) {
        return status;
    }
    struct umb_hash_slots larger = {umb__alloc_large(pool->alloc, bytes, 1), log2_size};
    if (larger.words == NULL) {
        pool->bytes -= bytes;
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu bytes refused", bytes);
    }
    if (!grows_by_pages(pool) || bytes < UMB__PAGE_ALLOC_LARGE) { /* else they are fresh */
        memset(larger.words, 0, bytes);
    }
    for (size_t i = 0; i < old_count; i++) {
        if (slots->words[i] != EMPTY) {
            slots_put(&larger, slots->words[i]);
        }
    }
    umb__free(pool->alloc, slots->words);
    pool->bytes -= old_count * sizeof *slots->words;
    *slots = larger;
    return UMB_OK;
}

uint64_t umb__brick_hash(const struct umb_pool *pool, const uint64_t slices[8])
{
    return XXH3_64bits_withSeed(slices, 8 * sizeof slices[0], pool->seed);
}

/* Makes room for one more brick. */
static enum umb_status brick_reserve(struct umb_pool *pool, struct umb_error *error)
{
    enum umb_status status;
    if (pool->brick_count > UMB_REF_INDEX_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "shadow octree: more than %u unique bricks",
                        UMB_REF_INDEX_MAX);
    }
    if (pool->brick_count == pool->brick_capacity) {
        const uint32_t capacity =
            grown(pool, pool->brick_capacity, sizeof *pool->bricks, UMB_REF_INDEX_MAX + 1U);
        void *block = pool->bricks;
        status = grow(pool, &block, sizeof *pool->bricks, pool->brick_capacity, capacity, error);
        pool->bricks = block;
        if (status != UMB_OK) {
            return status;
        }
        pool->brick_capacity = capacity;
    }
    return slots_full(pool, &pool->brick_slots, pool->brick_count)
               ? slots_grow(pool, &pool->brick_slots, error)
               : UMB_OK;
}

/* Adds a brick that is not there. */
static inline enum umb_status brick_add(struct umb_pool *pool, const uint64_t slices[8],
                                        uint64_t hash, uint32_t *ref, struct umb_error *error)
{
    const enum umb_status status = brick_reserve(pool, error);
    if (status != UMB_OK) {
        return status;
    }
    const uint32_t number = pool->brick_count++;
    memcpy(pool->bricks[number], slices, sizeof *pool->bricks);
    slots_add(pool, &pool->brick_slots, umb__slot_word(hash, number));
    *ref = number;
    return UMB_OK;
}

enum umb_status umb__pool_find_brick(struct umb_pool *pool, const uint64_t slices[8], uint64_t hash,
                                     uint32_t *ref, struct umb_error *error)
{
    if (pool->brick_slots.words != NULL) {
        const size_t last = ((size_t)1 << pool->brick_slots.log2_size) - 1;
        size_t at = umb__slot_place(&pool->brick_slots, hash);
        for (uint64_t word; (word = pool->brick_slots.words[at]) != EMPTY; at = (at + 1) & last) {
            const uint32_t number = umb__slot_number(word);
            if (umb__slot_fits(word, hash) &&
                memcmp(pool->bricks[number], slices, sizeof *pool->bricks) == 0) {
                *ref = number;
                return UMB_OK;
            }
        }
    }
    return brick_add(pool, slices, hash, ref, error);
}

/* The same in a loose pool: looks at one place. */
static enum umb_status find_late_brick(struct umb_pool *pool, const uint64_t slices[8],
                                       uint32_t *ref, struct umb_error *error)
{
    const uint64_t hash = umb__brick_hash(pool, slices);
    if (pool->brick_slots.words != NULL) {
        uint64_t *word = pool->brick_slots.words + umb__slot_place(&pool->brick_slots, hash);
        const uint32_t number = umb__slot_number(*word);
        if (umb__slot_fits(*word, hash) && *word != EMPTY &&
            memcmp(pool->bricks[number], slices, sizeof *pool->bricks) == 0) {
            *ref = number;
            return UMB_OK;
        }
        if (pool->brick_count < pool->brick_capacity) {
            *ref = pool->brick_count++;
            memcpy(pool->bricks[*ref], slices, sizeof *pool->bricks);
            *word = umb__slot_word(hash, *ref);
            return UMB_OK;
        }
    }
    return brick_add(pool, slices, hash, ref, error);
}

enum umb_status umb_pool_brick(struct umb_pool *pool, const uint64_t slices[8], uint32_t *ref,
                               struct umb_error *error)
{
    const uint64_t any = (slices[0] | slices[1] | slices[2] | slices[3]) |
                         (slices[4] | slices[5] | slices[6] | slices[7]);
    const uint64_t all = (slices[0] & slices[1] & slices[2] & slices[3]) &
                         (slices[4] & slices[5] & slices[6] & slices[7]);
    if (any == 0 || all == UINT64_MAX) {
        *ref = any == 0 ? UMB_REF_SHADOWED : UMB_REF_LIT;
        return UMB_OK;
    }
    return pool->is_loose
               ? find_late_brick(pool, slices, ref, error)
               : umb__pool_find_brick(pool, slices, umb__brick_hash(pool, slices), ref, error);
}

uint64_t umb__key_hash(const struct umb_pool *pool, const struct umb__node_key *key)
{
    /* Never above 8, which gcc -O3 does not see: it warns of reads beyond the words. */
    const size_t children = key->child_count < 8 ? key->child_count : 8;
    return XXH3_64bits_withSeed(key->words, (1 + children) * sizeof key->words[0], pool->seed);
}

void umb__key_from_children(const uint32_t children[8], struct umb__node_key *key)
{
    uint32_t mask = 0, count = 0;
    for (unsigned c = 0; c < 8; c++) {
        const enum umb_node_state state = umb_ref_state(children[c]);
        if (state == UMB_NODE_MIXED) {
            key->words[++count] = children[c];
        }
        mask |= (uint32_t)state << (2 * c);
    }
    key->words[0] = mask;
    key->child_count = count;
}

static int node_equals(const struct umb_pool_level *level, uint32_t node,
                       const struct umb__node_key *key)
{
    /* Equal masks have equally many mixed children. */
    return level->masks[node] == key->words[0] &&
           memcmp(level->children + level->first[node], key->words + 1,
                  key->child_count * sizeof key->words[0]) == 0;
}

static enum umb_status nodes_grow(struct umb_pool *pool, struct umb_pool_level *level,
                                  struct umb_error *error)
{
    const uint32_t capacity = grown(
        pool, level->capacity, sizeof *level->masks + sizeof *level->first, UMB_REF_INDEX_MAX + 1U);
    void *block = level->masks;
    enum umb_status status =
        grow(pool, &block, sizeof *level->masks, level->capacity, capacity, error);
    level->masks = block;
    if (status != UMB_OK) {
        return status;
    }
    block = level->first;
    const size_t old = level->first == NULL ? 0 : (size_t)level->capacity + 1;
    status = grow(pool, &block, sizeof *level->first, old, (size_t)capacity + 1, error);
    level->first = block;
    if (status != UMB_OK) {
        /* The masks keep their larger block; only their charge goes back to what is recorded. */
        pool->bytes -= (size_t)(capacity - level->capacity) * sizeof *level->masks;
        return status;
    }
    if (level->capacity == 0) {
        level->first[0] = 0;
    }
    level->capacity = capacity;
    return UMB_OK;
}

/* Makes room for one more node of up to eight children. */
static enum umb_status node_reserve(struct umb_pool *pool, struct umb_pool_level *level,
                                    struct umb_error *error)
{
    enum umb_status status;
    if (level->count > UMB_REF_INDEX_MAX || level->child_count > UINT32_MAX - 8U) {
        return umb_fail(error, UMB_E_LIMIT,
                        "shadow octree: more than %u nodes or children in one "
                        "level",
                        UMB_REF_INDEX_MAX);
    }
    if (level->count == level->capacity) {
        status = nodes_grow(pool, level, error);
        if (status != UMB_OK) {
            return status;
        }
    }
    if (level->child_capacity - level->child_count < 8) {
        const uint32_t capacity =
            grown(pool, level->child_capacity, sizeof *level->children, UINT32_MAX);
        void *block = level->children;
        status =
            grow(pool, &block, sizeof *level->children, level->child_capacity, capacity, error);
        level->children = block;
        if (status != UMB_OK) {
            return status;
        }
        level->child_capacity = capacity;
    }
    return UMB_OK;
}

/* Adds a node that is not there, or need not be looked for. There is room for it. */
static uint32_t node_add(struct umb_pool_level *level, const struct umb__node_key *key)
{
    const uint32_t number = level->count++;
    level->masks[number] = (uint16_t)key->words[0];
    memcpy(level->children + level->child_count, key->words + 1,
           key->child_count * sizeof key->words[0]);
    level->child_count += key->child_count;
    level->first[number + 1] = level->child_count;
    return number;
}

enum umb_status umb__pool_find_node(struct umb_pool *pool, uint32_t level_number,
                                    const struct umb__node_key *key, uint64_t hash, uint32_t *ref,
                                    struct umb_error *error)
{
    struct umb_pool_level *level = &pool->level[level_number];
    if (level->slots.words != NULL) {
        const size_t last = ((size_t)1 << level->slots.log2_size) - 1;
        size_t at = umb__slot_place(&level->slots, hash);
        for (uint64_t word; (word = level->slots.words[at]) != EMPTY; at = (at + 1) & last) {
            const uint32_t number = umb__slot_number(word);
            if (umb__slot_fits(word, hash) && node_equals(level, number, key)) {
                *ref = number;
                return UMB_OK;
            }
        }
    }
    enum umb_status status = node_reserve(pool, level, error);
    if (status == UMB_OK && slots_full(pool, &level->slots, level->count)) {
        status = slots_grow(pool, &level->slots, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    *ref = node_add(level, key);
    slots_put(&level->slots, umb__slot_word(hash, *ref));
    return UMB_OK;
}

/* The same in a loose pool: never looks. */
static enum umb_status add_late_node(struct umb_pool *pool, uint32_t level_number,
                                     const struct umb__node_key *key, uint32_t *ref,
                                     struct umb_error *error)
{
    struct umb_pool_level *level = &pool->level[level_number];
    if (level->count == level->capacity || level->child_capacity - level->child_count < 8) {
        const enum umb_status status = node_reserve(pool, level, error);
        if (status != UMB_OK) {
            return status;
        }
    }
    *ref = node_add(level, key);
    return UMB_OK;
}

enum umb_status umb_pool_node(struct umb_pool *pool, uint32_t level_number,
                              const uint32_t children[8], uint32_t *ref, struct umb_error *error)
{
    struct umb__node_key key;
    umb__key_from_children(children, &key);
    if (key.words[0] == 0 || key.words[0] == 0x5555) { /* all shadowed, all lit */
        *ref = key.words[0] == 0 ? UMB_REF_SHADOWED : UMB_REF_LIT;
        return UMB_OK;
    }
    return pool->is_loose ? add_late_node(pool, level_number, &key, ref, error)
                          : umb__pool_find_node(pool, level_number, &key, umb__key_hash(pool, &key),
                                                ref, error);
}

enum umb_status umb_pool_take(struct umb_pool *pool, const uint32_t *refs, const uint32_t *levels,
                              uint32_t root_count, struct umb_octree *octree,
                              struct umb_error *error)
{
    memset(octree, 0, sizeof *octree);
    octree->alloc = pool->alloc;
    octree->roots = umb__alloc_zeroed(pool->alloc, root_count, sizeof *octree->roots);
    if (octree->roots == NULL) {
        umb_pool_finish(pool);
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: memory for the roots refused");
    }
    octree->root_count = root_count;
    for (uint32_t i = 0; i < root_count; i++) {
        struct umb_octree_root *root = &octree->roots[i];
        root->level = levels[i];
        root->state = umb_ref_state(refs[i]);
        root->index = root->state == UMB_NODE_MIXED ? refs[i] : 0;
    }
    octree->brick_count = pool->brick_count;
    octree->bricks = pool->bricks;
    pool->bricks = NULL;
    for (uint32_t i = UMB_LEVEL_BRICK + 1; i <= UMB_LEVEL_MAX; i++) {
        struct umb_pool_level *from = &pool->level[i];
        octree->level[i] = (struct umb_octree_level){
            .count = from->count,
            .masks = from->masks,
            .first = from->first,
            .children = from->children,
        };
        from->masks = NULL;
        from->first = NULL;
        from->children = NULL;
    }
    umb_pool_finish(pool);
    return UMB_OK;
}
