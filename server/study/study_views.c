/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a study shows of one view (study.h): a picture by each resolution, and its difference from
 * rays; the shadow maps of the literature, every row of `umbrage-study techniques`, and the voxel
 * DAG of each asset, on the points that the camera sees.
 */
#include "study/study.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "study/study_picture.h"
#include "tool/progress.h"

#define WIDTH            640
#define HEIGHT           360
#define RESOLUTION_MIN   128
#define RESOLUTION_QUICK 512
#define RESOLUTION_FULL  1024
#define SUN_RAD          (0.53 * 3.14159265358979323846 / 180.0)

int umbt_study_has_picture(const struct umbt_study_result *result)
{
    return result->method == UMBT_STUDY_DAG && result->level == 0 &&
           (result->taps == 1 || result->taps == 9);
}

void umbt_study_picture_name(const struct umbt_study *study, const struct umbt_study_result *result,
                             int difference, char *name, size_t size)
{
    (void)snprintf(name, size, "pictures/%s-%u%s.png", study->bakes[result->bake].name,
                   result->taps, difference ? "-difference" : "");
}

static enum umb_status picture_save(const struct umbt_study *study,
                                    const struct umbt_picture *picture, const char *name,
                                    struct umb_error *error)
{
    char path[UMBT_STUDY_PATH];
    UMB__TRY(umbt_study_path(study, name, path, error));
    return umbt_picture_write(picture, path, error);
}

/* Makes the view of `umbrage render` for a picture of that size. */
static enum umb_status camera_make(const struct umbt_study *study, const uint32_t size[2],
                                   struct umbt_setup *setup, struct umb_error *error)
{
    const struct umbt_camera_request fitted = {0};
    setup->scene = &study->common.scene;
    setup->z_up = study->z_up;
    memcpy(setup->to_light, study->points.to_light, sizeof setup->to_light);
    return umbt_setup_camera(setup, &fitted, size, error);
}

static enum umb_status result_draw(const struct umbt_study *study,
                                   const struct umbt_study_result *result,
                                   const struct umbt_setup *setup, struct umbt_pictures *pictures,
                                   struct umb_error *error)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    struct umbt_shadow_source source = {
        .name = bake->name, .asset = bake->asset, .settings.taps = result->taps};
    struct umbt_picture_result ignored;
    char name[128];
    UMB__TRY(umb_query_prepare(bake->asset, &source.settings, &source.query, error));
    struct umbt_truth truth =
        umbt_truth_of(&study->common.scene, setup->to_light, bake->info.origin, &bake->frustum);
    truth.kind = UMBT_TRUTH_SURFACE;
    truth.settings = source.settings;
    truth.closed = NULL; /* its numbers are not used */
    struct umbt_picture_light light = umbt_picture_sun(setup);
    light.source = &source;
    light.truth = &truth;
    const struct umbt_picture_request request = {
        .setup = setup,
        .size = {WIDTH, HEIGHT},
        .lights = &light,
        .light_count = 1,
        .aa = study->options.quick ? 1 : 2,
        .threads = study->common.threads,
        .difference = 1,
        .quiet = 1,
    };
    umbt_pictures_finish(pictures);
    UMB__TRY(umbt_picture_render(&request, pictures, &ignored, error));
    umbt_study_picture_name(study, result, 0, name, sizeof name);
    UMB__TRY(picture_save(study, &pictures->asset, name, error));
    umbt_study_picture_name(study, result, 1, name, sizeof name);
    return picture_save(study, &pictures->difference, name, error);
}

static enum umb_status pictures_draw(const struct umbt_study *study, struct umbt_pictures *pictures,
                                     struct umb_error *error)
{
    static const uint32_t size[2] = {WIDTH, HEIGHT};
    struct umbt_setup setup;
    UMB__TRY(camera_make(study, size, &setup, error));
    for (uint32_t i = 0; i < study->result_count; i++) {
        if (umbt_study_has_picture(&study->results[i])) {
            UMB__TRY(result_draw(study, &study->results[i], &setup, pictures, error));
        }
    }
    return picture_save(study, &pictures->traced, "pictures/traced.png", error);
}

enum umb_status umbt_study_pictures(struct umbt_study *study, struct umb_error *error)
{
    struct umbt_pictures pictures = {0};
    UMB__TRY(umbt_study_folder(study, "pictures", error));
    const enum umb_status status = pictures_draw(study, &pictures, error);
    umbt_pictures_finish(&pictures);
    return status;
}

/* ---- techniques ---- */

/* Adds a row to the report, unless that is full. */
static void note(struct umbt_study *study, const char *name, int is_dag,
                 enum umbt_technique_truth truth, const struct umbt_technique_result *result)
{
    if (study->technique_count < UMBT_STUDY_TECHNIQUES_MAX) {
        struct umbt_study_technique *technique = &study->techniques[study->technique_count++];
        *technique =
            (struct umbt_study_technique){.truth = truth, .is_dag = is_dag, .result = *result};
        (void)snprintf(technique->name, sizeof technique->name, "%s", name);
    }
}

/* Measures the view's filter on the DAG of one asset, as one more technique. */
static enum umb_status dag_measure(struct umbt_study *study, const struct umbt_study_bake *bake,
                                   const struct umbt_technique_view *view, float *values,
                                   struct umb_error *error)
{
    struct umbt_technique_result result;
    char name[UMBT_STUDY_NAME];
    UMB__TRY(umbt_dag_run(view, bake->asset, UMBT_BOX, values, &result, error));
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
    umbu_progress_begin(&progress, "techniques", study->common.quiet);
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
    UMB__TRY(camera_make(study, view->size, &view->setup, error));
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
        .size = {256, 160},
        .resolution = resolution_for(&study->options),
        .taps = UMBT_STUDY_TAPS,
        .light_rad = SUN_RAD,
        .threads = study->common.threads,
    };
    const enum umb_status status = view_measure(study, &view, error);
    umbt_technique_view_finish(&view);
    return status;
}
