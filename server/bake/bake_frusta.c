/* SPDX-License-Identifier: Apache-2.0 */
/* The loop over frusta. */
#include "bake/bake_frusta.h"

#include <stdlib.h>
#include <string.h>

#include "bake/depth/depth_embree.h"
#include "bake/depth/depth_perspective.h"
#include "bake/depth/depth_raster.h"
#include "bake/interrupt.h"
#include "bake/progress.h"

/* What all frusta share. */
struct series {
    const struct umbb_options *options;
    const struct umbb_memory_plan *memory;
    struct umb_pool pool;
    struct umbb_progress progress;
    uint64_t texels_before; /* of the frusta already baked */
    struct umbb_bake_figures figures;
};

static void series_progress(void *user, uint64_t texels_done)
{
    struct series *series = user;
    umbb_progress_update(&series->progress, series->texels_before + texels_done);
}

static enum umb_status open_depth(const struct series *series, const struct umbb_casters *casters,
                                  struct umbb_depth *depth, struct umb_error *error)
{
    const struct umbb_depth_options options = {.tile_log2 = series->memory->tile_log2,
                                               .threads = series->options->threads,
                                               .max_bytes = series->memory->shared_max_bytes};
    if (series->options->depth == UMBB_DEPTH_EMBREE) {
        return umbb_depth_embree_create(casters, &options, depth, error);
    }
    return casters->depth_scale > 0.0
               ? umbb_depth_perspective_create(casters, &options, depth, error)
               : umbb_depth_raster_create(casters, &options, depth, error);
}

/* Bakes a frustum from casters in its voxel space. */
static enum umb_status bake_one(struct series *series, const struct umbb_casters *casters,
                                const struct umb_frustum_info *frustum, uint32_t *root,
                                struct umb_error *error)
{
    struct umbb_depth depth;
    enum umb_status status = open_depth(series, casters, &depth, error);
    if (status != UMB_OK) {
        return status;
    }
    const struct umbb_bake_options options = {
        .log2_size = frustum->log2_size,
        .tile_log2 = series->memory->tile_log2,
        .threads = series->options->threads,
        .closed_rule = frustum->closed,
        .octree_max_bytes = series->memory->octree_max_bytes,
        .shared_max_bytes = series->memory->shared_max_bytes,
        .cancelled = umbb_interrupted,
        .progress = series_progress,
        .progress_user = series,
    };
    struct umbb_bake_figures figures = {0};
    status = umbb_bake_into(&depth, &options, &series->pool, root, &figures, error);
    depth.destroy(depth.state);
    series->figures.texels += figures.texels;
    series->figures.tiles += figures.tiles;
    series->figures.seconds_depth += figures.seconds_depth;
    series->figures.seconds_build += figures.seconds_build;
    series->figures.octree_bytes = figures.octree_bytes;
    series->texels_before += (uint64_t)1 << (2 * frustum->log2_size);
    return status;
}

/* Brings the casters, which are in world space, before the frustum and bakes it. */
static enum umb_status bake_frustum(struct series *series, struct umbb_analysis *analysis,
                                    uint32_t number, uint32_t *root, struct umb_error *error)
{
    const struct umb_frustum_info *frustum = &analysis->frusta[number];
    const struct umb_light_info *light = &analysis->choice.lights[frustum->light];
    struct umbb_casters casters = {
        .corners = (const double(*)[3][3])analysis->corners,
        .kinds = analysis->kinds,
        .count = analysis->count,
        .size = (int32_t)1 << frustum->log2_size,
        .closed_rule = frustum->closed,
        .open_on_word = series->options->closed == UMBB_CLOSED_ON &&
                        analysis->closed_part_count < analysis->part_count,
    };
    if (light->kind == UMB_LIGHT_DIRECTIONAL) {
        umbb_analysis_to_voxels(analysis, number);
        return bake_one(series, &casters, frustum, root, error);
    }
    struct umbb_projected projected;
    enum umb_status status = umbb_analysis_project(
        analysis, number, series->memory->projected_max_bytes, &projected, error);
    if (status == UMB_OK) {
        casters.corners = (const double(*)[3][3])projected.corners;
        casters.kinds = projected.kinds;
        casters.count = projected.count;
        casters.depth_scale = projected.depth_scale;
        casters.depth_offset = projected.depth_offset;
        status = bake_one(series, &casters, frustum, root, error);
    }
    umbb_projected_finish(&projected);
    return status;
}

enum umb_status umbb_bake_frusta(struct umbb_analysis *analysis, const struct umbs_scene_view *view,
                                 const struct umbb_options *options,
                                 const struct umbb_memory_plan *memory, struct umb_octree *octree,
                                 struct umbb_bake_figures *figures, struct umb_error *error)
{
    const uint32_t count = analysis->frustum_count;
    struct series series = {.options = options, .memory = memory};
    uint32_t *roots = calloc(count, sizeof *roots), *levels = calloc(count, sizeof *levels);
    memset(octree, 0, sizeof *octree);
    umb_pool_init(&series.pool, NULL, memory->octree_max_bytes);
    umbb_progress_start(&series.progress, stderr, options->quiet, "Mtexel",
                        (uint64_t)count << (2 * options->resolution_log2));
    enum umb_status status =
        roots != NULL && levels != NULL
            ? UMB_OK
            : umb_fail(error, UMB_E_NO_MEMORY, "bake: memory for %u roots refused", count);
    for (uint32_t i = 0; i < count && status == UMB_OK; i++) {
        status = umbb_analysis_to_world(analysis, view, error);
        if (status == UMB_OK) {
            levels[i] = analysis->frusta[i].log2_size;
            status = bake_frustum(&series, analysis, i, &roots[i], error);
        }
    }
    umbb_progress_end(&series.progress);
    if (status == UMB_OK) {
        status = umb_pool_take(&series.pool, roots, levels, count, octree, error);
    }
    umb_pool_finish(&series.pool);
    free(roots);
    free(levels);
    *figures = series.figures;
    return status;
}
