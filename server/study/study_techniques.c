/* SPDX-License-Identifier: Apache-2.0 */
/* See study_techniques.h. */
#include "study/study_techniques.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tool/progress.h"
#include "study/technique_dag.h"
#include "study/technique_view.h"
#include "study/study_pictures.h"

#define WIDTH            256 /* pixels of the view */
#define HEIGHT           160
#define TAPS             9
#define RESOLUTION_MIN   128
#define RESOLUTION_QUICK 512
#define RESOLUTION_FULL  1024
#define SUN_RAD          (0.53 * 3.14159265358979323846 / 180.0)

/* Adds a row to the report. */
static void note(struct umbt_study *study, const char *name, enum umbt_technique_truth truth,
                 const struct umbt_technique_result *result)
{
    struct umbt_study_technique *technique = &study->techniques[study->technique_count++];
    *technique = (struct umbt_study_technique){
        .truth = truth == UMBT_BOX     ? "box"
                 : truth == UMBT_POINT ? "point"
                                       : "disc",
        .bytes = result->info.bytes,
        .build_s = result->build_s,
        .ns = result->query.ns,
        .spread = result->query.spread,
        .mean = result->mean,
        .lighter = result->lighter,
        .darker = result->darker,
        .over_half = result->over_half,
    };
    (void)snprintf(technique->name, sizeof technique->name, "%s", name);
}

static enum umb_status row_measure(struct umbt_study *study, const struct umbt_technique_view *view,
                                   const struct umbt_technique_row *row, float *values,
                                   struct umb_error *error)
{
    struct umbt_technique_result result;
    const enum umb_status status = umbt_technique_run(view, row, values, &result, error);
    if (status == UMB_OK) {
        note(study, row->name, row->truth, &result);
    }
    return status;
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
    const enum umb_status status = umbt_dag_run(view, bake->asset, row, values, &result, error);
    if (status == UMB_OK) {
        result.build_s = bake->cpu_s;
        (void)snprintf(name, sizeof name, "dag %s", bake->name);
        note(study, name, UMBT_BOX, &result);
        study->techniques[study->technique_count - 1].is_dag = 1;
    }
    return status;
}

static enum umb_status all_measure(struct umbt_study *study, const struct umbt_technique_view *view,
                                   float *values, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbu_progress progress;
    umbu_progress_begin(&progress, "techniques", study->options.quiet);
    for (size_t i = 0; status == UMB_OK && i < umbt_technique_row_count &&
                       study->technique_count < UMBT_STUDY_TECHNIQUES_MAX;
         i++) {
        status = row_measure(study, view, &umbt_technique_rows[i], values, error);
        const double done = (double)(i + 1);
        umbu_progress_show(&progress, done, done / (double)umbt_technique_row_count);
    }
    umbu_progress_end(&progress);
    for (uint32_t i = 0; status == UMB_OK && i < study->bake_count; i++) {
        if (study->bakes[i].asset != NULL && study->technique_count < UMBT_STUDY_TECHNIQUES_MAX) {
            status = dag_measure(study, &study->bakes[i], view, values, error);
        }
    }
    return status;
}

/* Texels a side: a power of two, and no more than a quarter of the highest resolution. */
static uint32_t resolution_for(const struct umbt_study_options *options)
{
    uint32_t resolution = options->quick ? RESOLUTION_QUICK : RESOLUTION_FULL;
    while (resolution > RESOLUTION_MIN && resolution > options->max_resolution / 4) {
        resolution /= 2;
    }
    return resolution;
}

enum umb_status umbt_study_techniques(struct umbt_study *study, struct umb_error *error)
{
    struct umbt_technique_view view = {
        .scene = &study->scene,
        .width = WIDTH,
        .height = HEIGHT,
        .resolution = resolution_for(&study->options),
        .taps = TAPS,
        .light_rad = SUN_RAD,
        .threads = (unsigned)study->options.threads,
    };
    memcpy(view.to_light, study->points.to_light, sizeof view.to_light);
    enum umb_status status =
        umbt_study_camera(study, WIDTH, HEIGHT, &view.camera, &view.z_up, error);
    if (status == UMB_OK) {
        status = umbt_technique_view_make(&view, error);
    }
    float *values = status == UMB_OK ? malloc(view.buffer.receiver_count * sizeof *values) : NULL;
    if (status == UMB_OK && values == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory",
                          view.buffer.receiver_count);
    }
    if (status == UMB_OK) {
        study->technique_resolution = view.resolution;
        study->technique_points = view.buffer.receiver_count;
        status = all_measure(study, &view, values, error);
    }
    free(values);
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
        umbu_json_rounded(json, "mean", t->mean, 6);
        umbu_json_rounded(json, "lighter", t->lighter, 6);
        umbu_json_rounded(json, "darker", t->darker, 6);
        umbu_json_rounded(json, "over_half", t->over_half, 6);
        umbu_json_integer(json, "bytes", t->bytes);
        umbu_json_rounded(json, "build_s", t->build_s, 6);
        umbu_json_rounded(json, "spread", t->spread, 6);
        umbu_json_rounded(json, "ns", t->spread > UMBT_STUDY_SPREAD_MAX ? (double)NAN : t->ns, 6);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}
