/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The shadow maps of the literature in a study (study.h): every row of `umbrage-study techniques`
 * and the voxel DAG of each asset, on the points that one camera sees, with a picture of each.
 *
 * Maps have as many texels a side as one of the study's assets, so that each stands beside a DAG of
 * equal resolution and one of equal bytes.
 */
#include "study/study.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/progress.h"

#define RESOLUTION_QUICK 512
#define RESOLUTION_FULL  1024
#define SUN_RAD          (0.53 * 3.14159265358979323846 / 180.0)

const char *const umbt_study_truth_names[UMBT_TECHNIQUE_TRUTHS] = {"box", "point", "disc"};

void umbt_study_technique_picture(const struct umbt_study_technique *technique,
                                  enum umbt_technique_truth truth, char *name, size_t size)
{
    char plain[UMBT_STUDY_NAME];
    (void)snprintf(plain, sizeof plain, "%s", technique != NULL ? technique->name : "traced");
    for (char *at = plain; *at != '\0'; at++) {
        *at = *at == ' ' ? '-' : *at;
    }
    (void)snprintf(name, size, "pictures/technique-%s-%s.png", plain,
                   umbt_study_truth_names[truth]);
}

/* Colours a pixel of a grey picture by a difference: red where it is too light, blue too dark. */
static void difference_color(double difference, uint8_t pixel[3])
{
    const double size = fmin(1.0, 2.0 * fabs(difference)), fade = 1.0 - size;
    const double grey = 150.0 + 0.35 * ((double)pixel[0] + pixel[1] + pixel[2]) / 3.0;
    pixel[0] = (uint8_t)(grey * fade + (difference > 0.0 ? 225.0 * size : 0.0));
    pixel[1] = (uint8_t)(grey * fade);
    pixel[2] = (uint8_t)(grey * fade + (difference < 0.0 ? 235.0 * size : 0.0));
}

/* Draws the view with `values` as the visibilities of its points, and beneath it the difference
 * from a truth. */
static enum umb_status view_draw(const struct umbt_study *study,
                                 const struct umbt_technique_view *view, const float *values,
                                 const float *truth, const char *name, struct umb_error *error)
{
    const size_t pixels = (size_t)view->size[0] * view->size[1];
    char path[UMBT_STUDY_PATH];
    struct umbt_sheet sheet = {.path = path};
    UMB__TRY(umbt_study_path(study, name, path, error));
    UMB__TRY(umbt_picture_init(&sheet.picture, view->size[0], 2 * view->size[1], error));
    umbt_sheet_draw(&sheet, 0, view, truth);
    memcpy(sheet.picture.pixels + 3 * pixels, sheet.picture.pixels, 3 * pixels);
    umbt_sheet_draw(&sheet, 0, view, values);
    for (size_t i = 0; i < pixels; i++) {
        const uint32_t slot = view->buffer.slots[i];
        difference_color(slot == UMBT_SKY ? 0.0 : (double)values[slot] - (double)truth[slot],
                         sheet.picture.pixels + 3 * (pixels + i));
    }
    const enum umb_status status = umbt_sheet_write(&sheet, error);
    umbt_picture_finish(&sheet.picture);
    return status;
}

/* Adds a row to the report, unless that is full, and draws it. */
static enum umb_status note(struct umbt_study *study, const struct umbt_technique_view *view,
                            const struct umbt_study_technique *row, const float *values,
                            struct umb_error *error)
{
    char name[128];
    if (study->technique_count == UMBT_STUDY_TECHNIQUES_MAX) {
        return UMB_OK;
    }
    study->techniques[study->technique_count++] = *row;
    umbt_study_technique_picture(row, row->truth, name, sizeof name);
    return view_draw(study, view, values, view->compared, name, error);
}

/* Measures an asset by each truth that it supports. */
static enum umb_status dag_measure(struct umbt_study *study, const struct umbt_study_bake *bake,
                                   const struct umbt_technique_view *view, float *values,
                                   struct umb_error *error)
{
    for (int truth = 0; truth < UMBT_TECHNIQUE_TRUTHS; truth++) {
        struct umbt_study_technique row = {.truth = (enum umbt_technique_truth)truth, .bake = bake};
        const enum umb_status status =
            umbt_dag_run(view, bake->asset, row.truth, values, &row.result, error);
        if (status == UMB_E_UNSUPPORTED) {
            continue; /* penumbras of a closed asset */
        }
        UMB__TRY(status);
        row.result.build_s = bake->cpu_s;
        (void)snprintf(row.name, sizeof row.name, "dag %s", bake->name);
        UMB__TRY(note(study, view, &row, values, error));
    }
    return UMB_OK;
}

static enum umb_status maps_measure(struct umbt_study *study,
                                    const struct umbt_technique_view *view, float *values,
                                    struct umb_error *error)
{
    const size_t rows = umbt_technique_row_count;
    struct umbu_progress progress;
    enum umb_status status = UMB_OK;
    umbu_progress_begin(&progress, "techniques", study->common.quiet);
    for (size_t i = 0; i < rows && status == UMB_OK; i++) {
        const struct umbt_technique_row *from = &umbt_technique_rows[i];
        struct umbt_study_technique row = {.truth = from->truth};
        (void)snprintf(row.name, sizeof row.name, "%s", from->name);
        status = umbt_technique_run(view, from, values, &row.result, error);
        if (status == UMB_OK) {
            status = note(study, view, &row, values, error);
        }
        umbu_progress_show(&progress, (double)(i + 1), (double)(i + 1) / (double)rows);
    }
    umbu_progress_end(&progress);
    return status;
}

/* Returns 1 if DAG row `i` stands beside a shadow map better than `best`, -1 for none. */
static int is_finer(const struct umbt_study *study, uint32_t i, int best)
{
    const struct umbt_study_technique *a = &study->techniques[i];
    const struct umbt_study_technique *b = best >= 0 ? &study->techniques[best] : NULL;
    if (b == NULL || a->bake->resolution != b->bake->resolution) {
        return b == NULL || a->bake->resolution > b->bake->resolution;
    }
    return !umbt_study_is_closed(a->bake); /* defined at every point, as a map is */
}

void umbt_study_techniques_pair(struct umbt_study *study)
{
    for (uint32_t m = 0; m < study->technique_count; m++) {
        struct umbt_study_technique *map = &study->techniques[m];
        map->same_texels = map->same_bytes = -1;
        for (uint32_t i = 0; map->bake == NULL && i < study->technique_count; i++) {
            const struct umbt_study_technique *dag = &study->techniques[i];
            if (dag->bake == NULL || dag->truth != map->truth) {
                continue;
            }
            if (dag->bake->resolution == study->technique_resolution &&
                is_finer(study, i, map->same_texels)) {
                map->same_texels = (int)i;
            }
            if (dag->result.info.bytes <= map->result.info.bytes &&
                is_finer(study, i, map->same_bytes)) {
                map->same_bytes = (int)i;
            }
        }
    }
}

static enum umb_status all_measure(struct umbt_study *study, const struct umbt_technique_view *view,
                                   float *values, struct umb_error *error)
{
    char name[128];
    for (int truth = 0; truth < UMBT_TECHNIQUE_TRUTHS; truth++) {
        umbt_study_technique_picture(NULL, (enum umbt_technique_truth)truth, name, sizeof name);
        UMB__TRY(view_draw(study, view, view->truth[truth], view->truth[truth], name, error));
    }
    UMB__TRY(maps_measure(study, view, values, error));
    for (uint32_t i = 0; i < study->bake_count; i++) {
        UMB__TRY(study->bakes[i].asset != NULL
                     ? dag_measure(study, &study->bakes[i], view, values, error)
                     : UMB_OK);
    }
    umbt_study_techniques_pair(study);
    return UMB_OK;
}

static enum umb_status view_measure(struct umbt_study *study, struct umbt_technique_view *view,
                                    struct umb_error *error)
{
    UMB__TRY(umbt_study_camera(study, view->size, &view->setup, error));
    UMB__TRY(umbt_technique_view_make(view, error));
    study->technique_resolution = view->resolution;
    study->technique_points = view->buffer.receiver_count;
    float *values = malloc(study->technique_points * sizeof *values);
    view->compared = malloc(study->technique_points * sizeof *view->compared);
    const enum umb_status status =
        values != NULL && view->compared != NULL
            ? all_measure(study, view, values, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory",
                       study->technique_points);
    free(view->compared);
    free(values);
    return status;
}

static const uint32_t quick_size[2] = {240, 150}, full_size[2] = {320, 200}; /* pixels */

/* Returns the side of the maps in texels: that of an asset of the study. */
static uint32_t resolution_for(const struct umbt_study *study)
{
    const uint32_t wanted = study->options.quick ? RESOLUTION_QUICK : RESOLUTION_FULL;
    uint32_t resolution = study->bakes[0].resolution;
    for (uint32_t i = 0; i < study->bake_count; i++) {
        if (study->bakes[i].asset != NULL && study->bakes[i].resolution <= wanted) {
            resolution = study->bakes[i].resolution;
        }
    }
    return resolution;
}

enum umb_status umbt_study_techniques(struct umbt_study *study, struct umb_error *error)
{
    const uint32_t *size = study->options.quick ? quick_size : full_size;
    struct umbt_technique_view view = {
        .size = {size[0], size[1]},
        .resolution = resolution_for(study),
        .taps = UMBT_STUDY_TAPS,
        .light_rad = SUN_RAD,
        .threads = study->common.threads,
        .quick = study->options.quick,
    };
    if (study->points.lamp != NULL) {
        return UMB_OK; /* study->missing says so */
    }
    const enum umb_status status = view_measure(study, &view, error);
    umbt_technique_view_finish(&view);
    return status;
}
