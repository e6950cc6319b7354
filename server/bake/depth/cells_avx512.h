/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_CELLS_AVX512_H
#define UMBRAGE_SERVER_BAKE_DEPTH_CELLS_AVX512_H
/* Shared declarations of the AVX-512 files that implement the steps of depth_cells.h. */
#include "bake/depth/depth_cells.h"

/* Depths from which a layer hides everything behind. */
struct umbb__hiding {
    const int32_t *far; /* `far` of the layer's cells */
    /* Greatest `far` in each band of cells; 0 beyond the last, for kernels that handle eight at a
     * time. */
    int32_t band_far[UMBB_CANVAS_MAX / 8 + UMBB_CELLS_SLACK];
    int32_t all_far; /* greatest of these */
};

/* Computes them from the notes. */
void umbb__cells_hiding_avx512(const struct umbb_cells *cells, enum umbb_layer layer,
                               struct umbb__hiding *hiding);

/* Notes triangles: see struct umbb_cells_steps. */
size_t umbb__cells_note_avx512(struct umbb_cells *cells, const struct umbb_coverage *coverages,
                               size_t count, const struct umbb_sides *sides);

#endif
