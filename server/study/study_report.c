/* SPDX-License-Identifier: Apache-2.0 */
/* A study's report (study.h): report.json, report.csv and report.html. */
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

#define BLOCK_BYTES   3072 /* a multiple of 3: base64 of blocks is base64 of the whole */
#define VERDICT_BYTES 16384

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
    umbu_json_bool(json, "closed", umbt_study_is_closed(bake));
    umbu_json_text(json, "reason", bake->reason);
    umbu_json_integer(json, "packed_bytes", bake->info.packed_bytes);
    umbu_json_integer(json, "memory_bytes", bake->info.memory_bytes);
    UMBU_JSON_VALUES(json, 6, {"voxel_m", bake->voxel_m}, {"bake_s", bake->wall_s},
                     {"bake_cpu_s", bake->cpu_s});
    umbu_json_end(json, '}');
}

#define COLUMNS 29

static void columns_of(const struct umbt_study_result *r, struct umbu_json_value columns[COLUMNS])
{
    const struct umbu_json_value all[COLUMNS] = {
        {"rms", r->rms},
        {"worst", r->worst},
        {"over_001", r->over_001},
        {"over_01", r->over_01},
        {"over_05", r->over_05},
        {"wrong", r->wrong},
        {"wrong_view", r->wrong_view},
        {"wrong_border", r->wrong_border},
        {"false_light", r->false_light},
        {"false_shadow", r->false_shadow},
        {"undecided", r->undecided},
        {"off_mean_m", r->off_mean_m},
        {"off_p95_m", r->off_p95_m},
        {"off_p99_m", r->off_p99_m},
        {"off_max_m", r->off_max_m},
        {"off_unknown", r->off_unknown},
        {"truth_error", r->truth_error},
        {"ns_view", r->view.ns},
        {"ns_free", r->free.ns},
        {"ns_view_all", r->all.ns},
        {"spread", r->view.spread},
        {"spread_free", r->free.spread},
        {"spread_all", r->all.spread},
        {"instructions", r->instructions},
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
    UMBU_JSON_COUNTS(json, {"bake", result->bake}, {"taps", result->taps}, {"level", result->level},
                     {"judged", result->judged}, {"memory_bytes", result->bytes});
    umbu_json_rounded(json, "build_s", result->build_s, 6);
    umbu_json_values(json, 6, columns, COLUMNS);
    umbu_json_end(json, '}');
}

static void json_light(struct umbu_json *json, const struct umb_light_info *light)
{
    umbu_json_begin(json, "light", '{');
    umbu_json_text(json, "name", light->name);
    umbu_json_bool(json, "lamp", light->kind != UMB_LIGHT_DIRECTIONAL);
    umbu_json_vector(json, "direction", light->direction);
    umbu_json_vector(json, "position", light->position);
    umbu_json_rounded(json, "extent", light->extent, 6);
    umbu_json_end(json, '}');
}

static void json_head(struct umbu_json *json, const struct umbt_study *study)
{
    const struct umbt_study_points *points = &study->points;
    umbu_json_text(json, "scene", study->common.scene_path);
    umbu_json_text(json, "version", UMB_VERSION_TEXT);
    UMBU_JSON_COUNTS(json, {"triangles", study->common.scene.count}, {"seed", study->common.seed},
                     {"threads", study->common.threads});
    json_light(json, &study->bakes[0].light);
    umbu_json_bool(json, "translucent", study->translucent);
    UMBU_JSON_VALUES(json, 6, {"diagonal_m", study->common.scene.diagonal_m},
                     {"reach_m", points->reach_m}, {"footprint_m", points->footprint_m},
                     {"study_s", study->seconds});
    umbu_json_integer(json, "truth_rays", study->options.truth_side * study->options.truth_side);
    umbu_json_integer(json, "runs", UMBT_STUDY_RUNS_MAX);
    umbu_json_number(json, "unsteady", UMBT_SPREAD_MAX);
    umbu_json_text(json, "uncounted", study->uncounted);
    umbu_json_begin(json, "samples", '{');
    for (int s = 0; s < UMBT_STUDY_SET_COUNT; s++) {
        umbu_json_integer(json, umbt_study_set_names[s], points->first[s + 1] - points->first[s]);
    }
    umbu_json_end(json, '}');
    umbu_json_text(json, "plan", study->bakes[0].info.plan);
}

static void json_rays(struct umbu_json *json, const struct umbt_time rays[UMBT_RAYS_WAYS])
{
    static const struct {
        const char *key;
        enum umbt_study_rays way;
    } rows[] = {{"ns_view", UMBT_RAYS_VIEW},
                {"ns_view8", UMBT_RAYS_VIEW8},
                {"ns_free", UMBT_RAYS_FREE},
                {"ns_area81", UMBT_RAYS_AREA},
                {"ns_area81_8", UMBT_RAYS_AREA8}};
    double spread = 0.0;
    umbu_json_integer(json, "rays", 1);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        umbu_json_rounded(json, rows[i].key, rays[rows[i].way].ns, 6);
        spread = fmax(spread, rays[rows[i].way].spread);
    }
    umbu_json_rounded(json, "spread", spread, 6);
}

static void json_technique(struct umbu_json *json, const struct umbt_study_technique *t)
{
    const struct umbt_technique_result *r = &t->result;
    umbu_json_begin(json, NULL, '{');
    umbu_json_text(json, "name", t->name);
    umbu_json_text(json, "truth", umbt_study_truth_names[t->truth]);
    umbu_json_bool(json, "dag", t->bake != NULL);
    umbu_json_integer(json, "resolution", t->bake != NULL ? t->bake->resolution : 0);
    umbu_json_bool(json, "closed", t->bake != NULL && umbt_study_is_closed(t->bake));
    umbu_json_integer(json, "bytes", r->info.bytes);
    umbu_json_signed(json, "same_texels", t->same_texels);
    umbu_json_signed(json, "same_bytes", t->same_bytes);
    UMBU_JSON_VALUES(json, 6, {"mean", r->mean}, {"lighter", r->lighter}, {"darker", r->darker},
                     {"over_half", r->over_half}, {"build_s", r->build_s},
                     {"spread", r->time.spread}, {"ns", r->time.ns},
                     {"ns_scalar", r->scalar.ns > 0.0 ? r->scalar.ns : (double)NAN});
    umbu_json_end(json, '}');
}

static void json_techniques(struct umbu_json *json, const struct umbt_study *study)
{
    UMBU_JSON_COUNTS(json, {"resolution", study->technique_resolution}, {"taps", UMBT_STUDY_TAPS},
                     {"points", study->technique_points});
    umbu_json_begin(json, "rows", '[');
    for (uint32_t i = 0; i < study->technique_count; i++) {
        json_technique(json, &study->techniques[i]);
    }
    umbu_json_end(json, ']');
}

void umbt_study_json(struct umbu_json *json, const void *user)
{
    const struct umbt_study *study = user;
    char summary[VERDICT_BYTES];
    json_head(json, study);
    umbu_json_begin(json, "rays", '{');
    json_rays(json, study->rays);
    umbu_json_end(json, '}');
    umbu_json_begin(json, "techniques", '{');
    json_techniques(json, study);
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

static void print_json(FILE *to, const struct umbt_study *study)
{
    struct umbu_json json = {.file = to};
    umbu_json_begin(&json, NULL, '{');
    umbt_study_json(&json, study);
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
        const int peer = !umbt_study_is_asset(result->method); /* peers have no file */
        fprintf(to, "%s,%s,%u,%d,%u,%u,%.6g,", result->name, bake->name, bake->resolution,
                umbt_study_is_closed(bake), result->taps, result->level, bake->voxel_m);
        fprintf(to, peer ? "," : "%" PRIu64 ",", bake->info.packed_bytes);
        fprintf(to, "%" PRIu64 ",%.6g", result->bytes, bake->wall_s + result->build_s);
        for (int i = 0; i < COLUMNS; i++) {
            fprintf(to, isfinite(columns[i].value) ? ",%.6g" : ",", columns[i].value);
        }
        fputs("\n", to);
    }
}

/* Writes a picture file as an <img>; nothing if the file is missing. attributes: of the figure, for
 * the page's scripts. */
static void image(FILE *to, const struct umbt_study *study, const char *name, const char *label,
                  const char *attributes)
{
    char path[UMBT_STUDY_PATH];
    unsigned char block[BLOCK_BYTES], digits[BLOCK_BYTES / 3 * 4 + 1];
    FILE *file = umbt_study_path(study, name, path, NULL) == UMB_OK ? fopen(path, "rb") : NULL;
    if (file == NULL) {
        return;
    }
    fprintf(to, "<figure%s><img alt=\"%s\" src=\"data:image/png;base64,", attributes, label);
    size_t got;
    while ((got = fread(block, 1, sizeof block, file)) > 0) {
        (void)fwrite(digits, 1, (size_t)EVP_EncodeBlock(digits, block, (int)got), to);
    }
    (void)fclose(file);
    fprintf(to, "\"><figcaption>%s</figcaption></figure>\n", label);
}

/* The view by rays, and the aliasing of one map. */
static void put_references(FILE *to, const struct umbt_study *study)
{
    image(to, study, "pictures/traced.png", "traced: one ray a sample", "");
    image(to, study, "pictures/aliasing.png",
          "aliasing of one map of 4096 texels a side: blue 1/16 pixel a texel and less, white 1, "
          "red 16; grey faces away",
          "");
}

static void put_views(FILE *to, const struct umbt_study *study)
{
    char name[128], label[160];
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        for (int difference = 0; umbt_study_has_picture(study, result) && difference < 2;
             difference++) {
            umbt_study_picture_name(study, result, difference, name, sizeof name);
            (void)snprintf(label, sizeof label, "%s, %u x %u taps%s",
                           study->bakes[result->bake].name, result->taps, result->taps,
                           difference ? ": difference" : "");
            image(to, study, name, label, "");
        }
    }
}

/* Writes, for each kind of truth, the traced view and the techniques that are compared with it. */
static void put_techniques(FILE *to, const struct umbt_study *study)
{
    char name[128], label[160], attributes[64];
    for (int truth = 0; truth < UMBT_TECHNIQUE_TRUTHS && study->technique_count > 0; truth++) {
        (void)snprintf(attributes, sizeof attributes, " data-truth=\"%s\"",
                       umbt_study_truth_names[truth]);
        umbt_study_technique_picture(NULL, (enum umbt_technique_truth)truth, name, sizeof name);
        (void)snprintf(label, sizeof label, "traced, %s", umbt_study_truth_names[truth]);
        image(to, study, name, label, attributes);
        for (uint32_t i = 0; i < study->technique_count; i++) {
            const struct umbt_study_technique *t = &study->techniques[i];
            if (t->truth == (enum umbt_technique_truth)truth) {
                umbt_study_technique_picture(t, t->truth, name, sizeof name);
                (void)snprintf(label, sizeof label, "%s: mean difference %.4f", t->name,
                               t->result.mean);
                image(to, study, name, label, attributes);
            }
        }
    }
}

static void put_pictures(FILE *to, const void *user)
{
    const struct umbt_study *study = user;
    fprintf(to, "<div class=\"pictures\">\n");
    put_references(to, study);
    fprintf(to, "</div>\n<div class=\"pictures\">\n");
    put_views(to, study);
    fprintf(to, "</div>\n<div id=\"technique-pictures\" class=\"pictures\">\n");
    put_techniques(to, study);
    fprintf(to, "</div>\n");
}

static void print_page(FILE *to, const struct umbt_study *study)
{
    const struct umbu_report report = {
        .title = "umbrage: what accuracy costs",
        .page = umbu_page_study_page,
        .page_size = umbu_page_study_page_size,
        .data = umbt_study_json,
        .pictures = put_pictures,
        .user = study,
    };
    umbu_report_print(to, &report);
}

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
        {"report.json", print_json}, {"report.csv", print_csv}, {"report.html", print_page}};
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        UMB__TRY(print_file(study, files[i].name, files[i].print, error));
    }
    return UMB_OK;
}
