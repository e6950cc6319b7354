/* SPDX-License-Identifier: Apache-2.0 */
/* The loop over frusta. */
#include "bake/bake_frusta.h"

#include <stdlib.h>
#include <string.h>

#include "base/page_alloc.h"
#include "base/try.h"
#include "bake/analysis/voxel_casters.h"
#include "bake/depth/depth.h"
#include "bake/base/interrupt.h"
#include "bake/base/bake_progress.h"
#include "format/receiver_mask.h"

/* State that all frusta share. */
struct series {
    const struct umbb_frusta_job *job;
    const struct umbb_options *options;
    const struct umbb_memory_plan *memory;
    struct umb__pool pool;
    struct umbb_tile tiles[2]; /* memory that all frusta use, one after the other */
    struct umb__occluder_depth *occluder_depths; /* [frustum_count]; NULL: not wanted */
    struct umbb_progress progress;
    uint64_t texels_total;
    uint64_t tiles_total;
    uint64_t texels_before; /* drawn for the frusta already baked */
    struct umbb_bake_figures figures;
};

/* Reports progress without the tiles found in the cache, which say nothing about the rate. */
static void series_progress(void *user, uint64_t texels_done, uint64_t tiles, uint64_t tiles_found)
{
    struct series *series = user;
    const uint64_t found = series->figures.tiles_found + tiles_found;
    umbb_progress_tiles(series->figures.tiles + tiles, series->tiles_total, found);
    series->progress.total = series->texels_total - (found << (2 * series->memory->tile_log2));
    umbb_progress_update(&series->progress, series->texels_before + texels_done);
}

static enum umb_status open_depth(const struct series *series, const struct umbb_casters *casters,
                                  struct umbb_depth *depth, struct umb_error *error)
{
    const struct umbb_depth_options options = {
        .tile_log2 = series->memory->tile_log2,
        .threads = series->options->threads,
        .prove = series->occluder_depths != NULL || series->job->receiver_mask_cells != NULL
                     ? UMBB_PROVE_NEVER
                     : UMBB_PROVE_AUTO,
        .max_bytes = series->memory->shared_max_bytes,
        .plain = series->options->depth == UMBB_DEPTH_PLAIN};
    return series->options->depth == UMBB_DEPTH_EMBREE
               ? umbb_depth_embree_create(casters, &options, depth, error)
               : umbb_depth_raster_create(casters, &options, depth, error);
}

uint64_t umbb_tile_count(const struct umbb_analysis *analysis, uint32_t tile_log2)
{
    return (uint64_t)analysis->frustum_count << (2 * (analysis->frusta[0].log2_size - tile_log2));
}

/* Range of a frustum's tiles to bake: begin .. end - 1. */
static void wanted_tiles(const struct series *series, uint32_t frustum, uint32_t *begin,
                         uint32_t *end)
{
    const struct umbb_options *o = series->options;
    const uint64_t count = (uint64_t)1 << (2 * (o->resolution_log2 - series->memory->tile_log2));
    const uint64_t before = frustum * count;
    const uint64_t first = o->only_given ? o->only_first : before;
    const uint64_t last = o->only_given ? o->only_last : before + count - 1;
    *begin = (uint32_t)(first > before ? (first - before < count ? first - before : count) : 0);
    *end = (uint32_t)(last < before ? 0 : last - before < count ? last - before + 1 : count);
}

static void add_figures(struct umbb_bake_figures *sum, const struct umbb_bake_figures *one)
{
    sum->texels += one->texels;
    sum->tiles += one->tiles;
    sum->tiles_found += one->tiles_found;
    sum->seconds_depth += one->seconds_depth;
    sum->seconds_build += one->seconds_build;
    sum->octree_bytes = one->octree_bytes; /* of all frusta so far */
}

/* Bakes a frustum from its depth. In: rule: the static rule, or NULL. */
static enum umb_status bake_depth(struct series *series, const struct umbb_depth *depth,
                                  struct umbb_static *rule, uint32_t number, uint32_t *root,
                                  struct umb_error *error)
{
    const struct umb_frustum_info *frustum = &series->job->analysis->frusta[number];
    struct umbb_tile_folder *tile_folder = series->job->tile_folder;
    struct umb__occluder_depth *occluder_depth =
        series->occluder_depths != NULL ? &series->occluder_depths[number] : NULL;
    struct umbb_cached_tiles cached_tiles = {0};
    struct umbb_bake_figures figures = {0};
    if (tile_folder != NULL) {
        const struct umbb_tile_shape shape = {
            .log2_size = frustum->log2_size,
            .tile_log2 = series->memory->tile_log2,
            .occluder_depth = occluder_depth,
        };
        umbb_tile_folder_frustum(tile_folder, number, &shape, depth);
        cached_tiles = umbb_tile_folder_cached_tiles(tile_folder);
    }
    struct umbb_bake_options options = {
        .log2_size = frustum->log2_size,
        .tile_log2 = series->memory->tile_log2,
        .threads = series->options->threads,
        .closed_rule = frustum->closed,
        .octree_max_bytes = series->memory->octree_max_bytes,
        .shared_max_bytes = series->memory->shared_max_bytes,
        .cached_tiles = tile_folder != NULL ? &cached_tiles : NULL,
        .occluder_depth = occluder_depth,
        .rule = rule,
        .tiles = series->tiles,
        .cancelled = umbb_interrupted,
        .progress = series_progress,
        .progress_user = series,
    };
    if (series->options->task == UMBB_TASK_TILE) {
        wanted_tiles(series, number, &options.only_first, &options.only_end);
    }
    const enum umb_status status =
        umbb_bake_into(depth, &options, &series->pool, root, &figures, error);
    if (tile_folder != NULL) {
        umbb_tile_folder_frustum_end(tile_folder);
    }
    add_figures(&series->figures, &figures);
    series->texels_before += figures.texels;
    return status;
}

/* Bakes a frustum from casters in its voxel space. */
static enum umb_status bake_one(struct series *series, const struct umbb_casters *casters,
                                uint32_t number, uint32_t *root, struct umb_error *error)
{
    uint64_t *cells = series->job->receiver_mask_cells;
    struct umbb_static rule = {0};
    struct umbb_depth depth;
    UMB__TRY(open_depth(series, casters, &depth, error));
    enum umb_status status = UMB_OK;
    if (cells != NULL) {
        status = umbb_static_init(&rule, casters, &series->job->analysis->frusta[number],
                                  cells + number * UMB__RECEIVER_MASK_WORDS, error);
    }
    if (status == UMB_OK) {
        status = bake_depth(series, &depth, cells != NULL ? &rule : NULL, number, root, error);
    }
    umbb_static_finish(&rule);
    depth.destroy(depth.state);
    return status;
}

/* Bakes a frustum under the static rule. This rule gives texels an `end` other than `lit`, and only
 * bakes under the closed rule have an array for `end`. So a bake without the closed rule gets it
 * here, with all casters marked as open. */
static enum umb_status bake_static(struct series *series, const struct umbb_casters *casters,
                                   uint32_t number, uint32_t *root, struct umb_error *error)
{
    struct umbb_casters ruled = *casters;
    uint8_t *open = NULL;
    if (!casters->closed_rule) {
        open = calloc(casters->count + 1, 1); /* UMBB_CASTER_OPEN */
        if (open == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "static rule: memory for %zu triangles refused",
                            casters->count);
        }
        ruled.kinds = open;
        ruled.closed_rule = 1;
    }
    const enum umb_status status = bake_one(series, &ruled, number, root, error);
    free(open);
    return status;
}

/* Makes the casters of a frustum and bakes it. */
static enum umb_status bake_frustum(struct series *series, uint32_t number, uint32_t *root,
                                    struct umb_error *error)
{
    const struct umbb_frusta_job *job = series->job;
    struct umbb_voxel_casters voxels;
    enum umb_status status = umbb_voxel_casters_make(
        job->analysis, job->view, number, job->memory->projected_max_bytes, &voxels, error);
    if (status == UMB_OK) {
        status = job->receiver_mask_cells != NULL
                     ? bake_static(series, &voxels.casters, number, root, error)
                     : bake_one(series, &voxels.casters, number, root, error);
    }
    umbb_voxel_casters_finish(&voxels);
    return status;
}

static enum umb_status open_occluder_depths(struct series *series, struct umb_error *error)
{
    const struct umbb_analysis *analysis = series->job->analysis;
    const uint32_t count = analysis->frustum_count;
    if (series->job->occluder_depth == NULL) {
        return UMB_OK;
    }
    series->occluder_depths = calloc(count, sizeof *series->occluder_depths);
    if (series->occluder_depths == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "bake: memory for %u fronts refused", count);
    }
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(umb__occluder_depth_init(&series->occluder_depths[i], NULL,
                                          analysis->frusta[i].log2_size,
                                          series->job->occluder_depth_max_bytes / count, error));
    }
    return UMB_OK;
}

static void close_occluder_depths(struct series *series)
{
    for (uint32_t i = 0;
         series->occluder_depths != NULL && i < series->job->analysis->frustum_count; i++) {
        umb__occluder_depth_finish(&series->occluder_depths[i]);
    }
    free(series->occluder_depths);
}

/* 1 if no tile of a frustum is to be baked. */
static int is_unwanted(const struct series *series, uint32_t frustum)
{
    uint32_t begin, end;
    wanted_tiles(series, frustum, &begin, &end);
    return series->options->task == UMBB_TASK_TILE && begin >= end;
}

static void finish_tiles(struct series *series)
{
    umbb_tile_finish(&series->tiles[0]);
    umbb_tile_finish(&series->tiles[1]);
}

/* Bakes the frusta of the requested tiles and joins their results. roots, levels: zeroed. */
static enum umb_status bake_all(struct series *series, uint32_t *roots, uint32_t *levels,
                                struct umb__octree *octree, struct umb_error *error)
{
    const struct umbb_frusta_job *job = series->job;
    const uint32_t count = job->analysis->frustum_count;
    UMB__TRY(open_occluder_depths(series, error));
    for (uint32_t i = 0; i < count; i++) {
        if (!is_unwanted(series, i)) {
            levels[i] = job->analysis->frusta[i].log2_size;
            UMB__TRY(bake_frustum(series, i, &roots[i], error));
        }
    }
    if (series->options->task == UMBB_TASK_TILE) {
        return UMB_OK;
    }
    finish_tiles(series);
    UMB__TRY(umb__pool_take(&series->pool, roots, levels, count, octree, error));
    if (job->tile_folder != NULL && job->tile_folder->base != NULL) {
        UMB__TRY(umbb_base_compact(job->tile_folder->base, octree, error));
    }
    return job->occluder_depth == NULL
               ? UMB_OK
               : umb__occluder_depth_join(series->occluder_depths, count,
                                          &job->occluder_depth->words, &job->occluder_depth->count,
                                          error);
}

enum umb_status umbb_bake_frusta(const struct umbb_frusta_job *job, struct umb__octree *octree,
                                 struct umbb_bake_figures *figures, struct umb_error *error)
{
    const struct umbb_options *options = job->options;
    const uint32_t count = job->analysis->frustum_count, tile_log2 = job->memory->tile_log2;
    struct series series = {.job = job, .options = options, .memory = job->memory};
    uint32_t *roots = calloc(count, sizeof *roots), *levels = calloc(count, sizeof *levels);
    memset(octree, 0, sizeof *octree);
    umb__pool_init(&series.pool, &umb__page_alloc, job->memory->octree_max_bytes);
    if (job->tile_folder != NULL && job->tile_folder->base != NULL) {
        umbb_base_load(job->tile_folder->base, &series.pool);
    }
    series.tiles_total = options->only_given ? options->only_last - options->only_first + 1
                                             : umbb_tile_count(job->analysis, tile_log2);
    series.texels_total = series.tiles_total << (2 * tile_log2);
    umbb_progress_tiles(0, series.tiles_total, 0);
    umbb_progress_start(&series.progress, options->quiet, "Mtexel", series.texels_total);
    const enum umb_status status =
        roots != NULL && levels != NULL
            ? bake_all(&series, roots, levels, octree, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "bake: memory for %u roots refused", count);
    umbb_progress_end(&series.progress);
    finish_tiles(&series);
    close_occluder_depths(&series);
    umb__pool_finish(&series.pool);
    free(roots);
    free(levels);
    *figures = series.figures;
    return status;
}
