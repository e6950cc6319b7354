/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_SURVEY_H
#define UMBRAGE_CORE_FORMAT_PACK_SURVEY_H
/*
 * Survey of an octree before packing: finds the nodes that the roots reach, checks these nodes, and
 * estimates their bytes in the file. The survey goes level by level from the top and reads each
 * array once from end to end. That is much faster than a walk through the tree, whose reads are
 * scattered over memory.
 */
#include <stddef.h>
#include "format/octree.h"

/* Returns the words of a set of `count` nodes, a bit each. */
static inline size_t umb__bits_words(size_t count)
{
    return count / 64 + 1;
}

static inline int umb__bits_has(const uint64_t *bits, uint32_t number)
{
    return (int)(bits[number / 64] >> (number % 64) & 1);
}

static inline void umb__bits_add(uint64_t *bits, uint32_t number)
{
    bits[number / 64] |= (uint64_t)1 << (number % 64);
}

/* Estimates the bytes of a node with `children` mixed children, all in the node's page. */
static inline size_t umb__node_estimate(uint32_t children)
{
    return 2 + (size_t)children;
}

struct umb__pack_survey {
    uint8_t *brick_bytes;               /* [brick_count] Estimated bytes of each brick */
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* Number of reached nodes of each level */
    uint64_t bytes[UMB_LEVEL_MAX + 1];  /* Estimated bytes of the reached nodes, each node once */
    const struct umb_alloc *alloc;
};

/*
 * Surveys an octree. Unreached nodes are not checked, except bricks, of which any bytes are valid.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range, an impossible mask).
 */
UMB_CHECKED enum umb_status umb__pack_survey(const struct umb__octree *octree,
                                             struct umb__pack_survey *survey,
                                             struct umb_error *error);
void umb__pack_survey_finish(struct umb__pack_survey *survey);

/* Fills error with E_NO_MEMORY for ordering, and returns that status. */
enum umb_status umb__pack_no_memory(struct umb_error *error);

#endif
