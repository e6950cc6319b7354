/* SPDX-License-Identifier: Apache-2.0 */
/* See trade_techniques.h. */
#include "study/trade_techniques.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "study/parallel_for.h"
#include "study/study_progress.h"
#include "study/technique_view.h"
#include "study/traced_shadow.h"
#include "study/trade_pictures.h"

#define WIDTH            256 /* pixels of the view */
#define HEIGHT           160
#define TAPS             9
#define RESOLUTION_MIN   128
#define RESOLUTION_QUICK 512
#define RESOLUTION_FULL  1024
#define SUN_RAD          (0.53 * 3.14159265358979323846 / 180.0)
#define BOX_RAYS         11 /* a side, as technique_view.c takes them */
#define BLOCK            512

static enum umb_status row_measure(const struct umbt_technique_view *view,
                                   const struct umbt_technique_row *row, float *values,
                                   struct umbt_trade_technique *technique, struct umb_error *error)
{
    struct umbt_technique_result result;
    const enum umb_status status = umbt_technique_run(view, row, values, &result, error);
    if (status != UMB_OK) {
        return status;
    }
    (void)snprintf(technique->name, sizeof technique->name, "%s", row->name);
    technique->truth = row->truth == UMBT_BOX ? "box" : row->truth == UMBT_POINT ? "point" : "disc";
    technique->bytes = result.info.bytes;
    technique->build_s = result.build_s;
    technique->mean = result.mean;
    technique->lighter = result.lighter;
    technique->darker = result.darker;
    technique->over_half = result.over_half;
    technique->ns = result.query.ns;
    technique->spread = result.query.spread;
    return UMB_OK;
}

/* The truth of one asset's own filter, for all points of the view. */
struct tracing {
    const struct umbt_technique_view *view;
    struct umbt_truth truth;
    float *values;
};

static enum umb_status trace_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct tracing *tracing = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double normal[3];
        for (size_t k = 0; k < 3; k++) {
            normal[k] = (double)tracing->view->buffer.normals[3 * i + k];
        }
        tracing->values[i] =
            umbt_truth_visibility(&tracing->truth, &tracing->view->buffer.positions[3 * i], normal);
    }
    return UMB_OK;
}

static enum umb_status dag_truth(const struct umbt_trade *trade, const struct umbt_trade_bake *bake,
                                 const struct umbt_technique_view *view, float *truth,
                                 struct umb_error *error)
{
    struct tracing tracing = {
        .view = view,
        .truth = {.rays = trade->scene.rays,
                  .kind = UMBT_TRUTH_AREA,
                  .settings = {.taps = TAPS},
                  .samples = BOX_RAYS,
                  .diagonal_m = trade->scene.diagonal_m,
                  .frustum = bake->frustum},
        .values = truth,
    };
    memcpy(tracing.truth.to_light, trade->points.to_light, sizeof tracing.truth.to_light);
    memcpy(tracing.truth.origin, bake->info.origin, sizeof tracing.truth.origin);
    return umbt_parallel_for(view->threads, view->buffer.receiver_count, BLOCK, trace_block,
                             &tracing, error);
}

/* All points of the view by one asset. */
struct asking {
    const struct umb_query *query;
    const struct umb_points *points;
    float *values;
};

static void ask(void *user)
{
    const struct asking *asking = user;
    struct umb_answers answers = {.values = asking->values};
    umb_query_run(asking->query, asking->points, 0, asking->points->count, &answers);
}

/* The DAG of one asset as one more technique. truth, values: float[receivers], scratch. */
static enum umb_status dag_measure(struct umbt_trade *trade, const struct umbt_trade_bake *bake,
                                   const struct umbt_technique_view *view, float *truth,
                                   float *values, struct umb_error *error)
{
    const struct umb_query_settings settings = {.taps = TAPS};
    const struct umb_points points = {.positions = view->buffer.positions,
                                      .format = UMB_POINT_F64,
                                      .normals = view->buffer.normals,
                                      .count = view->buffer.receiver_count};
    struct umbt_trade_technique *technique = &trade->techniques[trade->technique_count];
    struct umbt_technique_result result = {0};
    struct umb_query query;
    struct asking asking = {&query, &points, values};
    enum umb_status status = umb_query_prepare(bake->asset, &settings, &query, error);
    if (status == UMB_OK) {
        status = dag_truth(trade, bake, view, truth, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    const struct umbt_steady_time time =
        umbt_steady_time(ask, &asking, points.count, UMBT_TRADE_SPREAD_MAX);
    umbt_technique_compare(view, truth, values, &result);
    *technique = (struct umbt_trade_technique){
        .truth = "box",
        .is_dag = 1,
        .bytes = bake->info.memory_bytes,
        .build_s = bake->cpu_s,
        .ns = time.ns,
        .spread = time.spread,
        .mean = result.mean,
        .lighter = result.lighter,
        .darker = result.darker,
        .over_half = result.over_half,
    };
    char name[UMBT_TRADE_NAME]; /* by way of a copy: both lie in `trade`, which gcc takes for an
                                   overlap */
    (void)snprintf(name, sizeof name, "dag %s", bake->name);
    memcpy(technique->name, name, sizeof name);
    trade->technique_count++;
    return UMB_OK;
}

static enum umb_status all_measure(struct umbt_trade *trade, const struct umbt_technique_view *view,
                                   float *values, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    struct umbt_progress progress;
    umbt_progress_start(&progress, "techniques", trade->options.quiet);
    for (size_t i = 0; status == UMB_OK && i < umbt_technique_row_count &&
                       trade->technique_count < UMBT_TRADE_TECHNIQUES_MAX;
         i++) {
        status = row_measure(view, &umbt_technique_rows[i], values,
                             &trade->techniques[trade->technique_count], error);
        trade->technique_count += status == UMB_OK;
        umbt_progress_show(&progress, (double)(i + 1), (double)umbt_technique_row_count);
    }
    umbt_progress_end(&progress);
    for (uint32_t i = 0; status == UMB_OK && i < trade->bake_count; i++) {
        if (trade->bakes[i].asset != NULL && trade->technique_count < UMBT_TRADE_TECHNIQUES_MAX) {
            status = dag_measure(trade, &trade->bakes[i], view,
                                 values + view->buffer.receiver_count, values, error);
        }
    }
    return status;
}

/* Texels a side: a power of two, and no more than a quarter of the ladder's voxels. */
static uint32_t resolution_for(const struct umbt_trade_options *options)
{
    uint32_t resolution = options->quick ? RESOLUTION_QUICK : RESOLUTION_FULL;
    while (resolution > RESOLUTION_MIN && resolution > options->max_resolution / 4) {
        resolution /= 2;
    }
    return resolution;
}

enum umb_status umbt_trade_techniques(struct umbt_trade *trade, struct umb_error *error)
{
    struct umbt_technique_view view = {
        .scene = &trade->scene,
        .width = WIDTH,
        .height = HEIGHT,
        .resolution = resolution_for(&trade->options),
        .taps = TAPS,
        .light_rad = SUN_RAD,
        .threads = (unsigned)trade->options.threads,
    };
    memcpy(view.to_light, trade->points.to_light, sizeof view.to_light);
    enum umb_status status =
        umbt_trade_camera(trade, WIDTH, HEIGHT, &view.camera, &view.z_up, error);
    if (status == UMB_OK) {
        status = umbt_technique_view_make(&view, error);
    }
    float *values =
        status == UMB_OK ? malloc(2 * view.buffer.receiver_count * sizeof *values) : NULL;
    if (status == UMB_OK && values == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory",
                          view.buffer.receiver_count);
    }
    if (status == UMB_OK) {
        trade->technique_resolution = view.resolution;
        trade->technique_points = view.buffer.receiver_count;
        status = all_measure(trade, &view, values, error);
    }
    free(values);
    umbt_technique_view_finish(&view);
    return status;
}

void umbt_trade_techniques_json(FILE *to, const struct umbt_trade *trade)
{
    fprintf(to, "{\"resolution\":%u,\"taps\":%d,\"points\":%zu,\"rows\":[",
            trade->technique_resolution, TAPS, trade->technique_points);
    for (uint32_t i = 0; i < trade->technique_count; i++) {
        const struct umbt_trade_technique *t = &trade->techniques[i];
        fprintf(to,
                "%s{\"name\":\"%s\",\"truth\":\"%s\",\"dag\":%s,\"mean\":%.6g,\"lighter\":%.6g,"
                "\"darker\":%.6g,\"over_half\":%.6g,\"bytes\":%" PRIu64
                ",\"build_s\":%.6g,\"spread\":%.6g",
                i > 0 ? "," : "", t->name, t->truth, t->is_dag ? "true" : "false", t->mean,
                t->lighter, t->darker, t->over_half, t->bytes, t->build_s, t->spread);
        fprintf(to, t->spread > UMBT_TRADE_SPREAD_MAX ? ",\"ns\":null}" : ",\"ns\":%.6g}", t->ns);
    }
    fputs("]}", to);
}
