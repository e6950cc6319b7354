/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_SURVEY_H
#define UMBRAGE_CORE_FORMAT_PACK_SURVEY_H
/*
 * A survey of an octree before it is cut into pages (pack_cut.h). It finds the nodes that the roots
 * reach, checks these nodes, and estimates their bytes in the file. It goes level by level from the
 * top and reads each array once from end to end. That is much faster than a walk through the tree,
 * whose reads are scattered over memory.
 */
#include <stdbool.h>
#include <stddef.h>
#include "format/octree.h"

struct umb__pack_survey {
    uint8_t *brick_bytes;                 /* [brick_count] Estimated bytes of each brick */
    uint64_t *reached[UMB_LEVEL_MAX + 1]; /* A bit for each node of a level */
    uint64_t counts[UMB_LEVEL_MAX + 1];   /* Number of reached nodes of each level */
    uint64_t bytes[UMB_LEVEL_MAX + 1];    /* Estimated bytes of the reached nodes, each node once */
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

/* Returns whether a root reaches a node. */
static inline bool umb__pack_reached(const struct umb__pack_survey *survey, uint32_t level,
                                     uint32_t node)
{
    return survey->reached[level][node / 64] >> (node % 64) & 1;
}

/* Estimates the bytes of a node with `children` mixed children, all in the node's page. */
static inline uint32_t umb__pack_node_estimate(uint32_t children)
{
    return 2 + children;
}

/* Fills error with E_NO_MEMORY for the cuts, and returns that status. */
enum umb_status umb__pack_no_memory(struct umb_error *error);

#endif
