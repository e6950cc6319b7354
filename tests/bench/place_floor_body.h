/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of a floor; included by place_floor_avx2.c and place_floor_avx512.c, which name the
 * function (PLACE_FLOOR) and include the lanes that points are placed in. No guard: each includes
 * it once.
 */
#include "place_floor.h"

#include "query/kernel_place_lanes.h"

void PLACE_FLOOR(const struct umb_query *query, const struct umb_points *points, float *answers)
{
    const struct umb__query *q = (const struct umb__query *)(const void *)query->opaque;
    struct umb_query_stats stats = {0};
    struct umb__block block;
    struct umb__lane_placer placer;
    umb__lane_placer_init(q, points, &placer);
    for (size_t first = 0; first < points->count; first += block.size) {
        const size_t left = points->count - first;
        block.size = left < UMB__BLOCK ? (uint32_t)left : UMB__BLOCK;
        umb__lane_place_block(&placer, first, &block, &stats);
        for (uint32_t i = 0; i < block.size; i++) {
            block.lit[i] = (uint32_t)(block.x[i] ^ block.y[i] ^ block.z[i]) & 1;
        }
        umb__store_block(q, &block, first, answers);
    }
}
