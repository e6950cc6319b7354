/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Comparing an asset with traced rays: threads work on blocks of points. verify_draw.c draws the
 * points, verify_judge.c judges the answers.
 */
#include "rays/verify.h"

#include <math.h>
#include <pthread.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "rays/verify_block.h"
#include "tool/threads.h"

enum {
    BLOCK_POINTS = 2048,
    DEFAULT_POINTS = 1000000,
};

/* The job and its sums. */
struct crew {
    struct umbr_verify_job job;
    const struct umbr_exact *exact; /* NULL: no frustum needs it */
    pthread_mutex_t lock;           /* guards total, worst_block and calls of progress */
    struct umbr_verify_result total;
    uint64_t worst_block;
};

static void add_result(struct crew *crew, uint64_t number, const struct umbr_verify_result *result)
{
    (void)pthread_mutex_lock(&crew->lock);
    struct umbr_verify_result *total = &crew->total;
    total->records += result->records;
    total->points += result->points;
    total->near_boundary += result->near_boundary;
    total->skipped_inside += result->skipped_inside;
    total->inside_band += result->inside_band;
    total->outside_band += result->outside_band;
    if (result->has_worst && (!total->has_worst || number < crew->worst_block)) {
        total->has_worst = 1;
        memcpy(total->worst_point, result->worst_point, sizeof total->worst_point);
        crew->worst_block = number;
    }
    if (crew->job.options->progress != NULL) {
        crew->job.options->progress(crew->job.options->progress_user,
                                    total->records > 0 ? total->records : total->points);
    }
    (void)pthread_mutex_unlock(&crew->lock);
}

/* Compares `count` records. */
static void run_block(struct umbr_verify_block *block, uint64_t count)
{
    uint64_t missing;
    switch (block->job->options->kind) {
    case UMBR_VERIFY_SEGMENTS:
        umbr_verify_segments(block, count);
        break;
    case UMBR_VERIFY_COLUMNS:
        umbr_verify_columns(block, count);
        break;
    case UMBR_VERIFY_BOXES:
        umbr_verify_boxes(block, count);
        break;
    default:
        if (block->job->is_static) {
            umbr_verify_surfaces(block, count);
            break;
        }
        umbr_verify_outside(block, count / 4);
        missing = umbr_verify_near(block, count / 2);
        umbr_verify_uniform(block, count - count / 2 + missing);
    }
}

static enum umb_status compare_block(void *user, size_t first, size_t count,
                                     struct umb_error *error)
{
    struct crew *crew = user;
    const struct umbr_verify_job *job = &crew->job;
    const uint64_t number = first / BLOCK_POINTS;
    if (job->options->cancelled != NULL && job->options->cancelled()) {
        return umb_fail(error, UMB_E_CANCELLED, "verification: cancelled");
    }
    struct umbr_verify_block block = {
        .job = job,
        .light_frame = &job->frames[number % job->light.frustum_count],
        .random = job->options->seed,
    };
    block.exact = umbr_verify_needs_exact(block.light_frame, job->rays) ? crew->exact : NULL;
    /* Two steps of the generator keep neighbouring seeds and blocks apart. */
    block.random = umbr_next_random(&block) + number * UINT64_C(0xd1342543de82ef95);
    block.random = umbr_next_random(&block);
    run_block(&block, count);
    if (block.status != UMB_OK) {
        return umb_fail(error, UMB_E_NO_MEMORY, "verification: memory for rays in doubles refused");
    }
    add_result(crew, number, &block.result);
    return UMB_OK;
}

/* Makes the light local, and computes the distance from a lamp within which nothing casts. A bake
 * leaves out casters nearer than 2^-26 of the distance to the farthest corner of the casters' box,
 * and a surface that the lamp is on (bake/analysis/lamp_contact.h). */
static void place_light(struct umbr_verify_job *job, const struct umb_asset_info *info)
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        const double at = job->light.position[k];
        const double far = fmax(fabs(info->bounds.min[k] - at), fabs(info->bounds.max[k] - at));
        square += far * far;
        job->origin[k] = info->origin[k];
        job->light.position[k] -= info->origin[k];
    }
    job->bounds = info->bounds;
    job->free_m = 0x1p-27 * sqrt(square);
}

/* Makes rays in doubles if some frustum needs them. */
static enum umb_status prepare_exact(struct crew *crew, struct umb_error *error)
{
    const struct umbr_verify_job *job = &crew->job;
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; status == UMB_OK && i < job->light.frustum_count; i++) {
        if (umbr_verify_needs_exact(&job->frames[i], job->rays)) {
            status = umbr_rays_exact(job->rays, &crew->exact, error);
        }
    }
    return status;
}

static enum umb_status prepare(struct umbr_verify_job *job, uint32_t light, struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = light,
        .taps = 1,
        .bias_mode = UMB_BIAS_NONE,
        .format = UMB_ANSWER_U8,
        .opaque_only = 1, /* rays know only opaque and open */
    };
    enum umb_status status = umb_asset_get_light(job->asset, light, &job->light);
    if (status != UMB_OK) {
        return umb_fail(error, UMB_E_ARGUMENT, "light %u is not in the asset", light);
    }
    UMB__TRY(umb_query_prepare(job->asset, &settings, &job->query, error));
    if (job->options->kind != UMBR_VERIFY_POINTS) {
        status = umb_volume_prepare(job->asset, light, &job->volume, error);
    }
    if (status == UMB_OK && job->options->kind == UMBR_VERIFY_BOXES) {
        status = umb_volume_check_parallel(&job->volume, error);
    }
    if (status == UMB_OK && job->options->kind == UMBR_VERIFY_COLUMNS) {
        status = umb_volume_check_columns(&job->volume, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    if (job->light.frustum_count == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "light %u has no frustum", light);
    }
    struct umb_asset_info info;
    umb_asset_get_info(job->asset, &info);
    job->is_static = info.receiver_mask_bytes > 0;
    place_light(job, &info);
    job->frames = umb__alloc_zeroed(NULL, job->light.frustum_count, sizeof *job->frames);
    if (job->frames == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory for %u frusta",
                        job->light.frustum_count);
    }
    for (uint32_t i = 0; status == UMB_OK && i < job->light.frustum_count; i++) {
        status =
            umbr_light_frame_init(&job->frames[i], job->asset, job->light.first_frustum + i, error);
    }
    return status;
}

enum umb_status umbr_verify(const struct umb_asset *asset, uint32_t light,
                            const struct umbr_rays *rays, const struct umbr_verify_options *options,
                            struct umbr_verify_result *result, struct umb_error *error)
{
    static const struct umbr_verify_options defaults = {0};
    struct crew crew = {.job = {.asset = asset, .rays = rays}};
    *result = (struct umbr_verify_result){0};
    crew.job.options = options != NULL ? options : &defaults;
    const unsigned threads = crew.job.options->threads;
    const uint64_t points =
        crew.job.options->points > 0 ? crew.job.options->points : DEFAULT_POINTS;
    enum umb_status status = prepare(&crew.job, light, error);
    if (status == UMB_OK) {
        status = prepare_exact(&crew, error);
    }
    if (status == UMB_OK && pthread_mutex_init(&crew.lock, NULL) != 0) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "no memory for a mutex");
    }
    if (status == UMB_OK) {
        status = umbu_range_run(threads > 0 ? threads : umbu_processor_count(), (size_t)points,
                                BLOCK_POINTS, compare_block, &crew, error);
        (void)pthread_mutex_destroy(&crew.lock);
    }
    if (status == UMB_OK) {
        *result = crew.total;
    }
    umb__free(NULL, crew.job.frames);
    return status;
}
