/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_SPAN_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_SPAN_H
/* The inner loop of the rasteriser: one row of one triangle into one layer of integers. */
#include "bake/depth/coverage.h"

/*
 * Lowers layer[x - x_origin] to the fragment's lit, for x_first <= x <= x_last.
 *
 * In: row_z: umbb_coverage_row_z of that row. layer: int32[], indexed from x_origin.
 */
typedef void (*umbb_span_fn)(const struct umbb_coverage *coverage, double row_z, int32_t x_first,
                             int32_t x_last, int32_t x_origin, int32_t *layer);

/* Plain C: the definition. */
void umbb_span_plain(const struct umbb_coverage *coverage, double row_z, int32_t x_first,
                     int32_t x_last, int32_t x_origin, int32_t *layer);

/* Four texels at a time, the same bits; NULL if this build or this processor lacks AVX2. */
umbb_span_fn umbb_span_avx2(void);

#endif
