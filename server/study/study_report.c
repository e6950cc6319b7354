/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A study's report (study.h): in words, and as report.json, report.csv and report.html.
 *
 * In words: for errors of 1, 5, 20 cm and so on, the cheapest setting that stays below. A setting
 * stays below an error if 95 % of its wrong answers have a true boundary nearer than the error, and
 * hardly any has no boundary within reach.
 */
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

#define UNKNOWN_MAX 0.02 /* share of wrong answers without a boundary in reach */
#define BLOCK_BYTES 3072 /* a multiple of 3: base64 of blocks is base64 of the whole */

extern const unsigned char umbu_page_study_page[];
extern const size_t umbu_page_study_page_size;

/* ---- in words ---- */

static int stays_below(const struct umbt_study_result *result, double error_m)
{
    return result->off_p95_m <= error_m && result->off_unknown <= UNKNOWN_MAX;
}

/* Returns 1 if the time of a is known and shorter than that of b. If both times are unknown,
 * returns 1 if a reads fewer nodes. */
static int is_faster(const struct umbt_study_result *a, const struct umbt_study_result *b)
{
    const int a_known = a->view.spread <= UMBT_SPREAD_MAX;
    const int b_known = b->view.spread <= UMBT_SPREAD_MAX;
    return a_known && b_known ? a->view.ns < b->view.ns
                              : a_known > b_known || (a_known == b_known && a->nodes < b->nodes);
}

/* The fastest setting of a filter that stays below an error, or NULL. */
static const struct umbt_study_result *fastest(const struct umbt_study *study, double error_m,
                                               uint32_t least_taps)
{
    const struct umbt_study_result *best = NULL;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == UMBT_STUDY_DAG && result->taps >= least_taps &&
            stays_below(result, error_m) && (best == NULL || is_faster(result, best))) {
            best = result;
        }
    }
    return best;
}

static void say_setting(FILE *to, const struct umbt_study *study,
                        const struct umbt_study_result *result)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    fprintf(to, "%u^3 voxels %s, ", bake->resolution, bake->frustum.closed ? "closed" : "open");
    if (result->level > 0) {
        fprintf(to, "level %u: ", result->level);
    } else {
        fprintf(to, "%u x %u taps: ", result->taps, result->taps);
    }
    if (result->view.spread <= UMBT_SPREAD_MAX) {
        fprintf(to, "%.3g ns a point (runs within %.0f %%)", result->view.ns,
                100.0 * result->view.spread);
    } else {
        fprintf(to, "time too unsteady to tell");
    }
    fprintf(to, ", %.2f MB on disk, %.2f MB in memory, %.2g s to bake",
            1e-6 * (double)bake->info.packed_bytes, 1e-6 * (double)bake->info.memory_bytes,
            bake->wall_s);
}

/* The pair of settings in a sentence. */
struct choice {
    const struct umbt_study_result *hard, *soft; /* any filter; 9 taps and more, or NULL */
};

/* Writes the settings that stay below an error, unless they are those of the sentence before. */
static void say_error(FILE *to, const struct umbt_study *study, double error_m, struct choice *last)
{
    const struct choice choice = {fastest(study, error_m, 1), fastest(study, error_m, 9)};
    if (choice.hard == NULL || (choice.hard == last->hard && choice.soft == last->soft)) {
        return;
    }
    *last = choice;
    fprintf(to, "Edges within %.3g m: ", error_m);
    say_setting(to, study, choice.hard);
    if (choice.soft != NULL && choice.soft != choice.hard) {
        fprintf(to, "; with wide filters ");
        say_setting(to, study, choice.soft);
    }
    fprintf(to, ".\n");
}

static const struct umbt_study_result *sharpest(const struct umbt_study *study)
{
    const struct umbt_study_result *best = NULL;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == UMBT_STUDY_DAG &&
            (best == NULL || result->off_p95_m < best->off_p95_m)) {
            best = result;
        }
    }
    return best;
}

static void say_rays(FILE *to, const struct umbt_study *study, const struct umbt_study_result *best)
{
    const struct umbt_time *rays = study->rays;
    const struct umbt_study_result *one = fastest(study, INFINITY, 1);
    if (rays[UMBT_RAYS_VIEW].spread > UMBT_SPREAD_MAX) {
        fprintf(to, "Shadow rays by Embree: time too unsteady to tell.\n");
        return;
    }
    fprintf(
        to,
        "A shadow ray by Embree, exact: %.4g ns a point on the same view, %.4g ns eight at a time",
        rays[UMBT_RAYS_VIEW].ns, rays[UMBT_RAYS_VIEW8].ns);
    const double least = fmin(rays[UMBT_RAYS_VIEW].ns, rays[UMBT_RAYS_VIEW8].ns);
    if (one != NULL && one->view.spread <= UMBT_SPREAD_MAX &&
        best->view.spread <= UMBT_SPREAD_MAX) {
        fprintf(to, ", %.2g times the fastest look-up here and %.2g times the sharpest",
                least / one->view.ns, least / best->view.ns);
    }
    fprintf(to, "; 81 rays a point: %.5g ns, %.5g ns eight at a time.\n", rays[UMBT_RAYS_AREA].ns,
            rays[UMBT_RAYS_AREA8].ns);
}

/* Returns the setting of a method and filter width on the open asset of a resolution, or NULL. */
static const struct umbt_study_result *find(const struct umbt_study *study,
                                            enum umbt_study_method method, uint32_t resolution,
                                            uint32_t taps)
{
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == method && result->taps == taps && result->level == 0 &&
            !study->bakes[result->bake].frustum.closed &&
            study->bakes[result->bake].resolution == resolution) {
            return result;
        }
    }
    return NULL;
}

static void say_time(FILE *to, const struct umbt_study_result *result)
{
    if (result->view.spread <= UMBT_SPREAD_MAX) {
        fprintf(to, "%.3g ns", result->view.ns);
    } else {
        fprintf(to, "an unsteady time");
    }
}

/* Writes the cost of another method (a depth map, NanoVDB) at its finest resolution, beside that of
 * the asset with the same voxels. */
static void say_peer(FILE *to, const struct umbt_study *study, enum umbt_study_method method,
                     const char *name)
{
    static const uint32_t widths[2] = {1, 9};
    uint32_t finest = 0;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == method && study->bakes[result->bake].resolution > finest) {
            finest = study->bakes[result->bake].resolution;
        }
    }
    const char *between = "";
    for (int i = 0; finest > 0 && i < 2; i++) {
        const struct umbt_study_result *peer = find(study, method, finest, widths[i]);
        const struct umbt_study_result *ours = find(study, UMBT_STUDY_DAG, finest, widths[i]);
        if (peer == NULL || ours == NULL) {
            continue;
        }
        if (between[0] == '\0') {
            fprintf(to, "%s of the same %u^3 voxels: %.3g MB in memory, the open asset %.3g MB; ",
                    name, finest, 1e-6 * (double)peer->bytes, 1e-6 * (double)ours->bytes);
        }
        fprintf(to, "%s%u x %u taps ", between, widths[i], widths[i]);
        say_time(to, peer);
        fprintf(to, " against ");
        say_time(to, ours);
        between = ", ";
    }
    if (between[0] != '\0') {
        fprintf(to, ".\n");
    }
}

/* Writes the numbers of times that are left out because their runs differ too much. */
static void say_unsteady(FILE *to, const struct umbt_study *study)
{
    uint32_t one = 0, all = 0;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *r = &study->results[i];
        one += fmax(r->view.spread, r->free.spread) > UMBT_SPREAD_MAX;
        all += r->all.spread > UMBT_SPREAD_MAX;
    }
    if (one > 0 || all > 0) {
        fprintf(
            to,
            "Not told: times of %u of %u settings on one thread and of %u on all threads, since "
            "their runs differ by more than %.0f %% after all attempts; run again on a quieter "
            "machine.\n",
            one, study->result_count, all, 100.0 * UMBT_SPREAD_MAX);
    }
}

static void say_caveats(FILE *to, const struct umbt_study *study)
{
    say_unsteady(to, study);
    for (uint32_t i = 0; i < study->bake_count; i++) {
        if (study->bakes[i].asset == NULL) {
            fprintf(to, "Not reached: %s: %s.\n", study->bakes[i].name, study->bakes[i].reason);
        }
    }
}

void umbt_study_summary(const struct umbt_study *study, char *text, size_t size)
{
    text[0] = '\0';
    const struct umbt_study_result *best = sharpest(study);
    FILE *to = best != NULL ? fmemopen(text, size, "w") : NULL;
    if (to == NULL) { /* nothing to say, or no memory */
        return;
    }
    fprintf(to, "Sharpest of these resolutions: edges within %.3g m: ", best->off_p95_m);
    say_setting(to, study, best);
    fprintf(to, ".\n");
    /* Errors of 1, 2, 5 a decade, from the best reached one on. */
    const double decade = pow(10.0, floor(log10(fmax(best->off_p95_m, 1e-6))));
    struct choice last = {best, NULL};
    for (double scale = decade; scale <= study->points.reach_m; scale *= 10.0) {
        for (int step = 0; step < 3; step++) {
            const double error_m = scale * (step == 0 ? 1.0 : step == 1 ? 2.0 : 5.0);
            if (error_m > best->off_p95_m && error_m <= study->points.reach_m) {
                say_error(to, study, error_m, &last);
            }
        }
    }
    say_rays(to, study, best);
    say_peer(to, study, UMBT_STUDY_DEPTH_MAP, "A plain depth map (AVX2)");
    say_peer(to, study, UMBT_STUDY_NANOVDB, "A NanoVDB mask grid");
    if (study->missing != NULL && study->missing[0] != '\0') {
        fprintf(to, "%s\n", study->missing);
    }
    say_caveats(to, study);
    (void)fclose(to);
}

/* ---- files ---- */

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
    umbu_json_integer(json, "packed_bytes", bake->info.packed_bytes);
    umbu_json_integer(json, "memory_bytes", bake->info.memory_bytes);
    UMBU_JSON_VALUES(json, 6, {"voxel_m", bake->voxel_m}, {"bake_s", bake->wall_s},
                     {"bake_cpu_s", bake->cpu_s});
    umbu_json_end(json, '}');
}

#define COLUMNS 24

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
        {"ns_view", umbt_time_told(r->view)},
        {"ns_free", umbt_time_told(r->free)},
        {"ns_view_all", umbt_time_told(r->all)},
        {"spread", r->view.spread},
        {"spread_free", r->free.spread},
        {"spread_all", r->all.spread},
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
    umbu_json_text(json, "scene", study->common.scene_path);
    umbu_json_text(json, "version", UMB_VERSION_TEXT);
    umbu_json_integer(json, "triangles", study->common.scene.count);
    umbu_json_integer(json, "seed", study->common.seed);
    umbu_json_integer(json, "threads", study->common.threads);
    umbu_json_vector(json, "light", study->bakes[0].light.direction);
    UMBU_JSON_VALUES(json, 6, {"diagonal_m", study->common.scene.diagonal_m},
                     {"reach_m", points->reach_m}, {"study_s", study->seconds});
    umbu_json_integer(json, "truth_rays", study->options.truth_side * study->options.truth_side);
    umbu_json_integer(json, "runs", UMBT_STUDY_RUNS);
    umbu_json_begin(json, "samples", '{');
    for (int s = 0; s < UMBT_STUDY_SET_COUNT; s++) {
        umbu_json_integer(json, umbt_study_set_names[s], points->first[s + 1] - points->first[s]);
    }
    umbu_json_end(json, '}');
    umbu_json_text(json, "plan", study->bakes[0].info.plan);
}

/* Writes the times of rays, all of them or none. */
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
    const double spread = rays[UMBT_RAYS_VIEW].spread;
    umbu_json_integer(json, "rays", 1);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const struct umbt_time time = {rays[rows[i].way].ns, spread};
        umbu_json_rounded(json, rows[i].key, umbt_time_told(time), 6);
    }
    umbu_json_rounded(json, "spread", spread, 6);
}

static void json_techniques(struct umbu_json *json, const struct umbt_study *study)
{
    umbu_json_integer(json, "resolution", study->technique_resolution);
    umbu_json_integer(json, "taps", UMBT_STUDY_TAPS);
    umbu_json_integer(json, "points", study->technique_points);
    umbu_json_begin(json, "rows", '[');
    for (uint32_t i = 0; i < study->technique_count; i++) {
        static const char *const truths[] = {"box", "point", "disc"};
        const struct umbt_study_technique *t = &study->techniques[i];
        const struct umbt_technique_result *r = &t->result;
        umbu_json_begin(json, NULL, '{');
        umbu_json_text(json, "name", t->name);
        umbu_json_text(json, "truth", truths[t->truth]);
        umbu_json_bool(json, "dag", t->is_dag);
        umbu_json_integer(json, "bytes", r->info.bytes);
        UMBU_JSON_VALUES(json, 6, {"mean", r->mean}, {"lighter", r->lighter}, {"darker", r->darker},
                         {"over_half", r->over_half}, {"build_s", r->build_s},
                         {"spread", r->time.spread}, {"ns", umbt_time_told(r->time)});
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

void umbt_study_json(struct umbu_json *json, const void *user)
{
    const struct umbt_study *study = user;
    char summary[4096];
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
        const int peer = result->method >= UMBT_STUDY_DEPTH_MAP; /* peers have no file */
        fprintf(to, "%s,%s,%u,%d,%u,%u,%.6g,", result->name, bake->name, bake->resolution,
                bake->frustum.closed, result->taps, result->level, bake->voxel_m);
        fprintf(to, peer ? "," : "%" PRIu64 ",", bake->info.packed_bytes);
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
