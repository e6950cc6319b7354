/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_MAPPED_H
#define UMBRAGE_CORE_FORMAT_MAPPED_H
/* Making, validating and writing the mapped layout. */
#include "format/canonical.h"
#include "format/head.h"
#include "format/view.h"

/* A mapped layout that owns its memory. */
struct umb__mapped {
    struct umb__top *tops;
    uint32_t *grid;
    uint64_t *nodes;
    uint64_t (*bricks)[8];
    struct umb__column *columns;
    uint32_t *pieces;
    struct umb__view view;
    const struct umb_alloc *alloc;
};

/*
 * Lays an octree out for queries. The layout takes over the octree's bricks, which need no change.
 *
 * Grid sizes: a frustum of 2^n voxels a side gets a grid of 2^g cells a side, where n - g is odd
 * and g is at most 6. g is the largest such number whose grid fits the budget: an eighth of the
 * bytes of bricks and wide nodes of all levels, divided by the number of frusta. The smallest grid
 * is always allowed. Wide nodes of levels above the cells of every grid are left out.
 * Fails: E_NO_MEMORY, E_TOO_LARGE (octree and mapped layout together over max_memory_bytes, or 2^32
 *        words of nodes). The octree then keeps its bricks.
 * Cost:  linear in the octree.
 */
UMB_CHECKED enum umb_status umb__mapped_build(struct umb__octree *octree,
                                              const struct umb__content *content,
                                              uint64_t max_memory_bytes, struct umb__mapped *mapped,
                                              struct umb_error *error);
void umb__mapped_finish(struct umb__mapped *mapped);

/*
 * Makes the columns of a layout that has grids and nodes (a step of umb__mapped_build).
 *
 * The columns of a frustum are as narrow as their budget allows. The budget is a thirty-second of
 * the bytes of grids, nodes and bricks, divided by the number of frusta. Columns as wide as the
 * grid's cells are always allowed.
 * Out:   mapped: columns, pieces, and the fields of tops and view about them.
 * Fails: E_NO_MEMORY.
 * Cost:  linear in the bytes allowed.
 */
UMB_CHECKED enum umb_status umb__columns_build(const struct umb__content *content,
                                               struct umb__mapped *mapped, struct umb_error *error);

/* Returns the most bytes that umb__columns_build holds at once. In: mapped: with the sizes of grids
 * and the counts of nodes and bricks. */
uint64_t umb__columns_bytes_max(const struct umb__content *content,
                                const struct umb__mapped *mapped);

/*
 * Finds the sections of a mapped file and checks them.
 *
 * In:    full: 1 checks the checksums of all sections and the whole structure: every child number
 *        is the start of a node two levels below, or a brick. 0 checks only the lengths of the
 *        sections against the canonical block, the grids and the table of levels.
 * Out:   mapped: zeroed before the call except for its allocator; finish it also after a failure.
 *        Its view points into the file. Only the tops are copied, so that a query starts at checked
 *        values even if the file is overwritten later.
 * Trust: with full, safe on hostile bytes. Without, only on bytes that passed with full before.
 */
UMB_CHECKED enum umb_status umb__mapped_view(const uint8_t *file, const struct umb__head *head,
                                             const struct umb__content *content, int full,
                                             struct umb__mapped *mapped, struct umb_error *error);

#endif
