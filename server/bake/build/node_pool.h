/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_NODE_POOL_H
#define UMBRAGE_SERVER_BAKE_BUILD_NODE_POOL_H
/*
 * The merged octree under construction: equal bricks and equal nodes exist once a level.
 *
 *     umbb_pool_init(&pool, max_bytes);
 *     umbb_pool_brick(&pool, slices, &ref, &error);            level 3
 *     umbb_pool_node(&pool, level, children, &ref, &error);    levels 4..
 *     umbb_pool_take(&pool, root, level, &octree, &error);     the pool is empty afterwards
 *     umbb_pool_finish(&pool);
 *
 * A reference names a node of the level below or one of the two uniform states. What is uniform
 * is never stored. Keys are compared in full: a hash only says where to look.
 * Numbers follow the order of the calls; what they build does not depend on it.
 * Threads: one at a time.
 */
#include <stddef.h>
#include <stdint.h>
#include "format/octree.h"
#include "umbrage/status.h"

/* A child: one of these two, or the number of a node in the level below. */
#define UMBB_REF_LIT      UINT32_MAX
#define UMBB_REF_SHADOWED (UINT32_MAX - 1U)
#define UMBB_INDEX_MAX    (UINT32_MAX - 2U) /* largest number of a node or brick */

/* An open-addressing table: tag and number in one word; all ones is empty. */
struct umbb_hash_slots {
    uint64_t *words;
    uint32_t log2_size; /* meaningless while words is NULL */
};

struct umbb_pool_level {
    struct umbb_hash_slots slots;
    uint32_t count, capacity; /* nodes */
    uint32_t child_count, child_capacity;
    uint16_t *masks;
    uint32_t *first; /* [count + 1] */
    uint32_t *children;
};

struct umbb_pool {
    size_t bytes, max_bytes; /* in use; allowed */
    struct umbb_hash_slots brick_slots;
    uint32_t brick_count, brick_capacity;
    uint64_t (*bricks)[8];
    struct umbb_pool_level level[UMB_LEVEL_MAX + 1];
};

/* In: max_bytes: refuse to grow beyond. */
void umbb_pool_init(struct umbb_pool *pool, size_t max_bytes);
void umbb_pool_finish(struct umbb_pool *pool);

/*
 * Finds or adds a brick.
 *
 * Out:   ref: its number, or a uniform state if all its voxels are equal.
 * Fails: E_NO_MEMORY, E_LIMIT (max_bytes, or 2^32 - 2 bricks). The pool stays as it was.
 * Cost:  one hash of 64 bytes, about one missed cache line for an old brick.
 */
UMB_CHECKED enum umb_status umbb_pool_brick(struct umbb_pool *pool, const uint64_t slices[8],
                                            uint32_t *ref, struct umb_error *error);

/*
 * Finds or adds a node of a level from its eight children (x + 2 * y + 4 * z).
 *
 * Out:   ref: its number, or the children's state if all are uniform and the same.
 * Fails: as umbb_pool_brick.
 */
UMB_CHECKED enum umb_status umbb_pool_node(struct umbb_pool *pool, uint32_t level,
                                           const uint32_t children[8], uint32_t *ref,
                                           struct umb_error *error);

/*
 * Hands the arrays over as an octree with one root.
 *
 * In:    root: a reference into `level`, the level of the whole frustum.
 * Out:   octree: canonical if all nodes are reachable from the root; the caller finishes it.
 * Fails: E_NO_MEMORY. The pool is left empty either way.
 */
UMB_CHECKED enum umb_status umbb_pool_take(struct umbb_pool *pool, uint32_t root, uint32_t level,
                                           struct umb_octree *octree, struct umb_error *error);

#endif
