/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the stated bound; see bound_check.h. */
#include "study/bound_check.h"

#include <math.h>
#include <pthread.h>
#include <string.h>

#include "base/try.h"
#include "rays/verify_light_frame.h"
#include "study/study_math.h"
#include "tool/threads.h"

enum {
    BLOCK = 256,
    PLACES_FIRST = 48,     /* random places to try before the voxels' centres */
    PLACES_LAST = 2048,    /* random places to try after the voxels' centres */
    CENTRES_MAX = 1 << 18, /* most voxel centres of a coarse cell to try */
};

struct check {
    const struct umbt_bound_job *job;
    struct umb_query query;
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    double off_m; /* distance in metres from a surface to the start of rays: above float rounding */
    pthread_mutex_t lock;
    struct umbt_bound_result result;
};

/* A point whose answer is checked. */
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
    return !umbr_occluded(check->job->scene->rays, from, way, 0, distance);
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
    if (square > check->job->bound_m * check->job->bound_m || is_lit(check, place) == s->lit) {
        return 0;
    }
    return !s->lit || (above > 0 && !(check->frustum.closed &&
                                      umbt_point_is_inside(check->job->scene, place, NULL)));
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
            place[k] = s->at[k] + offset[k] * check->job->bound_m;
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
    if (umbr_light_frame_init(&frame, check->job->asset, e->frustum, NULL) != UMB_OK) {
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
        *inside |= umbt_point_is_inside(check->job->scene, place, NULL);
    }
    return 0;
}

/* Searches for a true boundary within the bound of an answer that differs from the truth. */
static void examine(const struct check *check, const struct suspect *s,
                    struct umbt_bound_result *result)
{
    result->differ++;
    if (search_ball(check, s, 0, PLACES_FIRST)) {
        return;
    }
    struct umb_explanation e;
    int inside = 0;
    const struct umb_points one = {
        .positions = s->at, .format = UMB_POINT_F64, .normals = s->normal, .count = 1};
    umb_query_explain(&check->query, &one, 0, &e);
    if (search_centres(check, s, &e, &inside)) {
        return;
    }
    inside |= umbt_point_is_inside(check->job->scene, e.moved, NULL);
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
    const struct umbt_point_set *points = check->job->points;
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
    if (facing < 0 && umbt_point_is_inside(check->job->scene, start, NULL)) {
        return 0;
    }
    s->lit = is_lit(check, start);
    return 1;
}

static enum umb_status check_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct check *check = user;
    struct umbt_bound_result sum = {0};
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        struct suspect s;
        float value = 0;
        struct umb_answers answers = {.values = &value};
        if (!take_point(check, i, &s)) {
            continue;
        }
        const struct umb_points one = {
            .positions = s.at, .format = UMB_POINT_F64, .normals = s.normal, .count = 1};
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

enum umb_status umbt_bound_check(const struct umbt_bound_job *job, struct umbt_bound_result *result,
                                 struct umb_error *error)
{
    struct check check = {.job = job, .off_m = 1e-6 * job->scene->diagonal_m};
    memset(result, 0, sizeof *result);
    UMB__TRY(umb_query_prepare(job->asset, &job->settings, &check.query, error));
    UMB__TRY(umb_asset_get_light(job->asset, job->settings.light, &check.light));
    UMB__TRY(umb_asset_get_frustum(job->asset, check.light.first_frustum, &check.frustum));
    if (pthread_mutex_init(&check.lock, NULL) != 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "bounds: no lock");
    }
    const enum umb_status status =
        umbu_range_run(job->threads, job->points->count, BLOCK, check_block, &check, error);
    (void)pthread_mutex_destroy(&check.lock);
    *result = check.result;
    return status;
}
