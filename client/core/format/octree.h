/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_OCTREE_H
#define UMBRAGE_CORE_FORMAT_OCTREE_H
/*
 * The octree: the form of an asset's voxels between the bake, the packed encoding and the mapped
 * layout. It is a merged sparse voxel octree (DAG) with one array of unique nodes a level, which
 * all frusta of an asset share.
 *
 * A node of level l covers (1 << l)^3 voxels. Nodes of level 3 are bricks: eight masks of 8x8x1
 * bits, one a depth slice (Sintorn et al. 2014, section 5); bit x + 8 * y of slice z is 1 where the
 * light is visible. A node of level 4 and up has eight children. Child c = x + 2 * y + 4 * z has
 * its state in bits 2c and 2c + 1 of the node's mask; the numbers of mixed children are listed in
 * the order of c.
 *
 * Invariant of canonical trees: no two equal nodes in a level, no node whose children are all lit
 * or all shadowed, no brick that is all lit or all shadowed, no node that no root reaches.
 */
#include <stdint.h>
#include "umbrage/asset.h"

enum umb__node_state {
    UMB__NODE_SHADOWED = 0,
    UMB__NODE_LIT = 1,
    UMB__NODE_MIXED = 2, /* Both; state 3 is never valid */
};

/* The unique nodes of one level, 4 and up; arrays may be NULL if the level has none. */
struct umb__octree_level {
    uint32_t count;
    uint16_t *masks;    /* [count] States of the children, 2 bits each */
    uint32_t *first;    /* [count + 1] Index in `children` of a node's first mixed child */
    uint32_t *children; /* [first[count]] Node numbers in the level below (bricks for level 4) */
};

struct umb__octree_root {
    enum umb__node_state state;
    uint32_t level; /* Logarithm of the frustum's voxels a side */
    uint32_t index; /* Number of a mixed root in its level, else 0 */
};

struct umb__octree {
    uint32_t brick_count;
    uint64_t (*bricks)[8];                             /* [brick_count][z] */
    struct umb__octree_level level[UMB_LEVEL_MAX + 1]; /* 0..3 unused */
    uint32_t root_count;
    struct umb__octree_root *roots; /* [root_count] One root a frustum */
    const struct umb_alloc *alloc;  /* Allocator of all arrays; NULL = malloc */
};

/* Frees the arrays and zeroes the struct; a zeroed struct is allowed. */
void umb__octree_finish(struct umb__octree *octree);

/* Returns the number of unique nodes of a level (bricks for level 3). */
static inline uint32_t umb__octree_level_count(const struct umb__octree *octree, uint32_t level)
{
    return level == UMB_LEVEL_BRICK ? octree->brick_count : octree->level[level].count;
}

/* Returns the starts of the runs of equal slices of a brick. Bit z is set if slice z differs from
 * slice z - 1; bit 0 is always set. */
static inline unsigned umb__brick_runs(const uint64_t brick[8])
{
    unsigned bits = 1;
    for (unsigned z = 1; z < 8; z++) {
        bits |= (unsigned)(brick[z] != brick[z - 1]) << z;
    }
    return bits;
}

/* Returns the number of mixed children of a mask (0..8). */
static inline unsigned umb__mask_mixed_count(uint16_t mask)
{
    return (unsigned)__builtin_popcount(mask & 0xaaaaU);
}

/* Returns the state of child c (0..7). */
static inline enum umb__node_state umb__mask_state(uint16_t mask, unsigned c)
{
    return (enum umb__node_state)(((unsigned)mask >> (2 * c)) & 3U);
}

#endif
