/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a floor; included by place_floor_avx2.c and place_floor_avx512.c, which name the
 * function (PLACE_FLOOR) and what places points (PLACER, PLACER_INIT, PLACE). No guard: each
 * includes it once.
 */
#include "place_floor.h"

void PLACE_FLOOR(const struct umb_query *query, const struct umb_points *points, float *answers)
{
    const struct umb__query *q = (const struct umb__query *)(const void *)query->opaque;
    struct umb_query_stats stats = {0};
    struct umb__block block;
    struct PLACER placer;
    PLACER_INIT(q, points, &placer);
    for (size_t first = 0; first < points->count; first += block.size) {
        const size_t left = points->count - first;
        block.size = left < UMB__BLOCK ? (uint32_t)left : UMB__BLOCK;
        PLACE(&placer, first, &block, &stats);
        for (uint32_t i = 0; i < block.size; i++) {
            block.lit[i] = (uint32_t)(block.x[i] ^ block.y[i] ^ block.z[i]) & 1;
        }
        umb__store_block(q, &block, first, answers);
    }
}
