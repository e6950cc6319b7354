/* SPDX-License-Identifier: Apache-2.0 */
/* See row_timer.h. */
#include "curve/row_timer.h"

#include <stdlib.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/asset_parts.h"

enum {
    RUNS = 7,
    INTERVALS = 8,
    INTERVAL = 1024,  /* Points of an interval, so many that a query's own start hardly counts */
    REPEATS_MAX = 64, /* of a few points */
};

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Makes a batch of `count` points from `first` on. */
static struct umb_points interval_of(const struct umb_points *points, size_t first, size_t count)
{
    const size_t size = points->format == UMB_POINT_F64 ? sizeof(double) : sizeof(float);
    struct umb_points interval = *points;
    interval.positions = (const unsigned char *)points->positions + 3 * first * size;
    interval.normals =
        points->normals ? (const float *)points->normals + 3 * first : points->normals;
    interval.count = count;
    return interval;
}

/* Queries INTERVALS intervals, the `turn`th of each part of the points. Returns nanoseconds a
 * point. */
static double time_intervals(const struct umb__row_timer *timer, const struct umb_query *query,
                             size_t turn, float *answers)
{
    const struct umb_points *points = timer->points;
    const size_t part = points->count / INTERVALS, turns = part / INTERVAL;
    struct umb_answers out = {.values = answers};
    size_t asked = 0;
    const double start = timer->now_s();
    if (turns > 0) {
        for (size_t i = 0; i < INTERVALS; i++) {
            const struct umb_points interval =
                interval_of(points, i * part + turn % turns * INTERVAL, INTERVAL);
            umb_query_run(query, &interval, 0, INTERVAL, &out);
            asked += INTERVAL;
        }
    } else {
        for (int i = 0; i < REPEATS_MAX && asked < INTERVALS * INTERVAL; i++) {
            umb_query_run(query, points, 0, points->count, &out);
            asked += points->count;
        }
    }
    return 1e9 * (timer->now_s() - start) / (double)asked;
}

static enum umb_status time_runs(const struct umb__row_timer *timer, double runs[][RUNS],
                                 float *answers, struct umb_error *error)
{
    for (size_t run = 0; run < RUNS; run++) {
        for (size_t row = 0; row < timer->count; row++) {
            const struct umb_query_settings settings = {.light = timer->light,
                                                        .taps = timer->rows[row].taps,
                                                        .level = timer->rows[row].level};
            struct umb_query query;
            UMB__TRY(umb_query_prepare(timer->asset, &settings, &query, error));
            runs[row][run] = time_intervals(timer, &query, run * timer->count + row, answers);
        }
    }
    return UMB_OK;
}

enum umb_status umb__time_rows(const struct umb__row_timer *timer, double ns[UMB_CURVE_ROWS_MAX],
                               struct umb_error *error)
{
    const struct umb_alloc *alloc = timer->asset->alloc;
    double runs[UMB_CURVE_ROWS_MAX][RUNS];
    const size_t room = timer->points->count < (size_t)INTERVALS * INTERVAL ? timer->points->count
                                                                            : (size_t)INTERVAL;
    float *answers = umb__alloc(alloc, room, sizeof *answers);
    if (answers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "calibration: memory for %zu answers refused",
                        room);
    }
    const enum umb_status status = time_runs(timer, runs, answers, error);
    umb__free(alloc, answers);
    for (size_t row = 0; row < timer->count && status == UMB_OK; row++) {
        qsort(runs[row], RUNS, sizeof *runs[row], by_size);
        ns[row] = runs[row][RUNS / 2];
    }
    return status;
}
