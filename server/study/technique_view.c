/* SPDX-License-Identifier: Apache-2.0 */
/* One view for all techniques; see technique_view.h. */
#include "study/technique_view.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "maps/map_parts.h"
#include "study/light_hits.h"
#include "tool/threads.h"
#include "study/shading.h"
#include "study/study_math.h"

#define DISC_RAYS 64U
#define AREA_RAYS 11U /* rays a side */
/* Distance of starts of rays from the surface, as a share of the scene's diagonal: above Embree's
 * rounding. */
#define LIFT_SHARE 2e-6
#define COLUMNS    5U /* drawings in a row of a sheet */
#define GAP        4U /* pixels between them */

/* A layer being traced. */
struct layer {
    const struct umbr_rays *rays;
    const struct umb_map_frustum *frustum;
    float *depth;
};

static void layer_item(void *user, size_t i)
{
    const struct layer *layer = user;
    double start[3], direction[3];
    struct umbr_hit hit = {.distance = -1.0};
    const double length = umbt_texel_ray(layer->frustum, i, start, direction);
    layer->depth[i] = 1.0F;
    if (length > 0.0) {
        umbr_nearest(layer->rays, start, direction, 0.0, length, &hit);
    }
    if (hit.distance >= 0.0) {
        layer->depth[i] = (float)fmin(hit.distance / length, 0.99999994);
    }
}

enum umb_status umbt_technique_layer(const struct umbt_technique_view *view,
                                     const struct umb_map_frustum *frustum, float *depth,
                                     struct umb_error *error)
{
    struct layer layer = {view->setup.scene->rays, frustum, depth};
    return umbu_range_each(view->threads, (size_t)frustum->width * frustum->height, 4096,
                           layer_item, &layer, error);
}

void umbt_technique_truth(const struct umbt_technique_view *view,
                          const struct umb_map_frustum *frustum, struct umbt_truth *truth)
{
    memset(truth, 0, sizeof *truth);
    truth->rays = view->setup.scene->rays;
    truth->kind = UMBT_TRUTH_AREA;
    truth->settings.taps = view->taps;
    truth->samples = AREA_RAYS;
    truth->diagonal_m = view->setup.scene->diagonal_m;
    memcpy(truth->to_light, view->setup.to_light, sizeof truth->to_light);
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
    umbt_widen(&view->buffer.normals[3 * i], normal);
    return umbt_truth_visibility(truth, &view->buffer.positions[3 * i], normal);
}

/* Share of the light's disc that a point sees. */
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
    umbt_technique_truth(view, &view->frustum, &box);
    surface = box;
    surface.kind = UMBT_TRUTH_SURFACE;
    for (size_t i = first; i < first + count; i++) {
        const double *point = &view->buffer.positions[3 * i];
        double normal[3];
        umbt_widen(&view->buffer.normals[3 * i], normal);
        view->truth[UMBT_BOX][i] = umbt_technique_traced(view, &box, i);
        view->truth[UMBT_POINT][i] = umbt_technique_traced(view, &surface, i);
        view->truth[UMBT_PENUMBRA][i] =
            disc_visibility(view, (const double(*)[2])disc, point, normal);
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
    UMB__TRY(umbt_technique_layer(view, &view->frustum, view->depth, error));
    UMB__TRY(umbt_gbuffer_view(&view->buffer, view->setup.scene, &view->setup.camera, view->size,
                               view->threads, error));
    const size_t receivers = view->buffer.receiver_count;
    for (int i = 0; i < UMBT_TECHNIQUE_TRUTHS; i++) {
        view->truth[i] = malloc(receivers * sizeof(float));
        if (view->truth[i] == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", receivers);
        }
    }
    return umbu_range_run(view->threads, receivers, 512, truth_block, view, error);
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
        double normal[3];
        umbt_widen(&view->buffer.normals[3 * i], normal);
        if (!(umb__dot(normal, view->setup.to_light) > 0.0)) {
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

static struct umbt_rgb pixel_color(const struct umbt_technique_view *view, size_t pixel,
                                   const float *values)
{
    const uint32_t slot = view->buffer.slots[pixel];
    const int up = view->setup.z_up ? 2 : 1;
    if (slot == UMBT_SKY) {
        double direction[3];
        umbt_camera_ray(&view->setup.camera,
                        ((double)(pixel % view->size[0]) + 0.5) / view->size[0],
                        ((double)(pixel / view->size[0]) + 0.5) / view->size[1], direction);
        return umbt_sky(direction[up]);
    }
    double normal[3];
    umbt_widen(&view->buffer.normals[3 * (size_t)slot], normal);
    const uint32_t key = umbt_scene_surface_key(view->setup.scene, view->buffer.triangles[slot]);
    return umbt_shade(umbt_surface_color(key), (double)values[slot],
                      umb__dot(normal, view->setup.to_light), normal[up]);
}

enum umb_status umbt_sheet_begin(struct umbt_sheet *sheet, const char *path,
                                 const struct umbt_technique_view *view, size_t tiles,
                                 struct umb_error *error)
{
    const uint32_t rows = (uint32_t)((tiles + COLUMNS - 1) / COLUMNS);
    sheet->path = path;
    return path != NULL ? umbt_picture_init(&sheet->picture, COLUMNS * (view->size[0] + GAP) - GAP,
                                            rows * (view->size[1] + GAP) - GAP, error)
                        : UMB_OK;
}

void umbt_sheet_draw(struct umbt_sheet *sheet, size_t tile, const struct umbt_technique_view *view,
                     const float *values)
{
    const size_t width = view->size[0], height = view->size[1];
    const size_t x0 = tile % COLUMNS * (width + GAP), y0 = tile / COLUMNS * (height + GAP);
    for (size_t pixel = 0; sheet->path != NULL && pixel < width * height; pixel++) {
        const struct umbt_rgb color = pixel_color(view, pixel, values);
        const size_t x = x0 + pixel % width, y = y0 + pixel / width;
        for (size_t c = 0; c < 3; c++) {
            sheet->picture.pixels[3 * (y * sheet->picture.width + x) + c] =
                umbt_srgb8(umbt_shoulder(color.c[c]));
        }
    }
}

enum umb_status umbt_sheet_write(const struct umbt_sheet *sheet, struct umb_error *error)
{
    return sheet->path != NULL ? umbt_picture_write(&sheet->picture, sheet->path, error) : UMB_OK;
}
