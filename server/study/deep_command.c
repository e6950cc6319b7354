/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `deep`: deep shadow maps of a scene with translucent casters, compared with brute-force products
 * of traced rays; the gain of neighbour links; and maps of moments beside them.
 */
#include "study/study_command.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "tool/json.h"
#include "study/light_hits.h"
#include "study/moment_rows.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "tool/threads.h"
#include "study/study_vec.h"
#include "study/technique_view.h"
#include "study/view_options.h"
#include "tool/exit_code.h"

#define REPEATS 3
#define COLUMNS 5U /* columns of the picture */
#define GAP     4U /* pixels between tiles */

struct deep {
    const char *scene_path, *output;
    struct umbt_view_options options;
    uint64_t resolution, taps, threads;
    double alpha, epsilon;
    int json, quiet;
    struct umbt_view view;
    struct umbt_gbuffer buffer;
    struct umb_map_frustum frustum;
    struct umbt_light_hits hits;
    float *values, *other; /* [receivers] */
    /* [receivers] products over a box of texels; products over the boxes around the four nearest
     * texels, weighted as in bilinear filtering. */
    double *box, *between;
    struct umbt_picture sheet;
};

#define AT(field) UMBU_AT(struct deep, field)

static const struct umbu_option OPTIONS[] = {
    {"SCENE", NULL, "the scene file", UMBU_TEXT, AT(scene_path), .needed = true},
    {"output", "FILE",
     "one view by each, side by side, PNG: the products over the window of a deep map, the deep "
     "map, the products over that of the others, then these in the order of the table, five a "
     "row; - is stdout",
     UMBU_TEXT, AT(output), .letter = 'o'},
    {"alpha", "A", "of BLEND surfaces, 0 to 1", UMBU_NUMBER(0, 1), AT(alpha), .standard = "0.5"},
    {"resolution", "N", "texels a side, 16 to 2048", UMBU_COUNT(16, 2048), AT(resolution),
     .standard = "512"},
    {"taps", "N", "width of the filter", UMBU_ODD(1, 17), AT(taps), .standard = "7"},
    {"epsilon", "E", "a list ends when less is left, 0 to 1", UMBU_NUMBER(0, 1), AT(epsilon),
     .standard = "0.001"},
    {UMBT_SUN_ROW(struct deep, options.sun)},
    {UMBT_CAMERA_ROW(struct deep, options.camera)},
    {UMBT_SIZE_ROW(struct deep, options.size, 2048, "320x200")},
    {UMBT_UP_ROW(struct deep, options.up)},
    {UMBT_THREADS_ROW(struct deep)},
    {UMBU_JSON_ROW(struct deep), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct deep, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-study deep",
    .usage = "umbrage-study deep SCENE [options]",
    .summary = "Builds deep shadow maps of a scene, and maps of moments, and compares them with\n"
               "products over traced hits. A surface whose material is BLEND takes --alpha of\n"
               "the light, or its own constant alpha where that is less than 1; every other\n"
               "surface takes all.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

/* Lifts points off their surfaces, towards the light, by half of the wider window: a plane then
 * does not shadow itself, as with bias_normal 1. Maps and products use the same points. */
static void points_lift(struct deep *d)
{
    for (size_t i = 0; i < d->buffer.receiver_count; i++) {
        const float *n = &d->buffer.normals[3 * i];
        const double normal[3] = {(double)n[0], (double)n[1], (double)n[2]};
        double shift = 0.0;
        for (int axis = 0; axis < 2; axis++) {
            const double *g = d->frustum.world_to_map[axis];
            shift += 0.5 * ((double)d->taps + 1.0) * fabs(umb__dot(normal, g)) / umb__dot(g, g);
        }
        shift = copysign(shift, umb__dot(normal, d->view.to_light));
        for (int k = 0; k < 3; k++) {
            d->buffer.positions[3 * i + (size_t)k] += shift * normal[k];
        }
    }
}

static enum umb_status scene_open(struct deep *d, struct umb_error *error)
{
    enum umb_status status = umbt_view_open(&d->options, d->scene_path, &d->view, error);
    if (status == UMB_OK) {
        status = umb_map_frustum_fit(d->view.to_light, &d->view.scene.box, (uint32_t)d->resolution,
                                     (uint32_t)d->resolution, &d->frustum, error);
    }
    if (status == UMB_OK) {
        status = umbt_gbuffer_init(&d->buffer, d->options.size[0], 1, d->options.size[1], error);
    }
    if (status == UMB_OK) {
        status = umbt_gbuffer_fill(&d->buffer, &d->view.scene, &d->view.camera, d->options.size[1],
                                   0, d->options.size[1], (unsigned)d->threads, error);
    }
    if (status == UMB_OK && d->buffer.receiver_count == 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--camera: sees nothing of the scene");
    }
    if (status != UMB_OK) {
        return status;
    }
    points_lift(d);
    d->values = calloc(d->buffer.receiver_count, sizeof *d->values);
    d->other = calloc(d->buffer.receiver_count, sizeof *d->other);
    d->box = calloc(d->buffer.receiver_count, sizeof *d->box);
    d->between = calloc(d->buffer.receiver_count, sizeof *d->between);
    if (d->values == NULL || d->other == NULL || d->box == NULL || d->between == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory",
                        d->buffer.receiver_count);
    }
    return umbt_light_hits_trace(&d->view.scene, &d->frustum, d->alpha, (unsigned)d->threads,
                                 &d->hits, error);
}

/* The points, without normals: a hair's own strands shadow it by their depth alone. */
static struct umb_points points_of(const struct deep *d)
{
    return (struct umb_points){.positions = d->buffer.positions,
                               .format = UMB_POINT_F64,
                               .count = d->buffer.receiver_count};
}

static struct umb_map_filter filter_of(const struct deep *d)
{
    return (struct umb_map_filter){.width = (double)d->taps,
                                   .bias_m = d->frustum.depth_m / 65536.0};
}

/* Result of one map: built, queried a few times, best time kept. */
struct result {
    struct umb_map_info info;
    double query_ns;
};

static enum umb_status map_ask(struct deep *d, const struct umb_map_deep_settings *settings,
                               float *values, struct result *result, struct umb_error *error)
{
    const struct umb_map_fragments in = {d->hits.first, d->hits.fragments};
    const struct umb_points points = points_of(d);
    const struct umb_map_filter filter = filter_of(d);
    struct umb_map *map;
    struct umb_map_query query;
    UMB__TRY(umb_map_build_deep(&d->frustum, &in, settings, NULL, &map, error));
    enum umb_status status = umb_map_prepare(map, &filter, &query, error);
    result->query_ns = INFINITY;
    for (int i = 0; i < REPEATS && status == UMB_OK; i++) {
        const double start = umbu_thread_cpu_s();
        umb_map_run(&query, &points, 0, points.count, values);
        result->query_ns =
            fmin(result->query_ns, 1e9 * (umbu_thread_cpu_s() - start) / (double)points.count);
    }
    umb_map_get_info(map, &result->info);
    umb_map_destroy(map);
    return status;
}

/* Light left at a depth behind a texel's own fragments: a product in long double. */
static long double texel_left(const struct deep *d, int64_t x, int64_t y, double depth)
{
    const int64_t side = (int64_t)d->resolution;
    long double left = 1.0L;
    if (x < 0 || y < 0 || x >= side || y >= side) {
        return left;
    }
    const size_t texel = (size_t)(y * side + x);
    for (uint64_t i = d->hits.first[texel]; i < d->hits.first[texel + 1]; i++) {
        left *= (double)d->hits.fragments[i].depth < depth
                    ? 1.0L - (long double)d->hits.fragments[i].alpha
                    : 1.0L;
    }
    return left;
}

/* Mean over a box of texels around (x, y). Its middle may lie between texels: those at its ends
 * then count by their share. */
static double brute_force(const struct deep *d, double x, double y, double depth)
{
    const int64_t taps = (int64_t)d->taps;
    const double x0 = floor(x), y0 = floor(y), fx = x - x0, fy = y - y0;
    long double sum = 0.0L;
    for (int64_t i = 0; i <= taps; i++) {
        const double across = i == 0 ? 1.0 - fx : i == taps ? fx : 1.0;
        for (int64_t k = 0; k <= taps; k++) {
            const double weight = across * (k == 0 ? 1.0 - fy : k == taps ? fy : 1.0);
            sum += weight > 0.0
                       ? (long double)weight * texel_left(d, (int64_t)x0 + i - taps / 2,
                                                          (int64_t)y0 + k - taps / 2, depth)
                       : 0.0L;
        }
    }
    return (double)(sum / (long double)(taps * taps));
}

static enum umb_status truth_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct deep *d = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double p[3], at[3];
        umb__subtract(&d->buffer.positions[3 * i], d->frustum.origin, p);
        for (int k = 0; k < 3; k++) {
            at[k] = umb__dot(d->frustum.world_to_map[k], p) + d->frustum.world_to_map[k][3];
        }
        const double depth = at[2] - filter_of(d).bias_m / d->frustum.depth_m;
        d->box[i] = brute_force(d, floor(at[0]), floor(at[1]), depth);
        d->between[i] = brute_force(d, at[0] - 0.5, at[1] - 0.5, depth);
    }
    return UMB_OK;
}

static double worst_difference(const struct deep *d, const float *values)
{
    double worst = 0.0;
    for (size_t i = 0; i < d->buffer.receiver_count; i++) {
        worst = fmax(worst, fabs((double)values[i] - d->box[i]));
    }
    return worst;
}

static void tile_draw(struct deep *d, size_t tile, const float *values)
{
    const struct umbt_technique_view view = {
        .scene = &d->view.scene,
        .camera = d->view.camera,
        .to_light = {d->view.to_light[0], d->view.to_light[1], d->view.to_light[2]},
        .z_up = d->view.z_up,
        .width = d->options.size[0],
        .height = d->options.size[1],
        .buffer = d->buffer};
    if (d->output != NULL) {
        umbt_technique_draw(&view, values, &d->sheet,
                            (uint32_t)(tile % COLUMNS) * (d->options.size[0] + GAP),
                            (uint32_t)(tile / COLUMNS) * (d->options.size[1] + GAP));
    }
}

/* Draws the truths as floats; the difference is invisible. */
static void truth_draw(struct deep *d, size_t tile, const double *truth)
{
    for (size_t i = 0; i < d->buffer.receiver_count; i++) {
        d->other[i] = (float)truth[i];
    }
    tile_draw(d, tile, d->other);
}

#define TILES_BEFORE 3U /* two truths and the deep map */

static enum umb_status sheet_begin(struct deep *d, struct umb_error *error)
{
    const size_t tiles = TILES_BEFORE + umbt_moment_row_count;
    const uint32_t rows = (uint32_t)((tiles + COLUMNS - 1) / COLUMNS);
    return d->output == NULL
               ? UMB_OK
               : umbt_picture_init(&d->sheet, COLUMNS * (d->options.size[0] + GAP) - GAP,
                                   rows * (d->options.size[1] + GAP) - GAP, error);
}

/* Runs all maps of moments. results: [umbt_moment_row_count]. */
static enum umb_status moments_run(struct deep *d, struct umbt_moment_result *results,
                                   struct umb_error *error)
{
    const struct umb_map_fragments in = {d->hits.first, d->hits.fragments};
    const struct umb_points points = points_of(d);
    const struct umbt_moment_question question = {.frustum = &d->frustum,
                                                  .fragments = &in,
                                                  .points = &points,
                                                  .taps = (uint32_t)d->taps,
                                                  .bias_m = filter_of(d).bias_m,
                                                  .truth = d->between};
    enum umb_status status = UMB_OK;
    truth_draw(d, 2, d->between);
    for (size_t i = 0; i < umbt_moment_row_count && status == UMB_OK; i++) {
        status = umbt_moment_row_run(&umbt_moment_rows[i], &question, d->other, &results[i], error);
        tile_draw(d, TILES_BEFORE + i, d->other);
    }
    if (status == UMB_OK && d->output != NULL) {
        status = umbt_picture_write(&d->sheet, d->output, error);
    }
    return status;
}

/* Results of the command. */
struct findings {
    struct result exact, searched, linked, streamed;
    /* Largest difference from the products: without truncation; with epsilon. */
    double exact_error, error;
    int linked_same, streamed_same;     /* 1: the same bits as the search */
    struct umbt_moment_result *moments; /* [umbt_moment_row_count] */
};

static enum umb_status deep_run(struct deep *d, struct findings *f, struct umb_error *error)
{
    struct umb_map_deep_settings settings = {.epsilon = d->epsilon, .way = UMB_MAP_DEEP_SEARCH};
    enum umb_status status = scene_open(d, error);
    if (status == UMB_OK) {
        status = umbu_range_run((unsigned)d->threads, d->buffer.receiver_count, 1024, truth_block,
                                d, error);
    }
    if (status == UMB_OK) {
        status = sheet_begin(d, error);
    }
    if (status == UMB_OK) {
        status = map_ask(d, &(struct umb_map_deep_settings){0}, d->values, &f->exact, error);
    }
    if (status == UMB_OK) {
        f->exact_error = worst_difference(d, d->values);
        status = map_ask(d, &settings, d->other, &f->searched, error);
    }
    const size_t bytes = d->buffer.receiver_count * sizeof *d->values;
    if (status == UMB_OK) {
        f->error = worst_difference(d, d->other);
        settings.way = UMB_MAP_DEEP_LINKS;
        status = map_ask(d, &settings, d->values, &f->linked, error);
        f->linked_same = status == UMB_OK && memcmp(d->values, d->other, bytes) == 0;
    }
    if (status == UMB_OK) {
        settings.way = UMB_MAP_DEEP_STREAM;
        status = map_ask(d, &settings, d->values, &f->streamed, error);
        f->streamed_same = status == UMB_OK && memcmp(d->values, d->other, bytes) == 0;
    }
    if (status == UMB_OK) {
        tile_draw(d, 1, d->values);
        truth_draw(d, 0, d->box);
        status = moments_run(d, f->moments, error);
    }
    return status;
}

/* Prints the cost of a way, compared with a search of every list. */
static void way_print(FILE *to, const char *name, const struct result *way,
                      const struct result *searched, int same)
{
    fprintf(to, "%-18s %" PRIu64 " bytes, %.0f ns a point, %.2f times as fast, %s bits\n", name,
            way->info.bytes, way->query_ns, searched->query_ns / way->query_ns,
            same ? "the same" : "OTHER");
}

static void print_text(FILE *to, const struct deep *d, const struct findings *f)
{
    fprintf(to,
            "%s: %" PRIu64 " texels a side, %" PRIu64
            " fragments in %zu lists, %zu points, %" PRIu64 " x %" PRIu64 " texels\n",
            d->scene_path, d->resolution, d->hits.first[d->resolution * d->resolution],
            d->hits.occupied, d->buffer.receiver_count, d->taps, d->taps);
    fprintf(to, "nothing left out:  %" PRIu64 " nodes, %" PRIu64 " bytes, off by at most %.3g\n",
            f->exact.info.fragments, f->exact.info.bytes, f->exact_error);
    fprintf(to, "epsilon %-9g  %" PRIu64 " nodes, off by at most %.3g\n", d->epsilon,
            f->searched.info.fragments, f->error);
    fprintf(to, "searched:          %" PRIu64 " bytes, %.0f ns a point\n", f->searched.info.bytes,
            f->searched.query_ns);
    way_print(to, "linked:", &f->linked, &f->searched, f->linked_same);
    way_print(to, "streamed:", &f->streamed, &f->searched, f->streamed_same);
    fprintf(to, "%-18s %9s %9s %9s %9s %9s %11s %8s %9s\n", "moments", "mean", "lighter", "darker",
            "most", "slack", "bytes", "build s", "ns/point");
    for (size_t i = 0; i < umbt_moment_row_count; i++) {
        const struct umbt_moment_result *r = &f->moments[i];
        fprintf(to, "%-18s %9.5f %9.5f %9.5f %9.5f %9.2g %11" PRIu64 " %8.3f %9.0f\n",
                umbt_moment_rows[i].name, r->mean, r->lighter, r->darker, r->most, r->info.slack,
                r->info.bytes, r->build_s, r->query_ns);
    }
}

static void put_map(struct umbu_json *json, const char *name, const struct result *map)
{
    umbu_json_begin(json, name, '{');
    umbu_json_integer(json, "nodes", map->info.fragments);
    umbu_json_integer(json, "bytes", map->info.bytes);
    umbu_json_rounded(json, "ns_per_point", map->query_ns, 6);
    umbu_json_end(json, '}');
}

static void put_moments(struct umbu_json *json, const char *name,
                        const struct umbt_moment_result *r)
{
    umbu_json_begin(json, NULL, '{');
    umbu_json_text(json, "name", name);
    umbu_json_rounded(json, "mean", r->mean, 9);
    umbu_json_rounded(json, "lighter", r->lighter, 9);
    umbu_json_rounded(json, "darker", r->darker, 9);
    umbu_json_rounded(json, "most", r->most, 9);
    umbu_json_rounded(json, "slack", r->info.slack, 9);
    umbu_json_integer(json, "bytes", r->info.bytes);
    umbu_json_rounded(json, "build_s", r->build_s, 6);
    umbu_json_rounded(json, "ns_per_point", r->query_ns, 6);
    umbu_json_end(json, '}');
}

static void print_json(const struct deep *d, const struct findings *f)
{
    struct umbu_json json = {.file = stdout};
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "scene", d->scene_path);
    umbu_json_integer(&json, "resolution", d->resolution);
    umbu_json_integer(&json, "taps", d->taps);
    umbu_json_rounded(&json, "epsilon", d->epsilon, 9);
    umbu_json_integer(&json, "fragments", d->hits.first[d->resolution * d->resolution]);
    umbu_json_integer(&json, "lists", d->hits.occupied);
    umbu_json_integer(&json, "points", d->buffer.receiver_count);
    umbu_json_rounded(&json, "exact_error", f->exact_error, 6);
    umbu_json_rounded(&json, "error", f->error, 6);
    put_map(&json, "exact", &f->exact);
    put_map(&json, "searched", &f->searched);
    put_map(&json, "linked", &f->linked);
    put_map(&json, "streamed", &f->streamed);
    umbu_json_bool(&json, "same_bits", f->linked_same && f->streamed_same);
    umbu_json_begin(&json, "moments", '[');
    for (size_t i = 0; i < umbt_moment_row_count; i++) {
        put_moments(&json, umbt_moment_rows[i].name, &f->moments[i]);
    }
    umbu_json_close(&json);
}

int umbt_deep_command(int argc, char **argv)
{
    struct deep d;
    struct findings findings = {0};
    struct umb_error error = {0};
    memset(&d, 0, sizeof d);
    struct umbu_parsed parsed;
    d.threads = umbu_processor_count();
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &d);
    if (code >= 0) {
        return code;
    }
    findings.moments = calloc(umbt_moment_row_count, sizeof *findings.moments);
    const enum umb_status status =
        findings.moments != NULL
            ? deep_run(&d, &findings, &error)
            : umb_fail(&error, UMB_E_NO_MEMORY, "results do not fit in memory");
    if (status == UMB_OK && d.json) {
        print_json(&d, &findings);
    } else if (status == UMB_OK && !d.quiet) {
        print_text(umbu_output_talk(d.output), &d, &findings);
    }
    umbt_light_hits_finish(&d.hits);
    free(d.values);
    free(d.other);
    free(d.box);
    free(d.between);
    free(findings.moments);
    umbt_picture_finish(&d.sheet);
    umbt_gbuffer_finish(&d.buffer);
    umbt_view_close(&d.view);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage-study deep: %s\n", error.message);
    }
    return umbu_exit_code(status);
}
