/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_CELLS_AVX512_H
#define UMBRAGE_SERVER_BAKE_DEPTH_CELLS_AVX512_H
/* The steps of depth_cells.h with AVX-512: two files, one table of functions. */
#include "bake/depth/depth_cells.h"

/* Notes triangles: see struct umbb_cells_steps. */
size_t umbb__cells_note_avx512(struct umbb_cells *cells, const struct umbb_coverage *coverages,
                               size_t count, const struct umbb_sides *sides);

#endif
