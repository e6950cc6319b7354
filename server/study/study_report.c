/* SPDX-License-Identifier: Apache-2.0 */
/* report.json, report.csv and the summary of a study (study.h). */
#include "study/study_report.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/output.h"
#include "study/study_techniques.h"
#include "umbrage/version.h"

#define PATH_BYTES 4096

static void json_bake(struct umbu_json *json, const struct umbt_study_bake *bake)
{
    char id[UMB_ID_TEXT_SIZE] = "";
    if (bake->asset != NULL) {
        umb_id_to_text(bake->info.id, id);
    }
    umbu_json_begin(json, NULL, '{');
    umbu_json_text(json, "name", bake->name);
    umbu_json_text(json, "asset", id);
    umbu_json_integer(json, "resolution", bake->resolution);
    umbu_json_bool(json, "closed", bake->asset != NULL && bake->frustum.closed);
    umbu_json_text(json, "reason", bake->reason);
    umbu_json_integer(json, "packed_bytes", bake->packed_bytes);
    umbu_json_integer(json, "memory_bytes", bake->info.memory_bytes);
    umbu_json_rounded(json, "voxel_m", bake->voxel_m, 6);
    umbu_json_rounded(json, "bake_s", bake->wall_s, 6);
    umbu_json_rounded(json, "bake_cpu_s", bake->cpu_s, 6);
    umbu_json_end(json, '}');
}

/* A column: a number of a result, by name. */
struct column {
    const char *name;
    double value;
};

#define COLUMNS 24

/* A time for the report; left out if its runs differ too much. */
static double told(double ns, double spread)
{
    return spread <= UMBT_STUDY_SPREAD_MAX ? ns : (double)NAN;
}

static void columns_of(const struct umbt_study_result *r, struct column columns[COLUMNS])
{
    const struct column all[COLUMNS] = {
        {"rms", r->rms},
        {"worst", r->worst},
        {"over_001", r->over_001},
        {"over_01", r->over_01},
        {"over_05", r->over_05},
        {"false_light", r->false_light},
        {"false_shadow", r->false_shadow},
        {"undecided", r->undecided},
        {"off_p50_m", r->off_p50_m},
        {"off_p95_m", r->off_p95_m},
        {"off_max_m", r->off_max_m},
        {"off_unknown", r->off_unknown},
        {"truth_error", r->truth_error},
        {"ns_view", told(r->ns_view, r->spread)},
        {"ns_free", told(r->ns_free, r->spread_free)},
        {"ns_view_all", told(r->ns_view_all, r->spread_all)},
        {"spread", r->spread},
        {"spread_free", r->spread_free},
        {"spread_all", r->spread_all},
        {"nodes", r->nodes},
        {"bricks", r->bricks},
        {"lines", r->lines},
        {"bound_m", r->bound_m},
        {"undefined", (double)r->undefined},
    };
    memcpy(columns, all, sizeof all);
}

static void json_result(struct umbu_json *json, const struct umbt_study_result *result)
{
    struct column columns[COLUMNS];
    columns_of(result, columns);
    umbu_json_begin(json, NULL, '{');
    umbu_json_text(json, "method", result->name);
    umbu_json_integer(json, "bake", result->bake);
    umbu_json_integer(json, "taps", result->taps);
    umbu_json_integer(json, "level", result->level);
    umbu_json_integer(json, "judged", result->judged);
    umbu_json_integer(json, "memory_bytes", result->bytes);
    umbu_json_rounded(json, "build_s", result->build_s, 6);
    for (int i = 0; i < COLUMNS; i++) {
        umbu_json_rounded(json, columns[i].name, columns[i].value, 6);
    }
    umbu_json_end(json, '}');
}

static void json_head(struct umbu_json *json, const struct umbt_study *study)
{
    const struct umbt_study_points *points = &study->points;
    umbu_json_text(json, "scene", study->options.scene);
    umbu_json_text(json, "version", UMB_VERSION_TEXT);
    umbu_json_integer(json, "triangles", study->scene.count);
    umbu_json_integer(json, "seed", study->options.seed);
    umbu_json_integer(json, "threads", study->options.threads);
    umbu_json_vector(json, "light", study->bakes[0].light.direction);
    umbu_json_rounded(json, "diagonal_m", study->scene.diagonal_m, 6);
    umbu_json_rounded(json, "reach_m", points->reach_m, 6);
    umbu_json_rounded(json, "study_s", study->seconds, 6);
    umbu_json_integer(json, "truth_rays", study->options.truth_side * study->options.truth_side);
    umbu_json_integer(json, "runs", UMBT_STUDY_RUNS);
    umbu_json_begin(json, "samples", '{');
    for (int s = 0; s < UMBT_STUDY_SET_COUNT; s++) {
        umbu_json_integer(json, umbt_study_set_names[s], points->first[s + 1] - points->first[s]);
    }
    umbu_json_end(json, '}');
    umbu_json_text(json, "plan", study->bakes[0].info.plan);
}

static void json_rays(struct umbu_json *json, const struct umbt_study *study)
{
    const double spread = study->rays.spread;
    umbu_json_integer(json, "rays", 1);
    umbu_json_rounded(json, "ns_view", told(study->rays.ns_view, spread), 6);
    umbu_json_rounded(json, "ns_view8", told(study->rays.ns_view8, spread), 6);
    umbu_json_rounded(json, "ns_free", told(study->rays.ns_free, spread), 6);
    umbu_json_rounded(json, "ns_area81", told(study->rays.ns_area, spread), 6);
    umbu_json_rounded(json, "ns_area81_8", told(study->rays.ns_area8, spread), 6);
    umbu_json_rounded(json, "spread", spread, 6);
}

void umbt_study_put(struct umbu_json *json, const struct umbt_study *study)
{
    char summary[4096];
    json_head(json, study);
    umbu_json_begin(json, "rays", '{');
    json_rays(json, study);
    umbu_json_end(json, '}');
    umbu_json_begin(json, "techniques", '{');
    umbt_study_techniques_json(json, study);
    umbu_json_end(json, '}');
    umbu_json_begin(json, "bakes", '[');
    for (uint32_t i = 0; i < study->bake_count; i++) {
        json_bake(json, &study->bakes[i]);
    }
    umbu_json_end(json, ']');
    umbu_json_begin(json, "results", '[');
    for (uint32_t i = 0; i < study->result_count; i++) {
        json_result(json, &study->results[i]);
    }
    umbu_json_end(json, ']');
    umbt_study_summary(study, summary, sizeof summary);
    umbu_json_text(json, "verdict", summary);
    umbu_json_text(json, "missing", study->missing);
}

void umbt_study_json(FILE *to, const struct umbt_study *study)
{
    struct umbu_json json = {.file = to};
    umbu_json_begin(&json, NULL, '{');
    umbt_study_put(&json, study);
    umbu_json_close(&json);
}

static void csv(FILE *to, const struct umbt_study *study)
{
    struct column columns[COLUMNS];
    columns_of(&study->results[0], columns);
    fputs("method,bake,resolution,closed,taps,level,voxel_m,packed_bytes,memory_bytes,bake_s", to);
    for (int i = 0; i < COLUMNS; i++) {
        fprintf(to, ",%s", columns[i].name);
    }
    fputs("\n", to);
    for (uint32_t r = 0; r < study->result_count; r++) {
        const struct umbt_study_result *result = &study->results[r];
        const struct umbt_study_bake *bake = &study->bakes[result->bake];
        columns_of(result, columns);
        const int peer = result->method >= UMBT_STUDY_DEPTH_MAP; /* peers have no file */
        fprintf(to, "%s,%s,%u,%d,%u,%u,%.6g,", result->name, bake->name, bake->resolution,
                bake->frustum.closed, result->taps, result->level, bake->voxel_m);
        fprintf(to, peer ? "," : "%" PRIu64 ",", bake->packed_bytes);
        fprintf(to, "%" PRIu64 ",%.6g", result->bytes, bake->wall_s + result->build_s);
        for (int i = 0; i < COLUMNS; i++) {
            fprintf(to, isfinite(columns[i].value) ? ",%.6g" : ",", columns[i].value);
        }
        fputs("\n", to);
    }
}

/* Writes the output of `print` as one file. */
static enum umb_status print_file(const struct umbt_study *study, const char *name,
                                  void (*print)(FILE *to, const struct umbt_study *study),
                                  struct umb_error *error)
{
    struct umbu_output output;
    char path[PATH_BYTES];
    if (snprintf(path, sizeof path, "%s/%s", study->options.folder, name) >= (int)sizeof path) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: the path has more than %d bytes", PATH_BYTES);
    }
    UMB__TRY(umbu_output_begin(path, UMBU_OUTPUT_COMMAND, &output, error));
    print(output.file, study);
    return umbu_output_commit(&output, error);
}

enum umb_status umbt_study_report(const struct umbt_study *study, struct umb_error *error)
{
    static const struct {
        const char *name;
        void (*print)(FILE *to, const struct umbt_study *study);
    } files[] = {
        {"report.json", umbt_study_json}, {"report.csv", csv}, {"report.html", umbt_study_page}};
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < sizeof files / sizeof files[0]; i++) {
        status = print_file(study, files[i].name, files[i].print, error);
    }
    return status;
}
