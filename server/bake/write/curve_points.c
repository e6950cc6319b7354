/* SPDX-License-Identifier: Apache-2.0 */
/* See curve_points.h. */
#include "bake/write/curve_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/depth/tile.h"
#include "bake/base/interrupt.h"
#include "base/try.h"
#include "base/vec.h"
#include "tool/threads.h"

/* Number of points. About half of the points face away from a light and do not count. The other
 * 2000 give the mean of an event of 1 % probability to a fifth of this mean. */
#define POINTS     4096U
#define POINTS_MIN 128U
/* Points of all lights together, if that leaves enough for each. */
#define POINTS_ALL (16U * POINTS)

struct drawn {
    double (*positions)[3]; /* [count] world */
    float (*outward)[3]; /* [count] unit normals of the winding, turned outward for closed parts */
    uint8_t *open;       /* [count] 1: not in a part baked as closed: lit from both sides */
    float (*normals)[3]; /* [count] normals for one light */
    uint32_t count;
};

/* Two numbers in [0, 1) for point k (splitmix64, Steele et al. 2014). */
static void units(uint64_t k, double out[2])
{
    for (int i = 0; i < 2; i++) {
        uint64_t bits = (2 * k + (uint64_t)i + 1) * UINT64_C(0x9e3779b97f4a7c15);
        bits = (bits ^ bits >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
        bits = (bits ^ bits >> 27) * UINT64_C(0x94d049bb133111eb);
        out[i] = (double)((bits ^ bits >> 31) >> 11) * 0x1p-53;
    }
}

/* Adds a point of triangle t. */
static void add_point(const struct umbb_analysis *analysis, size_t t, const double normal[3],
                      double length, struct drawn *drawn)
{
    const double(*c)[3] = (const double(*)[3])analysis->corners[t];
    const uint32_t k = drawn->count++;
    const double turn = analysis->kinds[t] == UMBB_CASTER_CLOSED_FLIPPED ? -1.0 : 1.0;
    double u[2];
    units(k, u);
    const double root = sqrt(u[0]), a = 1.0 - root, b = root * u[1];
    for (int i = 0; i < 3; i++) {
        drawn->positions[k][i] =
            c[0][i] + b * (c[1][i] - c[0][i]) + (1.0 - a - b) * (c[2][i] - c[0][i]);
        drawn->outward[k][i] = (float)(turn * normal[i] / length);
    }
    drawn->open[k] = !analysis->closed_rule || analysis->kinds[t] == UMBB_CASTER_OPEN;
}

/* Draws `wanted` points in the middle of equal shares of the surface's area. */
static void draw(const struct umbb_analysis *analysis, uint32_t wanted, struct drawn *drawn)
{
    double total = 0, before = 0, normal[3];
    for (size_t t = 0; t < analysis->count; t++) {
        umb__triangle_cross((const double(*)[3])analysis->corners[t], normal);
        total += umb__length(normal);
    }
    for (size_t t = 0; t < analysis->count && drawn->count < wanted; t++) {
        umb__triangle_cross((const double(*)[3])analysis->corners[t], normal);
        const double length = umb__length(normal);
        before += length;
        while (length > 0 && drawn->count < wanted &&
               (drawn->count + 0.5) * (total / wanted) < before) {
            add_point(analysis, t, normal, length, drawn);
        }
    }
}

/* Turns the normals of open parts to a light. */
static void face_light(const struct umb_light_info *light, struct drawn *drawn)
{
    for (uint32_t i = 0; i < drawn->count; i++) {
        double facing = 0;
        for (int k = 0; k < 3; k++) {
            const double ray = light->kind == UMB_LIGHT_DIRECTIONAL
                                   ? light->direction[k]
                                   : drawn->positions[i][k] - light->position[k];
            facing += ray * (double)drawn->outward[i][k];
        }
        const float turn = drawn->open[i] && facing > 0 ? -1.0F : 1.0F;
        for (int k = 0; k < 3; k++) {
            drawn->normals[i][k] = turn * drawn->outward[i][k];
        }
    }
}

static enum umb_status measure_lights(const struct umb__octree *octree, struct drawn *drawn,
                                      const struct umb_workers *workers,
                                      struct umb__content *content, struct umb_error *error)
{
    for (uint32_t light = 0; light < content->light_count; light++) {
        uint32_t rows;
        face_light(&content->lights[light], drawn);
        const struct umb_points points = {.positions = drawn->positions,
                                          .format = UMB_POINT_F64,
                                          .normals = drawn->normals,
                                          .count = drawn->count};
        UMB__TRY(umb__curve_measure(content, octree, light, &points, workers,
                                    content->curve + content->curve_count, &rows, error));
        content->curve_count += rows;
        if (umbb_interrupted()) {
            return umb_fail(error, UMB_E_CANCELLED, "interrupted: nothing was written");
        }
    }
    return UMB_OK;
}

/* Measures the curve with helpers. */
static enum umb_status measure(const struct umb__octree *octree, struct drawn *drawn,
                               unsigned threads, struct umb__content *content,
                               struct umb_error *error)
{
    struct umbu_threads *pool;
    UMB__TRY(umbu_threads_create(threads, &pool, error));
    const struct umb_workers workers = umbu_threads_workers(pool);
    const enum umb_status status = measure_lights(octree, drawn, &workers, content, error);
    umbu_threads_destroy(pool);
    return status;
}

static uint32_t points_a_light(uint32_t lights)
{
    const uint32_t share = POINTS_ALL / lights;
    return share > POINTS ? POINTS : share < POINTS_MIN ? POINTS_MIN : share;
}

enum umb_status umbb_curve_add(const struct umbb_analysis *analysis,
                               const struct umb__octree *octree, unsigned threads,
                               struct umb__content *content, struct umb_error *error)
{
    const uint32_t wanted = points_a_light(content->light_count);
    struct drawn drawn = {
        .positions = calloc(wanted, sizeof *drawn.positions),
        .outward = calloc(wanted, sizeof *drawn.outward),
        .open = calloc(wanted, 1),
        .normals = calloc(wanted, sizeof *drawn.normals),
    };
    enum umb_status status;
    content->curve =
        calloc((size_t)content->light_count * UMB_CURVE_ROWS_MAX, sizeof *content->curve);
    content->curve_count = 0;
    if (drawn.positions && drawn.outward && drawn.open && drawn.normals && content->curve) {
        draw(analysis, wanted, &drawn);
        status = measure(octree, &drawn, threads, content, error);
    } else {
        status = umb_fail(error, UMB_E_NO_MEMORY, "accuracy curve: memory for %u points refused",
                          wanted);
    }
    free(drawn.positions);
    free(drawn.outward);
    free(drawn.open);
    free(drawn.normals);
    if (status != UMB_OK) {
        free(content->curve);
        content->curve = NULL;
        content->curve_count = 0;
    }
    return status;
}
