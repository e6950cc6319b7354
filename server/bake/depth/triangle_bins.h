/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_TRIANGLE_BINS_H
#define UMBRAGE_SERVER_BAKE_DEPTH_TRIANGLE_BINS_H
/*
 * Lists of the triangles that may touch each cell of a square grid of texels.
 *
 * A triangle is listed in every cell where it covers a texel centre, and in few others; cells list
 * triangles in ascending order. Used twice: the whole map into tiles, a tile into blocks.
 */
#include "bake/depth/tile.h"
#include "umbrage/workers.h"

struct umbb_bins {
    uint32_t cells_x;  /* a side of the grid */
    uint64_t *first;   /* [cells + 1], where a cell's list starts */
    uint32_t *entries; /* [first[cells]] triangle numbers */
    uint64_t capacity; /* room of entries, kept between fills */
};

/* Input of the binning: all casters or those in `list`, in the square that starts at x0, y0. */
struct umbb_bins_input {
    const struct umbb_casters *casters;
    const uint32_t *list; /* caster numbers, ascending; not read if count is 0 or all is 1 */
    size_t count;         /* length of list */
    int all;              /* 1: every caster */
    int borders;          /* 1: list casters with a border (their marks) two texels further */
    int32_t x0, y0;
    uint32_t cell_log2; /* texels a side of a cell */
    uint32_t cells_x;   /* cells a side; at most 4096 */
    size_t max_bytes;   /* limit of the entries, and of the working memory next to them */
    const struct umb_workers *workers; /* threads to use; NULL: only the caller's */
};

/* Fills bins, reusing its memory. Start with a zeroed struct. Fails: E_NO_MEMORY, E_LIMIT. */
UMB_CHECKED enum umb_status umbb_bins_fill(struct umbb_bins *bins,
                                           const struct umbb_bins_input *input,
                                           struct umb_error *error);

/* The list of cell (x, y) of the grid; NULL only if *count is 0. */
static inline const uint32_t *umbb_bins_cell(const struct umbb_bins *bins, int32_t x, int32_t y,
                                             size_t *count)
{
    const size_t cell = (size_t)y * bins->cells_x + (size_t)x;
    *count = (size_t)(bins->first[cell + 1] - bins->first[cell]);
    return bins->entries == NULL ? NULL : bins->entries + bins->first[cell];
}

void umbb_bins_finish(struct umbb_bins *bins);

#endif
