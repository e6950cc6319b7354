/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Adds one pool to another, from the bricks up.
 *
 * In a large pool nearly every look-up waits for memory, first for its slot, then for the brick or
 * node that the slot names. A merge knows all keys beforehand. It takes them in groups, and each
 * step prefetches the cache lines that a later step reads. While the lines of one group arrive, the
 * next group's keys are hashed and its slots prefetched.
 */
#include <string.h>

#include "base/memory.h"
#include "format/node_pool_parts.h"

#define GROUP UMB__POOL_GROUP

/* Prefetches the slot that a look-up begins with, if there is a table. */
static void slot_ahead(const struct umb__hash_slots *slots, uint32_t tag)
{
    if (slots->words != NULL) {
        __builtin_prefetch(slots->words + umb__slot_place(slots, tag), 1);
    }
}

/* Returns the number in a slot; 0 for an empty slot, which is harmless to prefetch. */
static uint32_t number_in(const struct umb__hash_slots *slots, size_t place)
{
    const uint64_t word = slots->words[place];
    return word == UMB__SLOT_EMPTY ? 0 : umb__slot_number(word);
}

/* Bricks to look for, and their tags if they are known. */
struct bricks {
    const uint64_t (*slices)[8];
    const uint32_t *tags; /* [count] or NULL */
    uint32_t count;
};

/* A group of bricks under way. */
struct brick_group {
    const uint64_t (*bricks)[8];
    uint32_t count;
    uint32_t tags[GROUP];
    size_t places[GROUP];
    uint32_t log2_size; /* Size of the table for which `places` hold */
};

/* Starts a group, possibly empty, of the bricks from `first` on; prefetches their slots. */
static void brick_slots_ahead(const struct umb__pool *pool, const struct bricks *from,
                              uint32_t first, struct brick_group *group)
{
    group->count = from->count - first < GROUP ? from->count - first : GROUP;
    group->bricks = group->count > 0 ? from->slices + first : NULL;
    for (uint32_t i = 0; i < group->count; i++) {
        group->tags[i] =
            from->tags != NULL ? from->tags[first + i] : umb__brick_tag(pool, group->bricks[i]);
        slot_ahead(&pool->brick_slots, group->tags[i]);
    }
}

/* Reads the group's slots; prefetches the bricks that they name. */
static void bricks_ahead(const struct umb__pool *pool, struct brick_group *group)
{
    const struct umb__hash_slots *slots = &pool->brick_slots;
    group->log2_size = slots->log2_size;
    for (uint32_t i = 0; i < group->count && slots->words != NULL; i++) {
        group->places[i] = umb__slot_like(slots, group->tags[i]);
        __builtin_prefetch(pool->bricks[number_in(slots, group->places[i])]);
    }
}

static enum umb_status find_bricks(struct umb__pool *pool, const struct brick_group *group,
                                   uint32_t *refs, struct umb_error *error)
{
    const struct umb__hash_slots *slots = &pool->brick_slots;
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < group->count && status == UMB_OK; i++) {
        const uint64_t *slices = group->bricks[i];
        const uint32_t tag = group->tags[i];
        const int as_read = slots->words != NULL && slots->log2_size == group->log2_size;
        const size_t place = as_read ? group->places[i] : umb__slot_place(slots, tag);
        const uint64_t word = as_read ? slots->words[place] : UMB__SLOT_EMPTY;
        if (word != UMB__SLOT_EMPTY && umb__slot_tag(word) == tag &&
            umb__brick_equals(pool->bricks[umb__slot_number(word)], slices)) {
            refs[i] = umb__slot_number(word); /* Most bricks end here */
            continue;
        }
        status = umb__pool_brick_from(pool, slices, tag, place, &refs[i], error);
    }
    return status;
}

static enum umb_status merge_bricks(struct umb__pool *pool, const struct bricks *from,
                                    uint32_t *refs, struct umb_error *error)
{
    struct brick_group groups[2]; /* One group is found while the next is prefetched */
    enum umb_status status = UMB_OK;
    brick_slots_ahead(pool, from, 0, &groups[0]);
    for (uint32_t first = 0, turn = 0; first < from->count && status == UMB_OK; turn ^= 1) {
        struct brick_group *group = &groups[turn];
        const uint32_t next = first + group->count;
        bricks_ahead(pool, group);
        brick_slots_ahead(pool, from, next, &groups[turn ^ 1]);
        status = find_bricks(pool, group, refs + first, error);
        first = next;
    }
    return status;
}

enum umb_status umb__pool_find_bricks(struct umb__pool *pool, const uint64_t (*bricks)[8],
                                      uint32_t count, uint32_t *refs, struct umb_error *error)
{
    const struct bricks from = {bricks, NULL, count};
    return merge_bricks(pool, &from, refs, error);
}

/* Prefetches the slots of a group of nodes. */
static void node_slots_ahead(const struct umb__pool *pool, uint32_t level,
                             struct umb__node_group *group, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        group->tags[i] = umb__key_tag(pool, &group->keys[i]);
        slot_ahead(&pool->level[level].slots, group->tags[i]);
    }
}

/* Reads the group's slots; prefetches the nodes that they name. */
static void nodes_ahead(const struct umb__pool *pool, uint32_t number,
                        struct umb__node_group *group, uint32_t count)
{
    const struct umb__pool_level *level = &pool->level[number];
    group->log2_size = level->slots.log2_size;
    for (uint32_t i = 0; i < count && level->slots.words != NULL; i++) {
        group->places[i] = umb__slot_like(&level->slots, group->tags[i]);
        const uint32_t node = number_in(&level->slots, group->places[i]);
        __builtin_prefetch(level->masks + node);
        __builtin_prefetch(level->first + node);
    }
}

/* Prefetches the children of the nodes that the group's slots name. */
static void children_ahead(const struct umb__pool *pool, uint32_t number,
                           const struct umb__node_group *group, uint32_t count)
{
    const struct umb__pool_level *level = &pool->level[number];
    for (uint32_t i = 0; i < count && level->slots.words != NULL; i++) {
        const uint32_t node = number_in(&level->slots, group->places[i]);
        __builtin_prefetch(level->children + level->first[node]);
    }
}

static enum umb_status find_nodes(struct umb__pool *pool, uint32_t level,
                                  const struct umb__node_group *group, uint32_t count,
                                  uint32_t *refs, struct umb_error *error)
{
    const struct umb__hash_slots *slots = &pool->level[level].slots;
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        const int as_read = slots->words != NULL && slots->log2_size == group->log2_size;
        const size_t place = as_read ? group->places[i] : umb__slot_place(slots, group->tags[i]);
        status = umb__pool_node_from(pool, level, &group->keys[i], group->tags[i], place, &refs[i],
                                     error);
    }
    return status;
}

enum umb_status umb__pool_find_nodes(struct umb__pool *pool, uint32_t level,
                                     struct umb__node_group *group, uint32_t count, uint32_t *refs,
                                     struct umb_error *error)
{
    node_slots_ahead(pool, level, group, count);
    nodes_ahead(pool, level, group, count);
    children_ahead(pool, level, group, count);
    return find_nodes(pool, level, group, count, refs, error);
}

/* Computes the keys of n nodes of another pool. In: below: the new numbers of the level below. */
static void read_keys(const struct umb__pool_level *from, uint32_t first, uint32_t n,
                      const uint32_t *below, struct umb__node_group *group)
{
    for (uint32_t i = 0; i < n; i++) {
        struct umb__node_key *key = &group->keys[i];
        const uint32_t *children = from->children + from->first[first + i];
        *key = (struct umb__node_key){.words = {from->masks[first + i]}};
        key->child_count = from->first[first + i + 1] - from->first[first + i];
        for (uint32_t c = 0; c < key->child_count; c++) {
            key->words[1 + c] = below[children[c]];
        }
    }
}

/* Merges the nodes of a level. In: numbers: its `below` holds the references of the level below. */
static enum umb_status merge_nodes(struct umb__pool *pool, const struct umb__pool *from,
                                   uint32_t level, struct umb__pool_numbers *numbers,
                                   struct umb_error *error)
{
    const struct umb__pool_level *nodes = &from->level[level];
    struct umb__node_group groups[2]; /* One group is found while the next is prefetched */
    enum umb_status status = UMB_OK;
    uint32_t count = nodes->count < GROUP ? nodes->count : GROUP;
    read_keys(nodes, 0, count, numbers->below, &groups[0]);
    node_slots_ahead(pool, level, &groups[0], count);
    for (uint32_t first = 0, turn = 0; count > 0 && status == UMB_OK; turn ^= 1) {
        const uint32_t next = first + count, left = nodes->count - next;
        const uint32_t next_count = left < GROUP ? left : GROUP;
        nodes_ahead(pool, level, &groups[turn], count);
        read_keys(nodes, next, next_count, numbers->below, &groups[turn ^ 1]);
        children_ahead(pool, level, &groups[turn], count);
        node_slots_ahead(pool, level, &groups[turn ^ 1], next_count);
        status = find_nodes(pool, level, &groups[turn], count, numbers->refs + first, error);
        first = next;
        count = next_count;
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
        const struct bricks bricks = {(const uint64_t(*)[8])from->bricks, from->brick_tags,
                                      from->brick_count};
        const size_t count = i == UMB_LEVEL_BRICK ? bricks.count : from->level[i].count;
        swap_numbers(numbers);
        if (!umb__grow(NULL, &numbers->refs, &numbers->refs_capacity, count,
                       sizeof *numbers->refs)) {
            return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu numbers refused", count);
        }
        status = i == UMB_LEVEL_BRICK ? merge_bricks(pool, &bricks, numbers->refs, error)
                                      : merge_nodes(pool, from, i, numbers, error);
    }
    return status;
}

void umb__pool_numbers_finish(struct umb__pool_numbers *numbers)
{
    umb__free(NULL, numbers->refs);
    umb__free(NULL, numbers->below);
    *numbers = (struct umb__pool_numbers){0};
}
