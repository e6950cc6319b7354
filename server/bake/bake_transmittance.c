/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the maps of all frusta, at ever lower resolutions until the maps are small enough. */
#include "bake/bake_transmittance.h"

#include <stdlib.h>
#include <string.h>

#include "bake/analysis/voxel_casters.h"
#include "bake/base/interrupt.h"
#include "bake/depth/transmittance_make.h"
#include "base/try.h"

/* Log2 of the most texels a side of a map. */
#define LEVEL_MAX 11U

/* Limit of working memory: a map that needs more has too many fragments to be useful. */
#define WORKING_MAX ((size_t)1 << 30)

/* State that all frusta share. */
struct maps {
    const struct umbb_analysis *analysis;
    const struct umbb_options *options;
    struct umb__transmittance_bytes *bytes; /* the entry so far */
    uint32_t level_max;
    size_t working_bytes;
    int too_large;
};

/* Returns a copy of a frustum with x and y in texels of a map of 2^level texels a side. */
static struct umb_frustum_info coarse_frustum(const struct umb_frustum_info *frustum,
                                              uint32_t level)
{
    const double scale = 1.0 / (double)((uint32_t)1 << (frustum->log2_size - level));
    struct umb_frustum_info coarse = *frustum;
    for (int k = 0; k < 8; k++) {
        coarse.world_to_voxel[k / 4][k % 4] *= scale; /* by a power of two: exact */
    }
    return coarse;
}

/* Appends the map of a frustum. Out: level: of the map, or 0. */
static enum umb_status make_frustum(struct maps *maps, const struct umb_frustum_info *frustum,
                                    uint8_t *level, struct umb_error *error)
{
    const uint32_t n = frustum->log2_size, most = n < maps->level_max ? n : maps->level_max;
    const struct umb_frustum_info coarse = coarse_frustum(frustum, most);
    const size_t before = maps->bytes->count;
    struct umbb_voxel_casters voxels;
    enum umb_status status = umbb_voxel_casters_translucent(maps->analysis, &coarse,
                                                            maps->working_bytes, &voxels, error);
    if (status == UMB_OK) {
        const struct umbb_transmittance_input job = {
            .casters = &voxels.casters,
            .level = most,
            .threads = maps->options->threads,
            .max_bytes = UMBB_TRANSMITTANCE_BYTES_MAX,
            .working_bytes = maps->working_bytes,
            .cancelled = umbb_interrupted,
        };
        status = umbb_transmittance_make(&job, maps->bytes, &maps->too_large, error);
    }
    umbb_voxel_casters_finish(&voxels);
    *level = maps->bytes->count > before ? (uint8_t)most : 0;
    return status;
}

/* Appends the maps of all frusta to their levels, and sets these. */
static enum umb_status make_maps(struct maps *maps, uint8_t *levels, struct umb_error *error)
{
    struct umb__transmittance_bytes *bytes = maps->bytes;
    const uint32_t count = maps->analysis->frustum_count;
    UMB__TRY(umb__transmittance_append(bytes, levels, count, UMBB_TRANSMITTANCE_BYTES_MAX, error));
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(make_frustum(maps, &maps->analysis->frusta[i], &levels[i], error));
    }
    if (bytes->count == count) { /* no frustum has a map */
        umb__transmittance_bytes_finish(bytes);
    } else {
        memcpy(bytes->data, levels, count);
    }
    return UMB_OK;
}

/* Makes the entry with maps of at most 2^level_max texels a side. */
static enum umb_status make_entry(struct maps *maps, struct umb_error *error)
{
    uint8_t *levels = calloc(maps->analysis->frustum_count, 1);
    if (levels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: memory refused");
    }
    maps->too_large = 0;
    const enum umb_status status = make_maps(maps, levels, error);
    free(levels);
    return status;
}

enum umb_status umbb_transmittance_bake(const struct umbb_analysis *analysis,
                                        const struct umbb_options *options, size_t working_bytes,
                                        struct umb__transmittance_bytes *bytes, uint32_t *level,
                                        struct umb_error *error)
{
    const uint32_t n = options->resolution_log2;
    struct maps maps = {.analysis = analysis,
                        .options = options,
                        .bytes = bytes,
                        .level_max = n < LEVEL_MAX ? n : LEVEL_MAX,
                        .working_bytes = working_bytes < WORKING_MAX ? working_bytes : WORKING_MAX};
    memset(bytes, 0, sizeof *bytes);
    *level = 0;
    if (analysis->translucent_count == 0) {
        return UMB_OK;
    }
    enum umb_status status = make_entry(&maps, error);
    while (status == UMB_E_LIMIT && maps.too_large &&
           maps.level_max > UMB__TRANSMITTANCE_LEVEL_MIN) {
        umb__transmittance_bytes_finish(bytes);
        maps.level_max--;
        status = make_entry(&maps, error);
    }
    if (status == UMB_E_LIMIT && maps.too_large) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--effect transmittance=on: the maps of %u frusta take more than %zu MiB; "
                        "bake fewer lights, or transmittance=off",
                        analysis->frustum_count, UMBB_TRANSMITTANCE_BYTES_MAX >> 20);
    }
    *level = status == UMB_OK && bytes->count > 0 ? maps.level_max : 0;
    return status;
}
