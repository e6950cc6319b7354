/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `verify`: compares an asset file with rays through the scene it was baked from.
 *
 * Exit code 1: the asset disagrees with the rays outside the one-voxel band around shadow
 * boundaries, where it must not (rays/verify.h).
 */
#include "study/setup.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include "base/try.h"
#include "rays/verify_squares.h"
#include "study/verify_bounds.h"
#include "tool/clock.h"
#include "tool/progress.h"

#define BOUND_POINTS_MAX 10000000U

struct verify {
    struct umbt_common common;
    const char *file;
    enum umbr_verify_kind kind;
    uint64_t points, light;
    int bounds, every_voxel;
    struct umb_asset *asset;
    struct umb_asset_info info;
    uint32_t first_light, light_count;  /* range of lights to verify */
    struct umbr_verify_result *results; /* [light_count] */
    double seconds;
    uint64_t outside_band;
};

static const char *const ASKED[] = {"points", "segments", "columns", "boxes"};

#define AT(field) UMBU_AT(struct verify, field)

static const struct umbu_option OPTIONS[] = {
    {"FILE", NULL, "the asset file", UMBU_TEXT, AT(file), .needed = true},
    {"scene", "SCENE", "scene file that the asset was baked from", UMBU_TEXT, UMBT_AT(scene_path),
     .needed = true},
    {"bounds", NULL,
     "checks the asset's accuracy curve instead: where the answer of a setting differs from a ray, "
     "a true boundary must lie within the setting's bound",
     UMBU_FLAG, AT(bounds)},
    {"every-voxel", NULL,
     "compares all voxels with a ray through each column, 0.3 to 1 us a column on one processor, "
     "instead of points drawn at random",
     UMBU_FLAG, AT(every_voxel)},
    {"points", "N", "number of points for each light, at most 1000000000; 10000000 with --bounds",
     UMBU_COUNT(1, 1000000000), AT(points), .otherwise = "1000000, with --bounds 100000"},
    {"ask", "WHAT", "kind of the queries, --points of them: points, segments, columns or boxes",
     UMBU_CHOICE("points|segments|columns|boxes"), AT(kind), .standard = "points"},
    {.setting = "light",
     .help = "number of the only light to verify",
     AT(light),
     .max = UMB_LIGHTS_MAX - 1,
     .otherwise = "all"},
    {UMBT_SEED_ROW},
    {UMBT_THREADS_ROW},
    {UMBT_FORCE_ROW},
    {UMBT_JSON_ROW},
    {UMBT_QUIET_ROW("print nothing")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-study verify",
    .usage = "umbrage verify FILE --scene SCENE [options]",
    .summary = "Compares an asset with rays traced through the scene it was baked from. Half of\n"
               "the points lie within 4 voxels of a shadow boundary; of an asset baked under the\n"
               "static rule all lie on surfaces. Behind translucent casters the light that they\n"
               "leave is compared, too. Disagreement within one voxel of a boundary is\n"
               "counted; outside that band there must be none.",
    .notes = "Exit codes: 0 agrees, 1 disagrees outside the band, 2 usage, 65 bad data (also\n"
             "another scene), 66 no input, 69 unavailable, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

static enum umb_status options_check(struct verify *verify, struct umb_error *error)
{
    if (verify->every_voxel &&
        (verify->points > 0 || verify->bounds || verify->kind != UMBR_VERIFY_POINTS)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--every-voxel: does not go with --points, --ask and --bounds");
    }
    if (verify->points == 0) {
        verify->points = verify->bounds ? 100000 : 1000000;
    }
    if (verify->bounds && verify->points > BOUND_POINTS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "--points: %" PRIu64 ", at most %u with --bounds",
                        verify->points, BOUND_POINTS_MAX);
    }
    return verify->bounds && verify->kind != UMBR_VERIFY_POINTS
               ? umb_fail(error, UMB_E_ARGUMENT, "--ask: %s does not go with --bounds",
                          ASKED[verify->kind])
               : UMB_OK;
}

static enum umb_status inputs_open(struct verify *verify, struct umb_error *error)
{
    UMB__TRY(umb_asset_open_file(verify->file, NULL, &verify->asset, error));
    umb_asset_get_info(verify->asset, &verify->info);
    verify->light_count = verify->info.light_count;
    if (verify->light != UINT64_MAX) {
        if (verify->light >= verify->info.light_count) {
            return umb_fail(error, UMB_E_NOT_FOUND, "--light: %u, the lights of %s are 0 to %u",
                            (unsigned)verify->light, verify->file, verify->info.light_count - 1);
        }
        verify->first_light = (uint32_t)verify->light;
        verify->light_count = 1;
    }
    UMB__TRY(umbt_scene_init(&verify->common.scene, verify->common.scene_path,
                             umbt_scene_flags_of(verify->info.plan), error));
    return umbt_common_match(&verify->common, verify->file, verify->info.scene_hash, error);
}

/* 1 if the light's frusta were baked under the closed rule. */
static int light_is_closed(const struct umb_asset *asset, uint32_t light)
{
    struct umb_light_info info;
    struct umb_frustum_info frustum;
    if (umb_asset_get_light(asset, light, &info) != UMB_OK ||
        umb_asset_get_frustum(asset, info.first_frustum, &frustum) != UMB_OK) {
        return 0;
    }
    return frustum.closed;
}

/* Progress over all lights, in millions of points. */
struct compared {
    struct umbu_progress progress;
    double before, total;
};

static void show_compared(void *user, uint64_t points)
{
    struct compared *compared = user;
    const double done = compared->before + 1e-6 * (double)points;
    umbu_progress_show(&compared->progress, done, done / compared->total);
}

/* Points, or columns, to compare for a light. */
static uint64_t wanted(const struct verify *verify, uint32_t light)
{
    return verify->every_voxel ? umbr_columns_of(verify->asset, light) : verify->points;
}

/* Verifies one light. */
static enum umb_status light_verify(struct verify *verify, uint32_t light,
                                    struct compared *compared, struct umbr_verify_result *result,
                                    struct umb_error *error)
{
    const struct umbt_scene *scene = &verify->common.scene;
    const struct umbr_verify_options options = {
        .points = verify->points,
        .kind = verify->kind,
        .seed = verify->common.seed,
        .closed = light_is_closed(verify->asset, light) ? scene->parts.closed : NULL,
        .layers = scene->casts.layers,
        .threads = verify->common.threads,
        .progress = show_compared,
        .progress_user = compared,
    };
    return verify->every_voxel
               ? umbr_verify_voxels(verify->asset, light, scene->rays, &options, result, error)
               : umbr_verify(verify->asset, light, scene->rays, &options, result, error);
}

static enum umb_status lights_verify(struct verify *verify, struct umb_error *error)
{
    verify->results =
        calloc(verify->light_count > 0 ? verify->light_count : 1, sizeof *verify->results);
    if (verify->results == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%u results do not fit in memory",
                        verify->light_count);
    }
    const double start = umbu_clock_s();
    struct compared compared = {.total = 0};
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < verify->light_count; i++) {
        compared.total += 1e-6 * (double)wanted(verify, verify->first_light + i);
    }
    umbu_progress_begin(&compared.progress, verify->every_voxel ? "Mcolumns" : "Mpoints",
                        verify->common.quiet);
    for (uint32_t i = 0; i < verify->light_count && status == UMB_OK; i++) {
        const uint32_t light = verify->first_light + i;
        status = light_verify(verify, light, &compared, &verify->results[i], error);
        verify->outside_band += verify->results[i].outside_band;
        compared.before += 1e-6 * (double)wanted(verify, light);
    }
    umbu_progress_end(&compared.progress);
    verify->seconds = umbu_clock_s() - start;
    for (uint32_t i = 0; i < verify->light_count && status == UMB_OK; i++) {
        if (verify->results[i].points == 0 &&
            !verify->every_voxel) { /* must not pass for agreement */
            status = umb_fail(error, UMB_E_BAD_SCENE,
                              "light %u: no point can be compared: all %" PRIu64
                              " drawn lie inside closed solids",
                              verify->first_light + i, verify->results[i].skipped_inside);
        }
    }
    return status;
}

static double rate(uint64_t part, uint64_t whole)
{
    return whole > 0 ? (double)part / (double)whole : 0.0;
}

/* Prints what was compared with a light. In: i: index of its result. */
static void report_counts(const struct verify *verify, uint32_t i)
{
    const struct umbr_verify_result *result = &verify->results[i];
    const uint32_t light = verify->first_light + i;
    if (verify->every_voxel) {
        printf("light %u: all voxels of %" PRIu64 " columns compared, %" PRIu64
               " of them one by one, ",
               light, result->records, result->points);
        return;
    }
    if (result->records > 0) {
        printf("light %u: %" PRIu64 " %s asked\n", light, result->records, ASKED[verify->kind]);
    }
    printf("light %u: %" PRIu64 " %s compared, ", light, result->points,
           verify->kind > UMBR_VERIFY_SEGMENTS ? ASKED[verify->kind] : ASKED[0]);
}

static void report_text(const struct verify *verify)
{
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(verify->info.id, id);
    printf("asset %s\nscene %s: %zu triangles, %zu in closed parts\n", id,
           verify->common.scene_path, verify->common.scene.count,
           verify->common.scene.parts.closed_triangles);
    for (uint32_t i = 0; i < verify->light_count; i++) {
        const struct umbr_verify_result *result = &verify->results[i];
        report_counts(verify, i);
        if (verify->kind == UMBR_VERIFY_POINTS && !verify->every_voxel &&
            verify->info.receiver_mask_bytes == 0) {
            printf("%" PRIu64 " near a boundary, ", result->near_boundary);
        }
        if (result->translucent > 0) {
            printf("%" PRIu64 " behind translucent casters, ", result->translucent);
        }
        printf("%" PRIu64 " inside solids left out\n"
               "  inside the band:  %" PRIu64 " disagree (%.4f %%)\n"
               "  outside the band: %" PRIu64 " disagree (%.6f %%)\n",
               result->skipped_inside, result->inside_band,
               100.0 * rate(result->inside_band, result->points), result->outside_band,
               100.0 * rate(result->outside_band, result->points));
        if (result->has_worst) {
            printf("  for example at %.9g %.9g %.9g\n", result->worst_point[0],
                   result->worst_point[1], result->worst_point[2]);
        }
    }
    printf("%s in %.2f s\n", verify->outside_band > 0 ? "DISAGREES" : "agrees", verify->seconds);
}

static void report_json(const struct verify *verify)
{
    struct umbu_json json = {.file = stdout};
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(verify->info.id, id);
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "asset", id);
    umbu_json_text(&json, "scene", verify->common.scene_path);
    UMBU_JSON_COUNTS(&json, {"triangles", verify->common.scene.count},
                     {"closed_triangles", verify->common.scene.parts.closed_triangles},
                     {"seed", verify->common.seed});
    umbu_json_rounded(&json, "seconds", verify->seconds, 6);
    umbu_json_bool(&json, "agrees", verify->outside_band == 0);
    umbu_json_begin(&json, "lights", '[');
    for (uint32_t i = 0; i < verify->light_count; i++) {
        const struct umbr_verify_result *result = &verify->results[i];
        umbu_json_begin(&json, NULL, '{');
        UMBU_JSON_COUNTS(&json, {"light", verify->first_light + i}, {"records", result->records},
                         {"points", result->points}, {"near_boundary", result->near_boundary},
                         {"skipped_inside", result->skipped_inside},
                         {"translucent", result->translucent}, {"inside_band", result->inside_band},
                         {"outside_band", result->outside_band});
        UMBU_JSON_VALUES(&json, 9, {"inside_rate", rate(result->inside_band, result->points)},
                         {"outside_rate", rate(result->outside_band, result->points)});
        if (result->has_worst) {
            umbu_json_vector(&json, "worst_point", result->worst_point);
        }
        umbu_json_end(&json, '}');
    }
    umbu_json_close(&json);
}

static enum umb_status verify_run(void *state, const struct umbu_parsed *parsed,
                                  struct umb_error *error)
{
    struct verify *verify = state;
    verify->light = umbu_given(parsed, "light") ? verify->light : UINT64_MAX;
    UMB__TRY(options_check(verify, error));
    UMB__TRY(inputs_open(verify, error));
    if (verify->bounds) {
        struct umbt_bounds bounds = {.common = &verify->common,
                                     .asset = verify->asset,
                                     .first_light = verify->first_light,
                                     .light_count = verify->light_count,
                                     .points = verify->points};
        UMB__TRY(umbt_bounds_verify(&bounds, error));
        verify->common.code = bounds.beyond > 0;
        return UMB_OK;
    }
    UMB__TRY(lights_verify(verify, error));
    if (verify->common.json) {
        report_json(verify);
    } else if (!verify->common.quiet) {
        report_text(verify);
    }
    verify->common.code = verify->outside_band > 0;
    return UMB_OK;
}

static void finish(void *state)
{
    struct verify *verify = state;
    free(verify->results);
    umb_asset_close(verify->asset);
}

const struct umbt_command umbt_verify = {
    .options = &COMMAND, .bytes = sizeof(struct verify), .run = verify_run, .finish = finish};
