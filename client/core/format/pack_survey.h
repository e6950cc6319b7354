/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_SURVEY_H
#define UMBRAGE_CORE_FORMAT_PACK_SURVEY_H
/*
 * What there is to be packed: which nodes the roots reach, that they are sound, how many bytes they
 * will take. Level by level from the top, each array once from end to end, which is much quicker
 * than on the way through the tree, where all that is read of a node lies anywhere in memory.
 */
#include <stddef.h>
#include "format/octree.h"

/* Numbers of one level's nodes, a bit each. */
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

/* Number of unique nodes of a level (bricks for level 3). */
uint32_t umb__octree_level_count(const struct umb_octree *octree, uint32_t level);

/* What a node with so many mixed children will take in a page, roughly, references to other pages
 * not counted. */
static inline size_t umb__node_estimate(uint32_t children)
{
    return 2 + (size_t)children;
}

struct umb__pack_survey {
    uint8_t *brick_bytes;               /* [brick_count] what each will take, roughly */
    uint64_t counts[UMB_LEVEL_MAX + 1]; /* reached nodes of each level */
    uint64_t bytes[UMB_LEVEL_MAX + 1];  /* what they will take, each once */
    const struct umb_alloc *alloc;
};

/*
 * Fails: E_NO_MEMORY, E_ARGUMENT (a child or root out of range, an impossible mask). What is not
 * reached is not looked at, but for the bricks, of which anything will do.
 */
UMB_CHECKED enum umb_status umb__pack_survey(const struct umb_octree *octree,
                                             struct umb__pack_survey *survey,
                                             struct umb_error *error);
void umb__pack_survey_finish(struct umb__pack_survey *survey);

#endif
