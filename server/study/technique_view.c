/* SPDX-License-Identifier: Apache-2.0 */
/* One view for all techniques; see technique_view.h. */
#include "study/technique_view.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "maps/map_parts.h"
#include "tool/threads.h"
#include "study/shading.h"
#include "study/study_vec.h"
#include "study/technique_cascades.h"
#include "tool/clock.h"

#define DISC_RAYS 64U
#define AREA_RAYS 11U /* rays a side */
/* Share of the scene's diagonal: off the surface, above Embree's rounding. */
#define LIFT_SHARE 2e-6

/* A layer being traced. */
struct layer {
    const struct umbr_rays *rays;
    const struct umb_map_frustum *frustum;
    float *depth;
};

static enum umb_status layer_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct layer *layer = user;
    const uint32_t width = layer->frustum->width;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        const double x = (double)(i % width) + 0.5, y = (double)(i / width) + 0.5;
        double start[3], end[3], direction[3];
        struct umbr_hit hit;
        layer->depth[i] = 1.0F;
        if (umb_map_frustum_point(layer->frustum, x, y, 0.0, start) != UMB_OK ||
            umb_map_frustum_point(layer->frustum, x, y, 1.0, end) != UMB_OK) {
            continue;
        }
        umb__subtract(end, start, direction);
        const double length = umbt_normalize(direction);
        umbr_nearest(layer->rays, start, direction, 0.0, length, &hit);
        if (hit.distance >= 0.0) {
            layer->depth[i] = (float)fmin(hit.distance / length, 0.99999994);
        }
    }
    return UMB_OK;
}

enum umb_status umbt_technique_layer(const struct umbt_technique_view *view,
                                     const struct umb_map_frustum *frustum, float *depth,
                                     struct umb_error *error)
{
    struct layer layer = {view->scene->rays, frustum, depth};
    return umbu_range_run(view->threads, (size_t)frustum->width * frustum->height, 4096,
                          layer_block, &layer, error);
}

/* The map's texels as voxels of one depth step each, for the traced references. */
void umbt_technique_truth(const struct umbt_technique_view *view,
                          const struct umb_map_frustum *frustum, struct umbt_truth *truth)
{
    memset(truth, 0, sizeof *truth);
    truth->rays = view->scene->rays;
    truth->kind = UMBT_TRUTH_AREA;
    truth->settings.taps = view->taps;
    truth->samples = AREA_RAYS;
    truth->diagonal_m = view->scene->diagonal_m;
    memcpy(truth->to_light, view->to_light, sizeof truth->to_light);
    memcpy(truth->origin, frustum->origin, sizeof truth->origin);
    for (int i = 0; i < 3; i++) {
        memcpy(truth->frustum.world_to_voxel[i], frustum->world_to_map[i],
               sizeof truth->frustum.world_to_voxel[i]);
        const double *row = frustum->world_to_map[i];
        const double square = umb__dot(row, row);
        for (int k = 0; k < 3 && i < 2; k++) {
            truth->frustum.voxel_step[i][k] = row[k] / square;
        }
    }
    truth->frustum.world_to_voxel[3][3] = 1.0;
}

float umbt_technique_traced(const struct umbt_technique_view *view, const struct umbt_truth *truth,
                            size_t i)
{
    double normal[3];
    for (size_t k = 0; k < 3; k++) {
        normal[k] = (double)view->buffer.normals[3 * i + k];
    }
    return umbt_truth_visibility(truth, &view->buffer.positions[3 * i], normal);
}

/* Share of the light's disc that a point sees. */
static float disc_visibility(const struct umbt_technique_view *view, const double disc[][2],
                             const double point[3], const double normal[3])
{
    double start[3], across[2][3];
    if (!(umb__dot(normal, view->to_light) > 0.0)) {
        return 0.0F;
    }
    umbt_along(point, LIFT_SHARE * view->scene->diagonal_m, normal, start);
    for (int i = 0; i < 2; i++) {
        memcpy(across[i], view->frustum.world_to_map[i], sizeof across[i]);
        (void)umbt_normalize(across[i]);
    }
    const double radius = tan(0.5 * view->light_rad);
    uint32_t lit = 0;
    for (uint32_t k = 0; k < DISC_RAYS; k++) {
        double direction[3];
        umbt_along(view->to_light, radius * disc[k][0], across[0], direction);
        umbt_along(direction, radius * disc[k][1], across[1], direction);
        (void)umbt_normalize(direction);
        lit +=
            !umbr_occluded(view->scene->rays, start, direction, 0.0, 4.0 * view->scene->diagonal_m);
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
    umbt_technique_truth(view, &view->frustum, &box);
    surface = box;
    surface.kind = UMBT_TRUTH_SURFACE;
    for (size_t i = first; i < first + count; i++) {
        const double *point = &view->buffer.positions[3 * i];
        double normal[3];
        for (size_t k = 0; k < 3; k++) {
            normal[k] = (double)view->buffer.normals[3 * i + k];
        }
        view->truth[UMBT_BOX][i] = umbt_technique_traced(view, &box, i);
        view->truth[UMBT_POINT][i] = umbt_technique_traced(view, &surface, i);
        view->truth[UMBT_PENUMBRA][i] =
            disc_visibility(view, (const double(*)[2])disc, point, normal);
    }
    return UMB_OK;
}

enum umb_status umbt_technique_view_make(struct umbt_technique_view *view, struct umb_error *error)
{
    const size_t texels = (size_t)view->resolution * view->resolution;
    enum umb_status status =
        umb_map_frustum_fit(view->to_light, &view->scene->box, view->resolution, view->resolution,
                            &view->frustum, error);
    if (status == UMB_OK) {
        view->depth = malloc(texels * sizeof *view->depth);
        status = view->depth != NULL
                     ? umbt_gbuffer_init(&view->buffer, view->width, 1, view->height, error)
                     : umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    }
    if (status == UMB_OK) {
        status = umbt_technique_layer(view, &view->frustum, view->depth, error);
    }
    if (status == UMB_OK) {
        status = umbt_gbuffer_fill(&view->buffer, view->scene, &view->camera, view->height, 0,
                                   view->height, view->threads, error);
    }
    const size_t receivers = view->buffer.receiver_count;
    if (status == UMB_OK && receivers == 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--camera: sees nothing of the scene");
    }
    for (int i = 0; i < UMBT_TECHNIQUE_TRUTHS && status == UMB_OK; i++) {
        view->truth[i] = malloc(receivers * sizeof(float));
        if (view->truth[i] == NULL) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", receivers);
        }
    }
    return status == UMB_OK
               ? umbu_range_run(view->threads, receivers, 512, truth_block, view, error)
               : status;
}

void umbt_technique_view_finish(struct umbt_technique_view *view)
{
    free(view->depth);
    for (int i = 0; i < UMBT_TECHNIQUE_TRUTHS; i++) {
        free(view->truth[i]);
    }
    umbt_gbuffer_finish(&view->buffer);
}

void umbt_technique_compare(const struct umbt_technique_view *view, const float *truth,
                            const float *values, struct umbt_technique_result *result)
{
    size_t facing = 0, over = 0;
    for (size_t i = 0; i < view->buffer.receiver_count; i++) {
        const float *normal = &view->buffer.normals[3 * i];
        double cosine = 0.0;
        for (size_t k = 0; k < 3; k++) {
            cosine += (double)normal[k] * view->to_light[k];
        }
        if (!(cosine > 0.0)) {
            continue;
        }
        const double difference = (double)values[i] - (double)truth[i];
        result->lighter += fmax(difference, 0.0);
        result->darker += fmax(-difference, 0.0);
        over += fabs(difference) > 0.5;
        facing++;
    }
    const double count = facing > 0 ? (double)facing : 1.0;
    result->lighter /= count;
    result->darker /= count;
    result->mean = result->lighter + result->darker;
    result->over_half = (double)over / count;
}

struct umb_map_filter umbt_technique_filter(const struct umbt_technique_view *view,
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

/* State of querying all points of the view in one map. */
struct asking {
    const struct umb_map_query *query;
    struct umb_points points;
    float *values;
};

static void ask(void *user)
{
    const struct asking *asking = user;
    umb_map_run(asking->query, &asking->points, 0, asking->points.count, asking->values);
}

struct umb_map_settings umbt_technique_settings(const struct umbt_technique_view *view,
                                                const struct umbt_technique_row *row)
{
    struct umb_map_settings settings = row->settings;
    if (settings.technique != UMB_MAP_PCF && settings.access == UMB_MAP_BASE) {
        settings.blur = view->taps;
    }
    return settings;
}

enum umb_status umbt_technique_run(const struct umbt_technique_view *view,
                                   const struct umbt_technique_row *row, float *values,
                                   struct umbt_technique_result *result, struct umb_error *error)
{
    if (row->cascades > 0) {
        return umbt_technique_cascades_run(view, row, values, result, error);
    }
    memset(result, 0, sizeof *result);
    const struct umb_map_settings settings = umbt_technique_settings(view, row);
    const struct umb_map_layer layer = {.depth = view->depth};
    const struct umb_map_filter filter = umbt_technique_filter(view, row);
    struct umb_map *map;
    struct umb_map_query query;
    const double start = umbu_thread_cpu_s();
    UMB__TRY(umb_map_build(&view->frustum, &layer, &settings, NULL, &map, error));
    result->build_s = umbu_thread_cpu_s() - start;
    enum umb_status status = umb_map_prepare(map, &filter, &query, error);
    if (status == UMB_OK) {
        struct asking asking = {.query = &query,
                                .points = {.positions = view->buffer.positions,
                                           .format = UMB_POINT_F64,
                                           .normals = view->buffer.normals,
                                           .count = view->buffer.receiver_count},
                                .values = values};
        result->query = umbt_steady_time(ask, &asking, asking.points.count, UMBT_TECHNIQUE_STEADY);
        umb_map_get_info(map, &result->info);
        umbt_technique_compare(view, view->truth[row->truth], values, result);
    }
    umb_map_destroy(map);
    return status;
}

static struct umbt_rgb pixel_color(const struct umbt_technique_view *view, size_t pixel,
                                   const float *values)
{
    const uint32_t slot = view->buffer.slots[pixel];
    const int up = view->z_up ? 2 : 1;
    if (slot == UMBT_SKY) {
        double direction[3];
        umbt_camera_ray(&view->camera, ((double)(pixel % view->width) + 0.5) / view->width,
                        ((double)(pixel / view->width) + 0.5) / view->height, direction);
        return umbt_sky(direction[up]);
    }
    double normal[3];
    for (size_t k = 0; k < 3; k++) {
        normal[k] = (double)view->buffer.normals[3 * (size_t)slot + k];
    }
    const uint32_t key = umbt_scene_surface_key(view->scene, view->buffer.triangles[slot]);
    return umbt_shade(umbt_surface_color(key), (double)values[slot],
                      umb__dot(normal, view->to_light), normal[up]);
}

void umbt_technique_draw(const struct umbt_technique_view *view, const float *values,
                         struct umbt_picture *picture, uint32_t x0, uint32_t y0)
{
    for (size_t pixel = 0; pixel < (size_t)view->width * view->height; pixel++) {
        const struct umbt_rgb color = pixel_color(view, pixel, values);
        const size_t x = x0 + pixel % view->width, y = y0 + pixel / view->width;
        for (size_t c = 0; c < 3; c++) {
            picture->pixels[3 * (y * picture->width + x) + c] =
                umbt_srgb8(umbt_shoulder(color.c[c]));
        }
    }
}
