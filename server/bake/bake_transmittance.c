/* SPDX-License-Identifier: Apache-2.0 */
/* The loop over frusta, and over resolutions until the maps are small enough. */
#include "bake/bake_transmittance.h"

#include <stdlib.h>
#include <string.h>

#include "bake/analysis/cut_planes.h"
#include "bake/analysis/frusta.h"
#include "bake/analysis/light_frame.h"
#include "bake/depth/transmittance_make.h"
#include "bake/base/interrupt.h"

/* Limit of working memory: a map that needs more has too many fragments to be useful. */
#define WORKING_MAX ((size_t)1 << 30)

/* State that all frusta share. */
struct maps {
    struct umbb_analysis *analysis;
    const struct umbb_options *options;
    uint8_t *kinds; /* [translucent_count] zero: open */
    uint32_t level_max;
    size_t working_bytes;
    int too_large;
};

/* A copy of a frustum with x and y in texels of a map of 2^level texels a side. */
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

static enum umb_status make_map(struct maps *maps, const struct umbb_casters *casters,
                                uint32_t level, struct umb__transmittance_bytes *bytes,
                                struct umb_error *error)
{
    const struct umbb_transmittance_input job = {
        .casters = casters,
        .level = level,
        .threads = maps->options->threads,
        .max_bytes = UMBB_TRANSMITTANCE_BYTES_MAX,
        .working_bytes = maps->working_bytes,
        .cancelled = umbb_interrupted,
    };
    return umbb_transmittance_make(&job, bytes, &maps->too_large, error);
}

/* Makes the map of parallel light, from a projected copy of the triangles. */
static enum umb_status make_parallel(struct maps *maps, const struct umb_frustum_info *coarse,
                                     struct umbb_casters *casters, uint32_t level,
                                     struct umb__transmittance_bytes *bytes,
                                     struct umb_error *error)
{
    const struct umbb_analysis *analysis = maps->analysis;
    const size_t size = analysis->translucent_count * sizeof *analysis->translucent;
    double(*corners)[3][3] = malloc(size);
    if (corners == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: %zu bytes refused", size);
    }
    memcpy(corners, analysis->translucent, size);
    umbb_light_frame_apply(coarse, analysis->origin, corners, analysis->translucent_count);
    casters->corners = (const double(*)[3][3])corners;
    const enum umb_status status = make_map(maps, casters, level, bytes, error);
    free(corners);
    return status;
}

/* Makes the map of a spot or point light's face. */
static enum umb_status make_projected(struct maps *maps, const struct umb_frustum_info *coarse,
                                      struct umbb_casters *casters, uint32_t level,
                                      struct umb__transmittance_bytes *bytes,
                                      struct umb_error *error)
{
    const struct umbb_analysis *analysis = maps->analysis;
    const struct umb_light_info *light = &analysis->choice.lights[coarse->light];
    struct umbb_projected projected;
    struct umbb_cuts cuts = *casters->cuts;
    casters->corners = (const double(*)[3][3])analysis->translucent;
    enum umb_status status = umbb_perspective_project(
        casters, coarse, analysis->origin, umbb_light_reach(&analysis->bounds, light->position),
        maps->working_bytes, &projected, error);
    if (status == UMB_OK) {
        cuts.of = projected.cuts;
        casters->corners = (const double(*)[3][3])projected.corners;
        casters->kinds = projected.kinds;
        casters->count = projected.count;
        casters->cuts = &cuts;
        casters->depth_scale = projected.depth_scale;
        casters->depth_offset = projected.depth_offset;
        status = make_map(maps, casters, level, bytes, error);
    }
    umbb_projected_finish(&projected);
    return status;
}

/* Appends the map of a frustum. Out: levels: its level, or 0. */
static enum umb_status make_frustum(struct maps *maps, uint32_t number,
                                    struct umb__transmittance_bytes *bytes, uint8_t *levels,
                                    struct umb_error *error)
{
    struct umbb_analysis *analysis = maps->analysis;
    const struct umb_frustum_info *frustum = &analysis->frusta[number];
    const uint32_t n = frustum->log2_size, level = n < maps->level_max ? n : maps->level_max;
    const struct umb_frustum_info coarse = coarse_frustum(frustum, level);
    const size_t before = bytes->count;
    struct umbb_cuts cuts;
    umbb_cut_planes_translucent(analysis, &coarse, &cuts);
    struct umbb_casters casters = {
        .kinds = maps->kinds,
        .count = analysis->translucent_count,
        .size = (int32_t)1 << n,
        .cuts = &cuts,
    };
    const enum umb_status status =
        analysis->choice.lights[frustum->light].kind == UMB_LIGHT_DIRECTIONAL
            ? make_parallel(maps, &coarse, &casters, level, bytes, error)
            : make_projected(maps, &coarse, &casters, level, bytes, error);
    levels[number] = bytes->count > before ? (uint8_t)level : 0;
    return status;
}

/* Makes the entry with maps of at most 2^level_max texels a side. */
static enum umb_status make_entry(struct maps *maps, struct umb__transmittance_bytes *bytes,
                                  struct umb_error *error)
{
    const uint32_t count = maps->analysis->frustum_count;
    uint8_t *levels = calloc(count, 1);
    if (levels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: memory refused");
    }
    maps->too_large = 0;
    enum umb_status status =
        umb__transmittance_append(bytes, levels, count, UMBB_TRANSMITTANCE_BYTES_MAX, error);
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        status = make_frustum(maps, i, bytes, levels, error);
    }
    if (status == UMB_OK && bytes->count == count) { /* no frustum has a map */
        umb__transmittance_bytes_finish(bytes);
    } else if (status == UMB_OK) {
        memcpy(bytes->data, levels, count);
    }
    free(levels);
    return status;
}

enum umb_status umbb_transmittance_bake(struct umbb_analysis *analysis,
                                        const struct umbb_options *options, size_t working_bytes,
                                        struct umb__transmittance_bytes *bytes, uint32_t *level,
                                        struct umb_error *error)
{
    struct maps maps = {.analysis = analysis,
                        .options = options,
                        .level_max = UMBB_TRANSMITTANCE_LEVEL_MAX,
                        .working_bytes = working_bytes < WORKING_MAX ? working_bytes : WORKING_MAX};
    memset(bytes, 0, sizeof *bytes);
    *level = 0;
    if (analysis->translucent_count == 0) {
        return UMB_OK;
    }
    maps.kinds = calloc(analysis->translucent_count, 1);
    if (maps.kinds == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: memory refused");
    }
    maps.level_max =
        maps.level_max < options->resolution_log2 ? maps.level_max : options->resolution_log2;
    enum umb_status status = make_entry(&maps, bytes, error);
    while (status == UMB_E_LIMIT && maps.too_large &&
           maps.level_max > UMB__TRANSMITTANCE_LEVEL_MIN) {
        umb__transmittance_bytes_finish(bytes);
        maps.level_max--;
        status = make_entry(&maps, bytes, error);
    }
    free(maps.kinds);
    if (status == UMB_E_LIMIT && maps.too_large) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--effect transmittance=on: the maps of %u frusta take more than %zu MiB; "
                        "bake fewer lights, or transmittance=off",
                        analysis->frustum_count, UMBB_TRANSMITTANCE_BYTES_MAX >> 20);
    }
    *level = status == UMB_OK && bytes->count > 0 ? maps.level_max : 0;
    return status;
}
