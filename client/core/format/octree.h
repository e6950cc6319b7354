/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_OCTREE_H
#define UMBRAGE_CORE_FORMAT_OCTREE_H
/*
 * The exchange form of the shadow data: a merged sparse voxel octree (DAG), one pool of unique
 * nodes a level, shared by every frustum of an asset. The bake produces it, the packed encoding
 * stores it, the mapped layout is made from it.
 *
 * A node of level l covers (1 << l)^3 voxels. Level 3 are bricks: eight masks of 8x8x1 bits, one a
 * depth slice (Sintorn et al. 2014, section 5); bit x + 8 * y of slice z is 1 where the light is
 * visible. Levels 4 and up have eight children of 2-bit state, child x + 2 * y + 4 * z in bits
 * 2c and 2c+1 of the mask; mixed children are listed in child order.
 *
 * Invariant of canonical trees: no two equal nodes in a level, no node whose children are all lit
 * or all shadowed, no brick that is all lit or all shadowed, no node that no root reaches.
 */
#include <stdint.h>
#include "umbrage/asset.h"

enum umb__node_state {
    UMB__NODE_SHADOWED = 0,
    UMB__NODE_LIT = 1,
    UMB__NODE_MIXED = 2, /* 3 is never valid */
};

/* The unique nodes of one level, 4 and up; arrays may be NULL if there are none. */
struct umb__octree_level {
    uint32_t count;
    uint16_t *masks;    /* [count], 2 bits a child */
    uint32_t *first;    /* [count + 1], index in children of a node's first mixed child */
    uint32_t *children; /* [first[count]], node numbers in the level below (bricks for level 4) */
};

struct umb__octree_root {
    enum umb__node_state state;
    uint32_t level; /* log2 of the frustum's size */
    uint32_t index; /* in that level if state is mixed, else 0 */
};

struct umb__octree {
    uint32_t brick_count;
    uint64_t (*bricks)[8];                             /* [brick_count][z] */
    struct umb__octree_level level[UMB_LEVEL_MAX + 1]; /* 0..3 unused */
    uint32_t root_count;
    struct umb__octree_root *roots; /* [root_count], one a frustum */
    const struct umb_alloc *alloc;  /* owns all arrays; NULL = malloc */
};

/* Frees the arrays and zeroes the struct; a zeroed struct is allowed. */
void umb__octree_finish(struct umb__octree *octree);

/* Number of mixed children of a mask (0..8). */
static inline unsigned umb__mask_mixed_count(uint16_t mask)
{
    return (unsigned)__builtin_popcount(mask & 0xaaaaU);
}

/* State of child c (0..7). */
static inline enum umb__node_state umb__mask_state(uint16_t mask, unsigned c)
{
    return (enum umb__node_state)(((unsigned)mask >> (2 * c)) & 3U);
}

#endif
