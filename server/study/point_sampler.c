/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Query points of a scene; see point_sampler.h.
 *
 * Source: Osada et al. 2002, section 4.1 (uniform points on a triangle); Steele, Lea, Flood 2014
 * (SplitMix64).
 */
#include "study/point_sampler.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/bytes.h"
#include "base/try.h"
#include "study/gbuffer.h"
#include "tool/threads.h"
#include "tool/output.h"
#include "tool/progress.h"
#include "study/study_math.h"

#define ROUND         262144U  /* candidates tried in one round */
#define BLOCK         1024U    /* candidates a thread takes at a time */
#define HOPELESS      1000000U /* candidates after which too few accepted ones end the sampling */
#define HOPELESS_RATE 1000U    /* candidates for each accepted one, at most */
/* Distance off a surface before the inside test, as a share of the diagonal: ten times the ray
 * tracer's float rounding. */
#define CLEARANCE       1e-6
#define SIDE_MAX        16384U    /* pixels of a view */
#define PIXELS_MAX      67108864U /* pixels of a view; 64 Mi, as for a picture */
#define POINT_BYTES_MAX 192U /* longest text of one point: six numbers of at most 25 characters */
#define BUFFER_BYTES    65536U

/* A direction along no axis and no diagonal: few edges of man-made scenes are parallel to it. */
static const double generic_direction[3] = {0.48077173, 0.35128945, 0.80337211};

struct candidate {
    double position[3];
    double normal[3];
    int good;
};

struct sampling {
    const struct umbt_point_request *request;
    double *area_sums; /* [scene->count], of the triangles up to and with each */
    struct candidate *candidates;
    uint64_t first; /* number of candidates[0] */
};

static uint64_t mix(uint64_t z)
{
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
}

/* The next number in [0, 1) of a candidate's own stream. */
static double uniform(uint64_t *state)
{
    *state += 0x9e3779b97f4a7c15U;
    return (double)(mix(*state) >> 11) * 0x1p-53;
}

int umbt_point_is_inside(const struct umbt_scene *scene, const double point[3], const double *away)
{
    if (scene->parts.closed_triangles == 0) {
        return 0;
    }
    const double sign = away != NULL && umb__dot(away, generic_direction) < 0.0 ? -1.0 : 1.0;
    double direction[3];
    for (int k = 0; k < 3; k++) {
        direction[k] = sign * generic_direction[k];
    }
    (void)umbt_normalize(direction);
    int winding = 0, crossings = 0;
    umbr_crossings(scene->rays, point, direction, scene->parts.closed, &winding, &crossings);
    return winding > 0;
}

/* Finds the triangle where the running sum of areas exceeds `at`; its area is never zero. */
static size_t triangle_at(const struct sampling *sampling, double at)
{
    size_t low = 0, high = sampling->request->scene->count - 1;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (sampling->area_sums[middle] > at) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

static int surface_point(const struct sampling *sampling, uint64_t *state, double position[3],
                         double normal[3])
{
    const struct umbt_scene *scene = sampling->request->scene;
    const size_t t = triangle_at(sampling, uniform(state) * sampling->area_sums[scene->count - 1]);
    const double root = sqrt(uniform(state));
    const double share = uniform(state);
    const double(*corners)[3] = (const double(*)[3])scene->corners[t];
    double a[3], b[3];
    umb__subtract(corners[1], corners[0], a);
    umb__subtract(corners[2], corners[0], b);
    umbt_along(corners[0], root * (1.0 - share), a, position);
    umbt_along(position, root * share, b, position);
    umb__cross(a, b, normal);
    return umbt_normalize(normal) > 0.0;
}

static void candidate_make(void *user, size_t index)
{
    const struct sampling *sampling = user;
    const struct umbt_point_request *request = sampling->request;
    const struct umbt_scene *scene = request->scene;
    struct candidate *candidate = &sampling->candidates[index];
    uint64_t state = mix(request->seed + 0x9e3779b97f4a7c15U) ^ mix(sampling->first + index);
    memset(candidate, 0, sizeof *candidate);
    if (request->kind == UMBT_POINT_FREE) {
        for (int k = 0; k < 3; k++) {
            const double size = scene->box.max[k] - scene->box.min[k];
            candidate->position[k] = scene->box.min[k] + uniform(&state) * size;
        }
        candidate->good = !umbt_point_is_inside(scene, candidate->position, NULL);
        return;
    }
    if (!surface_point(sampling, &state, candidate->position, candidate->normal)) {
        return;
    }
    double off[3];
    if (request->kind == UMBT_POINT_NEAR) {
        umbt_along(candidate->position, uniform(&state) * request->reach_m, candidate->normal,
                   candidate->position);
        memcpy(off, candidate->position, sizeof off);
    } else {
        umbt_along(candidate->position, CLEARANCE * scene->diagonal_m, candidate->normal, off);
    }
    candidate->good = !umbt_point_is_inside(scene, off, candidate->normal);
}

static enum umb_status set_init(struct umbt_point_set *set, size_t count, struct umb_error *error)
{
    memset(set, 0, sizeof *set);
    set->positions = calloc(count, sizeof *set->positions);
    set->normals = calloc(count, sizeof *set->normals);
    if (set->positions == NULL || set->normals == NULL) {
        umbt_point_set_finish(set);
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", count);
    }
    return UMB_OK;
}

void umbt_point_set_finish(struct umbt_point_set *set)
{
    free(set->positions);
    free(set->normals);
    memset(set, 0, sizeof *set);
}

static void point_add(struct umbt_point_set *set, const double position[3], const double normal[3])
{
    memcpy(set->positions[set->count], position, sizeof set->positions[0]);
    for (int k = 0; k < 3; k++) {
        set->normals[set->count][k] = (float)normal[k];
    }
    set->count++;
}

static enum umb_status areas_sum(struct sampling *sampling, struct umb_error *error)
{
    const struct umbt_scene *scene = sampling->request->scene;
    sampling->area_sums = calloc(scene->count, sizeof *sampling->area_sums);
    sampling->candidates = calloc(ROUND, sizeof *sampling->candidates);
    if (sampling->area_sums == NULL || sampling->candidates == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "the areas of %zu triangles do not fit in memory",
                        scene->count);
    }
    double sum = 0.0;
    for (size_t i = 0; i < scene->count; i++) {
        double normal[3];
        umb__triangle_cross((const double(*)[3])scene->corners[i], normal);
        sum += umb__length(normal);
        sampling->area_sums[i] = sum;
    }
    if (!(sum > 0.0) || !isfinite(sum)) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: the triangles have no area", scene->path);
    }
    return UMB_OK;
}

/* Tries candidates in rounds until the set is full. A round is the last if fewer than one in
 * HOPELESS_RATE candidates was accepted so far. */
static enum umb_status rounds_run(struct sampling *sampling, struct umbt_point_set *set,
                                  struct umb_error *error)
{
    const struct umbt_point_request *request = sampling->request;
    struct umbu_progress progress;
    enum umb_status status = UMB_OK;
    umbu_progress_begin(&progress, "Mpoints", request->quiet);
    while (status == UMB_OK && set->count < request->count) {
        const size_t missing = request->count - set->count;
        const size_t tried =
            missing + missing / 8 + BLOCK < ROUND ? missing + missing / 8 + BLOCK : ROUND;
        sampling->first = set->candidates;
        status = umbu_range_each(request->threads, tried, BLOCK, candidate_make, sampling, error);
        for (size_t i = 0; i < tried && set->count < request->count; i++) {
            if (sampling->candidates[i].good) {
                point_add(set, sampling->candidates[i].position, sampling->candidates[i].normal);
            }
        }
        set->candidates += tried;
        umbu_progress_show(&progress, 1e-6 * (double)set->count,
                           (double)set->count / (double)request->count);
        if (status == UMB_OK && set->candidates >= HOPELESS && set->count < request->count &&
            set->count < set->candidates / HOPELESS_RATE) {
            status = umb_fail(error, UMB_E_BAD_SCENE,
                              "%s: only %zu of %llu candidates lie outside closed solids; %zu "
                              "points are wanted",
                              request->scene->path, set->count, (unsigned long long)set->candidates,
                              request->count);
        }
    }
    umbu_progress_end(&progress);
    return status;
}

enum umb_status umbt_points_sample(const struct umbt_point_request *request,
                                   struct umbt_point_set *set, struct umb_error *error)
{
    struct sampling sampling = {.request = request};
    UMB__TRY(set_init(set, request->count, error));
    enum umb_status status = areas_sum(&sampling, error);
    if (status == UMB_OK) {
        status = rounds_run(&sampling, set, error);
    }
    free(sampling.area_sums);
    free(sampling.candidates);
    if (status != UMB_OK) {
        umbt_point_set_finish(set);
    }
    return status;
}

/* Takes `count` of the buffer's points, evenly and in order. */
static enum umb_status hits_take(const struct umbt_gbuffer *buffer, size_t count,
                                 struct umbt_point_set *set, struct umb_error *error)
{
    UMB__TRY(set_init(set, count, error));
    for (size_t i = 0; i < count; i++) {
        const size_t at = (size_t)((double)i * ((double)buffer->receiver_count / (double)count));
        memcpy(set->positions[i], buffer->positions[at], sizeof set->positions[i]);
        memcpy(set->normals[i], buffer->normals[at], sizeof set->normals[i]);
    }
    set->count = count;
    return UMB_OK;
}

static enum umb_status view_trace(const struct umbt_pixel_request *view, const uint32_t size[2],
                                  struct umbt_gbuffer *buffer, struct umb_error *error)
{
    struct umbt_camera camera;
    UMB__TRY(umbt_camera_make(view->camera, view->subject, size[0], size[1], &camera, error));
    if (umbt_point_is_inside(view->scene, camera.eye, NULL)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--camera: the eye at %.9g,%.9g,%.9g is inside a closed solid",
                        camera.eye[0], camera.eye[1], camera.eye[2]);
    }
    return umbt_gbuffer_view(buffer, view->scene, &camera, size, view->threads, error);
}

enum umb_status umbt_points_of_pixels(const struct umbt_pixel_request *view,
                                      struct umbt_point_set *set, struct umb_error *error)
{
    uint32_t size[2] = {view->size[0], view->size[1]};
    memset(set, 0, sizeof *set);
    for (;;) { /* ends: each picture has more pixels than the last, up to SIDE_MAX */
        struct umbt_gbuffer buffer = {0};
        enum umb_status status = view_trace(view, size, &buffer, error);
        const size_t hits = buffer.receiver_count;
        const size_t count = view->count > 0 ? view->count : hits;
        if (status == UMB_OK && hits >= count) {
            status = hits_take(&buffer, count, set, error);
            set->candidates = (uint64_t)size[0] * size[1];
            umbt_gbuffer_finish(&buffer);
            return status;
        }
        umbt_gbuffer_finish(&buffer);
        UMB__TRY(status);
        const double grow = sqrt((double)count / (double)hits) * 1.01;
        const double wide = ceil((double)size[0] * grow), tall = ceil((double)size[1] * grow);
        if (wide > SIDE_MAX || tall > SIDE_MAX || wide * tall > PIXELS_MAX) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--camera: %ux%u pixels see only %zu points of the scene; %zu points "
                            "would need a picture above %u pixels a side or %u in all",
                            size[0], size[1], hits, count, SIDE_MAX, PIXELS_MAX);
        }
        size[0] = (uint32_t)wide;
        size[1] = (uint32_t)tall;
    }
}

/* ---- files ---- */

static size_t f32_put(float value, uint8_t *at)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    umb__store32(at, bits);
    return sizeof bits;
}

static size_t number_put(enum umbt_point_file_format format, double value, uint8_t *at)
{
    if (format == UMBT_POINT_FILE_F32) {
        return f32_put((float)value, at);
    }
    umb__store_f64(at, value);
    return sizeof value;
}

/* Writes one point at `at`; returns its bytes, at most POINT_BYTES_MAX. */
static size_t point_put(const struct umbt_point_file *file, const double position[3],
                        const float normal[3], uint8_t *at)
{
    size_t bytes = 0;
    if (file->format == UMBT_POINT_FILE_TEXT) {
        char line[POINT_BYTES_MAX];
        int length =
            snprintf(line, sizeof line, "%.17g %.17g %.17g", position[0], position[1], position[2]);
        if (file->normals && length > 0) {
            length += snprintf(line + length, sizeof line - (size_t)length, " %.9g %.9g %.9g",
                               (double)normal[0], (double)normal[1], (double)normal[2]);
        }
        line[length] = '\n';
        memcpy(at, line, (size_t)length + 1);
        return (size_t)length + 1;
    }
    for (int k = 0; k < 3; k++) {
        bytes += number_put(file->format, position[k], at + bytes);
    }
    for (int k = 0; k < 3 && file->normals; k++) {
        bytes += number_put(file->format, (double)normal[k], at + bytes);
    }
    return bytes;
}

enum umb_status umbt_point_file_write(const struct umbt_point_file *file,
                                      const struct umbt_point_set *set, uint64_t *bytes,
                                      struct umb_error *error)
{
    struct umbu_output out;
    uint8_t buffer[BUFFER_BYTES];
    size_t used = 0;
    *bytes = 0;
    enum umb_status status = UMB_OK;
    UMB__TRY(umbu_output_begin(file->path, UMBU_OUTPUT_COMMAND, &out, error));
    for (size_t i = 0; i < set->count && status == UMB_OK; i++) {
        double position[3];
        for (int k = 0; k < 3; k++) {
            position[k] = set->positions[i][k] - file->origin[k];
        }
        used += point_put(file, position, set->normals[i], buffer + used);
        if (used > sizeof buffer - POINT_BYTES_MAX || i + 1 == set->count) {
            status = umbu_output_write(&out, buffer, used, error);
            *bytes += used;
            used = 0;
        }
    }
    if (status == UMB_OK) {
        return umbu_output_commit(&out, error);
    }
    umbu_output_abandon(&out);
    return status;
}
