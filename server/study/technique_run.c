/* SPDX-License-Identifier: Apache-2.0 */
/* Builds, times and compares the rows of technique_run.h. */
#include "study/technique_run.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "study/study_math.h"
#include "tool/clock.h"

#define SPLIT_WEIGHT 0.5  /* weight of logarithmic against uniform splits (Zhang et al. 2006) */
#define BLOCK        512  /* points a thread traces at a time */
#define SAME_SUN     1e-9 /* 1 - cosine of the largest angle between equal suns: 0.003 degrees */
#define RUNS         5
#define ATTEMPTS     3     /* attempts at runs that agree */
#define RUN_S        0.002 /* shortest run, so that the clock measures it well */
#define CALLS_MAX    1000  /* most calls a run */

const enum umbt_technique_truth umbt_dag_truths[UMBT_DAG_ROWS] = {UMBT_POINT, UMBT_BOX};

/* ---- time of the answers ---- */

/* A query of all points of the view: of an asset, of one map, or of a map for each slice. */
struct asking {
    const struct umb_query *query;       /* the asset's; NULL: maps */
    const struct umb_map_query *maps;    /* one for each slice */
    const struct umb_cascade_plan *plan; /* NULL: one map */
    struct umb_points points;
    float *values;
};

static double calls_s(const struct asking *asking, int calls)
{
    const size_t count = asking->points.count;
    const double start = umbu_thread_cpu_s();
    for (int i = 0; i < calls; i++) {
        if (asking->query != NULL) {
            struct umb_answers answers = {.values = asking->values};
            umb_query_run(asking->query, &asking->points, 0, count, &answers);
        } else if (asking->plan != NULL) {
            umb_cascades_run(asking->plan, asking->maps, &asking->points, 0, count, asking->values);
        } else {
            umb_map_run(asking->maps, &asking->points, 0, count, asking->values);
        }
    }
    return umbu_thread_cpu_s() - start;
}

/* Answers all points on one thread and times the answers. result: receives ns and spread of the
 * steadiest attempt. A spread of UMBT_TECHNIQUE_STEADY ends the attempts. */
static void answer(const struct umbt_technique_view *view, struct asking asking,
                   struct umbt_technique_result *result)
{
    asking.points = (struct umb_points){.positions = view->buffer.positions,
                                        .format = UMB_POINT_F64,
                                        .normals = view->buffer.normals,
                                        .count = view->buffer.receiver_count};
    result->spread = INFINITY;
    const double once = calls_s(&asking, 1); /* also warms up the caches */
    const int calls = 1 + (int)fmin(RUN_S / fmax(once, 1e-9), CALLS_MAX);
    for (int i = 0; i < ATTEMPTS && result->spread > UMBT_TECHNIQUE_STEADY; i++) {
        double seconds[RUNS], spread;
        for (int run = 0; run < RUNS; run++) {
            seconds[run] = calls_s(&asking, calls);
        }
        const double middle = umbt_median(seconds, RUNS, &spread);
        if (spread < result->spread) {
            result->ns = 1e9 * middle / ((double)calls * (double)asking.points.count);
            result->spread = spread;
        }
    }
}

/* ---- the traced box of a point's own slice, or of an asset ---- */

struct tracing {
    const struct umbt_technique_view *view;
    const struct umbt_truth *truths;     /* one for each slice */
    const struct umb_cascade_plan *plan; /* NULL: one truth */
    float *traced;                       /* [receivers] */
};

static double distance_of(const struct umbt_technique_view *view, size_t i)
{
    double from_eye[3];
    umb__subtract(&view->buffer.positions[3 * i], view->setup.camera.eye, from_eye);
    return umb__dot(from_eye, view->setup.camera.forward);
}

static void traced_item(void *user, size_t i)
{
    const struct tracing *tracing = user;
    const struct umb_cascade_plan *plan = tracing->plan;
    const double distance = distance_of(tracing->view, i);
    uint32_t slice = 0;
    while (plan != NULL && slice + 1 < plan->count && distance >= plan->splits[slice + 1]) {
        slice++;
    }
    tracing->traced[i] = umbt_technique_traced(tracing->view, &tracing->truths[slice], i);
}

/* Compares answers with rays over the box of each point. */
static enum umb_status box_compare(struct tracing tracing, const float *values,
                                   struct umbt_technique_result *result, struct umb_error *error)
{
    const struct umbt_technique_view *view = tracing.view;
    const size_t count = view->buffer.receiver_count;
    tracing.traced = malloc(count * sizeof *tracing.traced);
    const enum umb_status status =
        tracing.traced != NULL
            ? umbu_range_each(view->threads, count, BLOCK, traced_item, &tracing, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", count);
    if (status == UMB_OK) {
        umbt_technique_compare(view, tracing.traced, values, result);
    }
    free(tracing.traced);
    return status;
}

/* ---- maps ---- */

/* The maps of a row: one for each slice. */
struct maps {
    struct umb_map *maps[UMB_CASCADES_MAX];
    struct umb_map_query queries[UMB_CASCADES_MAX];
    struct umbt_truth truths[UMB_CASCADES_MAX]; /* truths of each slice's box */
    struct umb_cascade_plan plan;
    float *depth; /* depths of one slice at a time */
};

/* The row's filter, completed with the view's values. */
static struct umb_map_filter filter_of(const struct umbt_technique_view *view,
                                       const struct umbt_technique_row *row)
{
    struct umb_map_filter filter = row->filter;
    filter.width = row->truth == UMBT_POINT ? 1.0 : (double)view->taps;
    filter.bias_normal = 1.0;
    filter.bias_m = view->frustum.depth_m / 65536.0; /* a step of 16 bits, for all techniques */
    if (filter.kernel == UMB_MAP_POISSON) {
        filter.width *= 1.12837917; /* a disc of the box's area */
    }
    if (filter.light_size > 0.0) {
        filter.light_size = view->light_rad;
        filter.width = UMB_MAP_WIDTH_MAX;
        filter.bias_normal = 1.0 / (double)UMB_MAP_WIDTH_MAX;
        filter.bias_slope = 1.0;
    }
    return filter;
}

/* Builds map i from a layer of depths and prepares its query; adds its time and bytes. */
static enum umb_status map_make(const struct umbt_technique_view *view,
                                const struct umbt_technique_row *row,
                                const struct umb_map_frustum *frustum, const float *depth,
                                struct maps *maps, uint32_t i, struct umbt_technique_result *result,
                                struct umb_error *error)
{
    struct umb_map_settings settings = row->settings;
    const struct umb_map_filter filter = filter_of(view, row);
    const struct umb_map_layer layer = {.depth = depth};
    const uint64_t bytes = result->info.bytes;
    if (settings.technique != UMB_MAP_PCF && settings.access == UMB_MAP_BASE) {
        settings.blur = view->taps;
    }
    const double start = umbu_thread_cpu_s();
    UMB__TRY(umb_map_build(frustum, &layer, &settings, NULL, &maps->maps[i], error));
    result->build_s += umbu_thread_cpu_s() - start;
    umb_map_get_info(maps->maps[i], &result->info);
    result->info.bytes += bytes;
    return umb_map_prepare(maps->maps[i], &filter, &maps->queries[i], error);
}

/* Splits the view between the distances of its nearest and its farthest point. */
static enum umb_status plan_make(const struct umbt_technique_view *view,
                                 const struct umbt_technique_row *row,
                                 struct umb_cascade_plan *plan, struct umb_error *error)
{
    struct umb_cascade_settings settings = {
        .count = row->cascades, .weight = SPLIT_WEIGHT, .fit = row->fit};
    struct umb_camera camera = umbt_camera_view(&view->setup.camera, INFINITY, 0.0);
    for (size_t i = 0; i < view->buffer.receiver_count; i++) {
        camera.near_m = fmin(camera.near_m, distance_of(view, i));
        camera.far_m = fmax(camera.far_m, distance_of(view, i));
    }
    camera.near_m *= 0.999; /* some room, if all points are equally far */
    camera.far_m *= 1.001;
    for (uint32_t i = 0; i < row->cascades; i++) {
        settings.resolution[i] = view->resolution / 2;
    }
    return umb_cascades_plan(&camera, view->setup.to_light, &view->setup.scene->box, &settings,
                             plan, error);
}

/* Runs a row with a map for each slice. The box of a point is that of its own slice. */
static enum umb_status cascades_run(const struct umbt_technique_view *view,
                                    const struct umbt_technique_row *row, struct maps *maps,
                                    float *values, struct umbt_technique_result *result,
                                    struct umb_error *error)
{
    const size_t texels = (size_t)(view->resolution / 2) * (view->resolution / 2);
    maps->depth = malloc(texels * sizeof *maps->depth);
    if (maps->depth == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    }
    UMB__TRY(plan_make(view, row, &maps->plan, error));
    for (uint32_t i = 0; i < row->cascades; i++) {
        const struct umb_map_frustum *frustum = &maps->plan.frusta[i];
        UMB__TRY(umbt_technique_layer(view, frustum, maps->depth, error));
        UMB__TRY(map_make(view, row, frustum, maps->depth, maps, i, result, error));
        umbt_technique_truth(view, frustum, &maps->truths[i]);
    }
    answer(view, (struct asking){.maps = maps->queries, .plan = &maps->plan, .values = values},
           result);
    if (row->truth == UMBT_BOX) {
        return box_compare((struct tracing){view, maps->truths, &maps->plan, NULL}, values, result,
                           error);
    }
    umbt_technique_compare(view, view->truth[row->truth], values, result);
    return UMB_OK;
}

static enum umb_status map_run(const struct umbt_technique_view *view,
                               const struct umbt_technique_row *row, struct maps *maps,
                               float *values, struct umbt_technique_result *result,
                               struct umb_error *error)
{
    UMB__TRY(map_make(view, row, &view->frustum, view->depth, maps, 0, result, error));
    answer(view, (struct asking){.maps = maps->queries, .values = values}, result);
    umbt_technique_compare(view, view->truth[row->truth], values, result);
    return UMB_OK;
}

enum umb_status umbt_technique_run(const struct umbt_technique_view *view,
                                   const struct umbt_technique_row *row, float *values,
                                   struct umbt_technique_result *result, struct umb_error *error)
{
    struct maps maps = {0};
    memset(result, 0, sizeof *result);
    const enum umb_status status =
        (row->cascades > 0 ? cascades_run : map_run)(view, row, &maps, values, result, error);
    for (uint32_t i = 0; i < UMB_CASCADES_MAX; i++) {
        umb_map_destroy(maps.maps[i]);
    }
    free(maps.depth);
    return status;
}

/* ---- a baked asset ---- */

enum umb_status umbt_dag_open(const struct umbt_technique_view *view, const char *path,
                              struct umb_asset **asset, struct umb_error *error)
{
    struct umb_light_info light;
    UMB__TRY(umb_asset_open_file(path, NULL, asset, error));
    if (umb_asset_get_light(*asset, 0, &light) != UMB_OK || light.kind != UMB_LIGHT_DIRECTIONAL ||
        !(1.0 + umb__dot(light.direction, view->setup.to_light) < SAME_SUN)) {
        umb_asset_close(*asset);
        *asset = NULL;
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--asset: '%.200s': its first light is not the view's sun", path);
    }
    return UMB_OK;
}

enum umb_status umbt_dag_run(const struct umbt_technique_view *view, const struct umb_asset *asset,
                             uint32_t row, float *values, struct umbt_technique_result *result,
                             struct umb_error *error)
{
    const int box = umbt_dag_truths[row] == UMBT_BOX;
    const struct umb_query_settings settings = {.taps = box ? view->taps : 1};
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_query query;
    struct umbt_truth truth;
    memset(result, 0, sizeof *result);
    umb_asset_get_info(asset, &info);
    result->info.bytes = info.memory_bytes;
    UMB__TRY(umb_query_prepare(asset, &settings, &query, error));
    answer(view, (struct asking){.query = &query, .values = values}, result);
    if (!box) {
        umbt_technique_compare(view, view->truth[UMBT_POINT], values, result);
        return UMB_OK;
    }
    umbt_technique_truth(view, &view->frustum, &truth);
    memcpy(truth.origin, info.origin, sizeof truth.origin);
    UMB__TRY(umb_asset_get_light(asset, 0, &light));
    UMB__TRY(umb_asset_get_frustum(asset, light.first_frustum, &truth.frustum));
    return box_compare((struct tracing){view, &truth, NULL, NULL}, values, result, error);
}
