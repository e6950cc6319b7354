/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_STORE_H
#define UMBRAGE_SERVER_BAKE_DEPTH_DEPTH_STORE_H
/* From the layers of a drawn block to the tile's texels and its lowest pyramid level. */
#include "bake/depth/tile.h"

enum umbb_layer {
    UMBB_LAYER_OPEN = 0,  /* nearest face of open casters */
    UMBB_LAYER_FRONT = 1, /* nearest front face of closed parts */
    UMBB_LAYER_BACK = 2,  /* nearest back face of closed parts */
    UMBB_LAYER_COUNT = 3,
};

/*
 * Decides lit and end of n x n texels from (x0, y0) of the tile on, and reduces them.
 *
 * In: layers: int32[UMBB_LAYER_COUNT][n * n] by 8x8 blocks; without the closed rule only the open
 *     one is read. n, x0, y0: multiples of 8.
 */
typedef void (*umbb_store_fn)(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0,
                              int32_t y0);

/* Plain C: the definition. */
void umbb_store_plain(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0,
                      int32_t y0);

/* A row of eight texels at a time; NULL if this build or this processor lacks AVX2. */
umbb_store_fn umbb_store_avx2(void);

#endif
