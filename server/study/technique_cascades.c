/* SPDX-License-Identifier: Apache-2.0 */
/* See technique_cascades.h. */
#include "study/technique_cascades.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "study/study_vec.h"
#include "tool/clock.h"

#define WEIGHT 0.5 /* weight of logarithmic against uniform splits (Zhang et al. 2006) */
#define BLOCK  512

/* A row being measured. */
struct cascades {
    const struct umbt_technique_view *view;
    struct umb_cascade_plan plan;
    struct umb_map *maps[UMB_CASCADES_MAX];
    struct umb_map_query queries[UMB_CASCADES_MAX];
    struct umbt_truth truths[UMB_CASCADES_MAX]; /* truths of each slice's box */
    float *depth;                               /* depths of one slice at a time */
    float *traced;                              /* [receivers] */
};

static double distance_of(const struct umbt_technique_view *view, size_t i)
{
    double from_eye[3];
    umb__subtract(&view->buffer.positions[3 * i], view->camera.eye, from_eye);
    return umb__dot(from_eye, view->camera.forward);
}

static enum umb_status plan_make(struct cascades *c, const struct umbt_technique_row *row,
                                 struct umb_error *error)
{
    const struct umbt_technique_view *view = c->view;
    struct umb_cascade_settings settings = {
        .count = row->cascades, .weight = WEIGHT, .fit = row->fit};
    struct umb_camera camera = umbt_camera_view(&view->camera, INFINITY, 0.0);
    for (size_t i = 0; i < view->buffer.receiver_count; i++) {
        camera.near_m = fmin(camera.near_m, distance_of(view, i));
        camera.far_m = fmax(camera.far_m, distance_of(view, i));
    }
    camera.near_m *= 0.999; /* some room, if all points are equally far */
    camera.far_m *= 1.001;
    for (uint32_t i = 0; i < row->cascades; i++) {
        settings.resolution[i] = view->resolution / 2;
    }
    return umb_cascades_plan(&camera, view->to_light, &view->scene->box, &settings, &c->plan,
                             error);
}

/* Builds the map of slice i, and prepares its query. */
static enum umb_status slice_make(struct cascades *c, const struct umbt_technique_row *row,
                                  uint32_t i, struct umbt_technique_result *result,
                                  struct umb_error *error)
{
    const struct umb_map_frustum *frustum = &c->plan.frusta[i];
    const struct umb_map_settings settings = umbt_technique_settings(c->view, row);
    const struct umb_map_filter filter = umbt_technique_filter(c->view, row);
    const struct umb_map_layer layer = {.depth = c->depth};
    struct umb_map_info info;
    enum umb_status status = umbt_technique_layer(c->view, frustum, c->depth, error);
    const double start = umbu_thread_cpu_s();
    if (status == UMB_OK) {
        status = umb_map_build(frustum, &layer, &settings, NULL, &c->maps[i], error);
    }
    result->build_s += umbu_thread_cpu_s() - start;
    if (status == UMB_OK) {
        status = umb_map_prepare(c->maps[i], &filter, &c->queries[i], error);
    }
    if (status == UMB_OK) {
        umb_map_get_info(c->maps[i], &info);
        info.bytes += result->info.bytes;
        result->info = info;
        umbt_technique_truth(c->view, frustum, &c->truths[i]);
    }
    return status;
}

static enum umb_status traced_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct cascades *c = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        const double distance = distance_of(c->view, i);
        uint32_t slice = 0;
        while (slice + 1 < c->plan.count && distance >= c->plan.splits[slice + 1]) {
            slice++;
        }
        c->traced[i] = umbt_technique_traced(c->view, &c->truths[slice], i);
    }
    return UMB_OK;
}

/* State of querying all points of the view in all slices. */
struct asking {
    const struct cascades *cascades;
    const struct umb_points *points;
    float *values;
};

static void ask(void *user)
{
    const struct asking *asking = user;
    const struct cascades *c = asking->cascades;
    umb_cascades_run(&c->plan, c->queries, asking->points, 0, asking->points->count,
                     asking->values);
}

static enum umb_status answer(struct cascades *c, const struct umbt_technique_row *row,
                              float *values, struct umbt_technique_result *result,
                              struct umb_error *error)
{
    const struct umbt_technique_view *view = c->view;
    const struct umb_points points = {.positions = view->buffer.positions,
                                      .format = UMB_POINT_F64,
                                      .normals = view->buffer.normals,
                                      .count = view->buffer.receiver_count};
    struct asking asking = {c, &points, values};
    result->query = umbt_steady_time(ask, &asking, points.count, UMBT_TECHNIQUE_STEADY);
    const float *truth = view->truth[row->truth];
    if (row->truth == UMBT_BOX) {
        UMB__TRY(umbu_range_run(view->threads, points.count, BLOCK, traced_block, c, error));
        truth = c->traced;
    }
    umbt_technique_compare(view, truth, values, result);
    return UMB_OK;
}

enum umb_status umbt_technique_cascades_run(const struct umbt_technique_view *view,
                                            const struct umbt_technique_row *row, float *values,
                                            struct umbt_technique_result *result,
                                            struct umb_error *error)
{
    const size_t texels = (size_t)(view->resolution / 2) * (view->resolution / 2);
    struct cascades c = {.view = view};
    memset(result, 0, sizeof *result);
    c.depth = malloc(texels * sizeof *c.depth);
    c.traced = malloc(view->buffer.receiver_count * sizeof *c.traced);
    enum umb_status status = c.depth != NULL && c.traced != NULL
                                 ? plan_make(&c, row, error)
                                 : umb_fail(error, UMB_E_NO_MEMORY, "cascades: memory refused");
    for (uint32_t i = 0; i < row->cascades && status == UMB_OK; i++) {
        status = slice_make(&c, row, i, result, error);
    }
    if (status == UMB_OK) {
        status = answer(&c, row, values, result, error);
    }
    for (uint32_t i = 0; i < UMB_CASCADES_MAX; i++) {
        umb_map_destroy(c.maps[i]);
    }
    free(c.depth);
    free(c.traced);
    return status;
}
