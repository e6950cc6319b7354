/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_NODE_POOL_H
#define UMBRAGE_CORE_FORMAT_NODE_POOL_H
/*
 * The merged octree under construction: equal bricks and equal nodes exist only once in each level.
 *
 *     umb__pool_init(&pool, NULL, max_bytes);
 *     umb__pool_brick(&pool, slices, &ref, &error);            level 3
 *     umb__pool_node(&pool, level, children, &ref, &error);    levels 4..
 *     umb__pool_take(&pool, &root, &level, 1, &octree, &error);   the pool is empty afterwards
 *     umb__pool_finish(&pool);
 *
 * A reference is the number of a node of the level below, or one of the two uniform states. Uniform
 * nodes and bricks are never stored. Equality is decided by the whole content; a hash only says
 * where to look. Numbers follow the order of the calls, but the tree is the same for every order.
 * Threads: one at a time.
 */
#include <stddef.h>
#include <stdint.h>
#include "format/octree.h"
#include "umbrage/status.h"

/* A child: one of the two uniform states below, or the number of a node in the level below. */
#define UMB__REF_LIT       UINT32_MAX
#define UMB__REF_SHADOWED  (UINT32_MAX - 1U)
#define UMB__REF_INDEX_MAX (UINT32_MAX - 2U) /* Largest number of a node or brick */

/* Returns the state that a reference stands for. */
static inline enum umb__node_state umb__ref_state(uint32_t ref)
{
    return ref == UMB__REF_LIT        ? UMB__NODE_LIT
           : ref == UMB__REF_SHADOWED ? UMB__NODE_SHADOWED
                                      : UMB__NODE_MIXED;
}

/* An open-addressing table whose size is a power of two. A word holds a tag and a number plus one;
 * zero is an empty slot. */
struct umb__hash_slots {
    uint64_t *words;
    uint32_t log2_size; /* Logarithm of the number of slots; 0 while words is NULL */
};

struct umb__pool_level {
    struct umb__hash_slots slots;
    uint32_t count, capacity; /* Numbers of nodes: stored, and with room */
    uint32_t child_count, child_capacity;
    uint16_t *masks;
    uint32_t *first; /* [count + 1] */
    uint32_t *children;
};

#define UMB__POOL_KEYS 16U

struct umb__pool {
    const struct umb_alloc *alloc;
    int is_loose;                  /* 1: made by umb__pool_init_loose */
    uint64_t keys[UMB__POOL_KEYS]; /* Secret keys of the hashes, the same in all pools of a
                                      process */
    size_t bytes, max_bytes;       /* Bytes in use, and their limit */
    uint64_t (*bricks)[8];
    uint32_t *brick_tags; /* Tags of a loose pool's bricks, which its merge uses again */
    struct umb__pool_level level[UMB_LEVEL_MAX + 1]; /* Level 3: table and numbers of the bricks */
};

/* Starts an empty pool. In: alloc: NULL = malloc. max_bytes: memory limit; SIZE_MAX for none. */
void umb__pool_init(struct umb__pool *pool, const struct umb_alloc *alloc, size_t max_bytes);
void umb__pool_finish(struct umb__pool *pool);

/*
 * Starts a loose pool, which will be merged into another pool. A loose pool finds an equal brick
 * only among the latest ones, by a table of a fixed size that stays in the L1 cache; older equal
 * bricks are stored again. It never looks for equal nodes, since few nodes have equals nearby.
 */
void umb__pool_init_loose(struct umb__pool *pool, const struct umb_alloc *alloc, size_t max_bytes);

/* Removes all bricks and nodes; keeps the memory for new ones. */
void umb__pool_clear(struct umb__pool *pool);

/*
 * Finds or adds a brick.
 *
 * Out:   ref: number of the brick, or a uniform state if all its voxels are equal.
 * Fails: E_NO_MEMORY, E_LIMIT (max_bytes, or 7/8 of 2^32 bricks). The pool is then unchanged.
 * Cost:  one hash of 64 bytes, and about one cache miss if the brick is in the pool.
 */
UMB_CHECKED enum umb_status umb__pool_brick(struct umb__pool *pool, const uint64_t slices[8],
                                            uint32_t *ref, struct umb_error *error);

/*
 * Finds or adds a node of a level from its eight children (x + 2 * y + 4 * z).
 *
 * Out:   ref: number of the node, or the children's state if all are uniform and equal.
 * Fails: as umb__pool_brick.
 */
UMB_CHECKED enum umb_status umb__pool_node(struct umb__pool *pool, uint32_t level,
                                           const uint32_t children[8], uint32_t *ref,
                                           struct umb_error *error);

/* Map from the numbers of one pool to those of another. Its memory is kept from one merge to the
 * next. Start zeroed. */
struct umb__pool_numbers {
    uint32_t *refs;  /* References of the requested level: [number in the merged pool] */
    uint32_t *below; /* References of the level below: working memory */
    size_t refs_capacity, below_capacity;
};

/*
 * Adds all bricks and nodes of another pool up to a level.
 *
 * In:    pool: not a loose one. from: any pool.
 * Out:   numbers: references of that level, in memory of malloc; free it with
 *        umb__pool_numbers_finish.
 * Fails: as umb__pool_brick. The pool may then hold part of the other.
 * Cost:  linear in the nodes added, at a fraction of the cost of single additions, since memory is
 *        prefetched many look-ups ahead.
 */
UMB_CHECKED enum umb_status umb__pool_merge(struct umb__pool *pool, const struct umb__pool *from,
                                            uint32_t level, struct umb__pool_numbers *numbers,
                                            struct umb_error *error);
void umb__pool_numbers_finish(struct umb__pool_numbers *numbers);

/*
 * Hands the arrays over as an octree.
 *
 * In:    refs, levels: uint32[root_count], the root of each frustum and its level.
 * Out:   octree: canonical if all nodes are reachable from the roots; the caller finishes it.
 * Fails: E_NO_MEMORY. The pool is left empty either way.
 */
UMB_CHECKED enum umb_status umb__pool_take(struct umb__pool *pool, const uint32_t *refs,
                                           const uint32_t *levels, uint32_t root_count,
                                           struct umb__octree *octree, struct umb_error *error);

#endif
