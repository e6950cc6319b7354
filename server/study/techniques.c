/* SPDX-License-Identifier: Apache-2.0 */
/* Traces the view of techniques.h; builds, times and compares its rows. */
#include "study/techniques.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "maps/map_parts.h"
#include "query/query_parts.h"
#include "study/technique_seams.h"
#include "tool/clock.h"
#include "tool/threads.h"

#define DISC_RAYS 64U
#define AREA_RAYS 11U /* rays a side */
/* Distance of starts of rays from the surface, as a share of the scene's diagonal: above Embree's
 * rounding. */
#define LIFT_SHARE   2e-6
#define SPLIT_WEIGHT 0.5  /* weight of logarithmic against uniform splits (Zhang et al. 2006) */
#define BLOCK        512  /* points a thread traces at a time */
#define SAME_SUN     1e-9 /* 1 - cosine of the largest angle between equal suns: 0.003 degrees */
#define RUNS         5
#define ATTEMPTS     3     /* series of runs, until the least agree */
#define RUN_S        0.002 /* shortest run, so that the clock measures it well */
#define CALLS_MAX    1000  /* most calls a run */

struct layer {
    const struct umbr_rays *rays;
    const struct umb_map_frustum *frustum;
    uint32_t side; /* samples along each side of a texel */
    float *depth;  /* [height][width][side * side] */
};

/* The ray of the light through a place of the map, as umbt_texel_ray. */
static double place_ray(const struct umb_map_frustum *frustum, double x, double y, double start[3],
                        double direction[3])
{
    double end[3];
    if (umb_map_frustum_point(frustum, x, y, 0.0, start) != UMB_OK ||
        umb_map_frustum_point(frustum, x, y, 1.0, end) != UMB_OK) {
        return 0.0;
    }
    umb__subtract(end, start, direction);
    return umbt_normalize(direction);
}

double umbt_texel_ray(const struct umb_map_frustum *frustum, size_t texel, double start[3],
                      double direction[3])
{
    return place_ray(frustum, (double)(texel % frustum->width) + 0.5,
                     (double)(texel / frustum->width) + 0.5, start, direction);
}

static void layer_item(void *user, size_t i)
{
    const struct layer *layer = user;
    double start[3], direction[3];
    struct umbr_hit hit = {.distance = -1.0};
    const size_t side = layer->side, texel = i / (side * side), sample = i % (side * side);
    const double x =
        (double)(texel % layer->frustum->width) + ((double)(sample % side) + 0.5) / (double)side;
    const double y =
        (double)(texel / layer->frustum->width) + ((double)(sample / side) + 0.5) / (double)side;
    const double length = place_ray(layer->frustum, x, y, start, direction);
    layer->depth[i] = 1.0F;
    if (length > 0.0) {
        umbr_nearest(layer->rays, start, direction, 0.0, length, &hit);
    }
    if (hit.distance >= 0.0) {
        layer->depth[i] = (float)fmin(hit.distance / length, 0.99999994);
    }
}

enum umb_status umbt_layer_trace(const struct umbt_technique_view *view,
                                 const struct umb_map_frustum *frustum, uint32_t side, float *depth,
                                 struct umb_error *error)
{
    struct layer layer = {view->setup.scene->rays, frustum, side, depth};
    return umbu_range_each(view->threads, (size_t)frustum->width * frustum->height * side * side,
                           4096, layer_item, &layer, error);
}

/* Makes the truth of the view's filter on an affine frustum: rays over the filter's box. The map's
 * texels are its voxels. */
static void box_truth(const struct umbt_technique_view *view, const struct umb_map_frustum *frustum,
                      struct umbt_truth *truth)
{
    struct umb_frustum_info texels = {.world_to_voxel[3][3] = 1.0};
    for (int i = 0; i < 3; i++) {
        const double *row = frustum->world_to_map[i];
        memcpy(texels.world_to_voxel[i], row, sizeof texels.world_to_voxel[i]);
        for (int k = 0; k < 3 && i < 2; k++) {
            texels.voxel_step[i][k] = row[k] / umb__dot(row, row);
        }
    }
    *truth = umbt_truth_of(view->setup.scene, view->setup.to_light, frustum->origin, &texels);
    truth->kind = UMBT_TRUTH_AREA;
    truth->by_normal = 1;
    truth->layers = NULL;
    truth->settings.taps = view->taps;
    truth->samples = AREA_RAYS;
}

static float traced(const struct umbt_technique_view *view, const struct umbt_truth *truth,
                    size_t i)
{
    double normal[3];
    umbt_widen(view->buffer.normals[i], normal);
    return umbt_truth_visibility(truth, view->buffer.positions[i], normal);
}

static float disc_visibility(const struct umbt_technique_view *view, const double disc[][2],
                             const double point[3], const double normal[3])
{
    double start[3], across[2][3];
    if (!(umb__dot(normal, view->setup.to_light) > 0.0)) {
        return 0.0F;
    }
    umbt_along(point, LIFT_SHARE * view->setup.scene->diagonal_m, normal, start);
    for (int i = 0; i < 2; i++) {
        memcpy(across[i], view->frustum.world_to_map[i], sizeof across[i]);
        (void)umbt_normalize(across[i]);
    }
    const double radius = tan(0.5 * view->light_rad);
    uint32_t lit = 0;
    for (uint32_t k = 0; k < DISC_RAYS; k++) {
        double direction[3];
        umbt_along(view->setup.to_light, radius * disc[k][0], across[0], direction);
        umbt_along(direction, radius * disc[k][1], across[1], direction);
        (void)umbt_normalize(direction);
        lit += !umbr_occluded(view->setup.scene->rays, start, direction, 0.0,
                              4.0 * view->setup.scene->diagonal_m);
    }
    return (float)lit / (float)DISC_RAYS;
}

static enum umb_status truth_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct umbt_technique_view *view = user;
    double disc[DISC_RAYS][2];
    struct umbt_truth box, surface;
    (void)error;
    umb__poisson_disc(disc, DISC_RAYS);
    box_truth(view, &view->frustum, &box);
    surface = box;
    surface.kind = UMBT_TRUTH_SURFACE;
    for (size_t i = first; i < first + count; i++) {
        const double *point = view->buffer.positions[i];
        double normal[3];
        umbt_widen(view->buffer.normals[i], normal);
        view->truth[UMBT_BOX][i] = traced(view, &box, i);
        view->truth[UMBT_POINT][i] = traced(view, &surface, i);
        view->truth[UMBT_PENUMBRA][i] =
            disc_visibility(view, (const double(*)[2])disc, point, normal);
    }
    return UMB_OK;
}

enum umb_status umbt_technique_points_make(struct umbt_technique_view *view,
                                           struct umb_error *error)
{
    UMB__TRY(umbt_gbuffer_view(&view->buffer, view->setup.scene, &view->setup.camera, view->size,
                               view->threads, error));
    const size_t receivers = view->buffer.receiver_count;
    for (int i = 0; i < UMBT_TECHNIQUE_TRUTHS; i++) {
        view->truth[i] = malloc(receivers * sizeof(float));
        if (view->truth[i] == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", receivers);
        }
    }
    return UMB_OK;
}

enum umb_status umbt_technique_view_make(struct umbt_technique_view *view, struct umb_error *error)
{
    const uint32_t side = view->resolution;
    const size_t texels = (size_t)side * side;
    UMB__TRY(umb_map_frustum_fit(view->setup.to_light, &view->setup.scene->box, side, side,
                                 &view->frustum, error));
    view->depth = malloc(texels * sizeof *view->depth);
    if (view->depth == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    }
    UMB__TRY(umbt_layer_trace(view, &view->frustum, 1, view->depth, error));
    UMB__TRY(umbt_technique_points_make(view, error));
    return umbu_range_run(view->threads, view->buffer.receiver_count, BLOCK, truth_block, view,
                          error);
}

void umbt_technique_view_finish(struct umbt_technique_view *view)
{
    free(view->depth);
    for (int i = 0; i < UMBT_TECHNIQUE_TRUTHS; i++) {
        free(view->truth[i]);
    }
    umbt_gbuffer_finish(&view->buffer);
}

int umbt_faces_light(const struct umbt_technique_view *view, size_t point, double direction[3],
                     double *distance)
{
    double normal[3];
    umbt_widen(view->buffer.normals[point], normal);
    memcpy(direction, view->setup.to_light, 3 * sizeof *direction);
    if (view->lamp != NULL) {
        umb__subtract(view->lamp, view->buffer.positions[point], direction);
        *distance = umbt_normalize(direction);
    }
    return umb__dot(normal, direction) > 0.0;
}

void umbt_technique_compare(const struct umbt_technique_view *view, const float *truth,
                            const float *values, struct umbt_technique_result *result)
{
    size_t count = 0, over = 0;
    double direction[3], distance;
    if (view->compared != NULL) {
        memcpy(view->compared, truth, view->buffer.receiver_count * sizeof *truth);
    }
    result->lighter = result->darker = 0.0;
    for (size_t i = 0; i < view->buffer.receiver_count; i++) {
        if (umbt_faces_light(view, i, direction, &distance)) {
            const double difference = (double)values[i] - (double)truth[i];
            result->lighter += fmax(difference, 0.0);
            result->darker += fmax(-difference, 0.0);
            over += fabs(difference) > 0.5;
            count++;
        }
    }
    const double divisor = count > 0 ? (double)count : 1.0;
    result->lighter /= divisor;
    result->darker /= divisor;
    result->mean = result->lighter + result->darker;
    result->over_half = (double)over / divisor;
}

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

/* Answers all points on one thread and times the answers, until the least runs agree. */
static void answer(const struct umbt_technique_view *view, struct asking asking,
                   struct umbt_technique_result *result)
{
    const size_t points = view->buffer.receiver_count;
    double ns[ATTEMPTS * RUNS];
    asking.points = umbt_points_at(view->buffer.positions[0], view->buffer.normals[0], points);
    result->time.spread = INFINITY;
    const double once = calls_s(&asking, 1); /* also warms up the caches */
    const int calls = 1 + (int)fmin(RUN_S / fmax(once, 1e-9), CALLS_MAX);
    const size_t attempts = view->quick ? 1 : ATTEMPTS;
    for (size_t i = 0; i < attempts && result->time.spread > UMBT_SPREAD_STEADY; i++) {
        for (size_t run = RUNS * i; run < RUNS * (i + 1); run++) {
            ns[run] = 1e9 * calls_s(&asking, calls) / ((double)calls * (double)points);
        }
        result->time = umbt_least(ns, RUNS * (i + 1));
    }
}

/* ---- the traced box of a point's own slice, or of an asset ---- */

struct tracing {
    const struct umbt_technique_view *view;
    const struct umbt_truth *truths;     /* one for each slice */
    const struct umb_cascade_plan *plan; /* NULL: one truth */
    float *traced;                       /* [receivers] */
};

static void traced_item(void *user, size_t i)
{
    const struct tracing *tracing = user;
    const struct umb_cascade_plan *plan = tracing->plan;
    const double distance =
        umbt_camera_depth(&tracing->view->setup.camera, tracing->view->buffer.positions[i]);
    uint32_t slice = 0;
    while (plan != NULL && slice + 1 < plan->count && distance >= plan->splits[slice + 1]) {
        slice++;
    }
    tracing->traced[i] = traced(tracing->view, &tracing->truths[slice], i);
}

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
    float *depth; /* depths of one slice at a time, or of several samples a texel */
};

struct umb_map_filter umbt_technique_filter(const struct umbt_technique_view *view,
                                            const struct umb_map_filter *own,
                                            enum umbt_technique_truth truth, double depth_m,
                                            double light_size)
{
    struct umb_map_filter filter = *own;
    filter.width = truth == UMBT_POINT ? 1.0 : (double)view->taps;
    filter.bias_normal = 1.0;
    filter.bias_m = depth_m / 65536.0; /* a step of 16 bits, for all techniques */
    if (filter.kernel == UMB_MAP_POISSON) {
        filter.width *= 1.12837917; /* a disc of the box's area */
    }
    if (filter.light_size > 0.0) {
        filter.light_size = light_size;
        filter.width = UMB_MAP_WIDTH_MAX;
        filter.bias_normal = 1.0 / (double)UMB_MAP_WIDTH_MAX;
        filter.bias_slope = 1.0;
    }
    return filter;
}

static struct umb_map_filter filter_of(const struct umbt_technique_view *view,
                                       const struct umbt_technique_row *row)
{
    return umbt_technique_filter(view, &row->filter, row->truth, view->frustum.depth_m,
                                 view->light_rad);
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
    const struct umb_map_layer layer = {.depth = depth, .samples = row->samples * row->samples};
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
        .count = row->cascades, .weight = SPLIT_WEIGHT, .fit = row->fit, .blend = row->blend};
    struct umb_camera camera = umbt_camera_view(&view->setup.camera, INFINITY, 0.0);
    for (size_t i = 0; i < view->buffer.receiver_count; i++) {
        const double depth = umbt_camera_depth(&view->setup.camera, view->buffer.positions[i]);
        camera.near_m = fmin(camera.near_m, depth);
        camera.far_m = fmax(camera.far_m, depth);
    }
    camera.near_m *= 0.999; /* some room, if all points are equally far */
    camera.far_m *= 1.001;
    for (uint32_t i = 0; i < row->cascades; i++) {
        settings.resolution[i] = view->resolution / 2;
    }
    return umb_cascades_plan(&camera, view->setup.to_light, &view->setup.scene->box, &settings,
                             plan, error);
}

/* Judges the seams, and prepares the queries again with their contrasts. */
static enum umb_status seams_run(const struct umbt_technique_view *view,
                                 const struct umbt_technique_row *row, struct maps *maps,
                                 struct umbt_technique_result *result, struct umb_error *error)
{
    struct umb_map_filter filter = filter_of(view, row);
    filter.contrast = 1.0;
    result->seam_count = row->cascades - 1;
    UMB__TRY(
        umbt_seams_run(view, &maps->plan, maps->maps, &filter, row->match, result->seams, error));
    for (uint32_t i = 1; i < row->cascades && row->match; i++) {
        filter.contrast = result->seams[i - 1].contrast;
        UMB__TRY(umb_map_prepare(maps->maps[i], &filter, &maps->queries[i], error));
    }
    return UMB_OK;
}

/* Runs a row with a map for each slice. A point's truth is that of the box filter of its slice. */
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
        UMB__TRY(umbt_layer_trace(view, frustum, 1, maps->depth, error));
        UMB__TRY(map_make(view, row, frustum, maps->depth, maps, i, result, error));
        box_truth(view, frustum, &maps->truths[i]);
    }
    UMB__TRY(seams_run(view, row, maps, result, error));
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
    const size_t texels = (size_t)view->resolution * view->resolution;
    if (row->samples > 1) {
        maps->depth = malloc(texels * row->samples * row->samples * sizeof *maps->depth);
        if (maps->depth == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
        }
        UMB__TRY(umbt_layer_trace(view, &view->frustum, row->samples, maps->depth, error));
    }
    UMB__TRY(map_make(view, row, &view->frustum, row->samples > 1 ? maps->depth : view->depth, maps,
                      0, result, error));
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

/* Times an asset's box or one tap by the kernel without vector instructions. A query with more
 * stages than its kernel keeps the time of `result`. */
static void answer_scalar(const struct umbt_technique_view *view, const struct umb_query *query,
                          float *values, struct umbt_technique_result *result)
{
    struct umb_query copy = {{0}};
    struct umb__query inside;
    struct umbt_technique_result scalar = *result;
    memcpy(&inside, query->opaque, sizeof inside);
    if (inside.run == inside.kernel) {
        inside.run = inside.kernel = umb__kernel_base;
        memcpy(copy.opaque, &inside, sizeof inside);
        answer(view, (struct asking){.query = &copy, .values = values}, &scalar);
    }
    result->scalar = scalar.time;
}

enum umb_status umbt_dag_run(const struct umbt_technique_view *view, const struct umb_asset *asset,
                             enum umbt_technique_truth kind, float *values,
                             struct umbt_technique_result *result, struct umb_error *error)
{
    const int penumbra = kind == UMBT_PENUMBRA;
    const struct umb_query_settings settings = {.taps = kind == UMBT_BOX ? view->taps : 1,
                                                .filter =
                                                    penumbra ? UMB_FILTER_PENUMBRA : UMB_FILTER_BOX,
                                                .light_extent = penumbra ? view->light_rad : 0.0,
                                                .opaque_only = 1}; /* as maps are */
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_query query;
    struct umbt_truth truth;
    memset(result, 0, sizeof *result);
    umb_asset_get_info(asset, &info);
    result->info.bytes = info.memory_bytes;
    UMB__TRY(umb_query_prepare(asset, &settings, &query, error));
    answer(view, (struct asking){.query = &query, .values = values}, result);
    if (kind != UMBT_BOX) {
        umbt_technique_compare(view, view->truth[kind], values, result);
    } else {
        box_truth(view, &view->frustum, &truth);
        truth.by_normal = 0;
        memcpy(truth.origin, info.origin, sizeof truth.origin);
        UMB__TRY(umb_asset_get_light(asset, 0, &light));
        UMB__TRY(umb_asset_get_frustum(asset, light.first_frustum, &truth.frustum));
        UMB__TRY(box_compare((struct tracing){view, &truth, NULL, NULL}, values, result, error));
    }
    if (!penumbra) {
        answer_scalar(view, &query, values, result);
    }
    return UMB_OK;
}
