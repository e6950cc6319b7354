/* SPDX-License-Identifier: Apache-2.0 */
/* See technique_dag.h. */
#include "study/technique_dag.h"

#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "study/study_vec.h"

#define BLOCK    512
#define SAME_SUN 1e-9 /* 1 - cosine of the largest angle between equal suns: 0.003 degrees */

const enum umbt_technique_truth umbt_dag_truths[UMBT_DAG_ROWS] = {UMBT_POINT, UMBT_BOX};

enum umb_status umbt_dag_open(const struct umbt_technique_view *view, const char *path,
                              struct umb_asset **asset, struct umb_error *error)
{
    struct umb_light_info light;
    UMB__TRY(umb_asset_open_file(path, NULL, asset, error));
    enum umb_status status = umb_asset_get_light(*asset, 0, &light);
    if (status != UMB_OK || light.kind != UMB_LIGHT_DIRECTIONAL ||
        !(1.0 + umb__dot(light.direction, view->to_light) < SAME_SUN)) {
        umb_asset_close(*asset);
        *asset = NULL;
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--asset: '%.200s': its first light is not the view's sun", path);
    }
    return UMB_OK;
}

/* The box of the view's filter in voxels, for all points. */
struct tracing {
    const struct umbt_technique_view *view;
    struct umbt_truth truth;
    float *traced;
};

static enum umb_status traced_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct tracing *tracing = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        tracing->traced[i] = umbt_technique_traced(tracing->view, &tracing->truth, i);
    }
    return UMB_OK;
}

static enum umb_status box_make(const struct umbt_technique_view *view,
                                const struct umb_asset *asset, float *traced,
                                struct umb_error *error)
{
    struct umb_asset_info info;
    struct umb_light_info light;
    struct tracing tracing = {.view = view, .traced = traced};
    umbt_technique_truth(view, &view->frustum, &tracing.truth);
    umb_asset_get_info(asset, &info);
    memcpy(tracing.truth.origin, info.origin, sizeof tracing.truth.origin);
    enum umb_status status = umb_asset_get_light(asset, 0, &light);
    if (status == UMB_OK) {
        status = umb_asset_get_frustum(asset, light.first_frustum, &tracing.truth.frustum);
    }
    return status == UMB_OK ? umbu_range_run(view->threads, view->buffer.receiver_count, BLOCK,
                                             traced_block, &tracing, error)
                            : status;
}

/* State of querying all points of the view. */
struct asking {
    const struct umb_query *query;
    const struct umb_points *points;
    struct umb_answers answers;
};

static void ask(void *user)
{
    struct asking *asking = user;
    umb_query_run(asking->query, asking->points, 0, asking->points->count, &asking->answers);
}

enum umb_status umbt_dag_run(const struct umbt_technique_view *view, const struct umb_asset *asset,
                             uint32_t row, float *values, struct umbt_technique_result *result,
                             struct umb_error *error)
{
    const int box = umbt_dag_truths[row] == UMBT_BOX;
    const struct umb_query_settings settings = {.taps = box ? view->taps : 1};
    const struct umb_points points = {.positions = view->buffer.positions,
                                      .format = UMB_POINT_F64,
                                      .normals = view->buffer.normals,
                                      .count = view->buffer.receiver_count};
    struct umb_asset_info info;
    struct umb_query query;
    memset(result, 0, sizeof *result);
    umb_asset_get_info(asset, &info);
    result->info.bytes = info.memory_bytes;
    enum umb_status status = umb_query_prepare(asset, &settings, &query, error);
    if (status != UMB_OK) {
        return status;
    }
    struct asking asking = {&query, &points, {.values = values}};
    result->query = umbt_steady_time(ask, &asking, points.count, UMBT_TECHNIQUE_STEADY);
    float *traced = box ? malloc(points.count * sizeof *traced) : NULL;
    if (box) {
        status = traced != NULL
                     ? box_make(view, asset, traced, error)
                     : umb_fail(error, UMB_E_NO_MEMORY, "%zu points: memory refused", points.count);
    }
    if (status == UMB_OK) {
        umbt_technique_compare(view, box ? traced : view->truth[UMBT_POINT], values, result);
    }
    free(traced);
    return status;
}
