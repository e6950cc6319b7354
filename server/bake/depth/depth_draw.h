/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_DRAW_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_DRAW_H
/*
 * The inner loops of the rasteriser: triangles into the layers of a block of texels.
 *
 * A layer is stored as a tile is: by 8x8 blocks, row by row in a block, blocks row by row. Eight
 * texels of one row are 32 bytes, and those of the next row follow them. So a small triangle
 * touches few cache lines, none of them a power of two apart.
 */
#include <stddef.h>
#include "bake/depth/coverage.h"

/* Texels a side of the largest canvas. */
#define UMBB_CANVAS_MAX 256

/* A square of texels being drawn into. */
struct umbb_canvas {
    int32_t x0, y0; /* first texel */
    int32_t n;      /* texels a side: a multiple of 8, at most UMBB_CANVAS_MAX */
    int32_t *front; /* int32[n * n], by 8x8 blocks: layer of the rows that face the light */
    int32_t *back;  /* layer of the other rows; may be the same as front */
    /* For each 8x8 block of front and of back a bound of its greatest texel, [n/8 * n/8]; the same
     * array if the layers are. A kernel may skip what lies behind it, and lower it. */
    int32_t *front_far, *back_far;
    /* 1: so little is drawn that whole bands of rows are hardly ever hidden, and a kernel need not
     * test for that; it affects time only. */
    int fresh;
};

/* Sets each block's number to its greatest texel. */
typedef void (*umbb_far_fn)(const int32_t *layer, int32_t n, int32_t *far);
void umbb_canvas_far(const int32_t *layer, int32_t n, int32_t *far);

/* AVX2 form; NULL if this build or this processor lacks it. */
umbb_far_fn umbb_far_avx2(void);

/* Index of the start of row y in a layer n texels wide; its texel x is at 64 * (x >> 3) + (x &
 * 7). */
static inline size_t umbb_canvas_row(size_t n, size_t y)
{
    return (y >> 3) * 8 * n + (y & 7) * 8;
}

/* A texel of the row that starts at `line`; x counts in the frustum. */
static inline int32_t *umbb_canvas_at(const struct umbb_canvas *canvas, int32_t *line, int32_t x)
{
    const size_t column = (size_t)(x - canvas->x0);
    return line + 64 * (column >> 3) + (column & 7);
}

/* Number of triangles in one call. */
#define UMBB_DRAW_MAX 32

/*
 * Lowers each number of the canvas whose texel a triangle covers to the fragment's lit.
 *
 * In: coverages: [count] prepared; none of their coordinates is larger than UMBB_COORDINATE_MAX.
 *     count: at most UMBB_DRAW_MAX.
 */
typedef void (*umbb_draw_fn)(const struct umbb_coverage *coverages, size_t count,
                             const struct umbb_canvas *canvas);

/* Plain C, straight from the predicate: the definition. */
void umbb_draw_plain(const struct umbb_coverage *coverages, size_t count,
                     const struct umbb_canvas *canvas);

/* AVX2: four rows and eight texels at a time, the same bits; NULL if this build or this processor
 * lacks it. */
umbb_draw_fn umbb_draw_avx2(void);

/* The faster one on this machine. */
umbb_draw_fn umbb_draw_quickest(void);

#endif
