/* SPDX-License-Identifier: Apache-2.0 */
/* See intern.h. Open addressing with linear probing, at most two thirds full. */
#include "format/intern.h"

#include <stdbool.h>
#include <string.h>
#include <xxhash.h>

#include "base/memory.h"

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "building: out of memory");
}

void umb_intern_init(struct umb_intern *intern, const struct umb_alloc *alloc)
{
    memset(intern, 0, sizeof *intern);
    intern->octree.alloc = alloc;
}

void umb_intern_finish(struct umb_intern *intern)
{
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(intern->octree.alloc, intern->tables[level].slots);
        umb__free(intern->octree.alloc, intern->tables[level].tags);
    }
    umb_octree_finish(&intern->octree);
    memset(intern, 0, sizeof *intern);
}

void umb_intern_take(struct umb_intern *intern, struct umb_octree *octree)
{
    *octree = intern->octree;
    memset(&intern->octree, 0, sizeof intern->octree);
    intern->octree.alloc = octree->alloc;
    umb_intern_finish(intern);
}

/* A node as its level stores it. */
struct node_key {
    uint16_t mask;
    uint32_t count;
    uint32_t children[8];
};

static uint64_t hash_node(const struct node_key *key)
{
    return XXH3_64bits_withSeed(key->children, key->count * sizeof key->children[0], key->mask);
}

static void load_node(const struct umb_octree_level *level, uint32_t node, struct node_key *key)
{
    key->mask = level->masks[node];
    key->count = level->first[node + 1] - level->first[node];
    memcpy(key->children, level->children + level->first[node],
           key->count * sizeof key->children[0]);
}

static uint64_t hash_stored(const struct umb_intern *intern, uint32_t level, uint32_t node)
{
    if (level == UMB_LEVEL_BRICK) {
        return XXH3_64bits(intern->octree.bricks[node], 64);
    }
    struct node_key key;
    load_node(&intern->octree.level[level], node, &key);
    return hash_node(&key);
}

static void insert(struct umb_intern_table *table, uint64_t hash, uint32_t number)
{
    size_t slot = (size_t)hash & (table->size - 1);
    while (table->slots[slot]) {
        slot = (slot + 1) & (table->size - 1);
    }
    table->slots[slot] = number + 1;
    table->tags[slot] = (uint32_t)(hash >> 32);
}

/* Makes room for one more entry beside `count`. */
static bool make_room(struct umb_intern *intern, uint32_t level, uint32_t count)
{
    struct umb_intern_table *table = &intern->tables[level];
    if (((size_t)count + 1) * 3 <= table->size * 2) {
        return true;
    }
    const struct umb_alloc *alloc = intern->octree.alloc;
    struct umb_intern_table bigger = {.size = table->size ? table->size * 2 : 1024};
    bigger.slots = umb__alloc_zeroed(alloc, bigger.size, sizeof *bigger.slots);
    bigger.tags = umb__alloc(alloc, bigger.size, sizeof *bigger.tags);
    if (!bigger.slots || !bigger.tags) {
        umb__free(alloc, bigger.slots);
        umb__free(alloc, bigger.tags);
        return false;
    }
    for (uint32_t i = 0; i < count; i++) {
        insert(&bigger, hash_stored(intern, level, i), i);
    }
    umb__free(alloc, table->slots);
    umb__free(alloc, table->tags);
    *table = bigger;
    return true;
}

static enum umb_status full_level(uint32_t level, struct umb_error *error)
{
    return umb_fail(error, UMB_E_TOO_LARGE, "building: level %u has more than %u unique nodes",
                    level, UINT32_MAX - 2);
}

enum umb_status umb_intern_brick(struct umb_intern *intern, const uint64_t brick[8],
                                 struct umb_node_value *value, struct umb_error *error)
{
    struct umb_octree *octree = &intern->octree;
    uint64_t all = brick[0], any = brick[0];
    for (size_t z = 1; z < 8; z++) {
        all &= brick[z];
        any |= brick[z];
    }
    *value = (struct umb_node_value){any == 0 ? UMB_NODE_SHADOWED : UMB_NODE_LIT, 0};
    if (any == 0 || ~all == 0) {
        return UMB_OK;
    }
    value->state = UMB_NODE_MIXED;
    if (octree->brick_count >= UINT32_MAX - 2) {
        return full_level(UMB_LEVEL_BRICK, error);
    }
    if (!make_room(intern, UMB_LEVEL_BRICK, octree->brick_count)) {
        return no_memory(error);
    }
    struct umb_intern_table *table = &intern->tables[UMB_LEVEL_BRICK];
    uint64_t hash = XXH3_64bits(brick, 64);
    for (size_t slot = (size_t)hash & (table->size - 1); table->slots[slot];
         slot = (slot + 1) & (table->size - 1)) {
        uint32_t number = table->slots[slot] - 1;
        if (table->tags[slot] == (uint32_t)(hash >> 32) &&
            memcmp(octree->bricks[number], brick, 64) == 0) {
            value->index = number;
            return UMB_OK;
        }
    }
    if (!umb__grow(octree->alloc, &octree->bricks, &intern->brick_capacity,
                   (size_t)octree->brick_count + 1, sizeof *octree->bricks)) {
        return no_memory(error);
    }
    memcpy(octree->bricks[octree->brick_count], brick, 64);
    insert(table, hash, octree->brick_count);
    value->index = octree->brick_count++;
    return UMB_OK;
}

/* Turns eight values into a key; true if they are one uniform state. */
static bool make_key(const struct umb_node_value children[8], struct node_key *key)
{
    key->mask = 0;
    key->count = 0;
    bool uniform = children[0].state != UMB_NODE_MIXED;
    for (unsigned c = 0; c < 8; c++) {
        key->mask = (uint16_t)(key->mask | (unsigned)children[c].state << (2 * c));
        uniform = uniform && children[c].state == children[0].state;
        if (children[c].state == UMB_NODE_MIXED) {
            key->children[key->count++] = children[c].index;
        }
    }
    return uniform;
}

static bool equal_node(const struct umb_octree_level *level, uint32_t node,
                       const struct node_key *key)
{
    return level->masks[node] == key->mask &&
           memcmp(level->children + level->first[node], key->children,
                  key->count * sizeof key->children[0]) == 0;
}

static enum umb_status append_node(struct umb_intern *intern, uint32_t l,
                                   const struct node_key *key, struct umb_error *error)
{
    struct umb_octree_level *level = &intern->octree.level[l];
    const struct umb_alloc *alloc = intern->octree.alloc;
    size_t count = level->count;
    if (!umb__grow(alloc, &level->masks, &intern->mask_capacity[l], count + 1,
                   sizeof *level->masks) ||
        !umb__grow(alloc, &level->first, &intern->first_capacity[l], count + 2,
                   sizeof *level->first)) {
        return no_memory(error);
    }
    uint32_t first = count ? level->first[count] : 0;
    if (!umb__grow(alloc, &level->children, &intern->child_capacity[l],
                   (size_t)first + 8, sizeof *level->children)) {
        return no_memory(error);
    }
    level->first[count] = first;
    level->first[count + 1] = first + key->count;
    level->masks[count] = key->mask;
    memcpy(level->children + first, key->children, key->count * sizeof key->children[0]);
    level->count++;
    return UMB_OK;
}

enum umb_status umb_intern_node(struct umb_intern *intern, uint32_t l,
                                const struct umb_node_value children[8],
                                struct umb_node_value *value, struct umb_error *error)
{
    struct umb_octree_level *level = &intern->octree.level[l];
    struct node_key key;
    if (make_key(children, &key)) {
        *value = children[0];
        return UMB_OK;
    }
    if (level->count >= UINT32_MAX - 2 ||
        (level->count > 0 && level->first[level->count] > UINT32_MAX - 16)) {
        return full_level(l, error);
    }
    if (!make_room(intern, l, level->count)) {
        return no_memory(error);
    }
    struct umb_intern_table *table = &intern->tables[l];
    uint64_t hash = hash_node(&key);
    value->state = UMB_NODE_MIXED;
    for (size_t slot = (size_t)hash & (table->size - 1); table->slots[slot];
         slot = (slot + 1) & (table->size - 1)) {
        uint32_t number = table->slots[slot] - 1;
        if (table->tags[slot] == (uint32_t)(hash >> 32) && equal_node(level, number, &key)) {
            value->index = number;
            return UMB_OK;
        }
    }
    enum umb_status status = append_node(intern, l, &key, error);
    if (status == UMB_OK) {
        value->index = level->count - 1;
        insert(table, hash, value->index);
    }
    return status;
}
