/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_KERNELS_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_KERNELS_H
/*
 * The inner loops of the rasteriser, for each set of vector instructions: preparing triangles,
 * drawing them into the layers of a block of texels, and storing the layers in a tile. The plain
 * forms are the definitions.
 *
 * A layer is stored as a tile is: by 8x8 blocks, row by row in a block, blocks row by row. Eight
 * texels of one row are 32 bytes, and those of the next row follow them. So a small triangle
 * touches few cache lines, none of them a power of two apart.
 */
#include "bake/base/vectors.h"
#include "bake/depth/depth_perspective.h"

/* Texels a side of the largest canvas. */
#define UMBB_CANVAS_MAX 256

/* Number of triangles in one call. */
#define UMBB_DRAW_MAX 32

/* A square of texels being drawn into. */
struct umbb_canvas {
    int32_t x0, y0; /* first texel */
    int32_t n;      /* texels a side: a multiple of 8, at most UMBB_CANVAS_MAX */
    struct umbb_rays rays;
    int32_t *front; /* int32[n * n], by 8x8 blocks: layer of the rows that face the light */
    int32_t *back;  /* layer of the other rows; may be the same as front */
    /* [n/8 * n/8] Bound of the greatest texel of each 8x8 block of front and of back; the same
     * array if `front` and `back` are one layer. A kernel may skip triangles behind a bound, and
     * may lower the bound. */
    int32_t *front_far, *back_far;
};

/* Returns the index of the start of row y in a layer n texels wide; its texel x is at 64 * (x >> 3)
 * + (x & 7). */
static inline size_t umbb_canvas_row(size_t n, size_t y)
{
    return (y >> 3) * 8 * n + (y & 7) * 8;
}

/*
 * Prepares several triangles; one that covers no texel centre gets row_first > row_last.
 *
 * In: corners: [..] as for umbb_coverage_prepare. triangles: uint32[count], indices into corners.
 * Out: coverages: [count].
 */
typedef void umbb_prepare_fn(const double (*corners)[3][3], const uint32_t *triangles, size_t count,
                             int32_t size, struct umbb_coverage *coverages);

/*
 * Draws triangles. A covered texel of the canvas takes the fragment's `lit` (the number of voxels
 * before the fragment, coverage.h) if that is less than the texel's number.
 *
 * In: coverages: [count] prepared; none of their coordinates is larger than UMBB_COORDINATE_MAX.
 *     count: at most UMBB_DRAW_MAX.
 */
typedef void umbb_draw_fn(const struct umbb_coverage *coverages, size_t count,
                          const struct umbb_canvas *canvas);

/* Sets the number of each 8x8 block of a layer to the block's greatest texel. */
typedef void umbb_far_fn(const int32_t *layer, int32_t n, int32_t *far);

/*
 * Decides lit and end of n x n texels from (x0, y0) of the tile on, and fills level 3 of the
 * pyramid over them.
 *
 * In: layers: int32[UMBB_LAYER_COUNT][n * n] by 8x8 blocks; without the closed rule only the open
 *     one is read. n, x0, y0: multiples of 8.
 */
typedef void umbb_store_fn(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0,
                           int32_t y0);

/* The kernels of one set of vector instructions. */
struct umbb_depth_kernels {
    umbb_prepare_fn *prepare;
    umbb_draw_fn *draw;
    umbb_far_fn *find_far;
    umbb_store_fn *store;
    const struct umbb_cells_steps *cells; /* depth_cells.h; NULL: triangles are drawn at once */
};

/* Returns the kernels of a set; NULL if this build or this processor lacks the set. */
const struct umbb_depth_kernels *umbb_depth_kernels(enum umbb_vectors vectors);

/* Draws a prepared caster into a canvas, without the texels that the caster's texture cuts out.
 * cut: number of the caster's cut in `cuts`. If `cuts` is NULL, the whole triangle is drawn. */
void umbb_draw_cut(const struct umbb_cuts *cuts, uint32_t cut, const struct umbb_coverage *coverage,
                   const struct umbb_canvas *canvas);

/* Forms of the kernels; the vector forms exist on x86-64 only. */
umbb_prepare_fn umbb_prepare_plain, umbb__prepare_avx2, umbb__prepare_avx512;
umbb_draw_fn umbb_draw_plain, umbb__draw_avx2;
umbb_far_fn umbb_far_plain, umbb__far_avx2;
umbb_store_fn umbb_store_plain, umbb__store_avx2;
extern const struct umbb_cells_steps umbb__cells_avx512;

#endif
