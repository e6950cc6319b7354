/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `techniques`: every shadow map technique on the same points of a scene, compared with traced
 * rays: error, bytes and time, and one picture of the view by each, side by side.
 */
#include "study/study_command.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/threads.h"
#include "study/technique_dag.h"
#include "study/view_options.h"
#include "tool/exit_code.h"

#define COLUMNS 5U
#define GAP     4U /* pixels between tiles */

struct study {
    const char *scene_path, *output, *asset_path;
    struct umbt_view_options options;
    uint64_t threads;
    int json, quiet;
    struct umbt_view opened;
    struct umbt_technique_view view;
    struct umbt_picture sheet;
    float *values;
    struct umb_asset *asset;               /* NULL: none */
    size_t row_count;                      /* rows of techniques, then of the asset */
    struct umbt_technique_result *results; /* [row_count] */
};

#define AT(field) UMBU_AT(struct study, field)

static const struct umbu_option OPTIONS[] = {
    {"SCENE", NULL, "the scene file", UMBU_TEXT, AT(scene_path), .needed = true},
    {"output", "FILE",
     "all views side by side, PNG: the three truths first, then the table's rows from left to "
     "right, five a row; - is stdout",
     UMBU_TEXT, AT(output), .letter = 'o'},
    {"asset", "FILE", "two rows more: an asset baked for the same sun", UMBU_TEXT, AT(asset_path)},
    {"resolution", "N", "texels a side, 64 to 4096", UMBU_POWER(64, 4096), AT(view.resolution),
     .standard = "1024"},
    {"taps", "N", "width of the filter in texels", UMBU_ODD(1, 17), AT(view.taps), .standard = "9"},
    {"light-size", "DEG", "the sun's diameter for penumbrae, at most 20", UMBU_ABOVE(0, 20),
     .unit = "deg", .scale = 3.14159265358979323846 / 180.0, AT(view.light_rad),
     .standard = "0.53"},
    {UMBT_SUN_ROW(struct study, options.sun)},
    {UMBT_CAMERA_ROW(struct study, options.camera)},
    {UMBT_SIZE_ROW(struct study, options.size, 2048, "256x160")},
    {UMBT_UP_ROW(struct study, options.up)},
    {UMBT_THREADS_ROW(struct study)},
    {UMBU_JSON_ROW(struct study), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct study, "no table")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-study techniques",
    .usage = "umbrage-study techniques SCENE [options]",
    .summary = "Runs every shadow map technique on what a camera sees, and compares with traced\n"
               "rays.",
    .notes = "Errors are means over points that face the light: of |answer - truth|, and of\n"
             "its parts. Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 73 cannot\n"
             "create, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

static enum umb_status view_open(struct study *study, struct umb_error *error)
{
    struct umbt_technique_view *view = &study->view;
    UMB__TRY(umbt_view_open(&study->options, study->scene_path, &study->opened, error));
    view->threads = (unsigned)study->threads;
    view->scene = &study->opened.scene;
    view->camera = study->opened.camera;
    view->z_up = study->opened.z_up;
    view->width = study->options.size[0];
    view->height = study->options.size[1];
    memcpy(view->to_light, study->opened.to_light, sizeof view->to_light);
    return umbt_technique_view_make(view, error);
}

static void tile_draw(struct study *study, size_t tile, const float *values)
{
    if (study->output != NULL) {
        umbt_technique_draw(&study->view, values, &study->sheet,
                            (uint32_t)(tile % COLUMNS) * (study->view.width + GAP),
                            (uint32_t)(tile / COLUMNS) * (study->view.height + GAP));
    }
}

/* Runs row i: a technique, or the asset. */
static enum umb_status row_run(struct study *study, size_t i, struct umb_error *error)
{
    struct umbt_technique_result *result = &study->results[i];
    if (i < umbt_technique_row_count) {
        return umbt_technique_run(&study->view, &umbt_technique_rows[i], study->values, result,
                                  error);
    }
    return umbt_dag_run(&study->view, study->asset, (uint32_t)(i - umbt_technique_row_count),
                        study->values, result, error);
}

static enum umb_status rows_run(struct study *study, struct umb_error *error)
{
    const size_t tiles = UMBT_TECHNIQUE_TRUTHS + study->row_count;
    const uint32_t rows = (uint32_t)((tiles + COLUMNS - 1) / COLUMNS);
    enum umb_status status = UMB_OK;
    study->values = malloc(study->view.buffer.receiver_count * sizeof *study->values);
    study->results = calloc(study->row_count, sizeof *study->results);
    if (study->values == NULL || study->results == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "answers do not fit in memory");
    }
    if (study->output != NULL) {
        status = umbt_picture_init(&study->sheet, COLUMNS * (study->view.width + GAP) - GAP,
                                   rows * (study->view.height + GAP) - GAP, error);
    }
    for (size_t i = 0; i < UMBT_TECHNIQUE_TRUTHS && status == UMB_OK; i++) {
        tile_draw(study, i, study->view.truth[i]);
    }
    for (size_t i = 0; i < study->row_count && status == UMB_OK; i++) {
        status = row_run(study, i, error);
        tile_draw(study, UMBT_TECHNIQUE_TRUTHS + i, study->values);
    }
    if (status == UMB_OK && study->output != NULL) {
        status = umbt_picture_write(&study->sheet, study->output, error);
    }
    return status;
}

/* Name of row i, and its truth. */
static const char *row_name(const struct study *study, size_t i, char *buffer, size_t size)
{
    if (i < umbt_technique_row_count) {
        return umbt_technique_rows[i].name;
    }
    const int box = umbt_dag_truths[i - umbt_technique_row_count] == UMBT_BOX;
    (void)snprintf(buffer, size, "dag-%u", box ? study->view.taps : 1U);
    return buffer;
}

static const char *row_truth(size_t i)
{
    static const char *const names[] = {"box", "point", "penumbra"};
    return names[i < umbt_technique_row_count ? umbt_technique_rows[i].truth
                                              : umbt_dag_truths[i - umbt_technique_row_count]];
}

static void report_text(FILE *to, const struct study *study)
{
    const struct umbt_technique_view *view = &study->view;
    fprintf(to, "%s: %zu triangles, %u texels a side, filter %u, %zu points\n", study->scene_path,
            study->opened.scene.count, view->resolution, view->taps, view->buffer.receiver_count);
    fprintf(to, "%-22s %-9s %9s %9s %9s %8s %11s %8s %9s\n", "technique", "truth", "mean",
            "lighter", "darker", "over 0.5", "bytes", "build s", "ns/point");
    for (size_t i = 0; i < study->row_count; i++) {
        const struct umbt_technique_result *r = &study->results[i];
        char name[16];
        fprintf(to, "%-22s %-9s %9.5f %9.5f %9.5f %7.3f%% %11" PRIu64 " %8.3f %9.0f\n",
                row_name(study, i, name, sizeof name), row_truth(i), r->mean, r->lighter, r->darker,
                100.0 * r->over_half, r->info.bytes, r->build_s, r->query.ns);
    }
}

static void report_json(const struct study *study)
{
    const struct umbt_technique_view *view = &study->view;
    struct umbu_json json = {.file = stdout};
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "scene", study->scene_path);
    umbu_json_integer(&json, "triangles", study->opened.scene.count);
    umbu_json_integer(&json, "resolution", view->resolution);
    umbu_json_integer(&json, "taps", view->taps);
    umbu_json_integer(&json, "points", view->buffer.receiver_count);
    umbu_json_begin(&json, "techniques", '[');
    for (size_t i = 0; i < study->row_count; i++) {
        const struct umbt_technique_result *r = &study->results[i];
        char name[16];
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "name", row_name(study, i, name, sizeof name));
        umbu_json_text(&json, "truth", row_truth(i));
        umbu_json_rounded(&json, "mean", r->mean, 9);
        umbu_json_rounded(&json, "lighter", r->lighter, 9);
        umbu_json_rounded(&json, "darker", r->darker, 9);
        umbu_json_rounded(&json, "over_half", r->over_half, 9);
        umbu_json_integer(&json, "bytes", r->info.bytes);
        umbu_json_rounded(&json, "slack", r->info.slack, 9);
        umbu_json_rounded(&json, "build_s", r->build_s, 6);
        umbu_json_rounded(&json, "query_ns", r->query.ns, 6);
        umbu_json_end(&json, '}');
    }
    umbu_json_close(&json);
}

int umbt_techniques_command(int argc, char **argv)
{
    struct study study;
    struct umb_error error = {0};
    memset(&study, 0, sizeof study);
    struct umbu_parsed parsed;
    study.threads = umbu_processor_count();
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &study);
    if (code >= 0) {
        return code;
    }
    enum umb_status status = view_open(&study, &error);
    study.row_count = umbt_technique_row_count;
    if (status == UMB_OK && study.asset_path != NULL) {
        study.row_count += UMBT_DAG_ROWS;
        status = umbt_dag_open(&study.view, study.asset_path, &study.asset, &error);
    }
    if (status == UMB_OK) {
        status = rows_run(&study, &error);
    }
    if (status == UMB_OK && study.json) {
        report_json(&study);
    } else if (status == UMB_OK && !study.quiet) {
        report_text(umbu_output_talk(study.output), &study);
    }
    free(study.values);
    free(study.results);
    umb_asset_close(study.asset);
    umbt_picture_finish(&study.sheet);
    umbt_technique_view_finish(&study.view);
    umbt_view_close(&study.opened);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage-study techniques: %s\n", error.message);
    }
    return umbu_exit_code(status);
}
