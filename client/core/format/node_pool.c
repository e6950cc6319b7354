/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and adds bricks and nodes in a pool, one at a time, so that equal ones exist only once in
 * each level (hash-consing). The file also turns a pool into an octree. */
#define XXH_INLINE_ALL
#include "format/node_pool_parts.h"

#include <string.h>
#include <sys/auxv.h>
#include <xxhash.h>

#include "base/memory.h"
#include "base/page_alloc.h"
#include "base/try.h"

/* Returns a hash of the 16 random bytes that the kernel hands each process at its start. */
static uint64_t secret_seed(void)
{
    const void *bytes = (const void *)(uintptr_t)getauxval(AT_RANDOM); /* NULL: none */
    return bytes != NULL ? XXH3_64bits(bytes, 16) : (uint64_t)(uintptr_t)getauxval;
}

void umb__pool_init(struct umb__pool *pool, const struct umb_alloc *alloc, size_t max_bytes)
{
    const uint64_t seed = secret_seed();
    memset(pool, 0, sizeof *pool);
    pool->alloc = alloc;
    pool->max_bytes = max_bytes;
    for (uint64_t i = 0; i < UMB__POOL_KEYS; i++) {
        pool->keys[i] = XXH3_64bits_withSeed(&i, sizeof i, seed);
    }
}

void umb__pool_init_loose(struct umb__pool *pool, const struct umb_alloc *alloc, size_t max_bytes)
{
    umb__pool_init(pool, alloc, max_bytes);
    pool->is_loose = 1;
}

void umb__pool_finish(struct umb__pool *pool)
{
    umb__free(pool->alloc, pool->bricks);
    umb__free(pool->alloc, pool->brick_tags);
    for (uint32_t i = 0; i <= UMB_LEVEL_MAX; i++) {
        umb__free(pool->alloc, pool->level[i].slots.words);
        umb__free(pool->alloc, pool->level[i].masks);
        umb__free(pool->alloc, pool->level[i].first);
        umb__free(pool->alloc, pool->level[i].children);
    }
    memset(pool, 0, sizeof *pool);
}

static void slots_clear(struct umb__hash_slots *slots)
{
    if (slots->words != NULL) {
        memset(slots->words, 0, ((size_t)1 << slots->log2_size) * sizeof *slots->words);
    }
}

void umb__pool_clear(struct umb__pool *pool)
{
    for (uint32_t i = 0; i <= UMB_LEVEL_MAX; i++) {
        struct umb__pool_level *level = &pool->level[i];
        if (level->count > 0) {
            slots_clear(&level->slots);
        }
        level->count = level->child_count = 0;
    }
}

/* --- room ------------------------------------------------------------------------------------- */

/*
 * A pool grows within a budget of bytes. A loose pool (umb__pool_init_loose) has no table for
 * nodes, and a table of fixed size for bricks. A table doubles when it is three quarters full, and
 * an array when it is full. Near the budget, tables fill to seven eighths and arrays grow by an
 * eighth, so that most of the budget can be used. Large arrays always grow by an eighth if the
 * allocator moves pages instead of copying.
 */
#define SLOTS_LOG2_MIN 10U
#define SLOTS_LOG2_MAX 32U /* As many bits as a tag has */
#define ITEMS_MIN      1024U
#define LARGE_BYTES    ((size_t)4 << 20) /* Size from which arrays are worth large pages */

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

/* Grows *array of items from old_count to new_count. During a copy both blocks are charged to the
 * pool's budget. */
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
static int slots_full(const struct umb__pool *pool, const struct umb__pool_level *level)
{
    if (level->slots.words == NULL || pool->is_loose) {
        return level->slots.words == NULL;
    }
    const uint64_t size = (uint64_t)1 << level->slots.log2_size,
                   wanted = (uint64_t)level->count + 1;
    return wanted > size / 4 * 3 &&
           (wanted > size / 8 * 7 || can_afford(pool, 2 * size * sizeof *level->slots.words));
}

/* Replaces a table by one twice as large. Words keep their order, so the new table is filled from
 * its beginning to its end. */
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

static enum umb_status bricks_grow(struct umb__pool *pool, struct umb__pool_level *level,
                                   uint32_t capacity, struct umb_error *error)
{
    const uint32_t old = level->capacity;
    UMB__TRY(grow(pool, &pool->bricks, sizeof *pool->bricks, old, capacity, error));
    if (pool->is_loose) {
        const enum umb_status status =
            grow(pool, &pool->brick_tags, sizeof *pool->brick_tags, old, capacity, error);
        if (status != UMB_OK) { /* The bricks keep their larger block, charged as the old one */
            pool->bytes -= (size_t)(capacity - old) * sizeof *pool->bricks;
            return status;
        }
    }
    level->capacity = capacity;
    return UMB_OK;
}

static enum umb_status brick_room(struct umb__pool *pool, struct umb__pool_level *level,
                                  struct umb_error *error)
{
    if (level->count > UMB__REF_INDEX_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "shadow octree: more than %u unique bricks",
                        UMB__REF_INDEX_MAX);
    }
    if (pool->is_loose && level->slots.words == NULL) {
        /* The table of a loose pool is allocated before its array, since each pool with room for a
         * brick must have a table. */
        UMB__TRY(slots_grow(pool, &level->slots, error));
    }
    if (level->count == level->capacity) {
        const uint32_t capacity =
            grown(pool, level->capacity, sizeof *pool->bricks, UMB__REF_INDEX_MAX + 1U);
        UMB__TRY(bricks_grow(pool, level, capacity, error));
    }
    return slots_full(pool, level) ? slots_grow(pool, &level->slots, error) : UMB_OK;
}

static enum umb_status nodes_grow(struct umb__pool *pool, struct umb__pool_level *level,
                                  uint32_t capacity, struct umb_error *error)
{
    const uint32_t old = level->capacity;
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

static enum umb_status children_grow(struct umb__pool *pool, struct umb__pool_level *level,
                                     uint32_t capacity, struct umb_error *error)
{
    UMB__TRY(grow(pool, &level->children, sizeof *level->children, level->child_capacity, capacity,
                  error));
    level->child_capacity = capacity;
    return UMB_OK;
}

static enum umb_status node_room(struct umb__pool *pool, struct umb__pool_level *level,
                                 struct umb_error *error)
{
    if (level->count > UMB__REF_INDEX_MAX || level->child_count > UINT32_MAX - 8U) {
        return umb_fail(error, UMB_E_LIMIT,
                        "shadow octree: more than %u nodes or children in one level",
                        UMB__REF_INDEX_MAX);
    }
    if (level->count == level->capacity) {
        const size_t bytes = sizeof *level->masks + sizeof *level->first;
        UMB__TRY(nodes_grow(pool, level,
                            grown(pool, level->capacity, bytes, UMB__REF_INDEX_MAX + 1U), error));
    }
    if (level->child_capacity - level->child_count < 8) {
        const uint32_t capacity =
            grown(pool, level->child_capacity, sizeof *level->children, UINT32_MAX);
        UMB__TRY(children_grow(pool, level, capacity, error));
    }
    return !pool->is_loose && slots_full(pool, level) ? slots_grow(pool, &level->slots, error)
                                                      : UMB_OK;
}

enum umb_status umb__pool_reserve(struct umb__pool *pool, uint32_t number, uint32_t nodes,
                                  uint32_t children, struct umb_error *error)
{
    struct umb__pool_level *level = &pool->level[number];
    if (nodes > UMB__REF_INDEX_MAX || children > UINT32_MAX - 8U) {
        return umb_fail(error, UMB_E_LIMIT, "shadow octree: %u nodes, %u children in a level",
                        nodes, children);
    }
    if (nodes > level->capacity) {
        UMB__TRY(number == UMB_LEVEL_BRICK ? bricks_grow(pool, level, nodes, error)
                                           : nodes_grow(pool, level, nodes, error));
    }
    if (number > UMB_LEVEL_BRICK && level->child_capacity < children + 8U) {
        UMB__TRY(children_grow(pool, level, children + 8U, error));
    }
    while (nodes > 0 && (level->slots.words == NULL ||
                         nodes > ((uint64_t)1 << level->slots.log2_size) / 4 * 3)) {
        UMB__TRY(slots_grow(pool, &level->slots, error));
    }
    return UMB_OK;
}

/* --- bricks and nodes ------------------------------------------------------------------------- */

/* Adds a brick without a look-up and returns its number. The pool has room for the brick. */
static uint32_t brick_add(struct umb__pool *pool, const uint64_t slices[8])
{
    const uint32_t number = pool->level[UMB_LEVEL_BRICK].count++;
    memcpy(pool->bricks[number], slices, sizeof *pool->bricks);
    return number;
}

/* Adds a node without a look-up and returns its number. The pool has room for the node. */
static uint32_t node_add(struct umb__pool_level *level, const struct umb__node_key *key)
{
    const uint32_t number = level->count++;
    level->masks[number] = (uint16_t)key->words[0];
    /* Always copies eight children: there is room, and a fixed length is faster than a loop. */
    memcpy(level->children + level->child_count, key->words + 1, 8 * sizeof key->words[0]);
    level->child_count += key->child_count;
    level->first[number + 1] = level->child_count;
    return number;
}

/* Finds or adds a brick of `slices`, or a node of `key` where slices is NULL. Inlined into the two
 * functions below. */
static inline __attribute__((always_inline)) enum umb_status
find_from(struct umb__pool *pool, struct umb__pool_level *level, const uint64_t *slices,
          const struct umb__node_key *key, uint32_t tag, size_t place, uint32_t *ref,
          struct umb_error *error)
{
    struct umb__hash_slots *slots = &level->slots;
    const uint32_t log2_size = slots->log2_size;
    uint64_t word = slots->words == NULL ? UMB__SLOT_EMPTY : slots->words[place];
    while (word != UMB__SLOT_EMPTY) {
        const uint32_t number = umb__slot_number(word);
        if (umb__slot_tag(word) == tag &&
            (slices != NULL ? umb__brick_equals(pool->bricks[number], slices)
                            : umb__node_equals(level, number, key))) {
            *ref = number;
            return UMB_OK;
        }
        place = umb__slot_after(slots, place);
        word = slots->words[place];
    }
    UMB__TRY(slices != NULL ? brick_room(pool, level, error) : node_room(pool, level, error));
    if (slots->log2_size != log2_size) {
        place = umb__slot_free(slots, tag);
    }
    *ref = slices != NULL ? brick_add(pool, slices) : node_add(level, key);
    slots->words[place] = umb__slot_word(tag, *ref);
    return UMB_OK;
}

enum umb_status umb__pool_brick_from(struct umb__pool *pool, const uint64_t slices[8], uint32_t tag,
                                     size_t place, uint32_t *ref, struct umb_error *error)
{
    return find_from(pool, &pool->level[UMB_LEVEL_BRICK], slices, NULL, tag, place, ref, error);
}

enum umb_status umb__pool_node_from(struct umb__pool *pool, uint32_t level,
                                    const struct umb__node_key *key, uint32_t tag, size_t place,
                                    uint32_t *ref, struct umb_error *error)
{
    return find_from(pool, &pool->level[level], NULL, key, tag, place, ref, error);
}

/* Finds or adds a brick in a loose pool: a look-up reads one slot only. */
static enum umb_status find_loose_brick(struct umb__pool *pool, const uint64_t slices[8],
                                        uint32_t *ref, struct umb_error *error)
{
    const uint32_t tag = umb__brick_tag(pool, slices);
    struct umb__pool_level *level = &pool->level[UMB_LEVEL_BRICK];
    if (level->count == level->capacity) {
        UMB__TRY(brick_room(pool, level, error));
    }
    uint64_t *word = level->slots.words + umb__slot_place(&level->slots, tag);
    const uint32_t number = umb__slot_number(*word);
    if (umb__slot_tag(*word) == tag && *word != UMB__SLOT_EMPTY &&
        umb__brick_equals(pool->bricks[number], slices)) {
        *ref = number;
        return UMB_OK;
    }
    *ref = brick_add(pool, slices);
    pool->brick_tags[*ref] = tag;
    *word = umb__slot_word(tag, *ref);
    return UMB_OK;
}

enum umb_status umb__pool_brick(struct umb__pool *pool, const uint64_t slices[8], uint32_t *ref,
                                struct umb_error *error)
{
    const uint64_t any = (slices[0] | slices[1] | slices[2] | slices[3]) |
                         (slices[4] | slices[5] | slices[6] | slices[7]);
    const uint64_t all = (slices[0] & slices[1] & slices[2] & slices[3]) &
                         (slices[4] & slices[5] & slices[6] & slices[7]);
    if (any == 0 || all == UINT64_MAX) {
        *ref = any == 0 ? UMB__REF_SHADOWED : UMB__REF_LIT;
        return UMB_OK;
    }
    if (pool->is_loose) {
        return find_loose_brick(pool, slices, ref, error);
    }
    const uint32_t tag = umb__brick_tag(pool, slices);
    const size_t place = umb__slot_place(&pool->level[UMB_LEVEL_BRICK].slots, tag);
    return umb__pool_brick_from(pool, slices, tag, place, ref, error);
}

void umb__key_from_children(const uint32_t children[8], struct umb__node_key *key)
{
    uint32_t mask = 0, count = 0;
    *key = (struct umb__node_key){0};
    for (unsigned c = 0; c < 8; c++) {
        const enum umb__node_state state = umb__ref_state(children[c]);
        if (state == UMB__NODE_MIXED) {
            key->words[++count] = children[c];
        }
        mask |= (uint32_t)state << (2 * c);
    }
    key->words[0] = mask;
    key->child_count = count;
}

/* Adds a node to a loose pool, without a look-up. */
static enum umb_status add_loose_node(struct umb__pool *pool, uint32_t level_number,
                                      const struct umb__node_key *key, uint32_t *ref,
                                      struct umb_error *error)
{
    struct umb__pool_level *level = &pool->level[level_number];
    if (level->count == level->capacity || level->child_capacity - level->child_count < 8) {
        UMB__TRY(node_room(pool, level, error));
    }
    *ref = node_add(level, key);
    return UMB_OK;
}

enum umb_status umb__pool_node(struct umb__pool *pool, uint32_t level_number,
                               const uint32_t children[8], uint32_t *ref, struct umb_error *error)
{
    struct umb__node_key key;
    umb__key_from_children(children, &key);
    if (key.words[0] == 0 || key.words[0] == 0x5555) { /* All shadowed, or all lit */
        *ref = key.words[0] == 0 ? UMB__REF_SHADOWED : UMB__REF_LIT;
        return UMB_OK;
    }
    if (pool->is_loose) {
        return add_loose_node(pool, level_number, &key, ref, error);
    }
    const uint32_t tag = umb__key_tag(pool, &key);
    const size_t place = umb__slot_place(&pool->level[level_number].slots, tag);
    return umb__pool_node_from(pool, level_number, &key, tag, place, ref, error);
}

enum umb_status umb__pool_take(struct umb__pool *pool, const uint32_t *refs, const uint32_t *levels,
                               uint32_t root_count, struct umb__octree *octree,
                               struct umb_error *error)
{
    memset(octree, 0, sizeof *octree);
    octree->alloc = pool->alloc;
    octree->roots = umb__alloc_zeroed(pool->alloc, root_count, sizeof *octree->roots);
    if (octree->roots == NULL) {
        umb__pool_finish(pool);
        return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: memory for the roots refused");
    }
    octree->root_count = root_count;
    for (uint32_t i = 0; i < root_count; i++) {
        struct umb__octree_root *root = &octree->roots[i];
        root->level = levels[i];
        root->state = umb__ref_state(refs[i]);
        root->index = root->state == UMB__NODE_MIXED ? refs[i] : 0;
    }
    octree->brick_count = pool->level[UMB_LEVEL_BRICK].count;
    octree->bricks = pool->bricks;
    pool->bricks = NULL;
    for (uint32_t i = UMB_LEVEL_BRICK + 1; i <= UMB_LEVEL_MAX; i++) {
        struct umb__pool_level *from = &pool->level[i];
        octree->level[i] = (struct umb__octree_level){
            .count = from->count,
            .masks = from->masks,
            .first = from->first,
            .children = from->children,
        };
        from->masks = NULL;
        from->first = NULL;
        from->children = NULL;
    }
    umb__pool_finish(pool);
    return UMB_OK;
}
