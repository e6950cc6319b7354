/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and adds bricks and nodes in a pool, one at a time, so that equal ones exist once a level
 * (hash-consing). The file also turns a pool into an octree. */
#define XXH_INLINE_ALL
#include "format/node_pool_parts.h"

#include <string.h>
#include <sys/auxv.h>
#include <xxhash.h>

#include "base/memory.h"
#include "base/try.h"

#define EMPTY UMB__SLOT_EMPTY

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
    umb__free(pool->alloc, pool->brick_slots.words);
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
    slots_clear(&pool->brick_slots);
    pool->brick_count = 0;
    for (uint32_t i = 0; i <= UMB_LEVEL_MAX; i++) {
        struct umb__pool_level *level = &pool->level[i];
        if (level->count > 0) {
            slots_clear(&level->slots);
        }
        level->count = level->child_count = 0;
    }
}

enum umb_status umb__pool_brick_from(struct umb__pool *pool, const uint64_t slices[8], uint32_t tag,
                                     size_t place, uint32_t *ref, struct umb_error *error)
{
    struct umb__hash_slots *slots = &pool->brick_slots;
    const uint32_t log2_size = slots->log2_size;
    uint64_t word = slots->words == NULL ? EMPTY : slots->words[place];
    while (word != EMPTY) {
        const uint32_t number = umb__slot_number(word);
        if (umb__slot_tag(word) == tag && umb__brick_equals(pool->bricks[number], slices)) {
            *ref = number;
            return UMB_OK;
        }
        place = umb__slot_after(slots, place);
        word = slots->words[place];
    }
    UMB__TRY(umb__pool_brick_room(pool, error));
    if (slots->log2_size != log2_size) {
        place = umb__slot_free(slots, tag);
    }
    *ref = pool->brick_count++;
    memcpy(pool->bricks[*ref], slices, sizeof *pool->bricks);
    slots->words[place] = umb__slot_word(tag, *ref);
    return UMB_OK;
}

/* Finds or adds a brick in a loose pool: a look-up reads one slot only. */
static enum umb_status find_loose_brick(struct umb__pool *pool, const uint64_t slices[8],
                                        uint32_t *ref, struct umb_error *error)
{
    const uint32_t tag = umb__brick_tag(pool, slices);
    if (pool->brick_count == pool->brick_capacity) {
        UMB__TRY(umb__pool_brick_room(pool, error));
    }
    uint64_t *word = pool->brick_slots.words + umb__slot_place(&pool->brick_slots, tag);
    const uint32_t number = umb__slot_number(*word);
    if (umb__slot_tag(*word) == tag && *word != EMPTY &&
        umb__brick_equals(pool->bricks[number], slices)) {
        *ref = number;
        return UMB_OK;
    }
    *ref = pool->brick_count++;
    memcpy(pool->bricks[*ref], slices, sizeof *pool->bricks);
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
    const size_t place = umb__slot_place(&pool->brick_slots, tag);
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

enum umb_status umb__pool_node_from(struct umb__pool *pool, uint32_t level_number,
                                    const struct umb__node_key *key, uint32_t tag, size_t place,
                                    uint32_t *ref, struct umb_error *error)
{
    struct umb__pool_level *level = &pool->level[level_number];
    struct umb__hash_slots *slots = &level->slots;
    const uint32_t log2_size = slots->log2_size;
    uint64_t word = slots->words == NULL ? EMPTY : slots->words[place];
    while (word != EMPTY) {
        const uint32_t number = umb__slot_number(word);
        if (umb__slot_tag(word) == tag && umb__node_equals(level, number, key)) {
            *ref = number;
            return UMB_OK;
        }
        place = umb__slot_after(slots, place);
        word = slots->words[place];
    }
    UMB__TRY(umb__pool_node_room(pool, level, error));
    if (slots->log2_size != log2_size) {
        place = umb__slot_free(slots, tag);
    }
    *ref = node_add(level, key);
    slots->words[place] = umb__slot_word(tag, *ref);
    return UMB_OK;
}

/* Adds a node to a loose pool, without a look-up. */
static enum umb_status add_loose_node(struct umb__pool *pool, uint32_t level_number,
                                      const struct umb__node_key *key, uint32_t *ref,
                                      struct umb_error *error)
{
    struct umb__pool_level *level = &pool->level[level_number];
    if (level->count == level->capacity || level->child_capacity - level->child_count < 8) {
        UMB__TRY(umb__pool_node_room(pool, level, error));
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

void umb__octree_finish(struct umb__octree *octree)
{
    const struct umb_alloc *alloc = octree->alloc;
    umb__free(alloc, octree->bricks);
    umb__free(alloc, octree->roots);
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(alloc, octree->level[level].masks);
        umb__free(alloc, octree->level[level].first);
        umb__free(alloc, octree->level[level].children);
    }
    memset(octree, 0, sizeof *octree);
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
    octree->brick_count = pool->brick_count;
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
