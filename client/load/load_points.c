/* SPDX-License-Identifier: Apache-2.0 */
/* The points of a load test, see load_points.h. */
#include "load/load_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "tool/tool_try.h"

#define POOL_POINTS  ((size_t)1 << 18)
#define POOL_BATCHES 16
#define TRACE_POINTS ((size_t)1 << 26)
#define PI           3.14159265358979323846
#define HALVINGS     14
#define BLOCK        16384U /* segments at a time, and points in a call */
#define BLOCKS       8      /* most blocks of segments */

/* Returns the next random number of a state. Source: Steele, Lea, Flood, "Fast splittable
 * pseudorandom number generators", 2014. */
static uint64_t next_random(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15U;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
}

/* Next random number, uniform in [low, high). */
static double random_within(uint64_t *state, double low, double high)
{
    double share = (double)(next_random(state) >> 11) * 0x1p-53;
    return low * (1 - share) + high * share;
}

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
 * Draws one camera frame. The eye is on an ellipse over the bounds, at the share `turn` (0..1) of
 * its length, and looks along the ellipse, 35 degrees down. Each pixel gives the point where its
 * ray meets the plane; a ray above the horizon ends at the border of the bounds.
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
            double at = random_within(&seed, bounds->min[axis], bounds->max[axis]);
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

/* --- points at shadow boundaries --- */

/* Segments whose first end is lit and whose second is not. */
struct hunt {
    struct umb_client *client;
    const struct umbc_load_source *source;
    const struct umbc_load_pool *pool;
    float *lit, *dark, *middle; /* [3 * BLOCK], relative to the pool's origin */
    uint8_t *of_lit, *of_dark;  /* [BLOCK] answers */
};

static enum umb_status ask(const struct hunt *hunt, const float *positions, uint8_t *answers,
                           struct umb_error *error)
{
    struct umb_client_query_request request = {
        .asset = hunt->source->asset,
        .settings = {.light = hunt->source->light,
                     .taps = 1,
                     .bias_mode = UMB_BIAS_NONE,
                     .format = UMB_ANSWER_U8},
        .points = {.positions = positions, .format = UMB_POINT_F32, .count = BLOCK},
    };
    memcpy(request.points.origin, hunt->pool->origin, sizeof request.points.origin);
    return umb_client_query(hunt->client, &request, answers, NULL, error);
}

static void draw(const struct hunt *hunt, const struct umb_box *bounds, uint64_t *seed, float *to)
{
    for (size_t i = 0; i < 3 * (size_t)BLOCK; i++) {
        size_t axis = i % 3;
        double at = random_within(seed, bounds->min[axis], bounds->max[axis]);
        to[i] = (float)(at - hunt->pool->origin[axis]);
    }
}

static void swap_point(float *a, float *b)
{
    float kept[3];
    memcpy(kept, a, sizeof kept);
    memcpy(a, b, sizeof kept);
    memcpy(b, kept, sizeof kept);
}

/* Keeps the segments that cross a shadow boundary, lit end first. Returns their number. */
static size_t keep_crossing(const struct hunt *hunt)
{
    size_t kept = 0;
    for (size_t i = 0; i < BLOCK; i++) {
        bool first = hunt->of_lit[i] > 127;
        bool second = hunt->of_dark[i] > 127;
        if (first == second) {
            continue;
        }
        if (second) {
            swap_point(hunt->lit + 3 * i, hunt->dark + 3 * i);
        }
        memmove(hunt->lit + 3 * kept, hunt->lit + 3 * i, 3 * sizeof(float));
        memmove(hunt->dark + 3 * kept, hunt->dark + 3 * i, 3 * sizeof(float));
        kept++;
    }
    return kept;
}

static enum umb_status halve(const struct hunt *hunt, size_t count, struct umb_error *error)
{
    for (int round = 0; round < HALVINGS; round++) {
        for (size_t i = 0; i < 3 * count; i++) {
            hunt->middle[i] = 0.5F * hunt->lit[i] + 0.5F * hunt->dark[i];
        }
        UMB__TRY(ask(hunt, hunt->middle, hunt->of_lit, error));
        for (size_t i = 0; i < count; i++) {
            float *end = hunt->of_lit[i] > 127 ? hunt->lit : hunt->dark;
            memcpy(end + 3 * i, hunt->middle + 3 * i, 3 * sizeof(float));
        }
    }
    return UMB_OK;
}

/* Fills the pool. Out: found: number of different points. */
static enum umb_status fill(const struct hunt *hunt, const struct umb_box *bounds, float *positions,
                            size_t *found, struct umb_error *error)
{
    size_t wanted = hunt->pool->batch * hunt->pool->batch_count;
    uint64_t seed = hunt->source->seed;
    *found = 0;
    for (int block = 0; block < BLOCKS && *found < wanted; block++) {
        draw(hunt, bounds, &seed, hunt->lit);
        draw(hunt, bounds, &seed, hunt->dark);
        UMB__TRY(ask(hunt, hunt->lit, hunt->of_lit, error));
        UMB__TRY(ask(hunt, hunt->dark, hunt->of_dark, error));
        const size_t count = keep_crossing(hunt);
        UMB__TRY(halve(hunt, count, error));
        size_t taken = count < wanted - *found ? count : wanted - *found;
        memcpy(positions + 3 * *found, hunt->lit, 3 * taken * sizeof(float));
        *found += taken;
    }
    return *found * 1000 < (size_t)BLOCK * BLOCKS && *found < wanted
               ? umb_fail(error, UMB_E_NOT_FOUND,
                          "boundary: only %zu of %u random segments cross a shadow boundary; use "
                          "--points random",
                          *found, BLOCK * BLOCKS)
               : UMB_OK;
}

/*
 * Replaces a pool of random points by points at shadow boundaries.
 *
 * Each point comes from a segment between a lit and a shadowed random point, which is halved 14
 * times. Its distance from the boundary is at most 1/16384 of the bounds' size. Segments that cross
 * no boundary are drawn anew, a few times. Fails: as the service; E_NOT_FOUND (fewer than one
 * segment in a thousand crosses a boundary).
 */
static enum umb_status find_boundaries(struct umb_client *client,
                                       const struct umbc_load_source *source,
                                       const struct umb_box *bounds, struct umbc_load_pool *pool,
                                       struct umb_error *error)
{
    size_t found = 0;
    struct hunt hunt = {.client = client, .source = source, .pool = pool};
    hunt.lit = calloc(9 * (size_t)BLOCK, sizeof *hunt.lit);
    hunt.of_lit = calloc(2 * (size_t)BLOCK, 1);
    enum umb_status status = UMB_E_NO_MEMORY;
    if (hunt.lit != NULL && hunt.of_lit != NULL) {
        hunt.dark = hunt.lit + 3 * (size_t)BLOCK;
        hunt.middle = hunt.dark + 3 * (size_t)BLOCK;
        hunt.of_dark = hunt.of_lit + BLOCK;
        status = fill(&hunt, bounds, pool->positions, &found, error);
    } else {
        (void)umb_fail(error, status, "out of memory for the borders of shadows");
    }
    /* Repeats the points if there are fewer than wanted. */
    for (size_t i = found; status == UMB_OK && i < pool->batch * pool->batch_count; i++) {
        memcpy(pool->positions + 3 * i, pool->positions + 3 * (i - found), 3 * sizeof(float));
    }
    free(hunt.lit);
    free(hunt.of_lit);
    return status;
}

/* --- all kinds --- */

static enum umb_status fill_trace(const struct umbc_load_source *source,
                                  struct umbc_load_pool *pool, struct umb_error *error)
{
    struct umbc_batch trace;
    UMB__TRY(umbc_points_load(source->trace, source->format, source->with_normals, TRACE_POINTS,
                              &trace, error));
    enum umb_status status = UMB_OK;
    if (trace.count == 0) {
        status = umb_fail(error, UMB_E_FORMAT, "'%.200s' has no points", source->trace);
    } else {
        pool->batch_count = (trace.count + pool->batch - 1) / pool->batch;
        status = make_room(pool, trace.has_normals, error);
    }
    for (size_t i = 0; status == UMB_OK && i < 3 * pool->batch * pool->batch_count; i++) {
        const size_t from = i % (3 * trace.count);
        pool->positions[i] = (float)(trace.wide[from] - pool->origin[i % 3]);
        if (trace.has_normals) {
            pool->normals[i] = trace.normals[from];
        }
    }
    umbc_batch_finish(&trace);
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
        status = find_boundaries(client, source, bounds, pool, error);
        if (status != UMB_OK) {
            umbc_load_pool_finish(pool);
        }
    }
    return status;
}
