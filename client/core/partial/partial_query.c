/* SPDX-License-Identifier: Apache-2.0 */
/* Queries the lower and the upper asset. Where their answers differ, the pages' nodes give the
 * bound of the error. */
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "partial/partial_parts.h"
#include "partial/partial_space.h"
#include "query/perspective.h"
#include "query/stages.h"

/* Points that both assets answer at a time, so that the answers stay in the cache. */
#define CHUNK 1024U

/* A query of both assets. */
struct bracket {
    struct umb_partial *p;
    struct umb_query lower, upper;
    const struct umb_points *points;
    bool want;
    struct umb__query q; /* Content of `lower` */
    struct umb_partial_answers *answers;
};

static uint32_t clamp_voxel(double v, double size)
{
    return v >= size ? (uint32_t)size - 1 : v > 0 ? (uint32_t)v : 0; /* NaN: 0 */
}

/* Looks up the window of point i in the pages. Out: error_m: as error_m of struct
 * umb_partial_answers. */
static struct umb__lack explain(const struct bracket *b, size_t i, double *error_m)
{
    static const struct umb_partial_view no_view;
    struct umb__space space;
    double voxel[3] = {0};
    uint32_t frustum;
    (void)umb__look_up_at(&b->q, b->points, i, voxel, &frustum);
    const struct umb_frustum_info *f = &b->p->canonical.content.frusta[frustum];
    const double size = (double)(1U << f->log2_size), half = b->q.taps / 2;
    uint32_t low[3], high[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        const double reach = axis < 2 ? half : 0;
        low[axis] = clamp_voxel(floor(voxel[axis]) - reach, size);
        high[axis] = clamp_voxel(floor(voxel[axis]) + reach, size);
    }
    const struct umb__lack lack = umb__partial_look(b->p, frustum, low, high, b->want);
    /* All missing cubes of the window lie at one depth, so the cube of the highest level has the
     * longest edge. */
    umb__space_init(&space, &b->p->canonical.content, frustum, &no_view);
    *error_m = umb__space_edge(&space, lack.level, low[2] >> lack.level << lack.level);
    return lack;
}

/* Estimates the answer of point i, for which the lower and the upper asset give different
 * answers. */
static void settle(const struct bracket *b, size_t i, float low, float high)
{
    struct umb_partial_answers *a = b->answers;
    double error_m;
    const struct umb__lack lack = explain(b, i, &error_m);
    a->values[i] = low + (high - low) * (float)lack.occupancy;
    if (a->error_m) {
        a->error_m[i] = (float)error_m;
    }
    a->worst_error_m = error_m > a->worst_error_m ? error_m : a->worst_error_m;
    a->exact--;
}

/* Stores the answers of a chunk as if all were exact, then settles those that are not. */
static void settle_chunk(const struct bracket *b, size_t first, size_t count, const float *low,
                         const float *high)
{
    struct umb_partial_answers *a = b->answers;
    const size_t size = count * sizeof *low;
    memcpy(a->values + first, low, size);
    if (a->low) {
        memcpy(a->low + first, low, size);
    }
    if (a->high) {
        memcpy(a->high + first, high, size);
    }
    if (a->error_m) {
        memset(a->error_m + first, 0, size);
    }
    a->exact += count;
    for (size_t i = 0; i < count; i++) {
        if (low[i] < high[i]) {
            settle(b, first + i, low[i], high[i]);
        }
    }
}

/* Some points of a chunk, one after the other; room for one more than the chunk has. */
struct chosen {
    uint32_t count;
    uint16_t index[CHUNK + 1];         /* Position of each in the chunk */
    double positions[3 * (CHUNK + 1)]; /* In the format of the chunk */
    float normals[3 * (CHUNK + 1)], footprints[CHUNK + 1];
};

/* Chooses the points whose answer is less than 1: where the lower asset is all lit, the upper one
 * is too. */
static void choose(const struct umb_points *points, const float *low, struct chosen *chosen)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < points->count; i++) {
        chosen->index[count] = (uint16_t)i;
        count += !(low[i] >= 1);
    }
    chosen->count = count;
}

/* Copies `size` bytes of each chosen point. */
static inline __attribute__((always_inline)) void gather(const struct chosen *chosen,
                                                         const void *from, size_t size, void *to)
{
    for (uint32_t i = 0; i < chosen->count; i++) {
        memcpy((uint8_t *)to + i * size, (const uint8_t *)from + chosen->index[i] * size, size);
    }
}

static struct umb_points chosen_points(const struct umb_points *points, struct chosen *chosen)
{
    struct umb_points some = *points;
    if (points->format == UMB_POINT_F32) {
        gather(chosen, points->positions, 3 * sizeof(float), chosen->positions);
    } else {
        gather(chosen, points->positions, 3 * sizeof(double), chosen->positions);
    }
    some.positions = chosen->positions;
    if (points->normals) {
        gather(chosen, points->normals, 3 * sizeof(float), chosen->normals);
        some.normals = chosen->normals;
    }
    if (points->footprints) {
        gather(chosen, points->footprints, sizeof(float), chosen->footprints);
        some.footprints = chosen->footprints;
    }
    some.count = chosen->count;
    return some;
}

/* Answers the points of a chunk from the upper asset. In: low: answers of the lower one. */
static void run_upper(const struct bracket *b, const struct umb_points *points, const float *low,
                      float *high)
{
    struct chosen chosen;
    float values[CHUNK];
    choose(points, low, &chosen);
    if (chosen.count > points->count - points->count / 4) { /* Copying would not pay */
        struct umb_answers all = {.values = high};
        umb_query_run(&b->upper, points, 0, points->count, &all);
        return;
    }
    const struct umb_points some = chosen_points(points, &chosen);
    struct umb_answers above = {.values = values};
    umb_query_run(&b->upper, &some, 0, some.count, &above);
    memcpy(high, low, points->count * sizeof *high);
    for (uint32_t i = 0; i < chosen.count; i++) {
        high[chosen.index[i]] = values[i];
    }
}

static void run_chunk(const struct bracket *b, size_t first, size_t count)
{
    float low[CHUNK], high[CHUNK];
    const struct umb_points points = umb__some_points(b->points, first, count);
    struct umb_answers below = {.values = low, .stats = b->answers->stats};
    umb_query_run(&b->lower, &points, 0, count, &below);
    run_upper(b, &points, low, high);
    b->answers->stats = below.stats;
    settle_chunk(b, first, count, low, high);
}

enum umb_status umb_partial_query(struct umb_partial *p, const struct umb_query_settings *settings,
                                  const struct umb_points *points, int want,
                                  struct umb_partial_answers *answers, struct umb_error *error)
{
    struct bracket b = {.p = p, .points = points, .want = want != 0, .answers = answers};
    struct umb_query_settings floats = *settings;
    floats.format = UMB_ANSWER_F32;
    answers->exact = 0;
    answers->worst_error_m = 0;
    if (!p->built) {
        return umb_fail(error, UMB_E_STATE, "partial asset: nothing is built yet");
    }
    const char *refusal = umb__filter_of(settings->filter)->partial;
    if (refusal != NULL) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "%s", refusal);
    }
    UMB__TRY(umb_query_prepare(&p->lower, &floats, &b.lower, error));
    UMB__TRY(umb_query_prepare(&p->upper, &floats, &b.upper, error));
    UMB__TRY(umb_points_check(points, error));
    memcpy(&b.q, b.lower.opaque, sizeof b.q);
    for (size_t first = 0; first < points->count; first += CHUNK) {
        const size_t rest = points->count - first;
        run_chunk(&b, first, rest < CHUNK ? rest : CHUNK);
    }
    return UMB_OK;
}
