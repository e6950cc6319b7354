/* SPDX-License-Identifier: Apache-2.0 */
/* Queries the lower and the upper asset. Where their answers differ, the pages' nodes give the bound
 * of the error. */
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

static void settle(const struct bracket *b, size_t i, float low, float high)
{
    struct umb_partial_answers *a = b->answers;
    double error_m = 0;
    float value = low;
    if (low < high) {
        const struct umb__lack lack = explain(b, i, &error_m);
        value = low + (high - low) * (float)lack.occupancy;
    } else {
        a->exact++;
    }
    a->values[i] = value;
    if (a->low) {
        a->low[i] = low;
    }
    if (a->high) {
        a->high[i] = high;
    }
    if (a->error_m) {
        a->error_m[i] = (float)error_m;
    }
    a->worst_error_m = error_m > a->worst_error_m ? error_m : a->worst_error_m;
}

/* Some points of a chunk, one after the other. */
struct chosen {
    uint32_t count;
    uint16_t index[CHUNK]; /* Position of each in the chunk */
    double positions[3 * CHUNK]; /* In the format of the chunk */
    float normals[3 * CHUNK], footprints[CHUNK];
};

/* Chooses the points whose answer is less than 1: where the lower asset is all lit, the upper one is
 * too. */
static void choose(const struct umb_points *points, const float *low, struct chosen *chosen)
{
    const size_t position = 3 * (points->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double));
    uint8_t *to = (uint8_t *)chosen->positions;
    uint32_t count = 0;
    for (size_t i = 0; i < points->count; i++) {
        if (low[i] >= 1) {
            continue;
        }
        chosen->index[count] = (uint16_t)i;
        memcpy(to + count * position, (const uint8_t *)points->positions + i * position, position);
        if (points->normals) {
            memcpy(chosen->normals + 3 * (size_t)count, (const uint8_t *)points->normals + 12 * i,
                   12);
        }
        if (points->footprints) {
            memcpy(chosen->footprints + count, (const uint8_t *)points->footprints + 4 * i, 4);
        }
        count++;
    }
    chosen->count = count;
}

/* Answers the points of a chunk from the upper asset. In: low: answers of the lower one. */
static void run_upper(const struct bracket *b, const struct umb_points *points, const float *low,
                      float *high)
{
    struct chosen chosen;
    float values[CHUNK];
    choose(points, low, &chosen);
    struct umb_answers above = {.values = chosen.count < points->count ? values : high};
    struct umb_points some = *points;
    if (chosen.count < points->count) {
        some.positions = chosen.positions;
        some.normals = points->normals ? chosen.normals : NULL;
        some.footprints = points->footprints ? chosen.footprints : NULL;
        some.count = chosen.count;
        memcpy(high, low, points->count * sizeof *high);
    }
    umb_query_run(&b->upper, &some, 0, some.count, &above);
    for (uint32_t i = 0; i < chosen.count && above.values == values; i++) {
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
    for (size_t i = 0; i < count; i++) {
        settle(b, first + i, low[i], high[i]);
    }
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
