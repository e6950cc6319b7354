/* SPDX-License-Identifier: Apache-2.0 */
/* The files of a study's report: report.json, report.csv, report.html (study.h). */
#include "study/study.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <openssl/evp.h>

#include "base/try.h"
#include "tool/output.h"
#include "tool/report.h"
#include "umbrage/version.h"

#define BLOCK_BYTES 3072 /* a multiple of 3: base64 of blocks is base64 of the whole */

extern const unsigned char umbu_page_study_page[];
extern const size_t umbu_page_study_page_size;

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
    UMBU_JSON_VALUES(json, 6, {"voxel_m", bake->voxel_m}, {"bake_s", bake->wall_s},
                     {"bake_cpu_s", bake->cpu_s});
    umbu_json_end(json, '}');
}

#define COLUMNS 24

/* A time for the report; left out if its runs differ too much. */
static double told(double ns, double spread)
{
    return spread <= UMBT_STUDY_SPREAD_MAX ? ns : (double)NAN;
}

/* The numbers of a result, by name. */
static void columns_of(const struct umbt_study_result *r, struct umbu_json_value columns[COLUMNS])
{
    const struct umbu_json_value all[COLUMNS] = {
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
    struct umbu_json_value columns[COLUMNS];
    columns_of(result, columns);
    umbu_json_begin(json, NULL, '{');
    umbu_json_text(json, "method", result->name);
    umbu_json_integer(json, "bake", result->bake);
    umbu_json_integer(json, "taps", result->taps);
    umbu_json_integer(json, "level", result->level);
    umbu_json_integer(json, "judged", result->judged);
    umbu_json_integer(json, "memory_bytes", result->bytes);
    umbu_json_rounded(json, "build_s", result->build_s, 6);
    umbu_json_values(json, 6, columns, COLUMNS);
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
    UMBU_JSON_VALUES(json, 6, {"diagonal_m", study->scene.diagonal_m}, {"reach_m", points->reach_m},
                     {"study_s", study->seconds});
    umbu_json_integer(json, "truth_rays", study->options.truth_side * study->options.truth_side);
    umbu_json_integer(json, "runs", UMBT_STUDY_RUNS);
    umbu_json_begin(json, "samples", '{');
    for (int s = 0; s < UMBT_STUDY_SET_COUNT; s++) {
        umbu_json_integer(json, umbt_study_set_names[s], points->first[s + 1] - points->first[s]);
    }
    umbu_json_end(json, '}');
    umbu_json_text(json, "plan", study->bakes[0].info.plan);
}

static void json_rays(struct umbu_json *json, const struct umbt_study_rays *rays)
{
    const double spread = rays->spread;
    umbu_json_integer(json, "rays", 1);
    UMBU_JSON_VALUES(json, 6, {"ns_view", told(rays->ns_view, spread)},
                     {"ns_view8", told(rays->ns_view8, spread)},
                     {"ns_free", told(rays->ns_free, spread)},
                     {"ns_area81", told(rays->ns_area, spread)},
                     {"ns_area81_8", told(rays->ns_area8, spread)}, {"spread", spread});
}

/* Writes the members of report.json; also the data of report.html. */
static void put_members(struct umbu_json *json, const void *user)
{
    const struct umbt_study *study = user;
    char summary[4096];
    json_head(json, study);
    umbu_json_begin(json, "rays", '{');
    json_rays(json, &study->rays);
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
    put_members(&json, study);
    umbu_json_close(&json);
}

static void print_csv(FILE *to, const struct umbt_study *study)
{
    struct umbu_json_value columns[COLUMNS];
    columns_of(&study->results[0], columns);
    fputs("method,bake,resolution,closed,taps,level,voxel_m,packed_bytes,memory_bytes,bake_s", to);
    for (int i = 0; i < COLUMNS; i++) {
        fprintf(to, ",%s", columns[i].key);
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

/* Writes a picture file as an <img>; nothing if the file is missing. */
static void image(FILE *to, const struct umbt_study *study, const char *name, const char *label)
{
    char path[UMBT_STUDY_PATH];
    unsigned char block[BLOCK_BYTES], digits[BLOCK_BYTES / 3 * 4 + 1];
    FILE *file = umbt_study_path(study, name, path, NULL) == UMB_OK ? fopen(path, "rb") : NULL;
    if (file == NULL) {
        return;
    }
    fprintf(to, "<figure><img alt=\"%s\" src=\"data:image/png;base64,", label);
    size_t got;
    while ((got = fread(block, 1, sizeof block, file)) > 0) {
        (void)fwrite(digits, 1, (size_t)EVP_EncodeBlock(digits, block, (int)got), to);
    }
    (void)fclose(file);
    fprintf(to, "\"><figcaption>%s</figcaption></figure>\n", label);
}

static void put_pictures(FILE *to, const void *user)
{
    const struct umbt_study *study = user;
    char name[128], label[160];
    image(to, study, "pictures/traced.png", "traced: one ray a sample");
    image(to, study, "pictures/aliasing.png",
          "aliasing of one map of 4096 texels a side: blue 1/16 pixel a texel and less, white 1, "
          "red 16; grey faces away");
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        for (int difference = 0; umbt_study_has_picture(result) && difference < 2; difference++) {
            umbt_study_picture_name(study, result, difference, name, sizeof name);
            (void)snprintf(label, sizeof label, "%s, %u x %u taps%s",
                           study->bakes[result->bake].name, result->taps, result->taps,
                           difference ? ", difference to the traced one" : "");
            image(to, study, name, label);
        }
    }
}

static void print_page(FILE *to, const struct umbt_study *study)
{
    const struct umbu_report report = {
        .title = "umbrage: what accuracy costs",
        .page = umbu_page_study_page,
        .page_size = umbu_page_study_page_size,
        .data = put_members,
        .pictures = put_pictures,
        .user = study,
    };
    umbu_report_print(to, &report);
}

/* Writes the output of `print` as one file. */
static enum umb_status print_file(const struct umbt_study *study, const char *name,
                                  void (*print)(FILE *to, const struct umbt_study *study),
                                  struct umb_error *error)
{
    struct umbu_output output;
    char path[UMBT_STUDY_PATH];
    UMB__TRY(umbt_study_path(study, name, path, error));
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
        {"report.json", umbt_study_json}, {"report.csv", print_csv}, {"report.html", print_page}};
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        UMB__TRY(print_file(study, files[i].name, files[i].print, error));
    }
    return UMB_OK;
}
