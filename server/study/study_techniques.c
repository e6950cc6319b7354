/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The shadow maps of the literature in the study: every row of `umbrage-study techniques`, and the
 * voxel DAG of each asset, on the points that one camera sees.
 */
#include "study/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/progress.h"
#include "study/technique_run.h"

#define WIDTH            256 /* pixels of the view */
#define HEIGHT           160
#define TAPS             9
#define RESOLUTION_MIN   128
#define RESOLUTION_QUICK 512
#define RESOLUTION_FULL  1024
#define SUN_RAD          (0.53 * 3.14159265358979323846 / 180.0)

/* Adds a row to the report, unless that is full. */
static void note(struct umbt_study *study, const char *name, int is_dag,
                 enum umbt_technique_truth truth, const struct umbt_technique_result *result)
{
    if (study->technique_count == UMBT_STUDY_TECHNIQUES_MAX) {
        return;
    }
    struct umbt_study_technique *technique = &study->techniques[study->technique_count++];
    *technique = (struct umbt_study_technique){
        .is_dag = is_dag,
        .truth = truth == UMBT_BOX     ? "box"
                 : truth == UMBT_POINT ? "point"
                                       : "disc",
        .bytes = result->info.bytes,
        .build_s = result->build_s,
        .ns = result->ns,
        .spread = result->spread,
        .mean = result->mean,
        .lighter = result->lighter,
        .darker = result->darker,
        .over_half = result->over_half,
    };
    (void)snprintf(technique->name, sizeof technique->name, "%s", name);
}

/* Measures the view's filter on the DAG of one asset, as one more technique. */
static enum umb_status dag_measure(struct umbt_study *study, const struct umbt_study_bake *bake,
                                   const struct umbt_technique_view *view, float *values,
                                   struct umb_error *error)
{
    struct umbt_technique_result result;
    char name[UMBT_STUDY_NAME];
    uint32_t row = 0;
    while (umbt_dag_truths[row] != UMBT_BOX) {
        row++;
    }
    UMB__TRY(umbt_dag_run(view, bake->asset, row, values, &result, error));
    result.build_s = bake->cpu_s;
    (void)snprintf(name, sizeof name, "dag %s", bake->name);
    note(study, name, 1, UMBT_BOX, &result);
    return UMB_OK;
}

static enum umb_status all_measure(struct umbt_study *study, const struct umbt_technique_view *view,
                                   float *values, struct umb_error *error)
{
    const size_t rows = umbt_technique_row_count;
    struct umbu_progress progress;
    struct umbt_technique_result result;
    enum umb_status status = UMB_OK;
    umbu_progress_begin(&progress, "techniques", study->options.quiet);
    for (size_t i = 0; i < rows && status == UMB_OK; i++) {
        const struct umbt_technique_row *row = &umbt_technique_rows[i];
        status = umbt_technique_run(view, row, values, &result, error);
        if (status == UMB_OK) {
            note(study, row->name, 0, row->truth, &result);
        }
        umbu_progress_show(&progress, (double)(i + 1), (double)(i + 1) / (double)rows);
    }
    umbu_progress_end(&progress);
    for (uint32_t i = 0; i < study->bake_count && status == UMB_OK; i++) {
        if (study->bakes[i].asset != NULL) {
            status = dag_measure(study, &study->bakes[i], view, values, error);
        }
    }
    return status;
}

/* Returns a map's side in texels: a power of two, at most a quarter of the highest resolution. */
static uint32_t resolution_for(const struct umbt_study_options *options)
{
    uint32_t resolution = options->quick ? RESOLUTION_QUICK : RESOLUTION_FULL;
    while (resolution > RESOLUTION_MIN && resolution > options->max_resolution / 4) {
        resolution /= 2;
    }
    return resolution;
}

static enum umb_status view_measure(struct umbt_study *study, struct umbt_technique_view *view,
                                    struct umb_error *error)
{
    UMB__TRY(umbt_study_camera(study, view->size, &view->setup, error));
    UMB__TRY(umbt_technique_view_make(view, error));
    study->technique_resolution = view->resolution;
    study->technique_points = view->buffer.receiver_count;
    float *values = malloc(study->technique_points * sizeof *values);
    const enum umb_status status =
        values != NULL ? all_measure(study, view, values, error)
                       : umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory",
                                  study->technique_points);
    free(values);
    return status;
}

enum umb_status umbt_study_techniques(struct umbt_study *study, struct umb_error *error)
{
    struct umbt_technique_view view = {
        .size = {WIDTH, HEIGHT},
        .resolution = resolution_for(&study->options),
        .taps = TAPS,
        .light_rad = SUN_RAD,
        .threads = (unsigned)study->options.threads,
    };
    const enum umb_status status = view_measure(study, &view, error);
    umbt_technique_view_finish(&view);
    return status;
}

void umbt_study_techniques_json(struct umbu_json *json, const struct umbt_study *study)
{
    umbu_json_integer(json, "resolution", study->technique_resolution);
    umbu_json_integer(json, "taps", TAPS);
    umbu_json_integer(json, "points", study->technique_points);
    umbu_json_begin(json, "rows", '[');
    for (uint32_t i = 0; i < study->technique_count; i++) {
        const struct umbt_study_technique *t = &study->techniques[i];
        umbu_json_begin(json, NULL, '{');
        umbu_json_text(json, "name", t->name);
        umbu_json_text(json, "truth", t->truth);
        umbu_json_bool(json, "dag", t->is_dag);
        umbu_json_integer(json, "bytes", t->bytes);
        UMBU_JSON_VALUES(json, 6, {"mean", t->mean}, {"lighter", t->lighter}, {"darker", t->darker},
                         {"over_half", t->over_half}, {"build_s", t->build_s},
                         {"spread", t->spread},
                         {"ns", t->spread > UMBT_STUDY_SPREAD_MAX ? (double)NAN : t->ns});
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}
