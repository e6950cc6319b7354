/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The pipeline. Each step frees the memory that the next does not need, so that --memory holds.
 */
#include "bake/bake_run.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "bake/analysis/analysis.h"
#include "bake/analysis/plan.h"
#include "bake/analysis/voxel_casters.h"
#include "bake/bake_frusta.h"
#include "bake/bake_report.h"
#include "bake/bake_transmittance.h"
#include "bake/base/interrupt.h"
#include "bake/memory_plan.h"
#include "bake/plan_choices.h"
#include "bake/base/bake_progress.h"
#include "bake/shut_in.h"
#include "bake/write/curve_points.h"
#include "bake/write/publish.h"
#include "base/try.h"
#include "common/private_folder.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "tool/threads.h"
#include "scene/scene_file.h"
#include "format/receiver_mask.h"
#include "umbrage/version.h"

/* Limit of frusta under the static rule: 32 KiB each, in a head of at most 64 MiB. */
#define STATIC_FRUSTA_MAX 1024U

/* Share of --memory that records of earlier self-checks may take. */
#define PROOFS_SHARE 32U

/* Share of the octree's memory that the octree of an earlier bake may take: the nodes of tiles that
 * changed stay in the pool until the bake ends. */
#define BASE_SHARE 16U

/* State of a run. */
struct run {
    const struct umbb_options *options; /* `chosen`, or the caller's */
    struct umbb_options chosen;         /* with the resolution of --max-error */
    struct umbs_scene *scene;
    struct umbb_bake_sandbox sandbox;
    struct umbb_analysis analysis;
    char *plan, *settings;
    struct umbu_threads *hashing;     /* thread that hashes the scene; NULL: nothing is hashed */
    uint8_t scene_hash[UMB_ID_BYTES]; /* set by that thread */
    struct umb__octree octree;
    struct umbb_occluder_depth_words occluder_depth;
    struct umb__transmittance_bytes transmittance;
    uint64_t *receiver_mask_cells; /* [frusta][UMB__RECEIVER_MASK_WORDS], or NULL: no static rule */
    struct umbb_publish publish;
    struct umbb_report report;
    struct umbb_tile_folder tile_folder; /* its cache.folder is NULL if no folder is used */
    struct umbb_proofs proofs;           /* records of earlier self-checks, or zero */
    struct umbb_base base;               /* octree of an earlier bake; its cache is NULL if none */
    uint64_t check_max_bytes;            /* limit of the asset's memory during its check */
    double start_s;
};

/* Prints each line with a prefix. */
static void print_notices(const char *lines)
{
    while (lines != NULL && *lines != '\0') {
        const size_t length = strcspn(lines, "\n");
        fprintf(stderr, "umbrage-bake: notice: %.*s\n", (int)(length < 500 ? length : 500), lines);
        lines += length + (lines[length] == '\n');
    }
}

/* Checks the output path before the work. An output that is the scene itself would destroy the
 * scene, and an unwritable output should be reported at once. */
static enum umb_status check_output(const struct umbb_options *options, struct umb_error *error)
{
    struct stat scene, output;
    if (options->output != NULL && stat(options->scene, &scene) == 0 &&
        stat(options->output, &output) == 0 && scene.st_dev == output.st_dev &&
        scene.st_ino == output.st_ino) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: '%.200s' is the scene itself", options->output);
    }
    return options->plan || options->task == UMBB_TASK_TILE
               ? UMB_OK
               : umbu_output_check(options->output, 0, error);
}

/* Warns if nothing tells the up axis: neither the file nor the options. */
static void print_up_warning(const struct umbb_options *options, const struct umbs_scene_view *view)
{
    const char *warning = umbs_scene_up_warning(view);
    if (warning != NULL && options->up == UMBB_UP_OF_SCENE) {
        fprintf(stderr, "umbrage-bake: warning: %s\n", warning);
    }
}

static enum umb_status import(struct run *run, struct umb_error *error)
{
    const struct umbb_options *o = run->options;
    const struct umbs_import_options limits = {
        .max_memory_bytes = o->memory_bytes, .shut_in = umbb_shut_in_calls, .user = &run->sandbox};
    const double start = umbu_clock_s();
    umbb_progress_phase("import");
    UMB__TRY(umbb_shut_in_paths(o, &run->sandbox, error));
    UMB__TRY(o->scene_buffer
                 ? umbs_scene_load("--scene-buffer", o->scene, &limits, &run->scene, error)
                 : umbs_scene_import(o->scene, &limits, &run->scene, error));
    run->report.seconds_import = umbu_clock_s() - start;
    if (!o->quiet) {
        umbb_shut_in_notice(&run->sandbox);
        print_notices(run->scene->view.warnings);
        print_up_warning(o, &run->scene->view);
    }
    return UMB_OK;
}

/* 1 if any light is a spot or point light. */
static int sees_from_a_point(const struct umbb_analysis *analysis)
{
    int found = 0;
    for (uint32_t i = 0; i < analysis->choice.count; i++) {
        found |= analysis->choice.lights[i].kind != UMB_LIGHT_DIRECTIONAL;
    }
    return found;
}

static struct umbb_memory_input memory_input(const struct run *run)
{
    const struct umbb_options *o = run->options;
    return (struct umbb_memory_input){
        .memory_bytes = o->memory_bytes,
        .scene_bytes = run->scene->map_bytes + umbb_cut_bytes(&run->analysis),
        .triangles = run->analysis.count,
        .log2_size = o->resolution_log2,
        .tile_log2 = o->tile_log2,
        .threads = o->threads,
        .closed_rule = run->analysis.closed_rule || o->static_rule,
        .ruled_frusta = o->static_rule ? run->analysis.frustum_count : 0,
        .copies = run->analysis.keeps_corners,
        .merging = o->task == UMBB_TASK_MERGE,
        .traced = o->depth == UMBB_DEPTH_EMBREE,
        .projected = sees_from_a_point(&run->analysis),
    };
}

/* Rounds to two digits, the precision of a forecast: 400, not 412.7. */
static double two_digits(double value)
{
    const double unit = value > 0 ? pow(10, floor(log10(value)) - 1) : 1;
    return round(value / unit) * unit;
}

/* Prints the resolution that --max-error chose, and its forecast. */
static void print_choice(const struct umbb_options *options, const struct umbb_forecast *forecast)
{
    fprintf(stderr,
            "umbrage-bake: --max-error %g m: %u voxels a side, true boundaries within %.3g m at "
            "one tap",
            options->max_error_m, 1U << options->resolution_log2, forecast->bound_m);
    if (forecast->costs.seconds > 0) {
        fprintf(stderr,
                "; about %.6g s of processor time, %.6g MB packed, %.6g MB of nodes, going by %u "
                "voxels",
                two_digits(forecast->costs.seconds),
                two_digits(forecast->costs.packed_bytes * 1e-6),
                two_digits(forecast->costs.octree_bytes * 1e-6), 1U << forecast->small_log2);
    }
    fputc('\n', stderr);
}

/* Chooses the resolution for --max-error. */
static enum umb_status choose_resolution(struct run *run, struct umb_error *error)
{
    struct umbb_forecast forecast;
    if (!(run->options->max_error_m > 0)) {
        return UMB_OK;
    }
    const struct umbb_small_job job = {.analysis = &run->analysis,
                                       .view = &run->scene->view,
                                       .options = run->options,
                                       .memory = memory_input(run)};
    run->chosen = *run->options;
    const enum umb_status status =
        umbb_resolution_choose(&job, &run->chosen.resolution_log2, &forecast, error);
    if (run->chosen.tile_log2 > run->chosen.resolution_log2) {
        run->chosen.tile_log2 = run->chosen.resolution_log2;
    }
    run->options = &run->chosen;
    if (status == UMB_OK && !run->options->quiet) {
        print_choice(run->options, &forecast);
    }
    return status;
}

/* Checks the conditions of the static rule. */
static enum umb_status check_static(const struct run *run, struct umb_error *error)
{
    const struct umbb_analysis *analysis = &run->analysis;
    if (!run->options->static_rule) {
        return UMB_OK;
    }
    if (sees_from_a_point(analysis)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "--static: the rule is for directional lights; leave out spot and point "
                        "lights, or the option");
    }
    if (analysis->cuts.translucent.triangles > 0 && !run->options->opaque_translucents) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "--static: %llu triangles take part of the light; switch that off "
                        "(--effect transmittance=off), or leave out the option",
                        (unsigned long long)analysis->cuts.translucent.triangles);
    }
    return analysis->frustum_count <= STATIC_FRUSTA_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_BAD_SCENE, "--static: %u lights, at most %u",
                          analysis->frustum_count, STATIC_FRUSTA_MAX);
}

static void hash_scene(void *user, uint32_t slice, unsigned thread)
{
    struct run *run = user;
    (void)slice, (void)thread;
    umbs_scene_hash(&run->scene->view, run->scene_hash);
}

/* Starts hashing the scene beside the analysis and the bake. */
static enum umb_status start_hash(struct run *run, struct umb_error *error)
{
    if (run->options->plan || run->options->task == UMBB_TASK_TILE) {
        return UMB_OK; /* no asset is written */
    }
    UMB__TRY(umbu_threads_create(run->options->threads < 2 ? 1 : 2, &run->hashing, error));
    umbu_threads_start(run->hashing, hash_scene, run, 1);
    return UMB_OK;
}

static enum umb_status analyse(struct run *run, struct umb_error *error)
{
    const struct umbs_scene_view *view = &run->scene->view;
    const double start = umbu_clock_s();
    umbb_progress_phase("analysis");
    UMB__TRY(umbb_analysis_run(view, run->options, &run->analysis, error));
    UMB__TRY(check_static(run, error));
    if (!run->options->quiet) {
        print_notices(run->analysis.choice.notices);
    }
    UMB__TRY(choose_resolution(run, error)); /* may replace the options */
    const struct umbb_small_job job = {.analysis = &run->analysis,
                                       .view = view,
                                       .options = run->options,
                                       .memory = memory_input(run),
                                       .packed = run->options->plan};
    UMB__TRY(umbb_closed_choose(&job, error));
    if (run->options->plan) {
        UMB__TRY(umbb_sharp_price_find(&job, (size_t)(run->options->memory_bytes / 2), error));
    }
    UMB__TRY(umbb_plan_text(&run->analysis, view, run->options, &run->plan, error));
    umbb_progress_plan(run->plan);
    UMB__TRY(umbb_settings_text(&run->analysis, run->options, &run->settings, error));
    run->report.seconds_analysis = umbu_clock_s() - start;
    return UMB_OK;
}

/* Opens the folder of tiles that the options name, if any. */
static enum umb_status open_tile_folder(struct run *run, struct umb_error *error)
{
    const struct umbb_options *o = run->options;
    enum umb_status status = UMB_OK;
    if (o->task == UMBB_TASK_TILE) {
        status = umbb_tile_folder_open(&run->tile_folder, UMBB_TILE_FOLDER_TILE, o->output,
                                       o->cache_size_given ? o->cache_bytes : UINT64_MAX,
                                       o->threads, error);
    } else if (o->task == UMBB_TASK_MERGE) {
        status = umbb_tile_folder_open(&run->tile_folder, UMBB_TILE_FOLDER_MERGE, o->from,
                                       UINT64_MAX, o->threads, error);
    } else if (o->cache != NULL && o->static_rule) {
        print_notices(o->quiet ? NULL
                               : "--cache: the static rule needs the whole map: every tile is "
                                 "baked");
    } else if (o->cache != NULL) {
        status = umbb_tile_folder_open(&run->tile_folder, UMBB_TILE_FOLDER_CACHE, o->cache,
                                       o->cache_bytes, o->threads, error);
    }
    run->tile_folder.quiet = o->quiet;
    return status;
}

/* Reads the records of earlier self-checks, which only a cache that no other user can change may
 * hold. */
static enum umb_status open_proofs(struct run *run, const struct umbb_memory_plan *memory,
                                   struct umb_error *error)
{
    const struct umbb_options *o = run->options;
    char *resolved;
    struct umb_error cause;
    if (run->tile_folder.cache.folder == NULL || o->task != UMBB_TASK_BAKE ||
        o->verify_points == 0 || run->analysis.count == 0) {
        return UMB_OK;
    }
    if (umbs_private_folder(o->cache, &resolved, &cause) != UMB_OK) {
        if (!o->quiet) {
            fprintf(stderr,
                    "umbrage-bake: notice: --cache: the self-check compares every tile: %s\n",
                    cause.message);
        }
        return UMB_OK;
    }
    free(resolved);
    const struct umbb_proofs_job job = {
        .analysis = &run->analysis,
        .tile_log2 = memory->tile_log2,
        .occluder_depth = o->occluder_depth && run->analysis.closed_rule,
        .points = umbb_check_points(o->verify_points, run->analysis.choice.count),
        .max_bytes = (size_t)(o->memory_bytes / PROOFS_SHARE),
        .cache = &run->tile_folder.cache,
    };
    run->tile_folder.proofs = &run->proofs;
    UMB__TRY(umbb_proofs_open(&run->proofs, &job, error));
    if (run->proofs.frusta == NULL || job.occluder_depth) {
        return UMB_OK;
    }
    run->tile_folder.base = &run->base;
    return umbb_base_open(&run->base, &run->proofs, &run->tile_folder.cache,
                          memory->octree_max_bytes / BASE_SHARE, error);
}

/* Checks tiles that several machines share: the tile size must be as requested, and tile numbers
 * must exist. */
static enum umb_status check_tiles(const struct run *run, const struct umbb_memory_plan *memory,
                                   struct umb_error *error)
{
    const struct umbb_options *o = run->options;
    if (o->task != UMBB_TASK_BAKE && memory->tile_log2 != o->tile_log2) {
        return umb_fail(
            error, UMB_E_LIMIT,
            "--memory: %llu MiB are not enough for tiles of %u: give more, or --tile %u "
            "to tile and merge alike",
            (unsigned long long)(o->memory_bytes >> 20), 1U << o->tile_log2,
            1U << memory->tile_log2);
    }
    const uint64_t count = umbb_tile_count(&run->analysis, memory->tile_log2);
    if (o->only_given && o->only_last >= count) {
        return umb_fail(error, UMB_E_ARGUMENT, "--only: '%llu': there are tiles 0 to %llu",
                        (unsigned long long)o->only_last, (unsigned long long)count - 1);
    }
    return UMB_OK;
}

/* Makes deep maps, when the tiles are freed and the octree is complete. */
static enum umb_status bake_transmittance(struct run *run, const struct umbb_memory_plan *memory,
                                          struct umb_error *error)
{
    const uint64_t left = memory->check_max_bytes;
    const size_t taken = run->report.figures.octree_bytes;
    return umbb_transmittance_bake(&run->analysis, run->options,
                                   left > taken ? (size_t)(left - taken) : 0, &run->transmittance,
                                   &run->report.transmittance_level, error);
}

/* Allocates the results of the static rule. */
static enum umb_status open_static(struct run *run, struct umb_error *error)
{
    const uint32_t count = run->analysis.frustum_count;
    if (!run->options->static_rule) {
        return UMB_OK;
    }
    run->receiver_mask_cells =
        calloc(count * UMB__RECEIVER_MASK_WORDS, sizeof *run->receiver_mask_cells);
    return run->receiver_mask_cells != NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "static rule: memory of %u lights refused",
                          count);
}

/* Content of the asset so far. */
static struct umb__content content_of(const struct run *run)
{
    return (struct umb__content){
        .light_count = run->analysis.choice.count,
        .frustum_count = run->analysis.frustum_count,
        .lights = run->analysis.choice.lights,
        .frusta = run->analysis.frusta,
        .bounds = run->analysis.bounds,
        .plan = run->plan,
        .settings = run->settings,
        .occluder_depth = run->occluder_depth.words,
        .occluder_depth_words = run->occluder_depth.count,
        .transmittance = run->transmittance.data,
        .transmittance_bytes = run->transmittance.count,
        .receiver_mask_cells = run->receiver_mask_cells,
    };
}

/* Bakes with memory, head and folder of tiles prepared. */
static enum umb_status bake_prepared(struct run *run, const struct umbb_memory_plan *memory,
                                     size_t occluder_depth_bytes, struct umb_error *error)
{
    const struct umbb_options *o = run->options;
    const struct umbb_frusta_job job = {
        .analysis = &run->analysis,
        .view = &run->scene->view,
        .options = o,
        .memory = memory,
        .tile_folder = run->tile_folder.cache.folder != NULL ? &run->tile_folder : NULL,
        .occluder_depth =
            o->occluder_depth && run->analysis.closed_rule ? &run->occluder_depth : NULL,
        .occluder_depth_max_bytes = occluder_depth_bytes,
        .receiver_mask_cells = run->receiver_mask_cells,
    };
    UMB__TRY(umbb_bake_frusta(&job, &run->octree, &run->report.figures, error));
    return o->task == UMBB_TASK_TILE ? UMB_OK : bake_transmittance(run, memory, error);
}

/* Takes the memory of a base from that of the octree: the file, and the arrays that are read from
 * it. */
static void leave_base(const struct umbb_base *base, struct umbb_memory_plan *memory)
{
    const size_t bytes = 2 * base->size;
    memory->octree_max_bytes -= bytes;
    memory->shared_max_bytes -= bytes < memory->shared_max_bytes ? bytes : 0;
}

static enum umb_status bake(struct run *run, struct umb_error *error)
{
    const struct umbb_options *o = run->options;
    const struct umbb_memory_input input = memory_input(run);
    struct umbb_memory_plan memory;
    size_t occluder_depth_bytes;
    UMB__TRY(umbb_memory_divide(&input, &memory, error));
    UMB__TRY(check_tiles(run, &memory, error));
    UMB__TRY(open_static(run, error));
    const struct umb__content content = content_of(run);
    UMB__TRY(umbb_head_occluder_depth_bytes(&content, run->analysis.translucent_count > 0,
                                            &occluder_depth_bytes, error));
    UMB__TRY(open_tile_folder(run, error));
    UMB__TRY(open_proofs(run, &memory, error));
    leave_base(&run->base, &memory);
    run->report.tile_log2 = memory.tile_log2;
    run->check_max_bytes = memory.check_max_bytes;
    const double start = umbu_clock_s();
    umbb_progress_phase("bake");
    run->report.depth_path = o->depth == UMBB_DEPTH_EMBREE  ? "embree"
                             : o->depth == UMBB_DEPTH_PLAIN ? "plain"
                                                            : "raster";
    const enum umb_status status = bake_prepared(run, &memory, occluder_depth_bytes, error);
    run->report.seconds_bake = umbu_clock_s() - start;
    if (status == UMB_E_CANCELLED && run->tile_folder.cache.folder != NULL &&
        o->task != UMBB_TASK_MERGE) {
        return umb_fail(error, status,
                        "interrupted: no asset was written; tiles that were done stay in '%.200s'",
                        run->tile_folder.cache.folder);
    }
    return status;
}

/* Writes the facts that are not part of the id. */
static void write_notes(const struct run *run, char *text, size_t size)
{
    const time_t now = time(NULL);
    struct tm utc;
    char stamp[32] = "unknown";
    if (gmtime_r(&now, &utc) != NULL) {
        strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%SZ", &utc);
    }
    snprintf(text, size, "seconds=%.3f\ntime=%s\nwriter=umbrage-bake %s\n",
             umbu_clock_s() - run->start_s, stamp, UMB_VERSION_TEXT);
}

/* Keeps the octree and its pages for the next bake. Without them the next one merges all tiles. */
static void keep_base(void *user, const struct umb__pack_cuts *cuts,
                      const struct umb__kept_page *pages, uint32_t page_count)
{
    const struct run *run = user;
    struct umb_error error;
    if (umbb_base_keep(&run->base, cuts, pages, page_count, &error) != UMB_OK &&
        !run->options->quiet) {
        fprintf(stderr, "umbrage-bake: notice: --cache: %s\n", error.message);
    }
}

static enum umb_status write_asset(struct run *run, struct umb_error *error)
{
    char notes[160];
    const double start = umbu_clock_s();
    umbb_progress_phase("write");
    write_notes(run, notes, sizeof notes);
    struct umb__content content = content_of(run);
    content.notes = notes;
    memcpy(content.origin, run->analysis.origin, sizeof content.origin);
    umbu_threads_wait(run->hashing, NULL, NULL);
    memcpy(content.scene_hash, run->scene_hash, sizeof content.scene_hash);
    run->publish.threads = run->options->threads;
    run->publish.kept = &run->base.kept;
    run->publish.made = run->base.cache != NULL ? keep_base : NULL;
    run->publish.made_user = run;
    UMB__TRY(umbb_analysis_need_corners(&run->analysis, &run->scene->view, error));
    if (run->analysis.count > 0) {
        UMB__TRY(
            umbb_curve_add(&run->analysis, &run->octree, run->options->threads, &content, error));
    }
    const enum umb_status status = umbb_publish_write(&run->publish, &content, &run->octree, error);
    free(content.curve);
    umbb_base_release(&run->base);
    run->report.seconds_write = umbu_clock_s() - start;
    if (status == UMB_E_CORRUPT && run->base.is_loaded) {
        return umb_fail(error, UMB_E_INTERNAL,
                        "--cache: the kept octree is false and was removed: bake again");
    }
    return status;
}

static enum umb_status check_asset(struct run *run, struct umb_error *error)
{
    struct umbb_analysis *analysis = &run->analysis;
    const double start = umbu_clock_s();
    double(*corners)[3][3] = NULL;
    umbb_progress_phase("verify");
    const uint64_t points = analysis->count > 0 ? run->options->verify_points : 0;
    if (points > 0) {
        UMB__TRY(umbb_analysis_need_corners(analysis, &run->scene->view, error));
        corners = umbb_analysis_take_turned(analysis);
    }
    const struct umbb_check check = {
        .corners = (const double(*)[3][3])corners,
        .closed = analysis->closed_rule ? analysis->kinds : NULL,
        .cuts = &analysis->cuts,
        .count = analysis->count,
        .open_on_word = analysis->open_on_word,
        .points = points,
        .threads = run->options->threads,
        .quiet = run->options->quiet,
        .max_memory_bytes = run->check_max_bytes,
        .proofs = run->proofs.frusta != NULL ? &run->proofs : NULL,
    };
    const enum umb_status status = umbb_publish_check(&run->publish, &run->octree, &check, error);
    free(corners);
    run->report.seconds_verify = umbu_clock_s() - start;
    return status;
}

/* Keeps the records of this self-check. Without them the next one compares more. */
static void keep_proofs(const struct run *run)
{
    struct umb_error error;
    if (umbb_proofs_keep(&run->proofs, &error) != UMB_OK && !run->options->quiet) {
        fprintf(stderr, "umbrage-bake: notice: --cache: %s\n", error.message);
    }
}

/* 1 if what was written may be the cause of a failure: then the next bake shall begin without the
 * base. Pages that were taken over from it may be unreadable, or larger than memory. */
static int is_of_content(enum umb_status status)
{
    return status == UMB_E_INTERNAL || status == UMB_E_CORRUPT || status == UMB_E_VERSION ||
           status == UMB_E_LIMIT || status == UMB_E_TOO_LARGE;
}

static enum umb_status bake_and_publish(struct run *run, struct umb_error *error)
{
    UMB__TRY(umbb_publish_begin(&run->publish, run->options->output, error));
    UMB__TRY(bake(run, error));
    enum umb_status status = write_asset(run, error);
    if (status == UMB_OK) {
        status = check_asset(run, error);
    }
    if (status == UMB_E_INTERNAL) {
        /* So that the next bake does not find a wrong tile again. */
        umbb_proofs_refuse(&run->proofs);
    }
    if (is_of_content(status)) {
        umbb_base_drop(&run->base);
    }
    UMB__TRY(status);
    UMB__TRY(umbb_publish_commit(&run->publish, error));
    keep_proofs(run);
    return UMB_OK;
}

/* Saves the imported scene as a file; with --plan only tells what it is. */
static enum umb_status save_scene(struct run *run, struct umb_error *error)
{
    char id[UMB_ID_TEXT_SIZE];
    uint8_t hash[UMB_ID_BYTES];
    umbb_interrupt_defer(); /* so that a signal also removes its temporary */
    if (!run->options->plan) {
        UMB__TRY(umbs_scene_save(run->scene, run->options->output, error));
    }
    if (!run->options->json && !run->options->plan) {
        return UMB_OK;
    }
    umbs_scene_hash(&run->scene->view, hash);
    umb_id_to_text(hash, id);
    if (!run->options->json) {
        printf("scene=%s triangles=%llu lights=%u\n", id,
               (unsigned long long)run->scene->view.world_triangle_count,
               run->scene->view.light_count);
    } else {
        struct umbu_json json = {.file = stdout};
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "scene", id);
        UMBU_JSON_COUNTS(&json, {"bytes", run->scene->map_bytes},
                         {"triangles", run->scene->view.world_triangle_count},
                         {"lights", run->scene->view.light_count});
        umbu_json_close(&json);
    }
    return UMB_OK;
}

static void print_plan(const struct run *run)
{
    const uint64_t tiles = umbb_tile_count(&run->analysis, run->options->tile_log2);
    umbb_progress_tiles(0, tiles, 0);
    if (run->options->json) {
        umbb_plan_print_json(stdout, &run->analysis, &run->scene->view, run->plan, tiles);
    } else {
        umbb_plan_print(stdout, &run->analysis, &run->scene->view, run->plan, tiles);
    }
}

static void print_report(struct run *run)
{
    run->report.options = run->options;
    run->report.analysis = &run->analysis;
    run->report.publish = &run->publish;
    run->report.damaged_tiles = run->tile_folder.cache.damaged;
    run->report.base_tiles = run->base.found;
    run->report.seconds_total = umbu_clock_s() - run->start_s;
    if (run->options->task == UMBB_TASK_TILE) {
        umbb_report_print_tiles(stdout, &run->report);
    } else if (run->options->json) {
        umbb_report_print_json(stdout, &run->report);
    } else if (!run->options->quiet) {
        umbb_report_print(stdout, &run->report);
    }
}

/* Runs the task from import to report. */
static enum umb_status run_task(struct run *run, struct umb_error *error)
{
    UMB__TRY(check_output(run->options, error));
    UMB__TRY(import(run, error));
    if (run->options->task == UMBB_TASK_IMPORT) {
        return save_scene(run, error);
    }
    UMB__TRY(start_hash(run, error));
    UMB__TRY(analyse(run, error));
    if (run->options->plan) {
        print_plan(run);
        return UMB_OK;
    }
    umbb_interrupt_defer();
    UMB__TRY(run->options->task == UMBB_TASK_TILE ? bake(run, error)
                                                  : bake_and_publish(run, error));
    print_report(run);
    return UMB_OK;
}

enum umb_status umbb_run(const struct umbb_options *options, struct umb_error *error)
{
    struct run run = {.options = options, .start_s = umbu_clock_s()};
    umbb_interrupt_install();
    umbb_progress_tell_to(options->progress_fd);
    enum umb_status status = run_task(&run, error);
    if (status == UMB_OK && fflush(stdout) != 0) {
        status = umb_fail(error, UMB_E_IO, "cannot write to standard output");
    }
    umbu_threads_destroy(run.hashing);
    umbb_publish_abandon(&run.publish);
    umb__octree_finish(&run.octree);
    umb__occluder_depth_words_free(NULL, run.occluder_depth.words);
    free(run.receiver_mask_cells);
    umb__transmittance_bytes_finish(&run.transmittance);
    umbb_base_close(&run.base);
    umbb_proofs_close(&run.proofs);
    umbb_tile_folder_close(&run.tile_folder);
    free(run.plan);
    free(run.settings);
    umbb_analysis_finish(&run.analysis);
    umbs_scene_destroy(run.scene);
    return status;
}
