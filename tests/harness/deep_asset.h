/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_DEEP_ASSET_H
#define UMBRAGE_TESTS_DEEP_ASSET_H
/*
 * Packed assets of few nodes that represent a huge tree, as only a hostile server makes them. The
 * children of each node are drawn from all nodes of the level below, so that 2^60 voxels take a
 * kilobyte.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/content.h"
#include "format/octree.h"
#include "make_asset.h"

enum {
    DEEP_WIDTH_MAX = 2048
};

/* Parameters of a deep asset. */
struct deep {
    uint32_t log2_size;  /* 6 to UMB_LEVEL_MAX */
    uint32_t width;      /* nodes of a level below the root, 1 to DEEP_WIDTH_MAX */
    uint32_t mixed;      /* about how many of a node's children are nodes: 1 to 8 */
    uint64_t seed;       /* not 0 */
    uint32_t page_bytes; /* most estimated bytes of a page; 0: as the format page says */
};

/* Nodes of a level: no more than the tree has there. */
static inline uint32_t deep_count(const struct deep *deep, uint32_t level)
{
    const uint32_t above = deep->log2_size - level;
    const uint32_t cubes = above < 4 ? 1U << (3 * above) : DEEP_WIDTH_MAX;
    return cubes < deep->width ? cubes : deep->width;
}

/* Returns a child's number in the level below, or UINT32_MAX for a uniform child. Every node is
 * some node's child. */
static inline uint32_t deep_child(const struct deep *deep, uint32_t level, uint32_t node,
                                  unsigned c, uint64_t *seed)
{
    const uint32_t count = deep_count(deep, level), below = deep_count(deep, level - 1);
    if (below > count) {
        return (8 * node + c) % below;
    }
    if (c == 0) {
        return node % below;
    }
    return next_random(seed) % 8 < deep->mixed ? (uint32_t)(next_random(seed) % below) : UINT32_MAX;
}

static inline void deep_fill_level(const struct deep *deep, uint32_t number, uint64_t *seed,
                                   struct umb__octree_level *level)
{
    level->count = deep_count(deep, number);
    level->masks = calloc(level->count, sizeof *level->masks);
    level->first = calloc(level->count + 1, sizeof *level->first);
    level->children = calloc(8 * (size_t)level->count, sizeof *level->children);
    for (uint32_t node = 0; node < level->count; node++) {
        uint32_t next = level->first[node];
        unsigned mask = 0;
        for (unsigned c = 0; c < 8; c++) {
            const uint32_t child = deep_child(deep, number, node, c, seed);
            if (child == UINT32_MAX) {
                mask |= (unsigned)(next_random(seed) & 1) << (2 * c);
            } else {
                mask |= (unsigned)UMB__NODE_MIXED << (2 * c);
                level->children[next++] = child;
            }
        }
        level->masks[node] = (uint16_t)mask;
        level->first[node + 1] = next;
    }
}

static inline void deep_octree(const struct deep *deep, struct umb__octree *octree)
{
    uint64_t seed = deep->seed;
    memset(octree, 0, sizeof *octree);
    octree->brick_count = deep_count(deep, UMB_LEVEL_BRICK);
    octree->bricks = calloc(octree->brick_count, sizeof *octree->bricks);
    for (uint32_t i = 0; i < 8 * octree->brick_count; i++) {
        octree->bricks[i / 8][i % 8] = next_random(&seed);
    }
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= deep->log2_size; level++) {
        deep_fill_level(deep, level, &seed, &octree->level[level]);
    }
    octree->root_count = 1;
    octree->roots = calloc(1, sizeof *octree->roots);
    *octree->roots = (struct umb__octree_root){UMB__NODE_MIXED, deep->log2_size, 0};
}

/* The packed file; side_m: metres that the frustum is wide. */
static inline struct bytes deep_asset(const struct deep *deep, double side_m)
{
    static const double origin[3] = {0, 0, 0};
    const struct voxels voxels = {.log2_size = deep->log2_size, .frustum_count = 1};
    struct umb__octree octree;
    struct umb__content content;
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    uint8_t id[UMB_ID_BYTES];
    deep_octree(deep, &octree);
    make_content(&voxels, side_m / (double)(1U << deep->log2_size), origin, &content);
    struct umb_error error = {0};
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
                                      .page_bytes = deep->page_bytes};
    if (umb__pack_run(&job, id, &error) != UMB_OK) {
        (void)fprintf(stderr, "deep asset: %s\n", error.message);
        abort();
    }
    umb__octree_finish(&octree);
    return file;
}

#endif
