/* SPDX-License-Identifier: Apache-2.0 */
/* See verify_bounds.h. */
#include "study/verify_bounds.h"

#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include "base/try.h"
#include "rays/verify_light_frame.h"
#include "study/point_sampler.h"
#include "study/study_math.h"
#include "tool/threads.h"
#include "umbrage/curve.h"

enum {
    BLOCK = 256,
    PLACES_FIRST = 48,     /* random places to try before the voxels' centres */
    PLACES_LAST = 1 << 17, /* random places to try after the voxels' centres: pockets are narrow */
    CENTRES_MAX = 1 << 18, /* most voxel centres of a coarse cell to try */
};

struct result {
    uint64_t points;       /* number of points compared: all that face the light */
    uint64_t differ;       /* number of answers that differ from the ray */
    uint64_t undefined;    /* differing answers with an undefined window and no boundary */
    uint64_t beyond;       /* differing answers without a true boundary within the bound */
    double worst_point[3]; /* an example of the points counted in `beyond` */
};

/* One row of a curve: a setting of automatic bias and the box filter, and its bound. */
struct check {
    const struct umbt_bounds *bounds;
    const struct umbt_point_set *points;
    uint32_t number; /* number of the light */
    struct umb_curve_row row;
    struct umb_query query;
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    double off_m; /* distance in metres from a surface to the start of rays: above float rounding */
    pthread_mutex_t lock;
    struct result result;
};

struct suspect {
    double at[3];
    float normal[3]; /* normal, turned towards the light */
    int lit;         /* 1: lit by a ray */
    size_t number;   /* number of the point, seed of its random places */
};

/* Number k in [0, 1) of a point (splitmix64, Steele et al. 2014). */
static double unit(size_t number, unsigned k)
{
    uint64_t bits = ((uint64_t)number * 65536U + k + 1) * UINT64_C(0x9e3779b97f4a7c15);
    bits = (bits ^ bits >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    bits = (bits ^ bits >> 27) * UINT64_C(0x94d049bb133111eb);
    return (double)((bits ^ bits >> 31) >> 11) * 0x1p-53;
}

static int is_lit(const struct check *check, const double from[3])
{
    double way[3], distance;
    umbr_towards_light(&check->light, from, way, &distance);
    return !umbr_occluded(check->bounds->common->scene.rays, from, way, 0, distance);
}

/*
 * Returns 1 if the truth at a place within the bound differs from that at the point. Two kinds of
 * places do not count: dark places behind the point's own surface, and places inside closed parts,
 * where the asset is undefined.
 */
static int tells(const struct check *check, const struct suspect *s, const double place[3])
{
    double square = 0, above = 0;
    for (int k = 0; k < 3; k++) {
        const double step = place[k] - s->at[k];
        square += step * step;
        above += step * (double)s->normal[k];
    }
    if (square > check->row.bound_m * check->row.bound_m || is_lit(check, place) == s->lit) {
        return 0;
    }
    return !s->lit ||
           (above > 0 && !(check->frustum.closed &&
                           umbt_point_is_inside(&check->bounds->common->scene, place, NULL)));
}

/* 1 if a random place in the ball of the bound has the other truth. */
static int search_ball(const struct check *check, const struct suspect *s, unsigned first,
                       unsigned count)
{
    for (unsigned i = first; i < first + count; i++) {
        double place[3], offset[3], square = 0;
        for (unsigned k = 0; k < 3; k++) {
            offset[k] = 2 * unit(s->number, 3 * i + k) - 1;
            square += offset[k] * offset[k];
        }
        for (int k = 0; k < 3; k++) {
            place[k] = s->at[k] + offset[k] * check->row.bound_m;
        }
        if (square <= 1 && tells(check, s, place)) {
            return 1;
        }
    }
    return 0;
}

/* Computes centre number i of the voxels of the answer, in world space. Returns 0 if it lies behind
 * the light. */
static int centre(const struct umbr_light_frame *frame, const struct umb_explanation *e, uint32_t i,
                  double place[3])
{
    const uint32_t side = e->level > 0 ? 1U << e->level : e->taps;
    double voxel[3] = {(double)e->window[0], (double)e->window[1], (double)e->cell[2]};
    for (int k = 0; k < 3 && e->level > 0; k++) {
        voxel[k] = (double)(e->cell[k] & ~(int64_t)(side - 1));
    }
    voxel[0] += i % side + 0.5;
    voxel[1] += i / side % side + 0.5;
    voxel[2] += i / side / side + 0.5;
    return umbr_light_frame_world(frame, voxel, place);
}

/* Returns 1 if the truth at a centre of the answer's voxels differs from that at the point. inside:
 * set to 1 if a centre lies in a closed part. */
static int search_centres(const struct check *check, const struct suspect *s,
                          const struct umb_explanation *e, int *inside)
{
    const uint32_t side = e->level > 0 ? 1U << e->level : e->taps;
    const uint32_t count = e->level > 0 ? side * side * side : side * side;
    const uint32_t step = count > CENTRES_MAX ? count / CENTRES_MAX | 1U : 1;
    struct umbr_light_frame frame;
    if (umbr_light_frame_init(&frame, check->bounds->asset, e->frustum, NULL) != UMB_OK) {
        return 0;
    }
    for (uint32_t i = 0; i < count; i += step) {
        double place[3];
        if (!centre(&frame, e, i, place)) {
            continue;
        }
        if (tells(check, s, place)) {
            return 1;
        }
        *inside |= umbt_point_is_inside(&check->bounds->common->scene, place, NULL);
    }
    return 0;
}

/* Searches for a true boundary within the bound of an answer that differs from the truth. */
static void examine(const struct check *check, const struct suspect *s, struct result *result)
{
    result->differ++;
    if (search_ball(check, s, 0, PLACES_FIRST)) {
        return;
    }
    struct umb_explanation e;
    int inside = 0;
    const struct umb_points one = umbt_points_at(s->at, s->normal, 1);
    umb_query_explain(&check->query, &one, 0, &e);
    if (search_centres(check, s, &e, &inside)) {
        return;
    }
    inside |= umbt_point_is_inside(&check->bounds->common->scene, e.moved, NULL);
    if (inside && check->frustum.closed) {
        result->undefined++;
    } else if (!search_ball(check, s, PLACES_FIRST, PLACES_LAST)) {
        result->beyond++;
        memcpy(result->worst_point, s->at, sizeof s->at);
    }
}

/* Makes a suspect of point `number`; on open parts the normal is turned towards the light. Returns
 * 0 if the point cannot face the light. */
static int take_point(const struct check *check, size_t number, struct suspect *s)
{
    const struct umbt_point_set *points = check->points;
    double way[3], normal[3], start[3], ignored;
    memcpy(s->at, points->positions[number], sizeof s->at);
    umbt_widen(points->normals[number], normal);
    s->number = number;
    umbr_towards_light(&check->light, s->at, way, &ignored);
    const double facing = umb__dot(normal, way);
    if (fabs(facing) < 0.01) { /* a ray along the surface is not reliable */
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        s->normal[k] = (float)(facing < 0 ? -normal[k] : normal[k]);
        start[k] = s->at[k] + (double)s->normal[k] * check->off_m;
    }
    if (facing < 0 && umbt_point_is_inside(&check->bounds->common->scene, start, NULL)) {
        return 0;
    }
    s->lit = is_lit(check, start);
    return 1;
}

static enum umb_status check_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct check *check = user;
    struct result sum = {0};
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        struct suspect s;
        float value = 0;
        struct umb_answers answers = {.values = &value};
        if (!take_point(check, i, &s)) {
            continue;
        }
        const struct umb_points one = umbt_points_at(s.at, s.normal, 1);
        umb_query_run(&check->query, &one, 0, 1, &answers);
        if (check->light.kind == UMB_LIGHT_SPOT && answers.stats.outside > 0) {
            continue; /* outside the cone: lit, whatever lies between */
        }
        sum.points++;
        if (value != (float)s.lit) {
            examine(check, &s, &sum);
        }
    }
    pthread_mutex_lock(&check->lock);
    check->result.points += sum.points;
    check->result.differ += sum.differ;
    check->result.undefined += sum.undefined;
    check->result.beyond += sum.beyond;
    if (sum.beyond > 0) {
        memcpy(check->result.worst_point, sum.worst_point, sizeof sum.worst_point);
    }
    pthread_mutex_unlock(&check->lock);
    return UMB_OK;
}

static void put_row(struct umbu_json *json, const struct check *check)
{
    const struct result *result = &check->result;
    umbu_json_begin(json, NULL, '{');
    umbu_json_rounded(json, "bound_m", check->row.bound_m, 9);
    UMBU_JSON_COUNTS(json, {"light", check->number}, {"level", check->row.level},
                     {"taps", check->row.taps}, {"points", result->points},
                     {"differ", result->differ}, {"undefined", result->undefined},
                     {"beyond", result->beyond});
    umbu_json_end(json, '}');
}

static void print_row(const struct check *check)
{
    const struct result *result = &check->result;
    printf("light %u, level %u, %2u taps: within %.4g m: %" PRIu64 " points, %" PRIu64
           " differ from a ray, %" PRIu64 " of them undefined, %" PRIu64 " beyond the bound\n",
           check->number, check->row.level, check->row.taps, check->row.bound_m, result->points,
           result->differ, result->undefined, result->beyond);
    if (result->beyond > 0) {
        printf("  for example at %.9g %.9g %.9g\n", result->worst_point[0], result->worst_point[1],
               result->worst_point[2]);
    }
}

static enum umb_status row_check(struct check *check, struct umb_error *error)
{
    const struct umb_query_settings settings = {
        .light = check->number, .taps = check->row.taps, .level = check->row.level};
    UMB__TRY(umb_query_prepare(check->bounds->asset, &settings, &check->query, error));
    UMB__TRY(umb_asset_get_light(check->bounds->asset, check->number, &check->light));
    UMB__TRY(
        umb_asset_get_frustum(check->bounds->asset, check->light.first_frustum, &check->frustum));
    if (pthread_mutex_init(&check->lock, NULL) != 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "bounds: no lock");
    }
    const enum umb_status status = umbu_range_run(
        check->bounds->common->threads, check->points->count, BLOCK, check_block, check, error);
    (void)pthread_mutex_destroy(&check->lock);
    return status;
}

/* Checks every row of the lights' curves, and prints each when it is done. */
static enum umb_status rows_check(struct umbt_bounds *bounds, const struct umbt_point_set *points,
                                  struct umbu_json *json, struct umb_error *error)
{
    size_t done = 0;
    for (uint32_t i = 0; i < bounds->light_count; i++) {
        struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
        size_t count;
        (void)umb_asset_get_curve(bounds->asset, bounds->first_light + i, rows, &count);
        for (size_t k = 0; k < count; k++, done++) {
            struct check check = {.bounds = bounds,
                                  .points = points,
                                  .number = bounds->first_light + i,
                                  .row = rows[k],
                                  .off_m = 1e-6 * bounds->common->scene.diagonal_m};
            UMB__TRY(row_check(&check, error));
            bounds->beyond += check.result.beyond;
            if (bounds->common->json) {
                put_row(json, &check);
            } else if (!bounds->common->quiet) {
                print_row(&check);
            }
        }
    }
    if (bounds->common->json) {
        umbu_json_end(json, ']');
        umbu_json_bool(json, "true", bounds->beyond == 0);
    }
    return done > 0
               ? UMB_OK
               : umb_fail(error, UMB_E_BAD_SCENE, "--bounds: the asset carries no accuracy curve");
}

enum umb_status umbt_bounds_verify(struct umbt_bounds *bounds, struct umb_error *error)
{
    const struct umbt_point_request request = {
        .scene = &bounds->common->scene,
        .kind = UMBT_POINT_SURFACE,
        .count = (size_t)bounds->points,
        .seed = bounds->common->seed,
        .threads = bounds->common->threads,
        .quiet = bounds->common->quiet,
    };
    struct umbu_json json = {.file = stdout};
    struct umbt_point_set points = {0};
    UMB__TRY(umbt_points_sample(&request, &points, error));
    if (bounds->common->json) {
        umbu_json_begin(&json, NULL, '{');
        umbu_json_begin(&json, "bounds", '[');
    }
    const enum umb_status status = rows_check(bounds, &points, &json, error);
    umbu_json_close(&json);
    umbt_point_set_finish(&points);
    return status;
}
