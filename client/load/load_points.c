/* SPDX-License-Identifier: Apache-2.0 */
/* The points of a load test, see load_points.h. */
#include "load/load_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "load/load_boundary.h"
#include "load/load_random.h"
#include "tool/tool_try.h"

#define POOL_POINTS  ((size_t)1 << 18)
#define POOL_BATCHES 16
#define TRACE_POINTS ((size_t)1 << 26)
#define TRACE_BATCH  65536
#define PI           3.14159265358979323846

struct umb_points umbc_load_pool_batch(const struct umbc_load_pool *pool, uint64_t index)
{
    size_t first = 3 * pool->batch * (size_t)(index % pool->batch_count);
    struct umb_points points = {
        .positions = pool->positions + first,
        .format = UMB_POINT_F32,
        .normals = pool->normals != NULL ? pool->normals + first : NULL,
        .count = pool->batch,
    };
    memcpy(points.origin, pool->origin, sizeof points.origin);
    return points;
}

void umbc_load_pool_finish(struct umbc_load_pool *pool)
{
    free(pool->positions);
    free(pool->normals);
    memset(pool, 0, sizeof *pool);
}

/* Axes of a view; the bounds are shortest along `up`. */
struct axes {
    int up, across, along;
};

static struct axes find_axes(const struct umb_box *bounds)
{
    struct axes axes = {.up = 2};
    for (int axis = 1; axis >= 0; axis--) {
        if (bounds->max[axis] - bounds->min[axis] < bounds->max[axes.up] - bounds->min[axes.up]) {
            axes.up = axis;
        }
    }
    axes.across = (axes.up + 1) % 3;
    axes.along = (axes.up + 2) % 3;
    return axes;
}

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/*
 * Draws one frame. The eye stands at `turn` (0..1) of an ellipse over the bounds and looks along
 * it, 35 degrees down. Each pixel gives the point where its ray meets the plane; a ray above the
 * horizon ends at the border of the bounds.
 */
static void draw_frame(const struct umb_box *bounds, const struct axes *axes, double turn,
                       const double origin[3], size_t count, float *positions)
{
    double size[3];
    for (int axis = 0; axis < 3; axis++) {
        size[axis] = bounds->max[axis] - bounds->min[axis];
    }
    double angle = 2 * PI * turn;
    double reach = 0.5 * hypot(size[axes->across], size[axes->along]);
    double eye[2] = {origin[axes->across] + 0.35 * size[axes->across] * cos(angle),
                     origin[axes->along] + 0.35 * size[axes->along] * sin(angle)};
    double ahead[2] = {-sin(angle), cos(angle)};
    double plane = bounds->min[axes->up] + 0.1 * size[axes->up];
    double height = 0.9 * size[axes->up] + 0.15 * reach;
    size_t width = (size_t)ceil(sqrt((double)count * 16 / 9));
    size_t rows = (count + width - 1) / width;
    for (size_t i = 0; i < count; i++) {
        double across = (((double)(i % width) + 0.5) / (double)width - 0.5) * 1.6;
        double down = 0.7 + (((double)(i / width) + 0.5) / (double)rows - 0.5) * 0.9;
        double distance = clamp(height / (down > 0.05 ? down : 0.05), 0, 4 * reach);
        double at[3];
        at[axes->across] = eye[0] + distance * (ahead[0] + across * ahead[1]);
        at[axes->along] = eye[1] + distance * (ahead[1] - across * ahead[0]);
        at[axes->up] = plane;
        for (int axis = 0; axis < 3; axis++) {
            positions[3 * i + (size_t)axis] =
                (float)(clamp(at[axis], bounds->min[axis], bounds->max[axis]) - origin[axis]);
        }
    }
}

static void fill_camera(const struct umb_box *bounds, struct umbc_load_pool *pool)
{
    const struct axes axes = find_axes(bounds);
    for (size_t frame = 0; frame < pool->batch_count; frame++) {
        draw_frame(bounds, &axes, (double)frame / (double)pool->batch_count, pool->origin,
                   pool->batch, pool->positions + 3 * pool->batch * frame);
    }
}

static void fill_random(const struct umb_box *bounds, uint64_t seed, struct umbc_load_pool *pool)
{
    for (size_t i = 0; i < pool->batch * pool->batch_count; i++) {
        for (size_t axis = 0; axis < 3; axis++) {
            double at = umbc_random_within(&seed, bounds->min[axis], bounds->max[axis]);
            pool->positions[3 * i + axis] = (float)(at - pool->origin[axis]);
        }
    }
}

static enum umb_status make_room(struct umbc_load_pool *pool, bool with_normals,
                                 struct umb_error *error)
{
    size_t count = pool->batch * pool->batch_count;
    pool->positions = calloc(count, 3 * sizeof *pool->positions);
    pool->normals = with_normals ? calloc(count, 3 * sizeof *pool->normals) : NULL;
    if (pool->positions == NULL || (with_normals && pool->normals == NULL)) {
        umbc_load_pool_finish(pool);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu points", count);
    }
    return UMB_OK;
}

/* A trace that is being read; grows by doubling. */
struct trace {
    float *positions, *normals;
    size_t count, capacity;
    bool has_normals;
};

static enum umb_status grow(struct trace *trace, size_t more, struct umb_error *error)
{
    if (trace->count + more <= trace->capacity) {
        return UMB_OK;
    }
    size_t capacity = 2 * (trace->count + more);
    float *positions = realloc(trace->positions, capacity * 3 * sizeof *positions);
    trace->positions = positions != NULL ? positions : trace->positions;
    float *normals = realloc(trace->normals, capacity * 3 * sizeof *normals);
    trace->normals = normals != NULL ? normals : trace->normals;
    if (positions == NULL || normals == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the trace");
    }
    trace->capacity = capacity;
    return UMB_OK;
}

static void append(struct trace *trace, const struct umbc_batch *batch, const double origin[3])
{
    for (size_t i = 0; i < 3 * batch->count; i++) {
        double value = batch->narrow != NULL ? (double)batch->narrow[i] : batch->wide[i];
        trace->positions[3 * trace->count + i] = (float)(value - origin[i % 3]);
        trace->normals[3 * trace->count + i] = batch->has_normals ? batch->normals[i] : 0;
    }
    trace->count += batch->count;
    trace->has_normals |= batch->has_normals;
}

static enum umb_status read_trace(const struct umbc_load_source *source, const double origin[3],
                                  struct trace *trace, struct umb_error *error)
{
    struct umbc_batch batch;
    struct umbc_points *points = calloc(1, sizeof *points);
    if (points == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the trace");
    }
    batch = (struct umbc_batch){0};
    enum umb_status status =
        umbc_points_open(source->trace, source->format, source->with_normals, points, error);
    if (status == UMB_OK) {
        status = umbc_batch_init(&batch, TRACE_BATCH, source->format, error);
    }
    while (status == UMB_OK && trace->count < TRACE_POINTS) {
        status = umbc_points_read(points, &batch, error);
        if (status != UMB_OK || batch.count == 0) {
            break;
        }
        status = grow(trace, batch.count, error);
        if (status == UMB_OK) {
            append(trace, &batch, origin);
        }
    }
    umbc_batch_finish(&batch);
    umbc_points_close(points);
    free(points);
    return status == UMB_OK && trace->count == 0
               ? umb_fail(error, UMB_E_FORMAT, "'%.200s' has no points", source->trace)
               : status;
}

static enum umb_status fill_trace(const struct umbc_load_source *source,
                                  struct umbc_load_pool *pool, struct umb_error *error)
{
    struct trace trace = {.count = 0};
    enum umb_status status = read_trace(source, pool->origin, &trace, error);
    if (status == UMB_OK) {
        pool->batch_count = (trace.count + pool->batch - 1) / pool->batch;
        status = make_room(pool, trace.has_normals, error);
    }
    for (size_t i = 0; status == UMB_OK && i < pool->batch * pool->batch_count; i++) {
        size_t from = i % trace.count;
        memcpy(pool->positions + 3 * i, trace.positions + 3 * from, 3 * sizeof(float));
        if (trace.has_normals) {
            memcpy(pool->normals + 3 * i, trace.normals + 3 * from, 3 * sizeof(float));
        }
    }
    free(trace.positions);
    free(trace.normals);
    return status;
}

enum umb_status umbc_load_pool_make(const struct umbc_load_source *source,
                                    const struct umb_box *bounds, struct umb_client *client,
                                    struct umbc_load_pool *pool, struct umb_error *error)
{
    memset(pool, 0, sizeof *pool);
    pool->batch = source->batch;
    pool->batch_count = (POOL_POINTS + source->batch - 1) / source->batch;
    pool->batch_count = pool->batch_count < POOL_BATCHES ? POOL_BATCHES : pool->batch_count;
    for (int axis = 0; axis < 3; axis++) {
        if (!(isfinite(bounds->min[axis]) && isfinite(bounds->max[axis]) &&
              bounds->min[axis] <= bounds->max[axis])) {
            return umb_fail(error, UMB_E_PROTOCOL, "the daemon sent invalid bounds");
        }
        pool->origin[axis] = 0.5 * bounds->min[axis] + 0.5 * bounds->max[axis];
    }
    if (source->kind == UMBC_LOAD_TRACE) {
        return fill_trace(source, pool, error);
    }
    enum umb_status status = UMB_OK;
    UMB__TRY(make_room(pool, false, error));
    if (source->kind == UMBC_LOAD_CAMERA) {
        fill_camera(bounds, pool);
    } else {
        fill_random(bounds, source->seed, pool);
    }
    if (source->kind == UMBC_LOAD_BOUNDARY) {
        status = umbc_load_find_boundaries(client, source, bounds, pool, error);
        if (status != UMB_OK) {
            umbc_load_pool_finish(pool);
        }
    }
    return status;
}
