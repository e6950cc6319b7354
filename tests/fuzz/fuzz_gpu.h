/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FUZZ_GPU_H
#define UMBRAGE_TESTS_FUZZ_GPU_H
/* The array for a GPU of a hostile asset, and the shaders' walk through it. The array is exactly as
 * long as its layout, so that the sanitizer sees every entry read or written outside. */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"
#include "make_asset.h"
#include "umbrage/gpu.h"
#include "umbrage/partial.h"
#include "umbrage.cuh"

/* A share of light, or two bounds of it. */
static inline void fuzz_demand_share(float2 share)
{
    FUZZ_DEMAND(share.x >= 0 && share.x <= share.y && share.y <= 1.0001F);
}

/* Walks from random positions in and around the frustum of a light. */
static inline void fuzz_gpu_walk(const struct umb_asset *asset, const uint4 *entries,
                                 uint32_t light)
{
    const struct umb_gpu_view view = {.light = light};
    struct umb_gpu_placement placement;
    struct umb_gpu_precision precision;
    struct umb_light_info info;
    UmbragePlacement faces[6];
    uint64_t seed = 23 + light;
    if (umb_asset_get_light(asset, light, &info) != UMB_OK ||
        umb_gpu_place(asset, &view, &placement, &precision, NULL) != UMB_OK) {
        return;
    }
    for (uint32_t i = 0; i < 6; i++) {
        memcpy(&faces[i], &placement, sizeof faces[i]);
    }
    for (uint32_t i = 0; i < 16; i++) {
        const float reach = (float)precision.range_m * (i % 2 == 0 ? 1 : 0.1F);
        const float3 at = make_float3((float)(random_unit(&seed) - 0.5) * reach,
                                      (float)(random_unit(&seed) - 0.5) * reach,
                                      (float)(random_unit(&seed) - 0.5) * reach);
        const float3 normal = make_float3(0, 0, i % 3 == 0 ? 1.0F : 0.0F);
        if (info.kind != UMB_LIGHT_DIRECTIONAL) {
            fuzz_demand_share(umbrage_lamp_box(entries, faces, 1, at, normal, 5));
            continue;
        }
        fuzz_demand_share(umbrage_box(entries, faces[0], at, normal, 5));
        fuzz_demand_share(umbrage_tent(entries, faces[0], at, normal, 17));
        fuzz_demand_share(umbrage_coarse(entries, faces[0], at, normal, 3));
        fuzz_demand_share(umbrage_footprint(entries, faces[0], at, normal, 1, reach));
        fuzz_demand_share(umbrage_penumbra(entries, faces[0], at, normal, 1, 0.05F));
    }
}

/* In: partial: the partial asset whose lower asset this is, or NULL. */
static inline void fuzz_gpu(const struct umb_asset *asset, struct umb_partial *partial)
{
    struct umb_gpu_layout layout;
    struct umb_gpu_range ranges[4];
    struct umb_asset_info info;
    if (asset == NULL || umb_gpu_layout_make(asset, 8, &layout, NULL) != UMB_OK) {
        return;
    }
    FUZZ_DEMAND(umb_gpu_layout_fits(asset, &layout));
    uint4 *entries = malloc((size_t)layout.entries * sizeof *entries);
    FUZZ_DEMAND(entries != NULL);
    umb_gpu_write(asset, partial, &layout, 0, layout.entries, &entries->x);
    for (size_t count = partial != NULL ? 4 : 0; count > 0;) {
        count = umb_gpu_changes(partial, &layout, ranges, 4);
        for (size_t i = 0; i < count; i++) {
            FUZZ_DEMAND(ranges[i].first <= layout.entries &&
                        ranges[i].count <= layout.entries - ranges[i].first);
            umb_gpu_write(asset, partial, &layout, ranges[i].first, ranges[i].count,
                          &entries[ranges[i].first].x);
        }
    }
    umb_asset_get_info(asset, &info);
    for (uint32_t light = 0; light < info.light_count && light < 4; light++) {
        fuzz_gpu_walk(asset, entries, light);
    }
    free(entries);
}

#endif
