/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_VIEW_H
#define UMBRAGE_CORE_FORMAT_VIEW_H
/*
 * The mapped layout: what queries read, in memory or in a mapped file, byte for byte the same.
 *
 * Each frustum of 2^n voxels a side begins with a grid of 2^g cells a side (one cell if g = 0). A
 * cell covers a cube of level n - g, where n - g is odd. Its value is 0 (shadowed), 1 (lit) or 2
 * plus the number of a node or brick. Below the grid stand wide nodes of levels ..., 9, 7, 5, each
 * of which spans two octree levels and has 4x4x4 children. The children of level 5 are bricks of 64
 * bytes: eight masks of 8x8x1 voxels, one a depth slice.
 *
 *   wide node, in 8-byte words: u64 mixed, u64 lit, then u32 number of each mixed child in order,
 *   padded with zeros to a multiple of two words. Child (x, y, z) is bit x + 4 * y + 16 * z of both
 *   masks; lit is 0 where mixed is 1. The number of a node is its first word in the node section.
 *
 * Beside its grid each frustum has columns, a shortcut for points. There is one column for each
 * square of 2^c texels a side (c odd, at most the level of the grid's cells). The column lists the
 * cubes of level c above its square, from the light on, as values like those of cells, called
 * pieces. Only the pieces `low` to `high` are stored: all cubes before `low` equal piece `low`, and
 * all cubes behind `high` equal piece `high`. Surfaces are thin, so lists are short. The first two
 * pieces of a frustum are 0 and 1: the lists of columns that are all shadowed or all lit.
 *
 * A node longer than a cache line of 64 bytes begins at a line, so that its masks and first numbers
 * share one line. A shorter node lies within one line, if possible in a gap that a longer node
 * left. The rest of a gap is zero: two zero words would be a node that is all shadowed, and written
 * trees have none. So the nodes of a level have no order.
 *
 * Why: wide nodes halve the dependent cache lines of a look-up (measured 1.7 to 2.3 times faster
 * than one octree level a node), and one node answers a whole window of a level-5 cell.
 */
#include <stdint.h>
#include "format/layout.h"
#include "umbrage/asset.h"

#define UMB__CELL_SHADOWED 0U
#define UMB__CELL_LIT      1U
#define UMB__CELL_FIRST    2U /* A cell of value v >= 2 is node or brick v - 2 */

/* The entrance to one frustum's voxels. */
struct umb__top {
    uint32_t grid_log2;    /* Logarithm g of the grid's cells a side */
    uint32_t column_level; /* Level c of the columns' pieces */
    uint64_t first_cell;   /* Index of the first cell in the grid section */
    uint64_t first_column; /* Index of the first column in the columns' section; column (x, y) is
                              at x + (y << (n - c)) behind it */
    uint64_t first_piece;  /* Index of the first piece in the pieces' section */
};

struct umb__column {
    uint32_t first; /* Index of piece `low`, counted from the frustum's first piece */
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
    uint64_t level_begin[UMB__WIDE_COUNT + 1]; /* First word of level 5 + 2i; the last is the end */
};

/* Returns the index, among the frustum's pieces, of a column's piece at depth z. In: z: in cubes of
 * the column's level. */
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

/* Returns the bit in a wide node's masks of octree grandchild `grandchild` (0..7) below child
 * `child` (0..7). */
static inline unsigned umb__wide_bit(unsigned child, unsigned grandchild)
{
    const unsigned x = (child & 1) * 2 + (grandchild & 1);
    const unsigned y = (child >> 1 & 1) * 2 + (grandchild >> 1 & 1);
    const unsigned z = (child >> 2) * 2 + (grandchild >> 2);
    return x + 4 * y + 16 * z;
}

/* Returns the number of the mixed child at bit `child` of a wide node. */
static inline uint32_t umb__wide_child(const uint64_t *node, unsigned child)
{
    unsigned rank = (unsigned)__builtin_popcountll(node[0] & (((uint64_t)1 << child) - 1));
    uint64_t word = node[2 + rank / 2];
    return (uint32_t)(rank % 2 ? word >> 32 : word);
}

#endif
