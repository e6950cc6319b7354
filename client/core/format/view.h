/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_VIEW_H
#define UMBRAGE_CORE_FORMAT_VIEW_H
/*
 * The mapped layout: what queries read, in memory or in a mapped file, byte for byte the same.
 *
 * Each frustum begins with a grid of 2^g cells a side (one cell if g = 0), each covering a cube of
 * level n - g, where n - g is odd. A cell is 0 (shadowed), 1 (lit) or 2 + a node or brick number.
 * Below it stand wide nodes that span two octree levels, 4x4x4 children: levels ..., 9, 7, 5; the
 * children of level 5 are bricks of 64 bytes (eight 8x8x1 masks, one a depth slice).
 *
 *   wide node, in 8-byte words: u64 mixed, u64 lit, then u32 number of each mixed child in order,
 *   padded with zeros to a multiple of two words. Child x + 4 * y + 16 * z is bit that of both
 *   masks; lit is 0 where mixed is 1. A number counts words from the start of the node section, or
 *   bricks.
 *
 * Beside its grid each frustum has columns, a shortcut for points. There is one column for each
 * square of 2^c texels a side (c odd, at most the level of the grid's cells). It lists the cubes of
 * level c above that square as values like a cell's, called pieces. A list has the pieces `low` to
 * `high`; nearer to the light than `low` all cubes equal piece `low`, farther than `high` all equal
 * piece `high`. Surfaces are thin, so lists are short. The first two pieces of a frustum are 0 and
 * 1: the lists of columns that are all shadowed or all lit.
 *
 * A node longer than a cache line of 64 bytes begins at a line, so that its masks and first numbers
 * share one line. A shorter node lies within one line, if possible in a gap that a longer one left;
 * the rest of a gap is zero. So the nodes of a level have no order. Two zero words would be a node
 * that is all shadowed, which written trees do not have.
 *
 * Why: wide nodes halve the dependent cache lines of a look-up (measured 1.7 to 2.3 times faster
 * than one octree level a node), and one node answers a whole window of a level-5 cell.
 */
#include <stdint.h>
#include "format/layout.h"
#include "umbrage/asset.h"

#define UMB__CELL_SHADOWED 0U
#define UMB__CELL_LIT      1U
#define UMB__CELL_FIRST    2U /* a cell of value v >= 2 is node or brick v - 2 */

struct umb__top {
    uint32_t grid_log2;    /* g */
    uint32_t column_level; /* c */
    uint64_t first_cell;   /* in the grid section */
    uint64_t first_column; /* First column in the columns' section; column (x, y) is at x + (y << (n
                              - c)) */
    uint64_t first_piece;  /* in the pieces' section */
};

struct umb__column {
    uint32_t first; /* Piece `low`, counted from the frustum's first */
    uint16_t low, high;
};

/* Borrowed arrays of the mapped layout. All little-endian, as the host must be. */
struct umb__view {
    const struct umb__top *tops; /* [frustum_count] */
    const uint32_t *grid;        /* [grid_count], cell x + (y << g) + (z << 2g) */
    const uint64_t *nodes;       /* [node_words] */
    const uint64_t (*bricks)[8]; /* [brick_count][z] */
    const struct umb__column *columns;
    const uint32_t *pieces;
    uint64_t grid_count, node_words, brick_count, column_count, piece_count;
    uint64_t level_begin[UMB__WIDE_COUNT + 1]; /* first word of level 5 + 2i; the last is the end */
};

/* Returns the place of the piece at depth z (in cubes of the column's level), counted from the
 * first. */
static inline uint32_t umb__column_piece(struct umb__column column, uint32_t z)
{
    uint32_t at = z < column.high ? z : column.high;
    return column.first + (at > column.low ? at - column.low : 0);
}

/* Returns the words of a wide node with so many mixed children. */
static inline uint64_t umb__wide_words(uint64_t mixed_count)
{
    return 2 + (mixed_count + 3) / 4 * 2;
}

/* Returns the number of the mixed child at bit `child` of a wide node. */
static inline uint32_t umb__wide_child(const uint64_t *node, unsigned child)
{
    unsigned rank = (unsigned)__builtin_popcountll(node[0] & (((uint64_t)1 << child) - 1));
    uint64_t word = node[2 + rank / 2];
    return (uint32_t)(rank % 2 ? word >> 32 : word);
}

#endif
