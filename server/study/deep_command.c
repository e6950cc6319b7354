/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `deep`: deep shadow maps of a scene with translucent casters, and maps of moments, compared with
 * products over traced hits; and the speed-up by links between neighbours.
 */
#include "study/techniques.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "study/deep_rays.h"
#include "study/study_math.h"
#include "tool/clock.h"
#include "tool/threads.h"

#define REPEATS    3
#define HITS_MAX   64U  /* most hits of a ray; farther hits are left out */
#define STEP_SHARE 1e-7 /* step beyond a hit, to find the next, as a share of the depth range */

#define LIGHT(count) .settings.technique = UMB_MAP_MOMENTS, .settings.terms = (count)
#define LOGS(count)  .settings.technique = UMB_MAP_ABSORBANCE, .settings.terms = (count)

/* Rows of the maps of moments. In each family of maps the parameter grows from row to row. */
static const struct moment_row {
    const char *name;
    struct umb_map_settings settings; /* without blur */
} MOMENTS[] = {
    {"moments-4", LIGHT(4)},
    {"moments-6", LIGHT(6)},
    {"moments-8", LIGHT(8)},
    {"moments-8-u16", LIGHT(8), .settings.format = UMB_MAP_U16},
    {"moments-4-over", LIGHT(4), .settings.overestimate = 0.25},
    {"moments-8-over", LIGHT(8), .settings.overestimate = 0.25},
    {"absorbance-4", LOGS(4)},
    {"absorbance-6", LOGS(6)},
    {"absorbance-8", LOGS(8)},
    {"absorbance-8-u16", LOGS(8), .settings.format = UMB_MAP_U16},
    {"absorbance-4-over", LOGS(4), .settings.overestimate = 0.25},
    {"absorbance-8-over", LOGS(8), .settings.overestimate = 0.25},
};

#define MOMENT_COUNT (sizeof MOMENTS / sizeof MOMENTS[0])

/* One map: built, queried a few times, best time kept. */
struct result {
    struct umb_map_info info;
    double build_s, ns; /* CPU time of the whole build; of a point */
    /* Differences from the products: mean of |answer - truth|, its two parts, the largest. */
    double mean, lighter, darker, most;
};

/* The deep maps. The first three leave nothing out; the other three end lists at epsilon. Maps of
 * equal lists give the same bits. */
enum {
    EXACT,
    WHOLE_LINKED,
    WHOLE_STREAMED,
    SEARCHED,
    LINKED,
    STREAMED,
    DEEPS
};
static const struct {
    const char *name;
    enum umb_map_deep_way way;
} WAYS[DEEPS] = {{"exact", UMB_MAP_DEEP_SEARCH},          {"exact_linked", UMB_MAP_DEEP_LINKS},
                 {"exact_streamed", UMB_MAP_DEEP_STREAM}, {"searched", UMB_MAP_DEEP_SEARCH},
                 {"linked", UMB_MAP_DEEP_LINKS},          {"streamed", UMB_MAP_DEEP_STREAM}};

/* Filters of deep maps that are compared with rays: one texel, the window, and the window with
 * exponents (Fuerst, Mattausch, Scherzer 2013: EDSM). */
static const struct {
    const char *name;
    int wide;
    double exponent;
} FILTERS[] = {
    {"texel", 0, 0},
    {"pcf", 1, 0},
    {"edsm-30", 1, 30},
    {"edsm-100", 1, 100},
    {"edsm-300", 1, 300},
    {"edsm-1000", 1, 1000},
    {"edsm-3000", 1, 3000},
    {"texel-edsm-100", 0, 100},
    {"texel-edsm-300", 0, 300},
};

#define FILTER_COUNT (sizeof FILTERS / sizeof FILTERS[0])
#define TRUTH_RAYS   11U /* rays a side over the window */

/* Differences of a filter's answers from two kinds of rays: one from the point, and many over the
 * window around it. */
struct compared {
    double ns;
    double mean[2], rms[2], lighter[2]; /* [point, window] */
};

/* All surfaces on the light's path through each texel. */
struct hits {
    struct umb_map_fragment *fragments; /* [first[texels]], nearest first in a texel */
    uint64_t *first;                    /* [texels + 1] */
    uint32_t *counts;                   /* [texels], while they are traced */
    size_t occupied;                    /* texels with a fragment */
};

struct deep {
    struct umbt_common common;
    uint64_t resolution, taps;
    double epsilon;
    struct umbt_deep_rays rays;
    struct umbt_technique_view view; /* setup, size, frustum and buffer only */
    struct hits hits;
    float *values, *other; /* [receivers] */
    /* [receivers] Products over a box of texels, and products over the boxes around the four
     * nearest texels, weighted as in bilinear filtering. */
    double *box, *between;
    struct umbt_sheet sheet;
    double
        *traced[2]; /* [receivers] transmittance by a ray from the point, by rays over the window */
    struct result deeps[DEEPS], moments[MOMENT_COUNT];
    struct compared filters[FILTER_COUNT];
    int same[DEEPS]; /* 1: the same bits as the search */
};

#define AT(field) UMBU_AT(struct deep, field)

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW},
    {"output", "FILE",
     "PNG file with one view by each map, side by side, five a row: the products over the window "
     "of a deep map, the deep map, the products over the window of the other maps, the maps of "
     "moments in the order of the table, rays over the window, then the filters of deep maps; - is "
     "stdout",
     UMBU_TEXT, UMBT_AT(output), .letter = 'o'},
    {"alpha", "A", "share of the light that a BLEND surface absorbs, 0 to 1", UMBU_NUMBER(0, 1),
     AT(rays.alpha), .standard = "0.5"},
    {"resolution", "N", "texels a side of each map, 16 to 2048", UMBU_COUNT(16, 2048),
     AT(resolution), .standard = "512"},
    {"taps", "N", "width of the filter in texels", UMBU_ODD(1, 17), AT(taps), .standard = "7"},
    {"epsilon", "E", "share of the light, 0 to 1, below which the list of a texel ends",
     UMBU_NUMBER(0, 1), AT(epsilon), .standard = "0.001"},
    {UMBT_SIZE_ROW(2048, "320x200")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-study deep",
    .usage = "umbrage-study deep SCENE [options]",
    .summary = "Builds deep shadow maps of a scene, and maps of moments, and compares them with\n"
               "products over traced hits. A surface whose material is BLEND takes --alpha of\n"
               "the light, or its own constant alpha where that is less than 1; every other\n"
               "surface takes all.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBT_SETUP},
};

/* Moves points off their surfaces, towards the light, by half of the wider window. A plane then
 * does not shadow itself, as with bias_normal 1. Maps and products use the same points. */
static void points_lift(struct deep *d)
{
    for (size_t i = 0; i < d->view.buffer.receiver_count; i++) {
        double normal[3], shift = 0.0;
        umbt_widen(d->view.buffer.normals[i], normal);
        for (int axis = 0; axis < 2; axis++) {
            const double *g = d->view.frustum.world_to_map[axis];
            shift += 0.5 * ((double)d->taps + 1.0) * fabs(umb__dot(normal, g)) / umb__dot(g, g);
        }
        shift = copysign(shift, umb__dot(normal, d->view.setup.to_light));
        for (int k = 0; k < 3; k++) {
            d->view.buffer.positions[i][k] += shift * normal[k];
        }
    }
}

/* ---- hits ---- */

/* Finds all hits of a texel's ray, nearest first, and stores those of texel i from index HITS_MAX *
 * i on. */
static void texel_item(void *user, size_t i)
{
    const struct deep *d = user;
    const struct hits *hits = &d->hits;
    double start[3], direction[3], reached = 0.0;
    const double length = umbt_texel_ray(&d->view.frustum, i, start, direction);
    while (length > 0.0 && hits->counts[i] < HITS_MAX) {
        struct umbr_hit hit;
        umbr_nearest(d->common.scene.rays, start, direction, reached, length, &hit);
        if (hit.distance < 0.0) {
            break;
        }
        hits->fragments[i * HITS_MAX + hits->counts[i]++] = (struct umb_map_fragment){
            (float)fmin(hit.distance / length, 1.0), umbt_deep_alpha(&d->rays, hit.triangle)};
        reached = hit.distance + STEP_SHARE * length;
    }
}

/* Traces all hits, and joins the lists: list i begins at first[i]. */
static enum umb_status hits_trace(struct deep *d, struct umb_error *error)
{
    struct hits *hits = &d->hits;
    const size_t texels = (size_t)d->resolution * d->resolution;
    uint64_t used = 0;
    hits->fragments = malloc(texels * HITS_MAX * sizeof *hits->fragments);
    hits->counts = calloc(texels, sizeof *hits->counts);
    hits->first = calloc(texels + 1, sizeof *hits->first);
    if (hits->fragments == NULL || hits->counts == NULL || hits->first == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    }
    UMB__TRY(umbu_range_each(d->common.threads, texels, 1024, texel_item, d, error));
    for (size_t i = 0; i < texels; i++) {
        const uint32_t count = hits->counts[i];
        hits->first[i] = used;
        hits->occupied += count > 0;
        memmove(hits->fragments + used, hits->fragments + i * HITS_MAX,
                count * sizeof *hits->fragments);
        used += count;
    }
    hits->first[texels] = used;
    return UMB_OK;
}

/* ---- maps ---- */

static enum umb_status scene_open(struct deep *d, struct umb_error *error)
{
    struct umbt_setup *setup = &d->view.setup;
    const struct umbt_scene *scene = &d->common.scene;
    const uint32_t side = (uint32_t)d->resolution;
    UMB__TRY(umbt_setup_open(&d->common, setup, error));
    d->rays.scene = scene;
    memcpy(d->view.size, d->common.size, sizeof d->view.size);
    UMB__TRY(
        umb_map_frustum_fit(setup->to_light, &scene->box, side, side, &d->view.frustum, error));
    UMB__TRY(umbt_gbuffer_view(&d->view.buffer, scene, &setup->camera, d->view.size,
                               d->common.threads, error));
    const size_t count = d->view.buffer.receiver_count;
    points_lift(d);
    d->values = calloc(count, sizeof *d->values);
    d->other = calloc(count, sizeof *d->other);
    d->box = calloc(count, sizeof *d->box);
    d->between = calloc(count, sizeof *d->between);
    d->traced[0] = calloc(count, sizeof *d->traced[0]);
    d->traced[1] = calloc(count, sizeof *d->traced[1]);
    if (d->values == NULL || d->other == NULL || d->box == NULL || d->between == NULL ||
        d->traced[0] == NULL || d->traced[1] == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", count);
    }
    return hits_trace(d, error);
}

/* Bias of all filters in metres: a step of 16 bits. */
static double bias_of(const struct deep *d)
{
    return d->view.frustum.depth_m / 65536.0;
}

/* Queries a map, keeps the best time of a few runs, and compares the answers. values: [receivers],
 * receives the answers. */
static enum umb_status map_ask(const struct deep *d, const struct umb_map *map, double width,
                               const double *truth, float *values, struct result *result,
                               struct umb_error *error)
{
    /* Without normals: a hair's own strands shadow it by their depth alone. */
    const struct umb_points points =
        umbt_points_at(d->view.buffer.positions[0], NULL, d->view.buffer.receiver_count);
    const struct umb_map_filter filter = {.width = width, .bias_m = bias_of(d)};
    struct umb_map_query query;
    UMB__TRY(umb_map_prepare(map, &filter, &query, error));
    umb_map_get_info(map, &result->info);
    result->ns = INFINITY;
    for (int i = 0; i < REPEATS; i++) {
        const double start = umbu_thread_cpu_s();
        umb_map_run(&query, &points, 0, points.count, values);
        result->ns = fmin(result->ns, 1e9 * (umbu_thread_cpu_s() - start) / (double)points.count);
    }
    for (size_t i = 0; i < points.count; i++) {
        const double difference = (double)values[i] - truth[i];
        result->lighter += fmax(difference, 0.0) / (double)points.count;
        result->darker += fmax(-difference, 0.0) / (double)points.count;
        result->most = fmax(result->most, fabs(difference));
    }
    result->mean = result->lighter + result->darker;
    return UMB_OK;
}

/* Builds a deep map, or with `moments` a map of moments, and queries it. */
static enum umb_status map_run(const struct deep *d, const struct umb_map_deep_settings *settings,
                               const struct moment_row *moments, float *values,
                               struct result *result, struct umb_error *error)
{
    const struct umb_map_fragments in = {d->hits.first, d->hits.fragments};
    struct umb_map *map;
    const double start = umbu_thread_cpu_s();
    if (moments != NULL) {
        struct umb_map_settings blurred = moments->settings;
        blurred.blur = (uint32_t)d->taps;
        UMB__TRY(umb_map_build_translucent(&d->view.frustum, &in, &blurred, NULL, &map, error));
    } else {
        UMB__TRY(umb_map_build_deep(&d->view.frustum, &in, settings, NULL, &map, error));
    }
    *result = (struct result){.build_s = umbu_thread_cpu_s() - start};
    const enum umb_status status =
        moments != NULL ? map_ask(d, map, 0.0, d->between, values, result, error)
                        : map_ask(d, map, (double)d->taps, d->box, values, result, error);
    umb_map_destroy(map);
    return status;
}

/* Returns the transmittance of a texel at a depth: the product over the fragments before it. */
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

/* Returns the mean transmittance over a box of texels around (x, y). If the middle lies between
 * texels, the outer texels count by their share. */
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

static void truth_item(void *user, size_t i)
{
    struct deep *d = user;
    double p[3], at[3];
    umb__subtract(d->view.buffer.positions[i], d->view.frustum.origin, p);
    for (int k = 0; k < 3; k++) {
        at[k] = umb__dot(d->view.frustum.world_to_map[k], p) + d->view.frustum.world_to_map[k][3];
    }
    const double depth = at[2] - bias_of(d) / d->view.frustum.depth_m;
    d->box[i] = brute_force(d, floor(at[0]), floor(at[1]), depth);
    d->between[i] = brute_force(d, at[0] - 0.5, at[1] - 0.5, depth);
    at[2] = depth;
    d->traced[0][i] = umbt_deep_traced(&d->rays, &d->view.frustum, at, 0.0, 1);
    d->traced[1][i] = umbt_deep_traced(&d->rays, &d->view.frustum, at, (double)d->taps, TRUTH_RAYS);
}

/* Draws the truths as floats; the difference is invisible. */
static void truth_draw(struct deep *d, size_t tile, const double *truth)
{
    for (size_t i = 0; i < d->view.buffer.receiver_count; i++) {
        d->other[i] = (float)truth[i];
    }
    umbt_sheet_draw(&d->sheet, tile, &d->view, d->other);
}

/* Asks a map of one filter of FILTERS, and compares it with the rays. */
static enum umb_status filter_run(struct deep *d, size_t f, struct umb_error *error)
{
    const struct umb_map_deep_settings settings = {.epsilon = d->epsilon,
                                                   .exponent = FILTERS[f].exponent};
    const struct umb_map_fragments in = {d->hits.first, d->hits.fragments};
    const size_t count = d->view.buffer.receiver_count;
    struct compared *compared = &d->filters[f];
    struct result result = {0};
    struct umb_map *map;
    UMB__TRY(umb_map_build_deep(&d->view.frustum, &in, &settings, NULL, &map, error));
    const enum umb_status status =
        map_ask(d, map, FILTERS[f].wide ? (double)d->taps : 1.0, d->box, d->other, &result, error);
    umb_map_destroy(map);
    compared->ns = result.ns;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        for (int k = 0; k < 2; k++) {
            const double difference = (double)d->other[i] - d->traced[k][i];
            compared->mean[k] += fabs(difference) / (double)count;
            compared->lighter[k] += fmax(difference, 0.0) / (double)count;
            compared->rms[k] += difference * difference / (double)count;
        }
    }
    compared->rms[0] = sqrt(compared->rms[0]);
    compared->rms[1] = sqrt(compared->rms[1]);
    return status;
}

#define TILES_BEFORE 3U /* two truths and the deep map */

static enum umb_status moments_run(struct deep *d, struct umb_error *error)
{
    truth_draw(d, 2, d->between);
    for (size_t i = 0; i < MOMENT_COUNT; i++) {
        UMB__TRY(map_run(d, NULL, &MOMENTS[i], d->other, &d->moments[i], error));
        umbt_sheet_draw(&d->sheet, TILES_BEFORE + i, &d->view, d->other);
    }
    return UMB_OK;
}

/* Draws the rays over the window, then every filter. */
static enum umb_status filters_run(struct deep *d, struct umb_error *error)
{
    const size_t first = TILES_BEFORE + MOMENT_COUNT;
    truth_draw(d, first, d->traced[1]);
    for (size_t f = 0; f < FILTER_COUNT; f++) {
        UMB__TRY(filter_run(d, f, error));
        umbt_sheet_draw(&d->sheet, first + 1 + f, &d->view, d->other);
    }
    return umbt_sheet_write(&d->sheet, error);
}

static enum umb_status deep_run(void *state, const struct umbu_parsed *parsed,
                                struct umb_error *error)
{
    struct deep *d = state;
    (void)parsed;
    UMB__TRY(scene_open(d, error));
    const size_t count = d->view.buffer.receiver_count, bytes = count * sizeof *d->values;
    UMB__TRY(umbu_range_each(d->common.threads, count, 1024, truth_item, d, error));
    UMB__TRY(umbt_sheet_begin(&d->sheet, d->common.output, &d->view,
                              TILES_BEFORE + MOMENT_COUNT + 1 + FILTER_COUNT, error));
    for (int i = 0; i < DEEPS; i++) {
        const int base = i < SEARCHED ? EXACT : SEARCHED;
        const struct umb_map_deep_settings settings = {.epsilon = i < SEARCHED ? 0.0 : d->epsilon,
                                                       .way = WAYS[i].way};
        UMB__TRY(
            map_run(d, &settings, NULL, i == base ? d->other : d->values, &d->deeps[i], error));
        d->same[i] = i > base && memcmp(d->values, d->other, bytes) == 0;
    }
    umbt_sheet_draw(&d->sheet, 1, &d->view, d->values);
    truth_draw(d, 0, d->box);
    UMB__TRY(moments_run(d, error));
    return filters_run(d, error);
}

static void filters_text(FILE *to, const struct deep *d)
{
    fprintf(to, "%-18s %11s %9s %9s %11s %9s %9s %9s\n", "against rays", "point: mean", "rms",
            "lighter", "window mean", "rms", "lighter", "ns/point");
    for (size_t f = 0; f < FILTER_COUNT; f++) {
        const struct compared *c = &d->filters[f];
        fprintf(to, "%-18s %11.5f %9.5f %9.5f %11.5f %9.5f %9.5f %9.0f\n", FILTERS[f].name,
                c->mean[0], c->rms[0], c->lighter[0], c->mean[1], c->rms[1], c->lighter[1], c->ns);
    }
}

static void report_text(FILE *to, const void *state)
{
    const struct deep *d = state;
    const struct result *exact = &d->deeps[EXACT], *searched = &d->deeps[SEARCHED];
    fprintf(to,
            "%s: %" PRIu64 " texels a side, %" PRIu64
            " fragments in %zu lists, %zu points, %" PRIu64 " x %" PRIu64 " texels\n",
            d->common.scene_path, d->resolution, d->hits.first[d->resolution * d->resolution],
            d->hits.occupied, d->view.buffer.receiver_count, d->taps, d->taps);
    fprintf(to, "nothing left out:  %" PRIu64 " nodes, %" PRIu64 " bytes, off by at most %.3g\n",
            exact->info.fragments, exact->info.bytes, exact->most);
    fprintf(to, "epsilon %-9g  %" PRIu64 " nodes, off by at most %.3g\n", d->epsilon,
            searched->info.fragments, searched->most);
    fprintf(to, "searched:          %" PRIu64 " bytes, %.0f ns a point\n", searched->info.bytes,
            searched->ns);
    for (int i = LINKED; i < DEEPS; i++) {
        fprintf(to, "%s:%*s%" PRIu64 " bytes, %.0f ns a point, %.2f times as fast, %s bits\n",
                WAYS[i].name, 18 - (int)strlen(WAYS[i].name), "", d->deeps[i].info.bytes,
                d->deeps[i].ns, searched->ns / d->deeps[i].ns, d->same[i] ? "the same" : "OTHER");
    }
    for (int i = EXACT; i < SEARCHED; i++) {
        const struct result *cut = &d->deeps[SEARCHED + i];
        fprintf(to, "%s, nothing left out:%*s%.0f ns a point; with epsilon %.2f times as fast\n",
                WAYS[SEARCHED + i].name, 10 - (int)strlen(WAYS[SEARCHED + i].name), "",
                d->deeps[i].ns, d->deeps[i].ns / cut->ns);
    }
    filters_text(to, d);
    fprintf(to, "%-18s %9s %9s %9s %9s %9s %11s %8s %9s\n", "moments", "mean", "lighter", "darker",
            "most", "slack", "bytes", "build s", "ns/point");
    for (size_t i = 0; i < MOMENT_COUNT; i++) {
        const struct result *r = &d->moments[i];
        fprintf(to, "%-18s %9.5f %9.5f %9.5f %9.5f %9.2g %11" PRIu64 " %8.3f %9.0f\n",
                MOMENTS[i].name, r->mean, r->lighter, r->darker, r->most, r->info.slack,
                r->info.bytes, r->build_s, r->ns);
    }
}

static void report_json(struct umbu_json *json, const void *state)
{
    const struct deep *d = state;
    umbu_json_text(json, "scene", d->common.scene_path);
    umbu_json_integer(json, "resolution", d->resolution);
    umbu_json_integer(json, "taps", d->taps);
    umbu_json_rounded(json, "epsilon", d->epsilon, 9);
    UMBU_JSON_COUNTS(json, {"fragments", d->hits.first[d->resolution * d->resolution]},
                     {"lists", d->hits.occupied}, {"points", d->view.buffer.receiver_count});
    UMBU_JSON_VALUES(json, 6, {"exact_error", d->deeps[EXACT].most},
                     {"error", d->deeps[SEARCHED].most});
    for (int i = 0; i < DEEPS; i++) {
        umbu_json_begin(json, WAYS[i].name, '{');
        UMBU_JSON_COUNTS(json, {"nodes", d->deeps[i].info.fragments},
                         {"bytes", d->deeps[i].info.bytes});
        umbu_json_rounded(json, "ns_per_point", d->deeps[i].ns, 6);
        umbu_json_end(json, '}');
    }
    umbu_json_bool(json, "same_bits",
                   d->same[LINKED] && d->same[STREAMED] && d->same[WHOLE_LINKED] &&
                       d->same[WHOLE_STREAMED]);
    umbu_json_begin(json, "filters", '[');
    for (size_t f = 0; f < FILTER_COUNT; f++) {
        const struct compared *c = &d->filters[f];
        umbu_json_begin(json, NULL, '{');
        umbu_json_text(json, "name", FILTERS[f].name);
        UMBU_JSON_VALUES(json, 9, {"point_mean", c->mean[0]}, {"point_rms", c->rms[0]},
                         {"window_mean", c->mean[1]}, {"window_rms", c->rms[1]});
        umbu_json_rounded(json, "ns_per_point", c->ns, 6);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
    umbu_json_begin(json, "moments", '[');
    for (size_t i = 0; i < MOMENT_COUNT; i++) {
        const struct result *r = &d->moments[i];
        umbu_json_begin(json, NULL, '{');
        umbu_json_text(json, "name", MOMENTS[i].name);
        umbu_json_integer(json, "bytes", r->info.bytes);
        UMBU_JSON_VALUES(json, 9, {"mean", r->mean}, {"lighter", r->lighter}, {"darker", r->darker},
                         {"most", r->most}, {"slack", r->info.slack});
        UMBU_JSON_VALUES(json, 6, {"build_s", r->build_s}, {"ns_per_point", r->ns});
        umbu_json_end(json, '}');
    }
}

static void finish(void *state)
{
    struct deep *d = state;
    free(d->hits.fragments);
    free(d->hits.counts);
    free(d->hits.first);
    free(d->values);
    free(d->other);
    free(d->box);
    free(d->between);
    free(d->traced[0]);
    free(d->traced[1]);
    umbt_picture_finish(&d->sheet.picture);
    umbt_gbuffer_finish(&d->view.buffer);
}

const struct umbt_command umbt_deep = {&COMMAND,    sizeof(struct deep), deep_run,
                                       report_text, report_json,         finish};
