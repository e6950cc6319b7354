/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Analysis of a scene: flattening, dropping triangles without area, parts, bounds, materials.
 * Memory is allocated only after the number of triangles has been checked against --memory.
 */
#include "bake/analysis/analysis.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/frusta.h"
#include "bake/analysis/light_frame.h"
#include "bake/depth/tile.h"
#include "base/try.h"
#include "scene/parts.h"
#include "tool/threads.h"

/* Triangles of a mesh from which on several threads flatten it. */
#define PARALLEL_FROM ((size_t)1 << 16)

void umbb_analysis_finish(struct umbb_analysis *analysis)
{
    free(analysis->corners);
    free(analysis->copy);
    free(analysis->kinds);
    free(analysis->dropped);
    free(analysis->frusta);
    free(analysis->translucent);
    free(analysis->translucent_cuts);
    umbs_cuts_finish(&analysis->cuts);
    umbb_light_choice_finish(&analysis->choice);
    memset(analysis, 0, sizeof *analysis);
}

/* Moves the kept opaque triangles to the start, and the translucent ones behind them. */
static void compact(struct umbb_analysis *analysis)
{
    size_t to = 0;
    for (size_t i = 0; i < analysis->flat_count; i++) {
        if (!analysis->dropped[i]) {
            if (to != i) {
                memmove(analysis->corners[to], analysis->corners[i], sizeof analysis->corners[i]);
            }
            to++;
        }
    }
    if (analysis->translucent_count > 0) {
        memcpy(analysis->corners[to], analysis->translucent,
               analysis->translucent_count * sizeof *analysis->translucent);
    }
}

/* Moves the cuts of the kept opaque triangles to the array's start, once: cuts do not change. */
static void compact_cuts(struct umbb_analysis *analysis)
{
    size_t to = 0;
    for (size_t i = 0; analysis->cuts.of != NULL && i < analysis->flat_count; i++) {
        if (!analysis->dropped[i]) {
            analysis->cuts.of[to++] = analysis->cuts.of[i];
        }
    }
}

/* Takes the translucent triangles out of the flattened ones. Allocates their array. */
static enum umb_status keep_translucent(struct umbb_analysis *analysis, struct umb_error *error)
{
    size_t to = 0;
    for (size_t i = 0; i < analysis->flat_count; i++) {
        analysis->translucent_count += analysis->dropped[i] == UMBB_TRANSLUCENT;
    }
    if (analysis->translucent_count == 0) {
        return UMB_OK;
    }
    analysis->translucent = malloc(analysis->translucent_count * sizeof *analysis->translucent);
    analysis->translucent_cuts =
        malloc(analysis->translucent_count * sizeof *analysis->translucent_cuts);
    if (analysis->translucent == NULL || analysis->translucent_cuts == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "analysis: memory for %zu translucent triangles refused",
                        analysis->translucent_count);
    }
    for (size_t i = 0; i < analysis->flat_count; i++) {
        if (analysis->dropped[i] == UMBB_TRANSLUCENT) {
            memcpy(analysis->translucent[to], analysis->corners[i], sizeof analysis->corners[i]);
            analysis->translucent_cuts[to++] = analysis->cuts.of[i];
        }
    }
    return UMB_OK;
}

static uint8_t kind_of(const struct umbs_part *part, enum umbb_closed_mode mode)
{
    if (mode == UMBB_CLOSED_OFF || (mode != UMBB_CLOSED_ON && !part->closed)) {
        return UMBB_CASTER_OPEN;
    }
    return part->closed && part->flipped ? UMBB_CASTER_CLOSED_FLIPPED : UMBB_CASTER_CLOSED;
}

/* Decides whether the closed rule is possible; without the rule all casters are open. */
static void decide_closed(struct umbb_analysis *analysis, enum umbb_closed_mode mode)
{
    analysis->open_on_word =
        mode == UMBB_CLOSED_ON ? analysis->part_count - analysis->closed_part_count : 0;
    analysis->closed_rule =
        mode == UMBB_CLOSED_ON || (mode != UMBB_CLOSED_OFF && analysis->closed_part_count > 0);
}

void umbb_analysis_rule(struct umbb_analysis *analysis, int closed)
{
    analysis->closed_rule = closed;
    for (uint32_t i = 0; i < analysis->frustum_count; i++) {
        analysis->frusta[i].closed = (uint8_t)closed;
    }
}

/* Takes over the results of the search for parts. Allocates dropped and kinds. */
static enum umb_status take_parts(struct umbb_analysis *analysis, const struct umbs_parts *parts,
                                  enum umbb_closed_mode mode, struct umb_error *error)
{
    analysis->degenerate_count = parts->degenerate_count;
    analysis->duplicate_count = parts->duplicate_triangles;
    analysis->closed_triangles = parts->closed_triangles;
    analysis->part_count = parts->part_count;
    analysis->dropped = calloc(analysis->flat_count, 1);
    analysis->kinds = calloc(analysis->flat_count, 1);
    if (analysis->dropped == NULL || analysis->kinds == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "analysis: memory for %zu triangles refused",
                        analysis->flat_count);
    }
    for (size_t i = 0; i < analysis->flat_count; i++) {
        const uint32_t cut = analysis->cuts.of != NULL ? analysis->cuts.of[i] : UMBS_CUT_NONE;
        if (parts->part_of[i] == UINT32_MAX || cut == UMBS_CUT_GONE || cut == UMBS_CUT_CLEAR) {
            analysis->gone_count += parts->part_of[i] != UINT32_MAX;
            analysis->dropped[i] = UMBB_DROPPED;
        } else if (cut != UMBS_CUT_NONE && umbs_cut_is_translucent(&analysis->cuts, cut)) {
            analysis->dropped[i] = UMBB_TRANSLUCENT;
        } else { /* a triangle with holes bounds no solid, also on the caller's word */
            analysis->kinds[analysis->count++] =
                cut != UMBS_CUT_NONE ? UMBB_CASTER_OPEN
                                     : kind_of(&parts->parts[parts->part_of[i]], mode);
        }
    }
    const struct umbs_part *largest_open = NULL;
    for (size_t i = 0; i < parts->part_count; i++) {
        const struct umbs_part *part = &parts->parts[i];
        analysis->closed_part_count += part->closed != 0;
        analysis->flipped_part_count += part->closed && part->flipped;
        if (!part->closed &&
            (largest_open == NULL || part->triangle_count > largest_open->triangle_count)) {
            largest_open = part;
            analysis->open_reason_part = i;
        }
    }
    if (largest_open != NULL) {
        umbs_part_reason(largest_open, analysis->open_reason, sizeof analysis->open_reason);
    }
    decide_closed(analysis, mode);
    return UMB_OK;
}

static enum umb_status find_parts(struct umbb_analysis *analysis, enum umbb_closed_mode mode,
                                  struct umb_error *error)
{
    struct umbs_parts parts;
    memset(&parts, 0, sizeof parts);
    UMB__TRY(umbs_parts_find((const double(*)[3][3])analysis->corners, analysis->flat_count, &parts,
                             error));
    umbs_cuts_open_parts(&analysis->cuts, &parts, analysis->flat_count);
    const enum umb_status status = take_parts(analysis, &parts, mode, error);
    umbs_parts_finish(&parts);
    UMB__TRY(status);
    UMB__TRY(keep_translucent(analysis, error));
    if (analysis->count + analysis->translucent_count > 0) {
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_BAD_SCENE, "scene: none of its %zu triangles %s",
                    analysis->flat_count,
                    analysis->gone_count > 0 ? "casts a shadow: the alpha of all is below their "
                                               "materials' cut-off, or they are clear"
                                             : "has an area");
}

/* Finds the cut-out and translucent triangles, unless the options take every triangle as opaque. */
static enum umb_status find_cuts(struct umbb_analysis *analysis, const struct umbs_scene_view *view,
                                 const struct umbb_options *options, struct umb_error *error)
{
    UMB__TRY((options->sharp_cut_outs ? umbs_cuts_find_sharp
                                      : umbs_cuts_find)(view, &analysis->cuts, error));
    umbs_cuts_take_as_opaque(&analysis->cuts, options->opaque_cut_outs,
                             options->opaque_translucents); /* the figures stay, for the plan */
    return UMB_OK;
}

/* Sets the bounds of the casters and the origin of the asset. */
static void measure(struct umbb_analysis *analysis)
{
    struct umb_box *box = &analysis->bounds;
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] = INFINITY;
        box->max[axis] = -INFINITY;
    }
    for (size_t i = 0; i < analysis->count + analysis->translucent_count; i++) {
        for (int k = 0; k < 9; k++) {
            const double value = analysis->corners[i][k / 3][k % 3]; /* finite */
            double *min = &box->min[k % 3], *max = &box->max[k % 3];
            *min = value < *min ? value : *min;
            *max = value > *max ? value : *max;
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] += 0.0; /* -0 becomes 0 */
        box->max[axis] += 0.0;
        analysis->origin[axis] = rint(0.5 * box->min[axis] + 0.5 * box->max[axis]) + 0.0;
    }
}

/* Triangles of one instance that are being flattened. */
struct flattening {
    const struct umbs_scene_view *view;
    const struct umbs_instance *instance;
    double (*corners)[3][3];
};

static enum umb_status flatten_block(void *user, size_t first, size_t count,
                                     struct umb_error *error)
{
    const struct flattening *f = user;
    (void)error;
    umbs_scene_flatten_part(f->view, f->instance, (uint32_t)first, (uint32_t)count,
                            f->corners + first);
    return UMB_OK;
}

/* Flattens the scene as umbs_scene_flatten does; threads share the triangles of large meshes. */
static enum umb_status flatten_all(const struct umbs_scene_view *view, unsigned threads,
                                   double (**corners)[3][3], size_t *count, struct umb_error *error)
{
    const size_t total = (size_t)view->world_triangle_count; /* at most 2^32: the product fits */
    enum umb_status status = UMB_OK;
    size_t at = 0;
    *count = total;
    *corners = malloc((total + 1) * sizeof **corners);
    if (*corners == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu world triangles", total);
    }
    for (uint32_t i = 0; i < view->instance_count && status == UMB_OK; i++) {
        const size_t triangles = view->meshes[view->instances[i].mesh].triangle_count;
        struct flattening f = {view, &view->instances[i], *corners + at};
        status =
            threads > 1 && triangles > PARALLEL_FROM
                ? umbu_range_run(threads, triangles, PARALLEL_FROM / 8, flatten_block, &f, error)
                : flatten_block(&f, 0, triangles, error);
        at += triangles;
    }
    if (status != UMB_OK) {
        free(*corners);
        *corners = NULL;
    }
    return status;
}

static enum umb_status flatten(struct umbb_analysis *analysis, const struct umbs_scene_view *view,
                               struct umb_error *error)
{
    UMB__TRY(
        flatten_all(view, analysis->threads, &analysis->corners, &analysis->flat_count, error));
    if (analysis->flat_count == 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "scene: no triangles");
    }
    /* The coordinates are checked before the areas are computed: if an area overflowed, its
     * triangle would be dropped without a message. */
    UMB__TRY(
        umbb_world_check((const double(*)[3][3])analysis->corners, analysis->flat_count, error));
    return analysis->flat_count < UINT32_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_LIMIT, "scene: %zu triangles are more than %u",
                          analysis->flat_count, UINT32_MAX - 1U);
}

/* Checks that flattening and the search for parts, in addition to the scene, fit allowed_bytes. */
static enum umb_status check_memory(const struct umbs_scene_view *view, uint64_t allowed_bytes,
                                    struct umb_error *error)
{
    /* The scene was counted in memory, so this fits 64 bits. */
    const uint64_t scene_bytes =
        view->vertex_count * (3 * sizeof(double) + (view->uvs != NULL ? 2 * sizeof(float) : 0)) +
        view->triangle_count * 3 * sizeof(uint32_t) + view->alpha_bytes;
    const uint64_t left = allowed_bytes > scene_bytes ? allowed_bytes - scene_bytes : 0;
    if (view->world_triangle_count > left / UMBB_TRIANGLE_BYTES) {
        return umb_fail(
            error, UMB_E_LIMIT,
            "--memory: %llu triangles%s need about %.0f MiB, %llu MiB are allowed",
            (unsigned long long)view->world_triangle_count,
            view->world_triangle_count > view->triangle_count ? " (instances multiplied out)" : "",
            ceil(((double)scene_bytes +
                  (double)view->world_triangle_count * (double)UMBB_TRIANGLE_BYTES) /
                 1048576.0),
            (unsigned long long)(allowed_bytes >> 20));
    }
    return UMB_OK;
}

/* Fits the frusta of each light. */
static enum umb_status fit_frusta(struct umbb_analysis *analysis, uint32_t log2_size,
                                  struct umb_error *error)
{
    const struct umbb_frusta_input input = {
        .fit = {.corners = (const double(*)[3][3])analysis->corners,
                .count = analysis->count + analysis->translucent_count,
                .origin = analysis->origin,
                .log2_size = log2_size,
                .threads = analysis->threads},
        .bounds = analysis->bounds,
        .closed = analysis->closed_rule,
    };
    return umbb_frusta_fit(&input, &analysis->choice, &analysis->frusta, &analysis->frustum_count,
                           error);
}

enum umb_status umbb_analysis_refit(struct umbb_analysis *analysis, uint32_t log2_size,
                                    struct umb_error *error)
{
    free(analysis->frusta);
    analysis->frusta = NULL;
    analysis->frustum_count = 0;
    return fit_frusta(analysis, log2_size, error);
}

/* Analyses a scene whose memory was checked. The caller finishes the analysis after a failure. */
static enum umb_status analyse(struct umbb_analysis *analysis, const struct umbs_scene_view *view,
                               const struct umbb_options *options, struct umb_error *error)
{
    UMB__TRY(flatten(analysis, view, error));
    UMB__TRY(find_cuts(analysis, view, options, error));
    UMB__TRY(find_parts(analysis, options->closed, error));
    compact(analysis);
    compact_cuts(analysis);
    measure(analysis);
    analysis->z_up = options->up == UMBB_UP_OF_SCENE ? view->z_up : options->up == UMBB_UP_Z;
    analysis->up_reason =
        options->up == UMBB_UP_OF_SCENE ? umbs_scene_up_reason(view) : "--up says so";
    UMB__TRY(umbb_lights_choose(view, options, analysis->z_up, &analysis->choice, error));
    for (uint32_t i = 0; options->penumbra == UMBB_PENUMBRA_OFF && i < analysis->choice.count;
         i++) {
        analysis->choice.lights[i].extent = 0.0;
        memset(analysis->choice.lights[i].side, 0, sizeof analysis->choice.lights[i].side);
    }
    return fit_frusta(analysis, options->resolution_log2, error);
}

enum umb_status umbb_analysis_run(const struct umbs_scene_view *view,
                                  const struct umbb_options *options,
                                  struct umbb_analysis *analysis, struct umb_error *error)
{
    memset(analysis, 0, sizeof *analysis);
    UMB__TRY(check_memory(view, options->memory_bytes, error));
    analysis->threads = options->threads;
    analysis->keeps_corners = view->world_triangle_count <=
                              options->memory_bytes / UMBB_COPIES_SHARE / sizeof *analysis->corners;
    const enum umb_status status = analyse(analysis, view, options, error);
    if (status != UMB_OK) {
        umbb_analysis_finish(analysis);
    }
    return status;
}

enum umb_status umbb_analysis_need_corners(struct umbb_analysis *analysis,
                                           const struct umbs_scene_view *view,
                                           struct umb_error *error)
{
    size_t count = 0;
    if (analysis->corners != NULL) {
        return UMB_OK;
    }
    UMB__TRY(flatten_all(view, analysis->threads, &analysis->corners, &count, error));
    if (count != analysis->flat_count) {
        free(analysis->corners);
        analysis->corners = NULL;
        return umb_fail(error, UMB_E_INTERNAL, "scene: %zu triangles became %zu",
                        analysis->flat_count, count);
    }
    compact(analysis);
    return UMB_OK;
}

double (*umbb_analysis_take_turned(struct umbb_analysis *analysis))[3][3]
{
    double(*corners)[3][3] = analysis->corners;
    analysis->corners = NULL;
    for (size_t i = 0; i < analysis->count; i++) {
        if (analysis->closed_rule && analysis->kinds[i] == UMBB_CASTER_CLOSED_FLIPPED) {
            umbs_triangle_turn(corners[i]);
        }
    }
    return corners;
}
