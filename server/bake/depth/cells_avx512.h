/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_CELLS_AVX512_H
#define UMBRAGE_SERVER_BAKE_DEPTH_CELLS_AVX512_H
/* The steps of depth_cells.h with AVX-512: what their files share. */
#include "bake/depth/depth_cells.h"

/* Where a layer hides what is behind. */
struct umbb__hiding {
    const int32_t *far; /* of its cells */
    /* The most of `far` in each band of cells; 0 beyond the last, for kernels that go by eight. */
    int32_t band_far[UMBB_CANVAS_MAX / 8 + UMBB_CELLS_SLACK];
    int32_t all_far; /* the most of these */
};

/* Finds them from what is noted. */
void umbb__cells_hiding_avx512(const struct umbb_cells *cells, enum umbb_layer layer,
                               struct umbb__hiding *hiding);

/* Notes triangles: see struct umbb_cells_steps. */
size_t umbb__cells_note_avx512(struct umbb_cells *cells, const struct umbb_coverage *coverages,
                               size_t count, const struct umbb_sides *sides);

#endif
