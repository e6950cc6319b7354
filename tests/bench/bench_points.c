/* SPDX-License-Identifier: Apache-2.0 */
/* The points of the query rows; see bench_points.h. */
#include "bench_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "bench_report.h"
#include "study/gbuffer.h"
#include "tool/threads.h"
#include "study/point_sampler.h"
#include "study/study_math.h"

#define PACKET_WIDE   4U
#define PACKET_TALL   2U
#define RANDOM_VOXELS 4.0
#define FACING_SPARE  4U /* candidates a point: at least one in four faces the sun */
#define SEED          7U
#define SLACK         (65.0 / 64.0) /* as the product's automatic bias */
#define EYE_FOV_DEG   50.0

const int bench_taps[3] = {1, 9, 17};

/* Where a camera is in a scene, and where it looks. */
struct stand {
    const char *scene;
    double x, y, above_ground; /* metres */
    double azimuth_deg, elevation_deg;
};

static const struct stand stands[] = {
    {"city", 40.5, -27.0, 1.7, 255.0, 0.0},
    {"terrain", 0.0, 0.0, 30.0, 310.0, -8.0},
};

/* Returns the metres along a unit normal by which the automatic bias moves a point (query.h,
 * UMB_BIAS_AUTO). */
static double bias_m(const struct bench_scene *scene, const double normal[3], int taps)
{
    const double(*step)[3] = scene->frustum.voxel_step;
    return 0.5 * SLACK *
           ((double)taps * (fabs(umb__dot(normal, step[0])) + fabs(umb__dot(normal, step[1]))) +
            fabs(umb__dot(normal, step[2])));
}

static void point_put(const struct bench_scene *scene, const double position[3], float *to)
{
    for (int k = 0; k < 3; k++) {
        to[k] = (float)(position[k] - scene->origin[k]);
    }
}

static float *array_make(size_t capacity)
{
    float *array = calloc(capacity, 3 * sizeof *array);
    if (array == NULL) {
        bench_fail("%zu points: out of memory", capacity);
    }
    return array;
}

static void arrays_make(struct bench_points *points, size_t capacity)
{
    for (int t = 0; t < 3; t++) {
        points->at[t] = array_make(capacity);
    }
    points->surface = array_make(capacity);
    points->normals = array_make(capacity);
}

void bench_points_finish(struct bench_points *points)
{
    for (int t = 0; t < 3; t++) {
        free(points->at[t]);
    }
    free(points->surface);
    free(points->normals);
    memset(points, 0, sizeof *points);
}

/* Adds a surface point, moved by `more_m` and the bias. Does not add a point that faces away from
 * the sun: its normal alone decides that it is shadowed, without a look-up. */
static void surface_take(const struct bench_scene *scene, const double position[3],
                         const float raw_normal[3], double more_m, struct bench_points *points)
{
    double normal[3];
    for (int k = 0; k < 3; k++) {
        normal[k] = (double)raw_normal[k];
    }
    if (umb__dot(normal, scene->light.direction) >= 0.0) {
        return;
    }
    for (int t = 0; t < 3; t++) {
        double moved[3];
        umbt_along(position, bias_m(scene, normal, bench_taps[t]) + more_m, normal, moved);
        point_put(scene, moved, &points->at[t][3 * points->count]);
    }
    double before[3];
    umbt_along(position, more_m, normal, before);
    point_put(scene, before, &points->surface[3 * points->count]);
    memcpy(&points->normals[3 * points->count], raw_normal, 3 * sizeof(float));
    points->count++;
}

/* Places a camera at eye height above the highest ground under the scene's viewpoint. */
static void stand_take(const struct bench_scene *scene, struct umbt_camera_request *request)
{
    const struct stand *stand = stands;
    while (strcmp(stand->scene, scene->name) != 0) {
        stand++;
    }
    const double above[3] = {stand->x, stand->y, scene->study.box.max[2] + 1.0};
    const double down[3] = {0.0, 0.0, -1.0};
    double look[3];
    struct umbr_hit ground;
    umbr_nearest(scene->study.rays, above, down, 0.0, INFINITY, &ground);
    umbt_along(above, ground.distance - stand->above_ground, down, request->eye);
    umbt_compass_vector(stand->azimuth_deg, stand->elevation_deg, 1, look);
    umbt_along(request->eye, 1.0, look, request->target);
    request->has_eye = 1;
    request->has_target = 1;
    request->fov_deg = EYE_FOV_DEG;
}

static void camera_make(const struct bench_scene *scene, enum bench_view view, uint32_t width,
                        uint32_t height, struct umbt_camera *camera)
{
    struct umb_error error;
    struct umbt_camera_request request = {0};
    struct umbt_camera_subject subject = {
        .points = (const double(*)[3])scene->study.corners,
        .count = 3 * scene->study.count,
        .box = scene->study.box,
        .z_up = 1,
    };
    for (int k = 0; k < 3; k++) {
        subject.to_light[k] = -scene->light.direction[k];
    }
    if (view == BENCH_VIEW_INSIDE) {
        stand_take(scene, &request);
    }
    bench_must(umbt_camera_make(&request, &subject, width, height, camera, &error), &error,
               "camera");
}

void bench_points_gbuffer(const struct bench_scene *scene, enum bench_view view,
                          struct bench_points *points)
{
    const int inside = view == BENCH_VIEW_INSIDE;
    const uint32_t width = inside ? 1920 : 1280, height = inside ? 1080 : 720;
    struct umbt_camera camera;
    struct umbt_gbuffer buffer;
    struct umb_error error;
    camera_make(scene, view, width, height, &camera);
    bench_must(umbt_gbuffer_init(&buffer, width, 1, height, &error), &error, "gbuffer");
    bench_must(umbt_gbuffer_fill(&buffer, &scene->study, &camera, height, 0, height,
                                 umbu_processor_count(), &error),
               &error, "gbuffer");
    *points =
        (struct bench_points){.name = inside ? "gbuffer" : "gbuffer-overview", .camera = camera};
    arrays_make(points, buffer.receiver_count);
    for (uint32_t i = 0; i < width * height; i++) {
        const uint32_t packet = i / (PACKET_WIDE * PACKET_TALL);
        const uint32_t across = width / PACKET_WIDE;
        const uint32_t x = packet % across * PACKET_WIDE + i % PACKET_WIDE;
        const uint32_t y = packet / across * PACKET_TALL + i / PACKET_WIDE % PACKET_TALL;
        const uint32_t slot = buffer.slots[y * width + x];
        if (slot != UMBT_SKY) {
            surface_take(scene, buffer.positions[slot], buffer.normals[slot], 0.0, points);
        }
    }
    umbt_gbuffer_finish(&buffer);
    bench_say("%s %s: %zu points", scene->name, points->name, points->count);
}

void bench_points_random(const struct bench_scene *scene, size_t count, struct bench_points *points)
{
    struct umbt_point_set set;
    struct umb_error error;
    struct gen_rng rng = {SEED};
    const double(*step)[3] = scene->frustum.voxel_step;
    const double voxel_m =
        (umb__length(step[0]) + umb__length(step[1]) + umb__length(step[2])) / 3.0;
    const struct umbt_point_request request = {
        .scene = &scene->study,
        .kind = UMBT_POINT_SURFACE,
        .count = FACING_SPARE * count,
        .seed = SEED,
        .threads = umbu_processor_count(),
        .quiet = 1,
    };
    bench_must(umbt_points_sample(&request, &set, &error), &error, "points");
    *points = (struct bench_points){.name = "random"};
    arrays_make(points, count);
    for (size_t i = 0; i < set.count && points->count < count; i++) {
        const double voxels = RANDOM_VOXELS * gen_range(&rng, 0, 1 << 20) / (double)(1 << 20);
        surface_take(scene, set.positions[i], set.normals[i], voxels * voxel_m, points);
    }
    umbt_point_set_finish(&set);
    bench_say("%s random: %zu points", scene->name, points->count);
}
