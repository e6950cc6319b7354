/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_NODE_POOL_PARTS_H
#define UMBRAGE_CORE_FORMAT_NODE_POOL_PARTS_H
/*
 * Between node_pool.c and pool_merge.c: hashes, keys and slots.
 *
 * A slot is one 64-bit word, tag above number plus one. The tag is the hash's high half; its first
 * bits give the place, so that a word alone says where it goes in a table of any size, and what is
 * left of them (7 bits of 32 in a table of 2^25 slots) tells words of one place apart. Slots that
 * follow one another are tried in turn until an empty one.
 *
 * Hashes have a seed that nobody outside the process knows: bricks of a stranger's file that all
 * had one hash would each be compared with all before. Numbers do not depend on it.
 */
#include "format/node_pool.h"

#define UMB__SLOT_EMPTY UINT64_C(0) /* as fresh pages are */

/* In: hash: or a slot's word. */
static inline size_t umb__slot_place(const struct umb_hash_slots *slots, uint64_t hash)
{
    return (size_t)(hash >> (64 - slots->log2_size));
}

static inline uint64_t umb__slot_word(uint64_t hash, uint32_t number)
{
    return (hash & 0xffffffff00000000ULL) | (number + 1U);
}

/* In: word: of a slot that is not empty. */
static inline uint32_t umb__slot_number(uint64_t word)
{
    return (uint32_t)word - 1U;
}

/* Whether a slot's word can be that of what has this hash. */
static inline int umb__slot_fits(uint64_t word, uint64_t hash)
{
    return (uint32_t)((word ^ hash) >> 32) == 0;
}

/* A node's key: its mask and its mixed children. */
struct umb__node_key {
    uint32_t words[9]; /* mask, children */
    uint32_t child_count;
};

uint64_t umb__brick_hash(const struct umb_pool *pool, const uint64_t slices[8]);
uint64_t umb__key_hash(const struct umb_pool *pool, const struct umb__node_key *key);

/* In: children: as umb_pool_node takes them. */
void umb__key_from_children(const uint32_t children[8], struct umb__node_key *key);

/* Finds or adds what is not uniform, under its hash; else as umb_pool_brick and umb_pool_node.
 * Not of a loose pool. */
UMB_CHECKED enum umb_status umb__pool_find_brick(struct umb_pool *pool, const uint64_t slices[8],
                                                 uint64_t hash, uint32_t *ref,
                                                 struct umb_error *error);
UMB_CHECKED enum umb_status umb__pool_find_node(struct umb_pool *pool, uint32_t level,
                                                const struct umb__node_key *key, uint64_t hash,
                                                uint32_t *ref, struct umb_error *error);

/* Nodes or bricks that are looked up together. */
#define UMB__POOL_GROUP 32U

/* A group of one level's nodes: the caller sets keys. */
struct umb__node_group {
    struct umb__node_key keys[UMB__POOL_GROUP];
    uint64_t hashes[UMB__POOL_GROUP];
    uint32_t numbers[UMB__POOL_GROUP];
};

/*
 * Find or add bricks, or a group of nodes; each step asks for the memory that a later one reads.
 * In: count: of nodes at most UMB__POOL_GROUP. Out: refs: uint32[count]. Fails: as umb_pool_brick.
 */
UMB_CHECKED enum umb_status umb__pool_find_bricks(struct umb_pool *pool,
                                                  const uint64_t (*bricks)[8], uint32_t count,
                                                  uint32_t *refs, struct umb_error *error);
UMB_CHECKED enum umb_status umb__pool_find_nodes(struct umb_pool *pool, uint32_t level,
                                                 struct umb__node_group *group, uint32_t count,
                                                 uint32_t *refs, struct umb_error *error);

#endif
