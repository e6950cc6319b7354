/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `verify`: compares an asset file with rays through the scene it was baked from.
 *
 * Exit code 1: the asset disagrees with the rays outside the one-voxel band around shadow
 * boundaries, where it must not (rays/verify.h).
 */
#include "study/study_command.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "rays/verify.h"
#include "study/bound_check.h"
#include "study/setup.h"
#include "tool/clock.h"
#include "tool/json.h"
#include "tool/progress.h"
#include "tool/threads.h"

#define BOUND_POINTS_MAX 10000000U

struct verify {
    const char *file, *scene_path;
    enum umbr_verify_kind kind;
    uint64_t points, light, seed, threads;
    int force, json, quiet, bounds;
    struct umbu_json bounds_json;
    struct umb_asset *asset;
    struct umb_asset_info info;
    struct umbt_scene scene;
    uint32_t first_light, light_count;  /* range of lights to verify */
    struct umbr_verify_result *results; /* [light_count] */
    double seconds;
    uint64_t outside_band;
    size_t rows_done; /* number of rows checked with --bounds */
};

static const char *const ASKED[] = {"points", "segments", "columns", "boxes"};

#define AT(field) UMBU_AT(struct verify, field)

static const struct umbu_option OPTIONS[] = {
    {"FILE", NULL, "the asset file", UMBU_TEXT, AT(file), .needed = true},
    {"scene", "SCENE", "scene file that the asset was baked from", UMBU_TEXT, AT(scene_path),
     .needed = true},
    {"bounds", NULL,
     "checks the asset's accuracy curve instead: where the answer of a setting differs from a ray, "
     "a true boundary must lie within the setting's bound",
     UMBU_FLAG, AT(bounds)},
    {"points", "N", "number of points for each light, at most 1000000000; 10000000 with --bounds",
     UMBU_COUNT(1, 1000000000), AT(points), .otherwise = "1000000, with --bounds 100000"},
    {"ask", "WHAT", "kind of the queries, --points of them: points, segments, columns or boxes",
     UMBU_CHOICE("points|segments|columns|boxes"), AT(kind), .standard = "points"},
    {"light", "N", "number of the only light to verify", UMBU_COUNT(0, UMB_LIGHTS_MAX - 1),
     AT(light), .otherwise = "all"},
    {UMBT_SEED_ROW(struct verify)},
    {UMBT_THREADS_ROW(struct verify)},
    {"force", NULL, "goes on even if the asset was baked from another scene", UMBU_FLAG, AT(force)},
    {UMBU_JSON_ROW(struct verify)},
    {UMBU_QUIET_ROW(struct verify, "print nothing")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-study verify",
    .usage = "umbrage verify FILE --scene SCENE [options]",
    .summary = "Compares an asset with rays traced through the scene it was baked from. Half of\n"
               "the points lie within 4 voxels of a shadow boundary; of an asset baked under the\n"
               "static rule all lie on surfaces. Disagreement within one voxel of a boundary is\n"
               "counted; outside that band there must be none.",
    .notes = "Exit codes: 0 agrees, 1 disagrees outside the band, 2 usage, 65 bad data (also\n"
             "another scene), 66 no input, 69 unavailable, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

/* Checks combinations of options. */
static enum umb_status options_check(struct verify *verify, struct umb_error *error)
{
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
            return umb_fail(error, UMB_E_NOT_FOUND, "--light: %u, but %s has %u lights",
                            (unsigned)verify->light, verify->file, verify->info.light_count);
        }
        verify->first_light = (uint32_t)verify->light;
        verify->light_count = 1;
    }
    UMB__TRY(umbt_scene_init_planned(&verify->scene, verify->scene_path, verify->info.plan, error));
    return verify->force
               ? UMB_OK
               : umbt_scene_match(&verify->scene, verify->file, verify->info.scene_hash, error);
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

static enum umb_status lights_verify(struct verify *verify, struct umb_error *error)
{
    verify->results =
        calloc(verify->light_count > 0 ? verify->light_count : 1, sizeof *verify->results);
    if (verify->results == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%u results do not fit in memory",
                        verify->light_count);
    }
    const double start = umbu_clock_s();
    struct compared compared = {.total = 1e-6 * (double)verify->points * verify->light_count};
    enum umb_status status = UMB_OK;
    umbu_progress_begin(&compared.progress, "Mpoints", verify->quiet);
    for (uint32_t i = 0; i < verify->light_count && status == UMB_OK; i++) {
        const uint32_t light = verify->first_light + i;
        const struct umbr_verify_options options = {
            .points = verify->points,
            .kind = verify->kind,
            .seed = verify->seed,
            .closed = light_is_closed(verify->asset, light) ? verify->scene.parts.closed : NULL,
            .threads = (unsigned)verify->threads,
            .progress = show_compared,
            .progress_user = &compared,
        };
        status = umbr_verify(verify->asset, light, verify->scene.rays, &options,
                             &verify->results[i], error);
        verify->outside_band += verify->results[i].outside_band;
        compared.before += 1e-6 * (double)verify->points;
    }
    umbu_progress_end(&compared.progress);
    verify->seconds = umbu_clock_s() - start;
    for (uint32_t i = 0; i < verify->light_count && status == UMB_OK; i++) {
        if (verify->results[i].points == 0) { /* must not pass for agreement */
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

static void report_text(const struct verify *verify)
{
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(verify->info.id, id);
    printf("asset %s\nscene %s: %zu triangles, %zu in closed parts\n", id, verify->scene_path,
           verify->scene.count, verify->scene.parts.closed_triangles);
    for (uint32_t i = 0; i < verify->light_count; i++) {
        const struct umbr_verify_result *result = &verify->results[i];
        if (result->records > 0) {
            printf("light %u: %" PRIu64 " %s asked\n", verify->first_light + i, result->records,
                   ASKED[verify->kind]);
        }
        printf("light %u: %" PRIu64 " %s compared, ", verify->first_light + i, result->points,
               verify->kind > UMBR_VERIFY_SEGMENTS ? ASKED[verify->kind] : ASKED[0]);
        if (verify->kind == UMBR_VERIFY_POINTS && verify->info.receiver_mask_bytes == 0) {
            printf("%" PRIu64 " near a boundary, ", result->near_boundary);
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
    umbu_json_text(&json, "scene", verify->scene_path);
    UMBU_JSON_COUNTS(&json, {"triangles", verify->scene.count},
                     {"closed_triangles", verify->scene.parts.closed_triangles},
                     {"seed", verify->seed});
    umbu_json_rounded(&json, "seconds", verify->seconds, 6);
    umbu_json_bool(&json, "agrees", verify->outside_band == 0);
    umbu_json_begin(&json, "lights", '[');
    for (uint32_t i = 0; i < verify->light_count; i++) {
        const struct umbr_verify_result *result = &verify->results[i];
        umbu_json_begin(&json, NULL, '{');
        UMBU_JSON_COUNTS(&json, {"light", verify->first_light + i}, {"records", result->records},
                         {"points", result->points}, {"near_boundary", result->near_boundary},
                         {"skipped_inside", result->skipped_inside},
                         {"inside_band", result->inside_band},
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

static void put_row(struct umbu_json *json, uint32_t light, const struct umb_curve_row *row,
                    const struct umbt_bound_result *result)
{
    umbu_json_begin(json, NULL, '{');
    umbu_json_rounded(json, "bound_m", row->bound_m, 9);
    UMBU_JSON_COUNTS(json, {"light", light}, {"level", row->level}, {"taps", row->taps},
                     {"points", result->points}, {"differ", result->differ},
                     {"undefined", result->undefined}, {"beyond", result->beyond});
    umbu_json_end(json, '}');
}

/* Checks one row of a light's curve against rays. */
static enum umb_status row_check(struct verify *verify, const struct umbt_point_set *points,
                                 uint32_t light, const struct umb_curve_row *row,
                                 struct umb_error *error)
{
    struct umbt_bound_result result;
    const struct umbt_bound_job job = {
        .scene = &verify->scene,
        .asset = verify->asset,
        .points = points,
        .settings = {.light = light, .taps = row->taps, .level = row->level},
        .bound_m = row->bound_m,
        .threads = (unsigned)verify->threads,
    };
    UMB__TRY(umbt_bound_check(&job, &result, error));
    if (verify->json) {
        put_row(&verify->bounds_json, light, row, &result);
    } else if (!verify->quiet) {
        printf("light %u, level %u, %2u taps: within %.4g m: %" PRIu64 " points, %" PRIu64
               " differ from a ray, %" PRIu64 " of them undefined, %" PRIu64 " beyond the bound\n",
               light, row->level, row->taps, row->bound_m, result.points, result.differ,
               result.undefined, result.beyond);
    }
    if (result.beyond > 0 && !verify->quiet && !verify->json) {
        printf("  for example at %.9g %.9g %.9g\n", result.worst_point[0], result.worst_point[1],
               result.worst_point[2]);
    }
    verify->outside_band += result.beyond;
    verify->rows_done++;
    return UMB_OK;
}

/* Checks every row of every light's curve. */
static enum umb_status rows_check(struct verify *verify, const struct umbt_point_set *points,
                                  struct umb_error *error)
{
    for (uint32_t i = 0; i < verify->light_count; i++) {
        const uint32_t light = verify->first_light + i;
        struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
        size_t count;
        (void)umb_asset_get_curve(verify->asset, light, rows, &count);
        for (size_t k = 0; k < count; k++) {
            UMB__TRY(row_check(verify, points, light, &rows[k], error));
        }
    }
    if (verify->json) {
        umbu_json_end(&verify->bounds_json, ']');
        umbu_json_bool(&verify->bounds_json, "true", verify->outside_band == 0);
    }
    return verify->rows_done > 0
               ? UMB_OK
               : umb_fail(error, UMB_E_BAD_SCENE, "--bounds: the asset carries no accuracy curve");
}

/* Runs --bounds. */
static enum umb_status bounds_verify(struct verify *verify, struct umb_error *error)
{
    const struct umbt_point_request request = {
        .scene = &verify->scene,
        .kind = UMBT_POINT_SURFACE,
        .count = (size_t)verify->points,
        .seed = verify->seed,
        .threads = (unsigned)verify->threads,
        .quiet = verify->quiet,
    };
    struct umbt_point_set points = {0};
    UMB__TRY(umbt_points_sample(&request, &points, error));
    if (verify->json) {
        verify->bounds_json.file = stdout;
        umbu_json_begin(&verify->bounds_json, NULL, '{');
        umbu_json_begin(&verify->bounds_json, "bounds", '[');
    }
    const enum umb_status status = rows_check(verify, &points, error);
    umbu_json_close(&verify->bounds_json);
    umbt_point_set_finish(&points);
    return status;
}

static enum umb_status verify_run(struct verify *verify, struct umb_error *error)
{
    UMB__TRY(options_check(verify, error));
    UMB__TRY(inputs_open(verify, error));
    if (verify->bounds) {
        return bounds_verify(verify, error); /* prints row by row */
    }
    UMB__TRY(lights_verify(verify, error));
    if (verify->json) {
        report_json(verify);
    } else if (!verify->quiet) {
        report_text(verify);
    }
    return UMB_OK;
}

int umbt_verify_command(int argc, char **argv)
{
    struct verify verify;
    struct umb_error error = {0};
    struct umbu_parsed parsed;
    memset(&verify, 0, sizeof verify);
    verify.light = UINT64_MAX;
    verify.threads = umbu_processor_count();
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &verify);
    if (code >= 0) {
        return code;
    }
    const enum umb_status status = verify_run(&verify, &error);
    free(verify.results);
    umbt_scene_finish(&verify.scene);
    umb_asset_close(verify.asset);
    return status == UMB_OK && verify.outside_band > 0 ? 1 : umbu_end(&COMMAND, status, &error);
}
