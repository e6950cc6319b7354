/* SPDX-License-Identifier: Apache-2.0 */
/* Hostile scene buffers: what validation accepts must be safe to flatten, hash and take apart. */
#include <math.h>
#include <string.h>

#include "scene/parts.h"
#include "scene/scene.h"
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct umbs_scene_view view;
    struct umb_error error = {0};
    uint8_t *exact = malloc(size ? size : 1); /* malloc aligns; the block ends where the data do */
    if (!exact) {
        return 0;
    }
    memcpy(exact, data, size);
    if (umbs_scene_view(exact, size, &view, &error) == UMB_OK &&
        view.world_triangle_count < 100000) {
        double(*corners)[3][3] = NULL;
        uint32_t *materials = NULL;
        size_t count = 0;
        uint8_t hash[UMB_ID_BYTES];
        struct umbs_parts parts;
        umbs_scene_hash(&view, hash);
        if (umbs_scene_flatten(&view, &corners, &materials, &count, NULL) == UMB_OK) {
            FUZZ_DEMAND(count == view.world_triangle_count);
            if (umbs_parts_find((const double(*)[3][3])corners, count, &parts, NULL) == UMB_OK) {
                FUZZ_DEMAND(parts.closed_triangles <= count);
                umbs_parts_finish(&parts);
            }
        }
        free(corners);
        free(materials);
    }
    free(exact);
    return 0;
}
