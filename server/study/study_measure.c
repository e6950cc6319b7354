/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Measures every setting on the same samples (study.h).
 *
 * The answers are the same bits in every run, and errors are summed in the order of the samples, so
 * a report's errors can be reproduced exactly.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "tool/progress.h"
#include "study/study_math.h"
#include "study/study_probe.h"
#include "umbrage/curve.h"

#define BLOCK    64
#define JUDGED_M 0.01F /* visibility error above which an answer is checked for undefined space */
#define CHECKED  1000  /* samples that are also traced with twice the rays a side */

/* Widths of filters, in full and --quick; 0 ends the list. */
static const uint32_t widths[2][6] = {{1, 3, 5, 9, 17}, {1, 3, 9}};
static const uint32_t levels[] = {3, 5}; /* coarse rows, of one tap */
#define WIDE_TAPS 9                      /* window of tents */

/*
 * The truth of a footprint, traced once. All settings with the same frustum and filter share this
 * truth, those of assets and of peers.
 */
struct traced {
    const struct umbt_study_points *points;
    struct umbt_study_truth truth; /* parameters of the rays; `closed` does not matter */
    float *values;                 /* [surface samples] */
    double error;                  /* estimated RMS error, against twice the rays a side */
};

struct truths {
    uint32_t count;
    struct traced list[UMBT_STUDY_SETTINGS_MAX];
};

/* State that all settings share, and the truth of the current one. */
struct judging {
    const struct umbt_probe *probe;
    const float *area;
    float *answers;     /* [points] */
    float *off;         /* [points], scratch */
    uint8_t *undefined; /* [points] */
    struct umbt_peers peers;
    struct truths truths;
    struct umbt_probe probes[UMBT_STUDY_SETTINGS_MAX];
};

/* ---- truths ---- */

static float trace(const struct umbt_study_truth *truth, const struct umbt_study_points *points,
                   size_t i)
{
    double normal[3];
    umbt_study_normal(points, i, normal);
    return umbt_study_truth_visibility(truth, points->positions[i], normal);
}

static void trace_item(void *user, size_t i)
{
    const struct traced *traced = user;
    traced->values[i] = trace(&traced->truth, traced->points, i);
}

/* Estimates the error of a truth by a second truth with twice the rays a side. */
static double own_error(const struct traced *traced)
{
    const size_t surface = traced->points->first[UMBT_STUDY_FREE];
    const size_t step = surface > CHECKED ? surface / CHECKED : 1;
    struct umbt_study_truth finer = traced->truth;
    double sum = 0.0, count = 0.0;
    finer.rays.samples *= 2;
    for (size_t i = 0; i < surface; i += step) {
        const double difference =
            (double)trace(&finer, traced->points, i) - (double)traced->values[i];
        sum += difference * difference;
        count += 1.0;
    }
    return count > 0.0 ? sqrt(sum / count) : 0.0;
}

/* Gets the truth of a probe's footprint, which is traced on first use. Fails: E_NO_MEMORY. */
static enum umb_status truth_get(struct truths *truths, const struct umbt_probe *probe,
                                 const struct traced **truth, struct umb_error *error)
{
    const size_t surface = probe->study->points.first[UMBT_STUDY_FREE];
    for (uint32_t i = 0; i < truths->count; i++) {
        if (umbt_study_truth_is_same(&truths->list[i].truth, &probe->truth)) {
            *truth = &truths->list[i];
            return UMB_OK;
        }
    }
    struct traced *made = &truths->list[truths->count]; /* one a setting at most */
    made->points = &probe->study->points;
    made->truth = probe->truth;
    made->values = malloc((surface + 1) * sizeof *made->values);
    if (made->values == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "the truth of %zu samples does not fit in memory",
                        surface);
    }
    truths->count++;
    const enum umb_status status =
        umbu_range_each(probe->study->common.threads, surface, BLOCK, trace_item, made, error);
    made->error = own_error(made);
    *truth = made;
    return status;
}

/* ---- errors ---- */

static void undefined_item(void *user, size_t i)
{
    struct judging *judging = user;
    const struct umbt_study_points *points = &judging->probe->study->points;
    double normal[3];
    umbt_study_normal(points, i, normal);
    judging->undefined[i] = (uint8_t)(fabsf(judging->answers[i] - judging->area[i]) > JUDGED_M &&
                                      umbt_study_truth_is_undefined(&judging->probe->truth,
                                                                    points->positions[i], normal));
}

/* Counts what an asset reads for a point of the view. */
static void reads_count(const struct umbt_probe *probe, float *values)
{
    const struct umbt_study_points *samples = &probe->study->points;
    const size_t view = samples->first[UMBT_STUDY_BORDER];
    const struct umb_points points =
        umbt_points_at(samples->positions[0], samples->normals[0], view);
    struct umb_answers answers = {.values = values};
    umb_query_run(&probe->query, &points, 0, view, &answers);
    probe->result->nodes = (double)answers.stats.nodes / (double)view;
    probe->result->bricks = (double)answers.stats.bricks / (double)view;
}

static enum umb_status errors_find(struct judging *judging, const struct umbt_probe *probe,
                                   struct umb_error *error)
{
    const struct umbt_study_points *points = &probe->study->points;
    const size_t surface = points->first[UMBT_STUDY_FREE];
    const struct traced *truth = NULL;
    if (probe->peer == NULL) {
        reads_count(probe, judging->answers);
    }
    umbt_probe_answer(probe, 0, points->count, judging->answers);
    UMB__TRY(truth_get(&judging->truths, probe, &truth, error));
    judging->probe = probe;
    judging->area = truth->values;
    UMB__TRY(umbu_range_each(probe->study->common.threads, surface, BLOCK, undefined_item, judging,
                             error));
    const struct umbt_judged judged = {.count = surface,
                                       .border = points->first[UMBT_STUDY_BORDER],
                                       .reach_m = points->reach_m,
                                       .answers = judging->answers,
                                       .area = judging->area,
                                       .sharp =
                                           probe->peer != NULL ? points->opaque : points->sharp,
                                       .boundary_m = points->boundary_m,
                                       .undefined = judging->undefined};
    umbt_errors_area(&judged, probe->result);
    umbt_errors_edges(&judged, judging->off, probe->result);
    probe->result->truth_error = truth->error;
    return UMB_OK;
}

/* ---- all settings ---- */

static void add_setting(struct umbt_study *study, const struct umbt_study_result *setting)
{
    if (study->result_count < UMBT_STUDY_SETTINGS_MAX) {
        study->results[study->result_count++] = *setting;
    }
}

/* Adds a setting of an asset, if the asset supports it. */
static void add_supported(struct umbt_study *study, struct umbt_study_result setting)
{
    const struct umb_query_settings settings = umbt_study_settings(study, &setting);
    struct umb_query ignored;
    setting.name = umbt_study_method_names[setting.method];
    if (umb_query_prepare(study->bakes[setting.bake].asset, &settings, &ignored, NULL) == UMB_OK) {
        add_setting(study, &setting);
    }
}

static void list_asset(struct umbt_study *study, uint32_t b, const uint32_t *taps)
{
    const struct umbt_study_bake *bake = &study->bakes[b];
    struct umbt_study_result setting = {.bake = b, .bytes = bake->info.memory_bytes};
    for (; *taps > 0; taps++) {
        setting.taps = *taps;
        add_supported(study, setting);
    }
    setting.taps = 1;
    for (size_t l = 0; l < sizeof levels / sizeof *levels; l++) {
        setting.level = levels[l];
        if (levels[l] <= umb_level_max(umbt_study_frustum(bake)->log2_size)) {
            add_supported(study, setting);
        }
    }
    setting.level = 0;
    setting.method = UMBT_STUDY_FOOTPRINT;
    add_supported(study, setting);
    setting.method = UMBT_STUDY_TENT;
    setting.taps = WIDE_TAPS;
    add_supported(study, setting);
    if (!umbt_study_is_closed(bake) && bake->light.extent > 0.0) {
        setting.method = UMBT_STUDY_PENUMBRA;
        setting.taps = 1;
        add_supported(study, setting);
    }
}

static void curve_read(const struct umbt_study *study, struct umbt_study_result *result)
{
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count = 0;
    if (result->method == UMBT_STUDY_DAG) {
        (void)umb_asset_get_curve(study->bakes[result->bake].asset, 0, rows, &count);
    }
    result->bound_m = (double)NAN;
    result->lines = (double)NAN;
    for (size_t i = 0; i < count; i++) {
        if (rows[i].taps == result->taps && rows[i].level == result->level) {
            result->bound_m = rows[i].bound_m;
            result->lines = rows[i].lines;
        }
    }
}

static void list_peer(struct umbt_study *study, const struct umbt_peer *peer, const uint32_t *taps)
{
    struct umbt_study_result setting = peer->setting;
    setting.taps = UMBT_PEER_DERIVED_TAPS;
    if (setting.method == UMBT_STUDY_DERIVED) {
        add_setting(study, &setting);
        return;
    }
    for (; *taps > 0; taps++) {
        setting.taps = *taps;
        add_setting(study, &setting);
    }
}

/* Lists all settings, those of assets first, each with its probe. */
static void list_settings(struct umbt_study *study, struct judging *judging)
{
    const uint32_t *taps = widths[study->options.quick];
    study->result_count = 0;
    for (uint32_t b = 0; b < study->bake_count; b++) {
        if (study->bakes[b].asset != NULL) {
            list_asset(study, b, taps);
        }
    }
    for (uint32_t p = 0; p < judging->peers.count; p++) {
        const uint32_t first = study->result_count;
        list_peer(study, &judging->peers.list[p], taps);
        for (uint32_t i = first; i < study->result_count; i++) {
            judging->probes[i].peer = &judging->peers.list[p];
        }
    }
    for (uint32_t i = 0; i < study->result_count; i++) {
        curve_read(study, &study->results[i]);
        judging->probes[i].study = study;
        judging->probes[i].result = &study->results[i];
        judging->probes[i].peers = &judging->peers;
    }
}

static enum umb_status settings_judge(struct umbt_study *study, struct judging *judging,
                                      struct umb_error *error)
{
    const struct umb_points points =
        umbt_points_at(study->points.positions[0], study->points.normals[0], study->points.count);
    struct umbu_progress progress;
    enum umb_status status = UMB_OK;
    judging->answers = calloc(points.count, sizeof *judging->answers);
    judging->off = calloc(points.count, sizeof *judging->off);
    judging->undefined = calloc(points.count, 1);
    if (judging->answers == NULL || judging->off == NULL || judging->undefined == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu samples do not fit in memory", points.count);
    }
    UMB__TRY(umb_points_check(&points, error));
    UMB__TRY(umbt_peers_make(study, &judging->peers, error));
    list_settings(study, judging);
    umbu_progress_begin(&progress, "settings", study->common.quiet);
    for (uint32_t i = 0; status == UMB_OK && i < study->result_count; i++) {
        status = umbt_probe_prepare(&judging->probes[i], error);
        if (status == UMB_OK) {
            status = errors_find(judging, &judging->probes[i], error);
        }
        umbu_progress_show(&progress, i + 1, (i + 1.0) / study->result_count);
    }
    umbu_progress_end(&progress);
    return status == UMB_OK ? umbt_study_times(study, judging->probes, error) : status;
}

enum umb_status umbt_study_measure(struct umbt_study *study, struct umb_error *error)
{
    struct judging *judging = calloc(1, sizeof *judging);
    if (judging == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "the settings do not fit in memory");
    }
    const enum umb_status status = settings_judge(study, judging, error);
    for (uint32_t i = 0; i < study->result_count; i++) {
        umbt_probe_finish(&judging->probes[i]);
    }
    umbt_peers_finish(&judging->peers);
    for (uint32_t i = 0; i < judging->truths.count; i++) {
        free(judging->truths.list[i].values);
    }
    free(judging->answers);
    free(judging->off);
    free(judging->undefined);
    free(judging);
    return status;
}
