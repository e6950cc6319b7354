/* SPDX-License-Identifier: Apache-2.0 */
/* See self_check.h. squares_check.c has the part that uses records of earlier bakes. */
#include "bake/write/self_check.h"

#include "bake/base/bake_progress.h"
#include "bake/base/interrupt.h"
#include "bake/write/check_verdict.h"
#include "bake/write/squares_check.h"
#include "base/try.h"

/* Seed of the compared points: fixed, so that a failure can be repeated. */
#define VERIFY_SEED 1

#define LIGHT_POINTS_MIN 20000U

uint64_t umbb_check_points(uint64_t points, uint32_t lights)
{
    const uint64_t share = points / lights;
    const uint64_t least = points < LIGHT_POINTS_MIN ? points : LIGHT_POINTS_MIN;
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

/* Compares points drawn at random in the whole asset. */
static enum umb_status compare_points(const struct umb_asset *asset, const struct umbb_check *check,
                                      uint32_t lights, struct umbb_checked *checked,
                                      struct umb_error *error)
{
    const struct umbr_rays_options quick = {
        .quick = 1, .threads = check->threads, .cuts = check->cuts};
    struct umbr_rays *rays;
    UMB__TRY(umbr_rays_build(check->corners, check->count, &quick, &rays, error));
    const uint64_t points = umbb_check_points(check->points, lights);
    struct compared compared = {.before = 0};
    umbb_progress_start(&compared.progress, check->quiet, "Mpoint", points * lights);
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
    for (uint32_t light = 0; light < lights && status == UMB_OK; light++) {
        struct umbr_verify_result result;
        status = umbr_verify(asset, light, rays, &options, &result, error);
        if (status == UMB_OK) {
            umbr_verify_result_add(&checked->verified, &result);
            compared.before = checked->verified.points;
            status = umbb_check_verdict(check, light, &result, error);
        }
    }
    umbb_progress_end(&compared.progress);
    umbr_rays_destroy(rays);
    checked->sampled = 1;
    if (status == UMB_OK && check->proofs != NULL) {
        umbb_squares_sampled(check->proofs, points);
    }
    return status;
}

/* Says what a signal leaves. */
static enum umb_status explain(enum umb_status status, struct umb_error *error)
{
    return status == UMB_E_CANCELLED ? umb_fail(error, status, "interrupted: nothing was written")
                                     : status;
}

enum umb_status umbb_self_check_part(const struct umb_asset *asset, const struct umbb_check *check,
                                     struct umbb_checked *checked, int *sample,
                                     struct umb_error *error)
{
    *checked = (struct umbb_checked){.sampled = 0};
    *sample = 1;
    return check->proofs == NULL
               ? UMB_OK
               : explain(umbb_squares_check(asset, check, checked, sample, error), error);
}

enum umb_status umbb_self_check_points(const struct umb_asset *asset,
                                       const struct umbb_check *check, struct umbb_checked *checked,
                                       struct umb_error *error)
{
    struct umb_asset_info info;
    umb_asset_get_info(asset, &info);
    return explain(compare_points(asset, check, info.light_count, checked, error), error);
}
