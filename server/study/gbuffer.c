/* SPDX-License-Identifier: Apache-2.0 */
/* Visible points; see gbuffer.h. */
#include "study/gbuffer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "tool/threads.h"
#include "study/study_math.h"

struct fill {
    struct umbt_gbuffer *buffer;
    const struct umbt_scene *scene;
    const struct umbt_camera *camera;
    uint32_t height;
    double far_m;
};

enum umb_status umbt_gbuffer_init(struct umbt_gbuffer *buffer, uint32_t width, uint32_t aa,
                                  uint32_t rows, struct umb_error *error)
{
    /* Callers bound width, aa and rows by 16384, 3 and 16384: the product fits into 64 bits. */
    const size_t capacity = (size_t)width * rows * aa * aa;
    memset(buffer, 0, sizeof *buffer);
    buffer->width = width;
    buffer->aa = aa;
    buffer->samples_max = capacity;
    buffer->capacity = capacity;
    buffer->slots = calloc(capacity, sizeof *buffer->slots);
    buffer->positions = calloc(capacity, sizeof *buffer->positions);
    buffer->normals = calloc(capacity, sizeof *buffer->normals);
    buffer->triangles = calloc(capacity, sizeof *buffer->triangles);
    if (buffer->slots == NULL || buffer->positions == NULL || buffer->normals == NULL ||
        buffer->triangles == NULL) {
        umbt_gbuffer_finish(buffer);
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu picture samples do not fit in memory",
                        capacity);
    }
    return UMB_OK;
}

void umbt_gbuffer_finish(struct umbt_gbuffer *buffer)
{
    free(buffer->slots);
    free(buffer->positions);
    free(buffer->normals);
    free(buffer->triangles);
    free(buffer->opacities);
    free(buffer->behind);
    memset(buffer, 0, sizeof *buffer);
}

/* Returns the distance at which a ray meets the triangle's plane. Embree's distance is returned
 * instead if the two differ much, as for a plane seen edge on. */
static double distance_refine(const double corners[3][3], const double normal[3],
                              const double eye[3], const double direction[3], double distance,
                              double tolerance)
{
    double to_corner[3];
    umb__subtract(corners[0], eye, to_corner);
    const double refined = umb__dot(to_corner, normal) / umb__dot(direction, normal);
    return isfinite(refined) && fabs(refined - distance) <= tolerance ? refined : distance;
}

/* Puts the ground at a sub-sample that sees it before `distance`; negative: the ray meets no
 * surface. A surface that lies on the ground hides it. */
static void ground_meet(const struct fill *fill, size_t index, const double direction[3],
                        double distance)
{
    struct umbt_gbuffer *buffer = fill->buffer;
    const struct umbt_ground *ground = &buffer->ground;
    const double *eye = fill->camera->eye;
    const double way = (ground->height - eye[ground->axis]) / direction[ground->axis];
    const double slack = 1e-6 * (fill->far_m + way);
    if (!ground->wanted || !(way > 0.0) || !(way < ground->extent_m) ||
        (distance >= 0.0 && distance <= way + slack)) {
        return;
    }
    umbt_along(eye, way, direction, buffer->positions[index]);
    buffer->positions[index][ground->axis] = ground->height;
    for (int k = 0; k < 3; k++) {
        buffer->normals[index][k] = k != ground->axis                    ? 0.0F
                                    : eye[ground->axis] < ground->height ? -1.0F
                                                                         : 1.0F;
    }
    buffer->triangles[index] = UMBT_GROUND;
}

/* Traces a sub-sample. Until hits_gather the hit is stored at the sub-sample's own index. */
static void sample_trace(void *user, size_t index)
{
    const struct fill *fill = user;
    struct umbt_gbuffer *buffer = fill->buffer;
    const double *eye = fill->camera->eye;
    double direction[3], normal[3], to_eye[3];
    umbt_gbuffer_direction(buffer, fill->camera, fill->height, index, direction);

    struct umbr_hit hit = {.distance = -1.0};
    umbr_nearest(umbt_seen_rays(fill->scene), eye, direction, 0.0, fill->far_m, &hit);
    buffer->triangles[index] = UMBT_SKY;
    ground_meet(fill, index, direction, hit.distance);
    if (!(hit.distance >= 0.0) || hit.triangle >= fill->scene->count ||
        buffer->triangles[index] == UMBT_GROUND) {
        return;
    }
    const double(*corners)[3] = (const double(*)[3])fill->scene->corners[hit.triangle];
    umb__triangle_cross(corners, normal);
    if (!(umbt_normalize(normal) > 0.0)) {
        return;
    }
    const double distance = distance_refine(corners, normal, eye, direction, hit.distance,
                                            1e-5 * (hit.distance + fill->far_m));
    umbt_along(eye, distance, direction, buffer->positions[index]);
    umb__subtract(eye, buffer->positions[index], to_eye);
    const double side = umb__dot(normal, to_eye) < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; k++) {
        buffer->normals[index][k] = (float)(side * normal[k]);
    }
    buffer->triangles[index] = hit.triangle;
}

/* Moves the hits to the start, in order. */
static void hits_gather(struct umbt_gbuffer *buffer, size_t sample_count)
{
    size_t n = 0;
    for (size_t i = 0; i < sample_count; i++) {
        buffer->slots[i] = UMBT_SKY;
        if (buffer->triangles[i] != UMBT_SKY) {
            memmove(buffer->positions[n], buffer->positions[i], sizeof buffer->positions[n]);
            memmove(buffer->normals[n], buffer->normals[i], sizeof buffer->normals[n]);
            buffer->triangles[n] = buffer->triangles[i];
            buffer->slots[i] = (uint32_t)n++;
        }
    }
    buffer->receiver_count = n;
    buffer->seen_count = n;
    buffer->first_layer = n;
}

enum umb_status umbt_gbuffer_fill(struct umbt_gbuffer *buffer, const struct umbt_scene *scene,
                                  const struct umbt_camera *camera, uint32_t height,
                                  uint32_t first_row, uint32_t row_count, unsigned threads,
                                  struct umb_error *error)
{
    double to_centre[3];
    for (int k = 0; k < 3; k++) {
        to_centre[k] = 0.5 * (scene->box.min[k] + scene->box.max[k]) - camera->eye[k];
    }
    struct fill fill = {
        .buffer = buffer,
        .scene = scene,
        .camera = camera,
        .height = height,
        .far_m = umb__length(to_centre) + scene->diagonal_m,
    };
    const size_t count = (size_t)buffer->width * row_count * buffer->aa * buffer->aa;
    buffer->first_row = first_row;
    buffer->row_count = row_count;
    const enum umb_status status =
        umbu_range_each(threads, count, 4096, sample_trace, &fill, error);
    if (status != UMB_OK) {
        return status;
    }
    hits_gather(buffer, count);
    return umbt_gbuffer_add_layers(buffer, scene, camera, height, fill.far_m, threads, error);
}

enum umb_status umbt_gbuffer_view(struct umbt_gbuffer *buffer, const struct umbt_scene *scene,
                                  const struct umbt_camera *camera, const uint32_t size[2],
                                  unsigned threads, struct umb_error *error)
{
    UMB__TRY(umbt_gbuffer_init(buffer, size[0], 1, size[1], error));
    UMB__TRY(umbt_gbuffer_fill(buffer, scene, camera, size[1], 0, size[1], threads, error));
    return buffer->receiver_count > 0
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "--camera: no pixel of %ux%u sees the scene",
                          size[0], size[1]);
}
