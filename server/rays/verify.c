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
    umbr_verify_result_add(total, result);
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

static enum umb_status compare_block(void *user, size_t first, size_t count,
                                     struct umb_error *error)
{
    static void (*const run[])(struct umbr_verify_block * block, uint64_t count) = {
        umbr_verify_points, umbr_verify_segments, umbr_verify_columns, umbr_verify_boxes};
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
    run[job->options->kind](&block, count);
    if (block.status != UMB_OK) {
        return umb_fail(error, UMB_E_NO_MEMORY, "verification: memory for rays in doubles refused");
    }
    add_result(crew, number, &block.result);
    return UMB_OK;
}

/* Makes the light's position local, and computes the distance from a lamp within which nothing
 * casts. A bake leaves out casters nearer than 2^-26 of the distance to the farthest corner of the
 * casters' box, and a surface that the lamp is on (bake/analysis/frusta.h). */
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

static enum umb_status prepare_exact(const struct umbr_verify_job *job,
                                     const struct umbr_exact **exact, struct umb_error *error)
{
    *exact = NULL;
    for (uint32_t i = 0; i < job->light.frustum_count; i++) {
        if (umbr_verify_needs_exact(&job->frames[i], job->rays)) {
            return umbr_rays_exact(job->rays, exact, error);
        }
    }
    return UMB_OK;
}

/* Checks that the light answers queries of the kind, and prepares them. */
static enum umb_status prepare_queries(struct umbr_verify_job *job, uint32_t light,
                                       struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = light,
        .taps = 1,
        .bias_mode = UMB_BIAS_NONE,
        .format = UMB_ANSWER_U8,
        .opaque_only = 1, /* translucent casters are judged apart */
    };
    if (umb_asset_get_light(job->asset, light, &job->light) != UMB_OK) {
        return umb_fail(error, UMB_E_ARGUMENT, "light %u is not in the asset", light);
    }
    UMB__TRY(umb_query_prepare(job->asset, &settings, &job->query, error));
    UMB__TRY(umbr_verify_light_prepare(job, light, error));
    if (job->options->kind != UMBR_VERIFY_POINTS) {
        UMB__TRY(umb_volume_prepare(job->asset, light, &job->volume, error));
    }
    if (job->options->kind == UMBR_VERIFY_COLUMNS) {
        UMB__TRY(umb_volume_check_columns(&job->volume, error));
    }
    return job->light.frustum_count > 0
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "light %u has no frustum", light);
}

enum umb_status umbr_verify_job_open(struct umbr_verify_job *job, uint32_t light,
                                     const struct umbr_exact **exact, struct umb_error *error)
{
    UMB__TRY(prepare_queries(job, light, error));
    const uint32_t count = job->light.frustum_count;
    struct umb_asset_info info;
    umb_asset_get_info(job->asset, &info);
    job->is_static = info.receiver_mask_bytes > 0;
    place_light(job, &info);
    job->frames = umb__alloc_zeroed(NULL, count, sizeof *job->frames);
    if (job->frames == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory for %u frusta", count);
    }
    for (uint32_t i = 0; i < count; i++) {
        UMB__TRY(umbr_light_frame_init(&job->frames[i], job->asset, job->light.first_frustum + i,
                                       error));
    }
    return prepare_exact(job, exact, error);
}

void umbr_verify_job_close(struct umbr_verify_job *job)
{
    umb__free(NULL, job->frames);
    job->frames = NULL;
}

enum umb_status umbr_verify(const struct umb_asset *asset, uint32_t light,
                            const struct umbr_rays *rays, const struct umbr_verify_options *options,
                            struct umbr_verify_result *result, struct umb_error *error)
{
    static const struct umbr_verify_options defaults = {0};
    const struct umbr_verify_options *o = options != NULL ? options : &defaults;
    struct crew crew = {.job = {.asset = asset, .rays = rays, .options = o}};
    *result = (struct umbr_verify_result){0};
    enum umb_status status = umbr_verify_job_open(&crew.job, light, &crew.exact, error);
    if (status == UMB_OK && pthread_mutex_init(&crew.lock, NULL) != 0) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "no memory for a mutex");
    }
    if (status == UMB_OK) {
        status = umbu_range_run(o->threads > 0 ? o->threads : umbu_processor_count(),
                                o->points > 0 ? (size_t)o->points : DEFAULT_POINTS, BLOCK_POINTS,
                                compare_block, &crew, error);
        (void)pthread_mutex_destroy(&crew.lock);
    }
    if (status == UMB_OK) {
        *result = crew.total;
    }
    umbr_verify_job_close(&crew.job);
    return status;
}
