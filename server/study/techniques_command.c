/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `techniques`: every shadow map technique on the same points of a scene, compared with traced
 * rays: error, bytes and time, and one picture of the view by each, side by side.
 */
#include "study/techniques.h"
#include "study/lamp_techniques.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"

struct techniques {
    struct umbt_common common;
    const char *asset_path;
    const char *lamp_text; /* Value of --lamp, or NULL */
    const char *only;      /* Beginning of the names of the rows that run, or NULL */
    struct umbt_technique_view view;
    struct umbt_lamp_view lamp;
    struct umbt_sheet sheet;
    float *values;                         /* [receivers] answers of a row */
    struct umb_asset *asset;               /* NULL: none */
    size_t row_count;                      /* number of rows: techniques, then of the asset */
    struct umbt_technique_result *results; /* [row_count] */
};

#define AT(field) UMBU_AT(struct techniques, field)

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW},
    {"output", "FILE",
     "PNG file with all views side by side, five a row: the three truths first, then the rows of "
     "the table; - is stdout",
     UMBU_TEXT, UMBT_AT(output), .letter = 'o'},
    {"asset", "FILE", "asset file baked for the same sun; adds two rows", UMBU_TEXT, AT(asset_path),
     .excludes = "lamp"},
    {"lamp", "X,Y,Z",
     "position of a point light in metres, in place of the sun: maps of a cube's faces and of two "
     "paraboloids; --sun still places the camera",
     UMBU_TEXT, AT(lamp_text)},
    {"lamp-size", "M", "diameter of the lamp for penumbrae in metres, above 0 to 1000",
     UMBU_ABOVE(0, 1000), AT(lamp.size_m), .standard = "0.2", .needs = "lamp"},
    {"only", "NAME", "runs the rows whose names begin with NAME", UMBU_TEXT, AT(only),
     .otherwise = "all"},
    {"resolution", "N", "texels a side of each map, a power of two from 64 to 4096",
     UMBU_POWER(64, 4096), AT(view.resolution), .standard = "1024"},
    {"taps", "N", "width of the filter in texels", UMBU_ODD(1, 17), AT(view.taps), .standard = "9"},
    {"light-size", "DEG", "angular diameter of the sun for penumbrae in degrees, above 0 to 20",
     UMBU_ABOVE(0, 20), .unit = "deg", .scale = 3.14159265358979323846 / 180.0, AT(view.light_rad),
     .standard = "0.53"},
    {UMBT_SIZE_ROW(2048, "256x160")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-study techniques",
    .usage = "umbrage-study techniques SCENE [options]",
    .summary = "Runs every shadow map technique on what a camera sees, and compares with traced\n"
               "rays.",
    .notes = "Errors are means over points that face the light: of |answer - truth|, and of\n"
             "its parts. Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 73 cannot\n"
             "create, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBT_SETUP},
};

/* Names of the drawings of the truths, in the order of enum umbt_technique_truth. */
static const char *const TRUTH_LABELS[UMBT_TECHNIQUE_TRUTHS] = {"traced: box", "traced: point",
                                                                "traced: penumbra"};

/* Truths of the rows of an asset. */
static const enum umbt_technique_truth DAG_TRUTHS[] = {UMBT_POINT, UMBT_BOX};

/* Name of row i; the asset's is written to the buffer. */
static const char *row_name(const struct techniques *t, size_t i, char *buffer, size_t size)
{
    if (t->lamp_text != NULL) {
        return umbt_lamp_rows[i].name;
    }
    if (i < umbt_technique_row_count) {
        return umbt_technique_rows[i].name;
    }
    const int box = DAG_TRUTHS[i - umbt_technique_row_count] == UMBT_BOX;
    (void)snprintf(buffer, size, "dag-%u", box ? t->view.taps : 1U);
    return buffer;
}

static int is_chosen(const struct techniques *t, size_t i)
{
    char name[16];
    return t->only == NULL ||
           strncmp(row_name(t, i, name, sizeof name), t->only, strlen(t->only)) == 0;
}

static enum umb_status row_run(struct techniques *t, size_t i, struct umb_error *error)
{
    struct umbt_technique_result *result = &t->results[i];
    if (t->lamp_text != NULL) {
        return umbt_lamp_run(&t->lamp, &umbt_lamp_rows[i], t->values, result, error);
    }
    if (i < umbt_technique_row_count) {
        return umbt_technique_run(&t->view, &umbt_technique_rows[i], t->values, result, error);
    }
    return umbt_dag_run(&t->view, t->asset, DAG_TRUTHS[i - umbt_technique_row_count], t->values,
                        result, error);
}

/* Traces the view, under the sun or the lamp, and counts the rows. */
static enum umb_status view_make(struct techniques *t, struct umb_error *error)
{
    if (t->lamp_text != NULL) {
        t->lamp.view = &t->view;
        t->row_count = umbt_lamp_row_count;
        if (!umbu_read_numbers(t->lamp_text, 3, t->lamp.position)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--lamp: '%.80s' is not a position; give X,Y,Z in metres",
                            t->lamp_text);
        }
        return umbt_lamp_view_make(&t->lamp, error);
    }
    t->row_count = umbt_technique_row_count;
    return umbt_technique_view_make(&t->view, error);
}

/* Draws the truths, then runs and draws the chosen rows. */
static enum umb_status rows_run(struct techniques *t, struct umb_error *error)
{
    for (size_t i = 0; i < UMBT_TECHNIQUE_TRUTHS; i++) {
        umbt_sheet_draw(&t->sheet, i, &t->view, t->view.truth[i]);
        umbt_sheet_label(&t->sheet, i, &t->view, TRUTH_LABELS[i]);
    }
    size_t tile = UMBT_TECHNIQUE_TRUTHS;
    for (size_t i = 0; i < t->row_count; i++) {
        if (is_chosen(t, i)) {
            char name[16];
            UMB__TRY(row_run(t, i, error));
            umbt_sheet_draw(&t->sheet, tile, &t->view, t->values);
            umbt_sheet_label(&t->sheet, tile++, &t->view, row_name(t, i, name, sizeof name));
        }
    }
    return umbt_sheet_write(&t->sheet, error);
}

static enum umb_status techniques_run(void *state, const struct umbu_parsed *parsed,
                                      struct umb_error *error)
{
    struct techniques *t = state;
    (void)parsed;
    UMB__TRY(umbt_setup_open(&t->common, &t->view.setup, error));
    t->view.threads = t->common.threads;
    memcpy(t->view.size, t->common.size, sizeof t->view.size);
    UMB__TRY(view_make(t, error));
    if (t->asset_path != NULL) {
        t->row_count += sizeof DAG_TRUTHS / sizeof DAG_TRUTHS[0];
        UMB__TRY(umbt_dag_open(&t->view, t->asset_path, &t->asset, error));
    }
    size_t chosen = 0;
    for (size_t i = 0; i < t->row_count; i++) {
        chosen += (size_t)is_chosen(t, i);
    }
    if (chosen == 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--only: '%.80s': no row begins so; `umbrage-study "
                        "techniques SCENE` prints all",
                        t->only);
    }
    t->values = malloc(t->view.buffer.receiver_count * sizeof *t->values);
    t->results = calloc(t->row_count, sizeof *t->results);
    if (t->values == NULL || t->results == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "answers do not fit in memory");
    }
    UMB__TRY(umbt_sheet_begin(&t->sheet, t->common.output, &t->view, UMBT_TECHNIQUE_TRUTHS + chosen,
                              error));
    return rows_run(t, error);
}

static const char *row_truth(const struct techniques *t, size_t i)
{
    static const char *const names[] = {"box", "point", "penumbra"};
    if (t->lamp_text != NULL) {
        return names[umbt_lamp_rows[i].truth];
    }
    return names[i < umbt_technique_row_count ? umbt_technique_rows[i].truth
                                              : DAG_TRUTHS[i - umbt_technique_row_count]];
}

/* Prints the seams of all rows with cascades. */
static void seams_text(FILE *to, const struct techniques *t)
{
    fprintf(to, "\n%-22s %9s %9s %9s %11s %9s\n", "seams", "at m", "points", "C", "jump, C = 1",
            "jump");
    for (size_t i = 0; i < t->row_count; i++) {
        for (uint32_t k = 0; k < t->results[i].seam_count; k++) {
            const struct umbt_seam *seam = &t->results[i].seams[k];
            fprintf(to, "%-22s %9.3g %9zu %9.3f %11.4f %9.4f\n", umbt_technique_rows[i].name,
                    seam->distance_m, seam->points, seam->contrast, seam->before, seam->after);
        }
    }
}

static void report_text(FILE *to, const void *state)
{
    const struct techniques *t = state;
    const struct umbt_technique_view *view = &t->view;
    fprintf(to, "%s: %zu triangles, %u texels a side, filter %u, %zu points\n",
            t->common.scene_path, t->common.scene.count, view->resolution, view->taps,
            view->buffer.receiver_count);
    fprintf(to, "%-22s %-9s %9s %9s %9s %8s %11s %8s %9s\n", "technique", "truth", "mean",
            "lighter", "darker", "over 0.5", "bytes", "build s", "ns/point");
    for (size_t i = 0; i < t->row_count; i++) {
        const struct umbt_technique_result *r = &t->results[i];
        char name[16];
        if (!is_chosen(t, i)) {
            continue;
        }
        fprintf(to, "%-22s %-9s %9.5f %9.5f %9.5f %7.3f%% %11" PRIu64 " %8.3f %9.0f\n",
                row_name(t, i, name, sizeof name), row_truth(t, i), r->mean, r->lighter, r->darker,
                100.0 * r->over_half, r->info.bytes, r->build_s, r->time.ns);
    }
    if (t->lamp_text == NULL) {
        seams_text(to, t);
    }
}

static void seams_json(struct umbu_json *json, const struct umbt_technique_result *result)
{
    if (result->seam_count == 0) {
        return;
    }
    umbu_json_begin(json, "seams", '[');
    for (uint32_t i = 0; i < result->seam_count; i++) {
        const struct umbt_seam *seam = &result->seams[i];
        umbu_json_begin(json, NULL, '{');
        umbu_json_integer(json, "points", seam->points);
        UMBU_JSON_VALUES(json, 6, {"distance_m", seam->distance_m}, {"contrast", seam->contrast},
                         {"jump_c1", seam->before}, {"jump", seam->after});
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

static void report_json(struct umbu_json *json, const void *state)
{
    const struct techniques *t = state;
    umbu_json_text(json, "scene", t->common.scene_path);
    UMBU_JSON_COUNTS(json, {"triangles", t->common.scene.count}, {"resolution", t->view.resolution},
                     {"taps", t->view.taps}, {"points", t->view.buffer.receiver_count});
    umbu_json_begin(json, "techniques", '[');
    for (size_t i = 0; i < t->row_count; i++) {
        const struct umbt_technique_result *r = &t->results[i];
        char name[16];
        if (!is_chosen(t, i)) {
            continue;
        }
        umbu_json_begin(json, NULL, '{');
        umbu_json_text(json, "name", row_name(t, i, name, sizeof name));
        umbu_json_text(json, "truth", row_truth(t, i));
        umbu_json_integer(json, "bytes", r->info.bytes);
        UMBU_JSON_VALUES(json, 9, {"mean", r->mean}, {"lighter", r->lighter}, {"darker", r->darker},
                         {"over_half", r->over_half}, {"slack", r->info.slack});
        UMBU_JSON_VALUES(json, 6, {"build_s", r->build_s}, {"query_ns", r->time.ns});
        seams_json(json, r);
        umbu_json_end(json, '}');
    }
}

static void finish(void *state)
{
    struct techniques *t = state;
    free(t->values);
    free(t->results);
    umb_asset_close(t->asset);
    umbt_picture_finish(&t->sheet.picture);
    umbt_lamp_view_finish(&t->lamp);
    umbt_technique_view_finish(&t->view);
}

const struct umbt_command umbt_techniques = {
    &COMMAND, sizeof(struct techniques), techniques_run, report_text, report_json, finish};
