/* SPDX-License-Identifier: Apache-2.0 */
/* See small_bake.h. */
#include "bake/small_bake.h"

#include <string.h>

#include "bake/bake_frusta.h"
#include "bake/base/bake_progress.h"
#include "base/try.h"
#include "common/sha256.h"
#include "format/content.h"
#include "format/layout.h"
#include "format/pack_cut.h"
#include "format/pack_survey.h"
#include "tool/clock.h"

/* Log2 of the largest tile: small tiles save the time that the kernel takes for fresh memory. */
#define TILE_LOG2 10U
/* Limit of the map of first occluders. */
#define DEPTH_MAX_BYTES ((size_t)48 << 20)

enum umb_status umbb_small_fit(const struct umbb_small_job *job, uint32_t log2_size,
                               struct umb_error *error)
{
    UMB__TRY(umbb_analysis_need_corners(job->analysis, job->view, error));
    return umbb_analysis_refit(job->analysis, log2_size, error);
}

enum umb_status umbb_small_divide(const struct umbb_small_job *job, uint32_t log2_size,
                                  struct umbb_memory_plan *plan, struct umb_error *error)
{
    struct umbb_memory_input input = job->memory;
    input.log2_size = log2_size;
    input.tile_log2 = input.tile_log2 < log2_size ? input.tile_log2 : log2_size;
    return umbb_memory_divide(&input, plan, error);
}

static enum umb_status count_bytes(void *user, const void *bytes, size_t count)
{
    (void)bytes;
    *(double *)user += (double)count;
    return UMB_OK;
}

static void take_cuts(void *user, const struct umb__pack_cuts *cuts,
                      const struct umb__kept_page *pages, uint32_t page_count)
{
    (void)pages;
    (void)page_count;
    *(double *)user = cuts->copies;
}

/* Packs an octree without writing it, for its costs. page_bytes: as in umb__pack_job. */
static enum umb_status pack(const struct umbb_small_job *job, const struct umb__octree *octree,
                            uint32_t page_bytes, struct umbb_page_costs *costs,
                            struct umb_error *error)
{
    static char nothing[] = "";
    const struct umb__content content = {
        .light_count = job->analysis->choice.count,
        .frustum_count = job->analysis->frustum_count,
        .lights = job->analysis->choice.lights,
        .frusta = job->analysis->frusta,
        .bounds = job->analysis->bounds,
        .plan = nothing,
        .settings = nothing,
    };
    const struct umb_sink sink = {count_bytes, &costs->bytes};
    const struct umb__pack_job pack = {.content = &content,
                                       .octree = octree,
                                       .sha256 = &umbs_sha256,
                                       .sink = &sink,
                                       .made = take_cuts,
                                       .made_user = &costs->copies,
                                       .page_bytes = page_bytes};
    uint8_t id[UMB_ID_BYTES];
    costs->bytes = 0;
    return umb__pack_run(&pack, id, error);
}

/* Packs into large pages, and into small ones unless their copies are too many. */
static enum umb_status pack_both(const struct umbb_small_job *job, const struct umb__octree *octree,
                                 const struct umb__pack_survey *survey, struct umbb_costs *costs,
                                 struct umb_error *error)
{
    struct umb__pack_cuts cuts;
    UMB__TRY(pack(job, octree, UMB__PAGE_BYTES_SHARED, &costs->large_pages, error));
    const enum umb_status status = umb__pack_cut(octree, survey, NULL, 0, NULL, &cuts, error);
    const int small = status == UMB_OK && cuts.page_bytes == UMB__PAGE_BYTES;
    umb__pack_cuts_finish(&cuts);
    UMB__TRY(status);
    if (small) {
        UMB__TRY(pack(job, octree, UMB__PAGE_BYTES, &costs->small_pages, error));
    }
    costs->packed_bytes = small ? costs->small_pages.bytes : costs->large_pages.bytes;
    return UMB_OK;
}

/* Measures a baked octree. */
static enum umb_status measure(const struct umbb_small_job *job, const struct umb__octree *octree,
                               struct umbb_costs *costs, struct umb_error *error)
{
    struct umb__pack_survey survey;
    UMB__TRY(umb__pack_survey(octree, &survey, error));
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        costs->level_bytes[level] = (double)survey.bytes[level];
    }
    const enum umb_status status =
        job->packed ? pack_both(job, octree, &survey, costs, error) : UMB_OK;
    umb__pack_survey_finish(&survey);
    return status;
}

enum umb_status umbb_small_bake(const struct umbb_small_job *job, uint32_t log2_size,
                                struct umbb_costs *costs, struct umb_error *error)
{
    struct umbb_options options = *job->options;
    struct umbb_memory_plan memory;
    struct umb__octree octree = {0};
    struct umbb_bake_figures figures = {0};
    struct umbb_occluder_depth_words depth = {0};
    const double start = umbu_process_cpu_s();
    const struct umbb_frusta_job bake = {.analysis = job->analysis,
                                         .view = job->view,
                                         .options = &options,
                                         .memory = &memory,
                                         .occluder_depth = job->occluder_depth ? &depth : NULL,
                                         .occluder_depth_max_bytes = DEPTH_MAX_BYTES};
    memset(costs, 0, sizeof *costs);
    options.task = UMBB_TASK_BAKE; /* everything, also if only tiles are wanted afterwards */
    options.only_given = 0;
    options.resolution_log2 = log2_size;
    options.quiet = 1;
    UMB__TRY(umbb_small_fit(job, log2_size, error));
    UMB__TRY(umbb_small_divide(job, log2_size, &memory, error));
    memory.tile_log2 = memory.tile_log2 < TILE_LOG2 ? memory.tile_log2 : TILE_LOG2;
    umbb_progress_hold(1);
    enum umb_status status = umbb_bake_frusta(&bake, &octree, &figures, error);
    umbb_progress_hold(0);
    if (status == UMB_OK) {
        status = measure(job, &octree, costs, error);
    }
    umb__octree_finish(&octree);
    costs->depth_bytes = (double)depth.count * sizeof *depth.words;
    umb__occluder_depth_words_free(NULL, depth.words);
    costs->seconds = umbu_process_cpu_s() - start;
    costs->octree_bytes = (double)figures.octree_bytes;
    return status;
}
