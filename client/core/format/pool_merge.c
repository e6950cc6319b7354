/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One pool added to another, from the bricks up.
 *
 * In a large pool nearly every look-up waits for memory, first for its slot, then for the key that
 * the slot names. Here all keys are known beforehand: they are taken in groups, and each step asks
 * for the lines that a later one reads. Between asking for a group's lines and reading them the
 * next group's keys are hashed and its slots asked for.
 */
#include <string.h>

#include "base/memory.h"
#include "format/node_pool_parts.h"

#define GROUP  UMB__POOL_GROUP
#define NOBODY UINT32_MAX

/* Asks for the line that a look-up begins with. */
static void slot_ahead(const struct umb_hash_slots *slots, uint64_t hash)
{
    if (slots->words != NULL) {
        __builtin_prefetch(slots->words + umb__slot_place(slots, hash));
    }
}

/* The first number with the hash's tag on its way, NOBODY if an empty slot comes before. */
static uint32_t slot_number(const struct umb_hash_slots *slots, uint64_t hash)
{
    if (slots->words == NULL) {
        return NOBODY;
    }
    const size_t last = ((size_t)1 << slots->log2_size) - 1;
    size_t at = umb__slot_place(slots, hash);
    for (uint64_t word; (word = slots->words[at]) != UMB__SLOT_EMPTY; at = (at + 1) & last) {
        if (umb__slot_fits(word, hash)) {
            return umb__slot_number(word);
        }
    }
    return NOBODY;
}

/* A group of bricks on its way. */
struct brick_group {
    const uint64_t (*bricks)[8];
    uint32_t count;
    uint64_t hashes[GROUP];
    uint32_t numbers[GROUP]; /* of those that may be equal, NOBODY without one */
};

/* The first bricks of many as a group, none if there are none; asks for their slots. */
static void brick_slots_ahead(const struct umb_pool *pool, const uint64_t (*bricks)[8],
                              uint32_t count, struct brick_group *group)
{
    group->bricks = bricks;
    group->count = count < GROUP ? count : GROUP;
    for (uint32_t i = 0; i < group->count; i++) {
        group->hashes[i] = umb__brick_hash(pool, bricks[i]);
        slot_ahead(&pool->brick_slots, group->hashes[i]);
    }
}

/* Reads the group's slots; asks for the bricks that they name. */
static void bricks_ahead(const struct umb_pool *pool, struct brick_group *group)
{
    for (uint32_t i = 0; i < group->count; i++) {
        group->numbers[i] = slot_number(&pool->brick_slots, group->hashes[i]);
        if (group->numbers[i] != NOBODY) {
            __builtin_prefetch(pool->bricks[group->numbers[i]]);
        }
    }
}

static enum umb_status find_bricks(struct umb_pool *pool, const struct brick_group *group,
                                   uint32_t *refs, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < group->count && status == UMB_OK; i++) {
        const uint32_t number = group->numbers[i];
        if (number != NOBODY &&
            memcmp(pool->bricks[number], group->bricks[i], sizeof *group->bricks) == 0) {
            refs[i] = number;
            continue;
        }
        status = umb__pool_find_brick(pool, group->bricks[i], group->hashes[i], &refs[i], error);
    }
    return status;
}

enum umb_status umb__pool_find_bricks(struct umb_pool *pool, const uint64_t (*bricks)[8],
                                      uint32_t count, uint32_t *refs, struct umb_error *error)
{
    struct brick_group groups[2]; /* one found, the next asked for */
    enum umb_status status = UMB_OK;
    brick_slots_ahead(pool, bricks, count, &groups[0]);
    for (uint32_t first = 0, turn = 0; first < count && status == UMB_OK; turn ^= 1) {
        struct brick_group *group = &groups[turn];
        const uint32_t next = first + group->count;
        bricks_ahead(pool, group);
        brick_slots_ahead(pool, bricks + next, count - next, &groups[turn ^ 1]);
        status = find_bricks(pool, group, refs + first, error);
        first = next;
    }
    return status;
}

/* Asks for the slots of a group of nodes. */
static void node_slots_ahead(const struct umb_pool *pool, uint32_t level,
                             struct umb__node_group *group, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        group->hashes[i] = umb__key_hash(pool, &group->keys[i]);
        slot_ahead(&pool->level[level].slots, group->hashes[i]);
    }
}

/* Reads the group's slots; asks for the nodes that they name. */
static void nodes_ahead(const struct umb_pool *pool, uint32_t number, struct umb__node_group *group,
                        uint32_t count)
{
    const struct umb_pool_level *level = &pool->level[number];
    for (uint32_t i = 0; i < count; i++) {
        group->numbers[i] = slot_number(&level->slots, group->hashes[i]);
        if (group->numbers[i] != NOBODY) {
            __builtin_prefetch(level->masks + group->numbers[i]);
            __builtin_prefetch(level->first + group->numbers[i]);
        }
    }
}

/* Asks for their children. */
static void children_ahead(const struct umb_pool *pool, uint32_t number,
                           const struct umb__node_group *group, uint32_t count)
{
    const struct umb_pool_level *level = &pool->level[number];
    for (uint32_t i = 0; i < count; i++) {
        if (group->numbers[i] != NOBODY) {
            __builtin_prefetch(level->children + level->first[group->numbers[i]]);
        }
    }
}

static enum umb_status find_nodes(struct umb_pool *pool, uint32_t level,
                                  const struct umb__node_group *group, uint32_t count,
                                  uint32_t *refs, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        status =
            umb__pool_find_node(pool, level, &group->keys[i], group->hashes[i], &refs[i], error);
    }
    return status;
}

enum umb_status umb__pool_find_nodes(struct umb_pool *pool, uint32_t level,
                                     struct umb__node_group *group, uint32_t count, uint32_t *refs,
                                     struct umb_error *error)
{
    node_slots_ahead(pool, level, group, count);
    nodes_ahead(pool, level, group, count);
    children_ahead(pool, level, group, count);
    return find_nodes(pool, level, group, count, refs, error);
}

/* Keys with the children's new numbers. */
static void read_keys(const struct umb_pool_level *from, uint32_t first, uint32_t n,
                      const uint32_t *below, struct umb__node_group *group)
{
    for (uint32_t i = 0; i < n; i++) {
        struct umb__node_key *key = &group->keys[i];
        const uint32_t *children = from->children + from->first[first + i];
        key->words[0] = from->masks[first + i];
        key->child_count = from->first[first + i + 1] - from->first[first + i];
        for (uint32_t c = 0; c < key->child_count; c++) {
            key->words[1 + c] = below[children[c]];
        }
    }
}

/* In: below: new numbers of the level below. */
static enum umb_status merge_nodes(struct umb_pool *pool, const struct umb_pool *from,
                                   uint32_t level, struct umb_pool_numbers *numbers,
                                   struct umb_error *error)
{
    const struct umb_pool_level *nodes = &from->level[level];
    struct umb__node_group groups[2]; /* one found, the next asked for */
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

static void swap_numbers(struct umb_pool_numbers *numbers)
{
    *numbers = (struct umb_pool_numbers){
        .refs = numbers->below,
        .below = numbers->refs,
        .refs_capacity = numbers->below_capacity,
        .below_capacity = numbers->refs_capacity,
    };
}

enum umb_status umb_pool_merge(struct umb_pool *pool, const struct umb_pool *from, uint32_t level,
                               struct umb_pool_numbers *numbers, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (uint32_t i = UMB_LEVEL_BRICK; i <= level && status == UMB_OK; i++) {
        const size_t count = i == UMB_LEVEL_BRICK ? from->brick_count : from->level[i].count;
        swap_numbers(numbers);
        if (!umb__grow(NULL, &numbers->refs, &numbers->refs_capacity, count,
                       sizeof *numbers->refs)) {
            return umb_fail(error, UMB_E_NO_MEMORY, "shadow octree: %zu numbers refused", count);
        }
        status = i == UMB_LEVEL_BRICK
                     ? umb__pool_find_bricks(pool, (const uint64_t(*)[8])from->bricks,
                                             from->brick_count, numbers->refs, error)
                     : merge_nodes(pool, from, i, numbers, error);
    }
    return status;
}

void umb_pool_numbers_finish(struct umb_pool_numbers *numbers)
{
    umb__free(NULL, numbers->refs);
    umb__free(NULL, numbers->below);
    *numbers = (struct umb_pool_numbers){0};
}
