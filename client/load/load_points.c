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

static enum umb_status fill_trace(const struct umbc_load_source *source,
                                  struct umbc_load_pool *pool, struct umb_error *error)
{
    struct umbc_point_list trace;
    UMB__TRY(umbc_points_load(source->trace, source->format, source->with_normals, TRACE_POINTS,
                              &trace, error));
    enum umb_status status = UMB_OK;
    if (trace.count == 0) {
        status = umb_fail(error, UMB_E_FORMAT, "'%.200s' has no points", source->trace);
    } else {
        pool->batch_count = (trace.count + pool->batch - 1) / pool->batch;
        status = make_room(pool, trace.normals != NULL, error);
    }
    for (size_t i = 0; status == UMB_OK && i < 3 * pool->batch * pool->batch_count; i++) {
        const size_t from = i % (3 * trace.count);
        pool->positions[i] = (float)(trace.positions[from] - pool->origin[i % 3]);
        if (trace.normals != NULL) {
            pool->normals[i] = trace.normals[from];
        }
    }
    umbc_point_list_finish(&trace);
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
