/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_DRAW_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_DRAW_H
/* The inner loops of the rasteriser: one triangle into the layers of a block of texels. */
#include "bake/depth/coverage.h"

/* Numbers behind a layer's last row that a kernel may read, and write back as they were. */
#define UMBB_CANVAS_PAD 4

/* A square of texels being drawn. */
struct umbb_canvas {
    int32_t x0, y0, n; /* first texel, texels a side */
    int32_t *front;    /* int32[n * n + UMBB_CANVAS_PAD]: takes rows that face the light */
    int32_t *back;     /* takes the others; may be the same as front */
};

/*
 * Lowers each number of the canvas whose texel the triangle covers to the fragment's lit.
 *
 * In: coverage: prepared; none of its coordinates is larger than UMBB_COORDINATE_MAX.
 */
typedef void (*umbb_draw_fn)(const struct umbb_coverage *coverage,
                             const struct umbb_canvas *canvas);

/* Plain C, straight from the predicate: the definition. */
void umbb_draw_plain(const struct umbb_coverage *coverage, const struct umbb_canvas *canvas);

/* Four rows and four texels at a time, the same bits; NULL if this build or this processor lacks
 * AVX2. */
umbb_draw_fn umbb_draw_avx2(void);

#endif
