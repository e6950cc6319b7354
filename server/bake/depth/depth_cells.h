/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_CELLS_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_CELLS_H
/*
 * Drawing in two steps. First each cell of 8x8 texels of a block gets notes: a part for each
 * triangle that may show there. Then each cell is drawn in registers and written once, at its place
 * in the tile. A part takes 16 bytes. A cell's texels take 256 bytes, which every triangle would
 * otherwise read and write again.
 *
 * Life, once a block: begin; note (as often as needed); then store. When the notes are full, `draw`
 * draws them into layers (depth_kernels.h) and clears them, noting goes on, and the layers hold the
 * result.
 *
 * Bounds tell what a cell hides. No texel of a cell ends up behind the cell's `far`, so a part
 * whose nearest lit is not below `far` need not be noted or drawn. A part's bounds are the
 * predicate's own values at corners of the cell: all operations of the predicate, rounded or not,
 * are monotone in x and in y. A cell that no single triangle covers gets its `far` from all parts
 * that cover the cell together.
 */
#include "bake/depth/depth_kernels.h"

#define UMBB_CELLS_MAX  ((UMBB_CANVAS_MAX / 8) * (UMBB_CANVAS_MAX / 8))
#define UMBB_PLANES_MAX 4096
#define UMBB_PARTS_MAX  16384 /* numbers fit 16 bits, as planes do */

/* Values of a coverage that all texels of a triangle share. */
struct umbb_plane {
    double anchor_x, anchor_y, anchor_z, gradient_x, gradient_y;
    double z_min, z_max;      /* range of the third coordinate */
    int32_t lit_min, lit_max; /* z_min and z_max of parallel light as lit */
};

/* Number of entries beyond the last that kernels may touch, because they handle eight cells, parts
 * or planes at a time. */
#define UMBB_CELLS_SLACK 8

/* Parts: what one triangle covers of one cell, one array a field. Part 0 means none. */
struct umbb_parts {
    uint64_t bits[UMBB_PARTS_MAX + UMBB_CELLS_SLACK];   /* a byte a row, the first texel lowest */
    int32_t nearest[UMBB_PARTS_MAX + UMBB_CELLS_SLACK]; /* least lit of the part, or less */
    uint32_t link[UMBB_PARTS_MAX + UMBB_CELLS_SLACK];   /* next part of the cell, plane << 16 */
};

/* The cells of a layer, row by row. */
struct umbb_cell_layer {
    uint64_t covered[UMBB_CELLS_MAX + UMBB_CELLS_SLACK]; /* texels covered by any part */
    int32_t most[UMBB_CELLS_MAX + UMBB_CELLS_SLACK];     /* greatest lit of any part, or more */
    int32_t far[UMBB_CELLS_MAX + UMBB_CELLS_SLACK]; /* greatest final lit of any texel, or more */
    uint32_t first[UMBB_CELLS_MAX + UMBB_CELLS_SLACK]; /* index of the first part */
};

/* Notes of a block of texels: the parts of triangles that each of its cells may show. The struct
 * takes about half a megabyte; a few triangles touch only a small part of it. */
struct umbb_cells {
    _Alignas(64) struct umbb_plane planes[UMBB_PLANES_MAX];
    struct umbb_parts parts;
    struct umbb_cell_layer layers[UMBB_LAYER_COUNT];
    int32_t x0, y0, n;  /* square of the map, as in a canvas */
    int32_t background; /* voxels a side of the map */
    struct umbb_rays rays;
    int layer_count; /* 1: only UMBB_LAYER_OPEN; or UMBB_LAYER_COUNT */
    uint32_t plane_count, part_count;
};

/* Makes empty notes for n x n texels from (x0, y0) of the map on. */
void umbb_cells_begin(struct umbb_cells *cells, int32_t n, int32_t x0, int32_t y0);

/* Layers for a triangle's rows that face the light, and for its other rows. often_hidden: 1 if
 * enough is drawn to hide whole bands of rows often; it affects time only. */
struct umbb_sides {
    enum umbb_layer front, back;
    int often_hidden;
};

/* Returns 1 if every depth computed for the cells of a triangle, doubled, fits an int32_t without a
 * clamp. Under parallel light a grazing triangle may not fit, because its slope has no limit; such
 * a triangle must be drawn by umbb_draw_plain. */
int umbb_cells_can_note(const struct umbb_rays *rays, const struct umbb_coverage *coverage);

/* The steps, with the same bits as umbb_draw_plain and umbb_store_plain. */
struct umbb_cells_steps {
    /* Notes triangles. coverages: [count], count at most UMBB_DRAW_MAX; umbb_cells_can_note is 1
     * for each. Returns the number of triangles noted, which the room limits; at least one if the
     * notes were empty. */
    size_t (*note)(struct umbb_cells *cells, const struct umbb_coverage *coverages, size_t count,
                   const struct umbb_sides *sides);
    /* Lowers the texels of layers, int32[layer_count][n * n] by 8x8 blocks, and clears the
     * notes. */
    void (*draw)(struct umbb_cells *cells, int32_t *layers);
    /* Decides lit and end of the texels from (x, y) of the tile on, and level 3 of the pyramid over
     * them. Uncovered cells are marked as background, and their texels are not written. */
    void (*store)(const struct umbb_cells *cells, struct umbb_tile *tile, int32_t x, int32_t y);
};

/* The first step of umbb__cells_avx512, on x86-64 only. */
size_t umbb__cells_note_avx512(struct umbb_cells *cells, const struct umbb_coverage *coverages,
                               size_t count, const struct umbb_sides *sides);

#endif
