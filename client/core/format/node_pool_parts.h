/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_NODE_POOL_PARTS_H
#define UMBRAGE_CORE_FORMAT_NODE_POOL_PARTS_H
/*
 * Tags, keys and slots, shared by node_pool.c, node_pool_merge.c and pack_read.c.
 *
 * A tag is a hash of 32 bits. The high bits of the tag give the place in a table of any size. A
 * slot is one 64-bit word: the tag in the high half, the number plus one in the low half. So a
 * table can grow from its words alone. The low bits of the tag (7 of 32 in a table of 2^25 slots)
 * tell most keys apart that belong in the same slot. Probing is linear, up to an empty slot.
 *
 * Tags are keyed with secrets of the process. Otherwise a hostile file could hold bricks that all
 * have one tag, and each would be compared with all bricks before it. The hash of a node is a sum
 * of its words times secret keys. The hash of a brick is a sum of products of two words, with a
 * secret key added to each word. The hashes of any two inputs are equal with a probability near
 * 2^-32. Numbers do not depend on the keys.
 * Source: Lemire and Kaser, "Strongly universal string hashing is fast", 2014 (Multilinear and
 * Multilinear-HM).
 */
#include "format/node_pool.h"

#define UMB__SLOT_EMPTY UINT64_C(0) /* Zero, as fresh pages are */

/* Returns the first slot of a tag's probe sequence. In: slots: a table; its log2_size is 0 while it
 * has no slots. */
static inline size_t umb__slot_place(const struct umb__hash_slots *slots, uint32_t tag)
{
    return (size_t)(((uint64_t)tag << slots->log2_size) >> 32);
}

static inline size_t umb__slot_after(const struct umb__hash_slots *slots, size_t place)
{
    return (place + 1) & (((size_t)1 << slots->log2_size) - 1);
}

static inline uint64_t umb__slot_word(uint32_t tag, uint32_t number)
{
    return (uint64_t)tag << 32 | (number + 1U);
}

static inline uint32_t umb__slot_tag(uint64_t word)
{
    return (uint32_t)(word >> 32);
}

/* Returns the number in a word. In: word: not empty. */
static inline uint32_t umb__slot_number(uint64_t word)
{
    return (uint32_t)word - 1U;
}

/* Returns the first empty slot on a tag's probe sequence. */
static inline size_t umb__slot_free(const struct umb__hash_slots *slots, uint32_t tag)
{
    size_t place = umb__slot_place(slots, tag);
    while (slots->words[place] != UMB__SLOT_EMPTY) {
        place = umb__slot_after(slots, place);
    }
    return place;
}

/* Returns the first slot of a tag's probe sequence that holds this tag or is empty. */
static inline size_t umb__slot_like(const struct umb__hash_slots *slots, uint32_t tag)
{
    size_t place = umb__slot_place(slots, tag);
    uint64_t word;
    while ((word = slots->words[place]) != UMB__SLOT_EMPTY && umb__slot_tag(word) != tag) {
        place = umb__slot_after(slots, place);
    }
    return place;
}

/* The content of a node: its mask and its mixed children. */
struct umb__node_key {
    uint32_t words[9]; /* Mask, then the children, then zeros */
    uint32_t child_count;
};

/* Makes a tag from a sum of products. Low bits of such a sum depend on less of the input, so the
 * high bits are mixed into them. */
static inline uint32_t umb__sum_tag(uint64_t sum)
{
    return (uint32_t)(((sum ^ sum >> 32) * UINT64_C(0x9e3779b97f4a7c15)) >> 32);
}

/* Returns the product of the two halves of a pair, after a key was added to each half. */
static inline uint64_t umb__pair_product(uint64_t pair, const uint64_t keys[2])
{
    return ((uint32_t)pair + keys[0]) * ((pair >> 32) + keys[1]);
}

static inline uint32_t umb__brick_tag(const struct umb__pool *pool, const uint64_t slices[8])
{
    const uint64_t *keys = pool->keys;
    const uint64_t a = umb__pair_product(slices[0], keys) + umb__pair_product(slices[1], keys + 2);
    const uint64_t b =
        umb__pair_product(slices[2], keys + 4) + umb__pair_product(slices[3], keys + 6);
    const uint64_t c =
        umb__pair_product(slices[4], keys + 8) + umb__pair_product(slices[5], keys + 10);
    const uint64_t d =
        umb__pair_product(slices[6], keys + 12) + umb__pair_product(slices[7], keys + 14);
    return umb__sum_tag((a + b) + (c + d));
}

static inline uint32_t umb__key_tag(const struct umb__pool *pool, const struct umb__node_key *key)
{
    const uint64_t *keys = pool->keys;
    const uint32_t *words = key->words;
    const uint64_t sum = (words[0] * keys[0] + words[1] * keys[1] + words[2] * keys[2]) +
                         (words[3] * keys[3] + words[4] * keys[4] + words[5] * keys[5]) +
                         (words[6] * keys[6] + words[7] * keys[7] + words[8] * keys[8]);
    return umb__sum_tag(sum);
}

static inline int umb__brick_equals(const uint64_t a[8], const uint64_t b[8])
{
    return (((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]) | (a[3] ^ b[3])) |
            ((a[4] ^ b[4]) | (a[5] ^ b[5]) | (a[6] ^ b[6]) | (a[7] ^ b[7]))) == 0;
}

static inline int umb__node_equals(const struct umb__pool_level *level, uint32_t node,
                                   const struct umb__node_key *key)
{
    if (level->masks[node] != key->words[0]) {
        return 0;
    }
    /* Equal masks have equally many mixed children. */
    const uint32_t *children = level->children + level->first[node];
    uint32_t differing = 0;
    for (uint32_t c = 0; c < key->child_count; c++) {
        differing |= children[c] ^ key->words[1 + c];
    }
    return differing == 0;
}

/* Makes the key of a node from its eight children. */
void umb__key_from_children(const uint32_t children[8], struct umb__node_key *key);

/*
 * Find or add a brick or node that is not uniform. Not for loose pools. In: place: slot on the
 * tag's probe sequence, with nothing equal before it. Fails: as umb__pool_brick.
 */
UMB_CHECKED enum umb_status umb__pool_brick_from(struct umb__pool *pool, const uint64_t slices[8],
                                                 uint32_t tag, size_t place, uint32_t *ref,
                                                 struct umb_error *error);
UMB_CHECKED enum umb_status umb__pool_node_from(struct umb__pool *pool, uint32_t level,
                                                const struct umb__node_key *key, uint32_t tag,
                                                size_t place, uint32_t *ref,
                                                struct umb_error *error);

/* Makes room for so many nodes of a level, or bricks, and their children. In: pool: not a loose
 * one. Fails: as umb__pool_brick. */
UMB_CHECKED enum umb_status umb__pool_reserve(struct umb__pool *pool, uint32_t level,
                                              uint32_t nodes, uint32_t children,
                                              struct umb_error *error);

/* Number of nodes or bricks that are looked up together. */
#define UMB__POOL_GROUP 32U

/* A group of bricks, or of nodes of one level. The caller sets the count, and bricks or keys. */
struct umb__pool_group {
    uint32_t count; /* At most UMB__POOL_GROUP */
    const uint64_t (*bricks)[8];
    struct umb__node_key keys[UMB__POOL_GROUP];
    uint32_t tags[UMB__POOL_GROUP];
    size_t places[UMB__POOL_GROUP];
    uint32_t log2_size; /* Size of the table for which `places` hold */
};

/*
 * Finds or adds a group. Each step prefetches the memory that a later step reads.
 * Out: refs: uint32[group->count]. Fails: as umb__pool_brick.
 */
UMB_CHECKED enum umb_status umb__pool_find(struct umb__pool *pool, uint32_t level,
                                           struct umb__pool_group *group, uint32_t *refs,
                                           struct umb_error *error);

#endif
