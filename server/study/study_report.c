/* SPDX-License-Identifier: Apache-2.0 */
/* report.json, report.csv and the summary of a study (study.h). */
#include "study/study_report.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/json_text.h"
#include "study/output_guard.h"
#include "study/study_techniques.h"
#include "umbrage/version.h"

#define PATH_BYTES 4096

enum umb_status umbt_study_write(const struct umbt_study *study, const char *name,
                                 const void *bytes, size_t size, struct umb_error *error)
{
    char path[PATH_BYTES];
    if (snprintf(path, sizeof path, "%s/%s", study->options.folder, name) >= (int)sizeof path) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: the path has more than %d bytes", PATH_BYTES);
    }
    return umbt_output_replace(path, bytes, size, error);
}

/* Writes a number; JSON has no infinities. */
static void number(FILE *to, const char *name, double value)
{
    fprintf(to, isfinite(value) ? ",\"%s\":%.6g" : ",\"%s\":null", name, value);
}

static void json_bake(FILE *to, const struct umbt_study_bake *bake)
{
    char id[UMB_ID_TEXT_SIZE] = "";
    if (bake->asset != NULL) {
        umb_id_to_text(bake->info.id, id);
    }
    fprintf(to, "{\"name\":\"%s\",\"asset\":\"%s\",\"resolution\":%u,\"closed\":%s,\"reason\":",
            bake->name, id, bake->resolution,
            bake->asset != NULL && bake->frustum.closed ? "true" : "false");
    umbs_json_text(to, bake->reason);
    fprintf(to, ",\"packed_bytes\":%" PRIu64 ",\"memory_bytes\":%" PRIu64, bake->packed_bytes,
            bake->info.memory_bytes);
    number(to, "voxel_m", bake->voxel_m);
    number(to, "bake_s", bake->wall_s);
    number(to, "bake_cpu_s", bake->cpu_s);
    fputs("}", to);
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

static void json_result(FILE *to, const struct umbt_study_result *result)
{
    struct column columns[COLUMNS];
    columns_of(result, columns);
    fprintf(to,
            "{\"method\":\"%s\",\"bake\":%u,\"taps\":%u,\"level\":%u,\"judged\":%" PRIu64
            ",\"memory_bytes\":%" PRIu64,
            result->name, result->bake, result->taps, result->level, result->judged, result->bytes);
    number(to, "build_s", result->build_s);
    for (int i = 0; i < COLUMNS; i++) {
        number(to, columns[i].name, columns[i].value);
    }
    fputs("}", to);
}

static void json_head(FILE *to, const struct umbt_study *study)
{
    const struct umbt_study_points *points = &study->points;
    const double *light = study->bakes[0].light.direction;
    fputs("{\"scene\":", to);
    umbs_json_text(to, study->options.scene);
    fprintf(to, ",\"version\":\"%s\",\"triangles\":%zu,\"seed\":%" PRIu64 ",\"threads\":%" PRIu64,
            UMB_VERSION_TEXT, study->scene.count, study->options.seed, study->options.threads);
    fprintf(to, ",\"light\":[%.9g,%.9g,%.9g]", light[0], light[1], light[2]);
    number(to, "diagonal_m", study->scene.diagonal_m);
    number(to, "reach_m", points->reach_m);
    number(to, "study_s", study->seconds);
    fprintf(to, ",\"truth_rays\":%" PRIu64 ",\"runs\":%d,\"samples\":{",
            study->options.truth_side * study->options.truth_side, UMBT_STUDY_RUNS);
    for (int s = 0; s < UMBT_STUDY_SET_COUNT; s++) {
        fprintf(to, "%s\"%s\":%zu", s > 0 ? "," : "", umbt_study_set_names[s],
                points->first[s + 1] - points->first[s]);
    }
    fputs("}", to);
}

void umbt_study_json(FILE *to, const struct umbt_study *study)
{
    char summary[4096];
    json_head(to, study);
    fputs(",\"plan\":", to);
    umbs_json_text(to, study->bakes[0].info.plan);
    fputs(",\"rays\":{\"rays\":1", to);
    number(to, "ns_view", told(study->rays.ns_view, study->rays.spread));
    number(to, "ns_view8", told(study->rays.ns_view8, study->rays.spread));
    number(to, "ns_free", told(study->rays.ns_free, study->rays.spread));
    number(to, "ns_area81", told(study->rays.ns_area, study->rays.spread));
    number(to, "ns_area81_8", told(study->rays.ns_area8, study->rays.spread));
    number(to, "spread", study->rays.spread);
    fputs("},\"techniques\":", to);
    umbt_study_techniques_json(to, study);
    fputs(",\"bakes\":[", to);
    for (uint32_t i = 0; i < study->bake_count; i++) {
        fputs(i > 0 ? "," : "", to);
        json_bake(to, &study->bakes[i]);
    }
    fputs("],\"results\":[", to);
    for (uint32_t i = 0; i < study->result_count; i++) {
        fputs(i > 0 ? "," : "", to);
        json_result(to, &study->results[i]);
    }
    umbt_study_summary(study, summary, sizeof summary);
    fputs("],\"verdict\":", to);
    umbs_json_text(to, summary);
    fputs(",\"missing\":", to);
    umbs_json_text(to, study->missing);
    fputs("}\n", to);
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
    char *text = NULL;
    size_t size = 0;
    FILE *to = open_memstream(&text, &size);
    if (to == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%s does not fit in memory", name);
    }
    print(to, study);
    const int failed = ferror(to);
    if (fclose(to) != 0 || failed) {
        free(text);
        return umb_fail(error, UMB_E_NO_MEMORY, "%s does not fit in memory", name);
    }
    const enum umb_status status = umbt_study_write(study, name, text, size, error);
    free(text);
    return status;
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
