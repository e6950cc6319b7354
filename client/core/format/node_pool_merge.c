/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Adds one pool to another, from the bricks up.
 *
 * In a large pool nearly every look-up waits for memory, first for its slot, then for the brick or
 * node that the slot names. A merge knows all keys beforehand. It takes them in groups, and each
 * step prefetches the cache lines that a later step reads. While the lines of one group arrive, the
 * next group's keys are hashed and its slots prefetched.
 */
#include <stdbool.h>
#include <string.h>

#include "base/memory.h"
#include "format/node_pool_parts.h"

/* Bricks and nodes share the source of the steps below. The steps are inlined with a constant
 * argument `bricks`, so that they do not test it for each item. */
#define STEP static inline __attribute__((always_inline))

/* Returns the number in a slot; 0 for an empty slot, which is harmless to prefetch. */
static uint32_t number_in(const struct umb__hash_slots *slots, size_t place)
{
    const uint64_t word = slots->words[place];
    return word == UMB__SLOT_EMPTY ? 0 : umb__slot_number(word);
}

/* Prefetches the slots that a group's look-ups begin with. In: tags: tags of the group, or NULL. */
STEP void slots_ahead(const struct umb__pool *pool, uint32_t level, bool bricks,
                      const uint32_t *tags, struct umb__pool_group *group)
{
    const struct umb__hash_slots *slots = &pool->level[level].slots;
    for (uint32_t i = 0; i < group->count; i++) {
        group->tags[i] = tags != NULL ? tags[i]
                         : bricks     ? umb__brick_tag(pool, group->bricks[i])
                                      : umb__key_tag(pool, &group->keys[i]);
        if (slots->words != NULL) {
            __builtin_prefetch(slots->words + umb__slot_place(slots, group->tags[i]), 1);
        }
    }
}

/* Reads the group's slots; prefetches the bricks or nodes that they name. */
STEP void items_ahead(const struct umb__pool *pool, uint32_t level, bool bricks,
                      struct umb__pool_group *group)
{
    const struct umb__hash_slots *slots = &pool->level[level].slots;
    group->log2_size = slots->log2_size;
    for (uint32_t i = 0; i < group->count && slots->words != NULL; i++) {
        group->places[i] = umb__slot_like(slots, group->tags[i]);
        const uint32_t number = number_in(slots, group->places[i]);
        if (bricks) {
            __builtin_prefetch(pool->bricks[number]);
        } else {
            __builtin_prefetch(pool->level[level].masks + number);
            __builtin_prefetch(pool->level[level].first + number);
        }
    }
}

/* Prefetches the children of the nodes that the group's slots name. */
static void children_ahead(const struct umb__pool *pool, uint32_t number,
                           const struct umb__pool_group *group)
{
    const struct umb__pool_level *level = &pool->level[number];
    for (uint32_t i = 0; i < group->count && level->slots.words != NULL; i++) {
        const uint32_t node = number_in(&level->slots, group->places[i]);
        __builtin_prefetch(level->children + level->first[node]);
    }
}

STEP enum umb_status find(struct umb__pool *pool, uint32_t level, bool bricks,
                          const struct umb__pool_group *group, uint32_t *refs,
                          struct umb_error *error)
{
    const struct umb__hash_slots *slots = &pool->level[level].slots;
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < group->count && status == UMB_OK; i++) {
        const uint32_t tag = group->tags[i];
        const bool as_read = slots->words != NULL && slots->log2_size == group->log2_size;
        const size_t place = as_read ? group->places[i] : umb__slot_place(slots, tag);
        if (!bricks) {
            status = umb__pool_node_from(pool, level, &group->keys[i], tag, place, &refs[i], error);
            continue;
        }
        const uint64_t word = as_read ? slots->words[place] : UMB__SLOT_EMPTY;
        if (word != UMB__SLOT_EMPTY && umb__slot_tag(word) == tag &&
            umb__brick_equals(pool->bricks[umb__slot_number(word)], group->bricks[i])) {
            refs[i] = umb__slot_number(word); /* Most bricks end here */
            continue;
        }
        status = umb__pool_brick_from(pool, group->bricks[i], tag, place, &refs[i], error);
    }
    return status;
}

STEP enum umb_status find_group(struct umb__pool *pool, uint32_t level, bool bricks,
                                struct umb__pool_group *group, uint32_t *refs,
                                struct umb_error *error)
{
    slots_ahead(pool, level, bricks, NULL, group);
    items_ahead(pool, level, bricks, group);
    if (!bricks) {
        children_ahead(pool, level, group);
    }
    return find(pool, level, bricks, group, refs, error);
}

enum umb_status umb__pool_find(struct umb__pool *pool, uint32_t level,
                               struct umb__pool_group *group, uint32_t *refs,
                               struct umb_error *error)
{
    return level == UMB_LEVEL_BRICK ? find_group(pool, level, true, group, refs, error)
                                    : find_group(pool, level, false, group, refs, error);
}

/* Reads a group, possibly empty, of another pool's bricks or nodes from `first` on. In: below: the
 * new numbers of the level below. */
STEP void read_group(const struct umb__pool *from, uint32_t level, bool bricks, uint32_t first,
                     const uint32_t *below, struct umb__pool_group *group)
{
    const struct umb__pool_level *nodes = &from->level[level];
    const uint32_t left = nodes->count - first;
    group->count = left < UMB__POOL_GROUP ? left : UMB__POOL_GROUP;
    group->bricks = bricks && left > 0 ? (const uint64_t(*)[8])from->bricks + first : NULL;
    for (uint32_t i = 0; i < group->count && !bricks; i++) {
        struct umb__node_key *key = &group->keys[i];
        const uint32_t *children = nodes->children + nodes->first[first + i];
        *key = (struct umb__node_key){.words = {nodes->masks[first + i]}};
        key->child_count = nodes->first[first + i + 1] - nodes->first[first + i];
        for (uint32_t c = 0; c < key->child_count; c++) {
            key->words[1 + c] = below[children[c]];
        }
    }
}

/* Merges the bricks or the nodes of a level. In: numbers: its member `below` has the new references
 * of the level below. */
STEP enum umb_status merge_level(struct umb__pool *pool, const struct umb__pool *from,
                                 uint32_t level, bool bricks, struct umb__pool_numbers *numbers,
                                 struct umb_error *error)
{
    struct umb__pool_group groups[2]; /* One group is found while the next is prefetched */
    const uint32_t *tags = bricks ? from->brick_tags : NULL;
    enum umb_status status = UMB_OK;
    read_group(from, level, bricks, 0, numbers->below, &groups[0]);
    slots_ahead(pool, level, bricks, tags, &groups[0]);
    for (uint32_t first = 0, turn = 0; groups[turn].count > 0 && status == UMB_OK; turn ^= 1) {
        struct umb__pool_group *group = &groups[turn], *next = &groups[turn ^ 1];
        const uint32_t end = first + group->count;
        items_ahead(pool, level, bricks, group);
        read_group(from, level, bricks, end, numbers->below, next);
        if (!bricks) {
            children_ahead(pool, level, group);
        }
        slots_ahead(pool, level, bricks, tags != NULL ? tags + end : NULL, next);
        status = find(pool, level, bricks, group, numbers->refs + first, error);
        first = end;
    }
    return status;
}

static void swap_numbers(struct umb__pool_numbers *numbers)
{
    *numbers = (struct umb__pool_numbers){
        .refs = numbers->below,
        .below = numbers->refs,
        .refs_capacity = numbers->below_capacity,
        .below_capacity = numbers->refs_capacity,
    };
}

enum umb_status umb__pool_merge(struct umb__pool *pool, const struct umb__pool *from,
                                uint32_t level, struct umb__pool_numbers *numbers,
                                struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (uint32_t i = UMB_LEVEL_BRICK; i <= level && status == UMB_OK; i++) {
        const size_t count = from->level[i].count;
        swap_numbers(numbers);
        if (!umb__grow(NULL, &numbers->refs, &numbers->refs_capacity, count,
                       sizeof *numbers->refs)) {
            return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu numbers refused", count);
        }
        status = i == UMB_LEVEL_BRICK ? merge_level(pool, from, i, true, numbers, error)
                                      : merge_level(pool, from, i, false, numbers, error);
    }
    return status;
}

void umb__pool_numbers_finish(struct umb__pool_numbers *numbers)
{
    umb__free(NULL, numbers->refs);
    umb__free(NULL, numbers->below);
    *numbers = (struct umb__pool_numbers){0};
}
