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
#include "common/json_text.h"
#include "study/output_guard.h"
#include "study/parallel_for.h"
#include "study/study_args.h"
#include "study/technique_dag.h"
#include "study/view_options.h"
#include "tool/exit_code.h"

#define COLUMNS 5U
#define GAP     4U /* pixels between tiles */

static const double degree = 3.14159265358979323846 / 180.0;

static const char help[] =
    "usage: umbrage-study techniques SCENE [options]\n"
    "\n"
    "Runs every shadow map technique on what a camera sees, and compares with traced rays.\n"
    "\n"
    "  -o, --output FILE   all views side by side, PNG: the three truths first, then the table's\n"
    "                      rows from left to right, five a row; - is stdout\n"
    "  --asset FILE        two rows more: an asset baked for the same sun\n"
    "  --resolution N      texels a side, a power of two, 64 to 4096 (default 1024)\n"
    "  --taps N            width of the filter in texels, odd, 1 to 17 (default 9)\n"
    "  --light-size DEG    the sun's diameter for penumbrae, above 0 to 20 (default 0.53)\n"
    "  --sun AZ,EL         degrees (default: the scene's first sun, else 135,45)\n"
    "  --camera WHERE      as `umbrage render` takes it (default: fitted)\n"
    "  --size WxH          pixels of a view (default 256x160)\n"
    "  --up y|z            the scene's up axis (default: by its format)\n"
    "  --threads N         default: all processors\n"
    "  --json              print one JSON object\n"
    "  -q, --quiet         no table\n"
    "  --help\n"
    "\n"
    "Errors are means over points that face the light: of |answer - truth|, and of its parts.\n"
    "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 73 cannot create, 74 I/O, 75 "
    "temporary.\n";

struct study {
    const char *scene_path, *output, *asset_path;
    const char *light_size;
    struct umbt_view_options options;
    uint64_t resolution, taps, threads;
    int json, quiet, help;
    struct umbt_view opened;
    struct umbt_technique_view view;
    struct umbt_picture sheet;
    float *values;
    struct umb_asset *asset;               /* NULL: none */
    size_t row_count;                      /* rows of techniques, then of the asset */
    struct umbt_technique_result *results; /* [row_count] */
};

static enum umb_status options_check(struct study *study, struct umb_error *error)
{
    struct umbt_technique_view *view = &study->view;
    if ((study->resolution & (study->resolution - 1)) != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--resolution: %" PRIu64 " is no power of two",
                        study->resolution);
    }
    if (study->taps % 2 == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--taps: %" PRIu64 " is even", study->taps);
    }
    view->resolution = (uint32_t)study->resolution;
    view->taps = (uint32_t)study->taps;
    view->threads = (unsigned)study->threads;
    view->light_rad = 0.53 * degree;
    if (study->light_size != NULL) {
        const char *at = study->light_size;
        double value = 0.0;
        if (!umbt_number_read(&at, &value) || (*at != '\0' && strcmp(at, "deg") != 0) ||
            !(value > 0.0 && value <= 20.0)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--light-size: '%.60s' is not above 0 and at most 20 degrees",
                            study->light_size);
        }
        view->light_rad = value * degree;
    }
    return UMB_OK;
}

static enum umb_status options_parse(int argc, char **argv, struct study *study,
                                     struct umb_error *error)
{
    const struct umbt_option table[] = {
        {"SCENE", UMBT_WORD, &study->scene_path, 0, 0},
        {"-o", UMBT_TEXT, &study->output, 0, 0},
        {"--output", UMBT_TEXT, &study->output, 0, 0},
        {"--asset", UMBT_TEXT, &study->asset_path, 0, 0},
        {"--resolution", UMBT_COUNT, &study->resolution, 64, 4096},
        {"--taps", UMBT_COUNT, &study->taps, 1, 17},
        {"--light-size", UMBT_TEXT, &study->light_size, 0, 0},
        {"--sun", UMBT_TEXT, &study->options.sun, 0, 0},
        {"--camera", UMBT_TEXT, &study->options.camera, 0, 0},
        {"--size", UMBT_TEXT, &study->options.size, 0, 0},
        {"--up", UMBT_TEXT, &study->options.up, 0, 0},
        {"--threads", UMBT_COUNT, &study->threads, 1, 256},
        {"--json", UMBT_FLAG, &study->json, 0, 0},
        {"--quiet", UMBT_FLAG, &study->quiet, 0, 0},
        {"--help", UMBT_FLAG, &study->help, 0, 0},
    };
    study->resolution = 1024;
    study->taps = 9;
    study->threads = umbt_processor_count();
    study->options = (struct umbt_view_options){.width = 256, .height = 160, .size_max = 2048};
    const enum umb_status status =
        umbt_args_parse(argc, argv, table, sizeof table / sizeof table[0], error);
    if (status != UMB_OK || study->help) {
        return status;
    }
    const enum umb_status checked = umbt_output_check_json(study->output, study->json, error);
    return checked == UMB_OK ? options_check(study, error) : checked;
}

static enum umb_status view_open(struct study *study, struct umb_error *error)
{
    struct umbt_technique_view *view = &study->view;
    const enum umb_status status =
        umbt_view_open(&study->options, study->scene_path, &study->opened, error);
    if (status != UMB_OK) {
        return status;
    }
    view->scene = &study->opened.scene;
    view->camera = study->opened.camera;
    view->z_up = study->opened.z_up;
    view->width = study->options.width;
    view->height = study->options.height;
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
    printf("{\"scene\":");
    umbs_json_text(stdout, study->scene_path);
    printf(",\"triangles\":%zu,\"resolution\":%u,\"taps\":%u,\"points\":%zu,\"techniques\":[",
           study->opened.scene.count, view->resolution, view->taps, view->buffer.receiver_count);
    for (size_t i = 0; i < study->row_count; i++) {
        const struct umbt_technique_result *r = &study->results[i];
        char name[16];
        printf("%s{\"name\":\"%s\",\"truth\":\"%s\",\"mean\":%.9g,\"lighter\":%.9g"
               ",\"darker\":%.9g,\"over_half\":%.9g,\"bytes\":%" PRIu64
               ",\"slack\":%.9g,\"build_s\":%.6f,\"query_ns\":%.1f}",
               i > 0 ? "," : "", row_name(study, i, name, sizeof name), row_truth(i), r->mean,
               r->lighter, r->darker, r->over_half, r->info.bytes, r->info.slack, r->build_s,
               r->query.ns);
    }
    printf("]}\n");
}

int umbt_techniques_command(int argc, char **argv)
{
    struct study study;
    struct umb_error error = {0};
    memset(&study, 0, sizeof study);
    enum umb_status status = options_parse(argc, argv, &study, &error);
    if (status == UMB_OK && study.help) {
        fputs(help, stdout);
        return 0;
    }
    if (status == UMB_OK) {
        status = view_open(&study, &error);
    }
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
        report_text(umbt_output_talk(study.output), &study);
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
