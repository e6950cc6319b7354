/* SPDX-License-Identifier: Apache-2.0 */
/* The steps between an octree in memory and an asset under its name. */
#include "bake/write/publish.h"

#include <string.h>

#include "base/page_alloc.h"
#include "base/try.h"
#include "tool/threads.h"
#include "bake/base/interrupt.h"
#include "bake/base/bake_progress.h"
#include "common/sha256.h"

/* Seed of the compared points: fixed, so that a failure can be repeated. */
#define VERIFY_SEED 1

#define LIGHT_POINTS_MIN 20000U

enum umb_status umbb_publish_begin(struct umbb_publish *publish, const char *path,
                                   struct umb_error *error)
{
    memset(publish, 0, sizeof *publish);
    publish->threads = 1;
    return umbu_output_begin(path, 0, &publish->file, error);
}

/* A sink that counts bytes, checks for signals, and passes bytes on to the file's sink. */
struct counter {
    struct umb_sink file;
    uint64_t bytes;
};

static enum umb_status counted_write(void *user, const void *bytes, size_t count)
{
    struct counter *counter = user;
    if (umbb_interrupted()) {
        return UMB_E_CANCELLED;
    }
    counter->bytes += count;
    return counter->file.write(counter->file.user, bytes, count);
}

enum umb_status umbb_publish_write(struct umbb_publish *publish, const struct umb__content *content,
                                   const struct umb__octree *octree, struct umb_error *error)
{
    struct counter counter = {.file = umbu_output_sink(&publish->file)};
    const struct umb_sink sink = {counted_write, &counter};
    if (error != NULL) {
        error->message[0] = '\0';
    }
    struct umbu_threads *jobs;
    UMB__TRY(umbu_threads_create(publish->threads, &jobs, error));
    const struct umb_workers workers = umbu_threads_workers(jobs);
    const struct umb__pack_job job = {.content = content,
                                      .octree = octree,
                                      .sha256 = &umbs_sha256,
                                      .sink = &sink,
                                      .workers = &workers,
                                      .cancelled = umbb_interrupted};
    enum umb_status status = umb__pack_run(&job, publish->id, error);
    umbu_threads_destroy(jobs);
    publish->bytes = counter.bytes;
    if (status == UMB_E_CANCELLED) {
        return umb_fail(error, status, "interrupted: nothing was written");
    }
    return status == UMB_OK ? UMB_OK : umbu_output_explain(&publish->file, status, error);
}

static enum umb_status judge(const struct umbb_check *check, uint32_t light,
                             const struct umbr_verify_result *result, struct umb_error *error)
{
    const double *p = result->worst_point;
    if (result->outside_band == 0) {
        return UMB_OK;
    }
    if (check->open_on_word > 0) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "--closed on: %zu parts are not closed, and light gets in: light %u: %llu "
                        "of %llu points disagree with traced rays, one at %.9g %.9g %.9g; nothing "
                        "was published (--closed auto bakes such parts as they are)",
                        check->open_on_word, light, (unsigned long long)result->outside_band,
                        (unsigned long long)result->points, p[0], p[1], p[2]);
    }
    return umb_fail(error, UMB_E_INTERNAL,
                    "self-check: light %u: %llu of %llu points disagree with traced rays by more "
                    "than a voxel, one at %.9g %.9g %.9g; nothing was published",
                    light, (unsigned long long)result->outside_band,
                    (unsigned long long)result->points, p[0], p[1], p[2]);
}

/* Returns the points for each light: an equal share, but enough to reveal a wrong matrix. */
static uint64_t points_a_light(const struct umbb_check *check, uint32_t lights)
{
    const uint64_t share = check->points / lights;
    const uint64_t least = check->points < LIGHT_POINTS_MIN ? check->points : LIGHT_POINTS_MIN;
    return share > least ? share : least;
}

/* Progress over all lights. */
struct compared {
    struct umbb_progress progress;
    uint64_t before; /* points of the earlier lights */
};

static void show_compared(void *user, uint64_t points)
{
    struct compared *compared = user;
    umbb_progress_update(&compared->progress, compared->before + points);
}

static enum umb_status compare_with_rays(struct umbb_publish *publish,
                                         const struct umb_asset *asset,
                                         const struct umbb_check *check, struct umb_error *error)
{
    const struct umbr_rays_options quick = {
        .quick = 1, .threads = check->threads, .cuts = check->cuts};
    struct umbr_rays *rays;
    UMB__TRY(umbr_rays_build(check->corners, check->count, &quick, &rays, error));
    const uint64_t points = points_a_light(check, publish->info.light_count);
    struct compared compared = {.before = 0};
    umbb_progress_start(&compared.progress, check->quiet, "Mpoint",
                        points * publish->info.light_count);
    const struct umbr_verify_options options = {
        .points = points,
        .seed = VERIFY_SEED,
        .closed = check->closed,
        .threads = check->threads,
        .cancelled = umbb_interrupted,
        .progress = show_compared,
        .progress_user = &compared,
    };
    enum umb_status status = UMB_OK;
    for (uint32_t light = 0; light < publish->info.light_count && status == UMB_OK; light++) {
        struct umbr_verify_result result;
        status = umbr_verify(asset, light, rays, &options, &result, error);
        if (status == UMB_OK) {
            umbr_verify_result_add(&publish->verified, &result);
            compared.before = publish->verified.points;
            status = judge(check, light, &result, error);
        }
    }
    umbb_progress_end(&compared.progress);
    umbr_rays_destroy(rays);
    if (status == UMB_E_CANCELLED) {
        return umb_fail(error, status, "interrupted: nothing was written");
    }
    return status;
}

/* Opens the written file. Its array of nodes grows without copies, as in the bake: otherwise the
 * checks would take more memory than the bake. */
static enum umb_status reopen(const struct umbb_publish *publish, uint64_t max_memory_bytes,
                              struct umb_asset **asset, struct umb_error *error)
{
    const struct umb_open_options options = {.max_memory_bytes = max_memory_bytes,
                                             .alloc = &umb__page_alloc};
    struct umb_error cause;
    const enum umb_status status =
        umb_asset_open_file(publish->file.temporary, &options, asset, &cause);
    if (status == UMB_E_TOO_LARGE) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: too little is left to check what was baked; give more or lower "
                        "the resolution (%s)",
                        cause.message);
    }
    if (status != UMB_OK && error != NULL) {
        *error = cause;
    }
    return status;
}

enum umb_status umbb_publish_check(struct umbb_publish *publish, const struct umbb_check *check,
                                   struct umb_error *error)
{
    struct umb_asset *asset;
    enum umb_status status = UMB_OK;
    UMB__TRY(reopen(publish, check->max_memory_bytes, &asset, error));
    umb_asset_get_info(asset, &publish->info);
    if (memcmp(publish->info.id, publish->id, sizeof publish->id) != 0) {
        status = umb_fail(error, UMB_E_INTERNAL,
                          "self-check: the identity read back is not the one written");
    } else if (check->points > 0) {
        status = compare_with_rays(publish, asset, check, error);
    }
    umb_asset_close(asset);
    publish->info.plan = publish->info.settings = publish->info.notes = NULL;
    if (status == UMB_OK && umbb_interrupted()) {
        status = umb_fail(error, UMB_E_CANCELLED, "interrupted: nothing was written");
    }
    return status;
}

enum umb_status umbb_publish_commit(struct umbb_publish *publish, struct umb_error *error)
{
    return umbu_output_commit(&publish->file, error);
}

void umbb_publish_abandon(struct umbb_publish *publish)
{
    umbu_output_abandon(&publish->file);
}
