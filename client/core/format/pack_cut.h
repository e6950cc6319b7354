/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PACK_CUT_H
#define UMBRAGE_CORE_FORMAT_PACK_CUT_H
/*
 * Cuts an octree into pages, by the content of each subtree alone.
 *
 * The piece of a node is the node with the pieces of those children that stay with it. A piece
 * without cuts is whole. Where a whole piece would take more than a page, the node is cut: its
 * children leave, and share pages of their own, as many as fit. The piece of a node above a cut is
 * coarse: whole children leave it, except a few small ones; coarse children leave where they would
 * take more than a page. So a page holds either whole pieces or coarse ones, of children of one
 * node. What is below a node decides all its cuts: after an edit only pages on the way from the
 * edit to the root differ.
 *
 * A node that several pages need is copied to each of them, unless it is below a cut.
 */
#include "format/pack_survey.h"
#include "umbrage/workers.h"

/* One page: children of a cut node, or roots of frusta. */
struct umb__pack_page {
    uint32_t level; /* Level of the cut node; 0: roots */
    uint32_t node;  /* Number of the cut node, or of the first frustum */
    uint32_t part;  /* Which of the cut node's pages, or the number of frusta */
};

/* Parts of a node: four bits for each mixed child, the first one lowest. 0: the child stays with
 * the node; else 1 plus the number of its page among those of the node. */
static inline uint32_t umb__part_of(uint32_t parts, uint32_t child)
{
    return parts >> 4 * child & 15;
}

/* Returns the number of pages that parts name. */
static inline uint32_t umb__part_count(uint32_t parts)
{
    uint32_t most = 0;
    for (; parts != 0; parts >>= 4) {
        most = (parts & 15) > most ? parts & 15 : most;
    }
    return most;
}

#define UMB__CUT_LOWEST (UMB_LEVEL_BRICK + 2U) /* Lowest level whose nodes may be cut */

struct umb__pack_kept;

struct umb__pack_cuts {
    const struct umb__octree *octree;
    uint32_t
        *parts[UMB_LEVEL_MAX + 1]; /* [count of the level] Parts of each node of levels 5 and up */
    uint32_t *bytes[UMB_LEVEL_MAX + 1]; /* [count of the level] Estimated bytes of the pages of each
                                           node of levels 5 and up; 0: not cut */
    /* [count of the level] For levels 4 and up, a bound of the bytes of each node's piece, and a
     * flag if the piece is coarse. */
    uint32_t *sums[UMB_LEVEL_MAX + 1];
    struct umb__pack_page *tops; /* [top_count] Pages of the roots */
    uint32_t top_count;
    uint32_t page_bytes; /* Most estimated bytes of a page */
    double copies;       /* Estimated bytes of all pages, over those of the nodes, each once */
    const struct umb_alloc *alloc;
};

/*
 * Cuts a surveyed octree. In: workers: or NULL; the result is the same. most: most estimated bytes
 * of a page; 0: the size that the format page chooses. kept: cuts of nodes that are known, or NULL;
 * the result is the same if they are true. Out: cuts: finish them also after a failure.
 * Fails: E_NO_MEMORY, E_CORRUPT (kept cuts that no octree has).
 */
UMB_CHECKED enum umb_status umb__pack_cut(const struct umb__octree *octree,
                                          const struct umb__pack_survey *survey,
                                          const struct umb_workers *workers, uint32_t most,
                                          const struct umb__pack_kept *kept,
                                          struct umb__pack_cuts *cuts, struct umb_error *error);
void umb__pack_cuts_finish(struct umb__pack_cuts *cuts);

/* Returns the parts of a node of level 4 and up; 0: all its children stay. */
static inline uint32_t umb__pack_parts(const struct umb__pack_cuts *cuts, uint32_t level,
                                       uint32_t node)
{
    return cuts->parts[level] ? cuts->parts[level][node] : 0;
}

#endif
