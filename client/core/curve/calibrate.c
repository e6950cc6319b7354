/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Measures how many nanoseconds a query takes for each point on this machine, with the settings of
 * each row of an accuracy curve. Rows are timed on the caller's points. If the caller gives none,
 * they are timed on points of two kinds: easy ones anywhere in the frustum (mostly large uniform
 * cells), and hard ones where the light first meets a caster. The cache lines that one tap reads
 * are counted for both kinds and for the curve's points on surfaces. These three counts tell how
 * hard the curve's points are, and the costs are interpolated between easy and hard.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/asset_parts.h"
#include "query/query_parts.h"
#include "query/voxel_walk.h"
#include "umbrage/curve.h"

enum {
    POINTS = 32768,    /* Number of points of each kind */
    COLUMN_STEPS = 64, /* Cubes visited along a ray before another ray is tried */
    HARDNESS_MAX = 2,  /* Limit of the extrapolation: the curve's points may be harder than the hard
                          points, but not by much */
    RUNS = 7,          /* Runs of each row */
    INTERVALS = 8,     /* Intervals of a run */
    INTERVAL = 1024,   /* Points of an interval, so many that a query's own start hardly counts */
    REPEATS_MAX = 64,  /* Most queries of a run of few points */
};

/* Points of one kind, world space relative to the asset's origin. */
struct sample {
    double (*positions)[3];
    double lines; /* Lines that one tap reads, as the curve counts them */
    double ns[UMB_CURVE_ROWS_MAX];
};

struct job {
    const struct umb_asset *asset;
    const struct umb_frustum_info *frustum;
    uint32_t light;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count;
    struct umb__tree tree; /* Tree of the light's first frustum */
    struct sample easy, hard;
    double (*now_s)(void);
};

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Queries INTERVALS short runs of points, and returns nanoseconds a point. The points are divided
 * into INTERVALS equal parts, and each part into runs. One run is taken from each part: number
 * `turn`, modulo the number of runs in a part. If a part is shorter than a run, queries all points
 * repeatedly. */
static double time_intervals(const struct job *job, const struct umb_points *points,
                             const struct umb_query *query, size_t turn, float *answers)
{
    const size_t part = points->count / INTERVALS, turns = part / INTERVAL;
    struct umb_answers out = {.values = answers};
    size_t asked = 0;
    const double start = job->now_s();
    if (turns > 0) {
        for (size_t i = 0; i < INTERVALS; i++) {
            const struct umb_points interval =
                umb__some_points(points, i * part + turn % turns * INTERVAL, INTERVAL);
            umb_query_run(query, &interval, 0, INTERVAL, &out);
            asked += INTERVAL;
        }
    } else {
        for (int i = 0; i < REPEATS_MAX && asked < INTERVALS * INTERVAL; i++) {
            umb_query_run(query, points, 0, points->count, &out);
            asked += points->count;
        }
    }
    return 1e9 * (job->now_s() - start) / (double)asked;
}

static enum umb_status time_runs(const struct job *job, const struct umb_points *points,
                                 double runs[][RUNS], float *answers, struct umb_error *error)
{
    for (size_t run = 0; run < RUNS; run++) {
        for (size_t row = 0; row < job->count; row++) {
            const struct umb_query_settings settings = {
                .light = job->light, .taps = job->rows[row].taps, .level = job->rows[row].level};
            struct umb_query query;
            UMB__TRY(umb_query_prepare(job->asset, &settings, &query, error));
            runs[row][run] = time_intervals(job, points, &query, run * job->count + row, answers);
        }
    }
    return UMB_OK;
}

/*
 * Times the rows of a light's curve. In: points: at least one, finite. Out: ns: nanoseconds a
 * point, for each row.
 *
 * A run queries a few intervals of consecutive points, spread over all of them, so that it sees
 * points of all kinds in their real order. The next run and the next row take other intervals, so
 * that no row finds its data in the cache because of the row before. Runs of the rows are
 * interleaved, and the median of a row's runs counts.
 */
static enum umb_status time_rows(const struct job *job, const struct umb_points *points,
                                 double ns[UMB_CURVE_ROWS_MAX], struct umb_error *error)
{
    const struct umb_alloc *alloc = job->asset->alloc;
    double runs[UMB_CURVE_ROWS_MAX][RUNS];
    const size_t room =
        points->count < (size_t)INTERVALS * INTERVAL ? points->count : (size_t)INTERVAL;
    float *answers = umb__alloc(alloc, room, sizeof *answers);
    if (answers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "calibration: out of memory for %zu answers", room);
    }
    const enum umb_status status = time_runs(job, points, runs, answers, error);
    umb__free(alloc, answers);
    for (size_t row = 0; row < job->count && status == UMB_OK; row++) {
        qsort(runs[row], RUNS, sizeof *runs[row], by_size);
        ns[row] = runs[row][RUNS / 2];
    }
    return status;
}

static double unit(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return (double)((*state * UINT64_C(0x2545f4914f6cdd1d)) >> 11) * 0x1p-53;
}

/* Returns the number of cache lines that the look-up of a voxel reads, counted as in
 * docs/reference/umb-format.md. One line is read for each wide node on the way from the grid to the
 * smallest uniform cube around the voxel, or to its brick. */
static double lines_at(const struct job *job, const double voxel[3])
{
    const uint32_t highest = umb_level_max(job->frustum->log2_size);
    struct umb_volume_stats ignored = {0};
    const struct umb__place place = umb__tree_locate(
        &job->tree, (uint32_t)voxel[0], (uint32_t)voxel[1], (uint32_t)voxel[2], &ignored);
    const uint32_t lowest = place.brick ? UMB_LEVEL_BRICK : place.level + 2;
    return lowest > highest ? 1 : 2 + (highest - lowest) / 2;
}

static void draw_points(struct job *job)
{
    const double size = (double)(1U << job->frustum->log2_size);
    uint64_t state = 1;
    for (size_t i = 0; i < POINTS; i++) {
        double voxel[3];
        for (unsigned axis = 0; axis < 3; axis++) { /* One draw a statement: their order is fixed */
            voxel[axis] = unit(&state) * size;
        }
        job->easy.lines += lines_at(job, voxel) / POINTS;
        umb__voxel_to_world(job->frustum, voxel, job->easy.positions[i]);
        double depth = -1;
        for (int tries = 0; tries < 8 && depth < 0; tries++) {
            voxel[0] = unit(&state) * size;
            voxel[1] = unit(&state) * size;
            depth = (double)umb__first_shadow(&job->tree, (uint32_t)voxel[0], (uint32_t)voxel[1], 0,
                                              COLUMN_STEPS);
        }
        voxel[2] = depth >= 0 ? depth : voxel[2];
        job->hard.lines += lines_at(job, voxel) / POINTS;
        umb__voxel_to_world(job->frustum, voxel, job->hard.positions[i]);
    }
}

/* Returns how hard the curve's points are to query, from 0 (as the easy points) to 1 (as the hard
 * points). */
static double hardness(const struct job *job)
{
    const double span = job->hard.lines - job->easy.lines;
    size_t plain = 0;
    while (plain + 1 < job->count && (job->rows[plain].level > 0 || job->rows[plain].taps > 1)) {
        plain++;
    }
    const double from_easy = job->rows[plain].lines - job->easy.lines;
    return span > 0.05 ? fmin(fmax(from_easy / span, 0), HARDNESS_MAX) : 1;
}

/*
 * Fills in the costs, so that a row with more lines never costs less. Measured times may have
 * another order: a look-up that stops at a coarse level may take longer than one of a single tap.
 * Then neighbouring rows are replaced by their mean until the order is right. This isotonic
 * regression gives the nearest costs that rise with the lines.
 */
static void conclude(const struct umb_curve_row *rows, size_t count,
                     const double row_ns[UMB_CURVE_ROWS_MAX], struct umb_calibration *calibration)
{
    size_t order[UMB_CURVE_ROWS_MAX], pool_size[UMB_CURVE_ROWS_MAX], pools = 0;
    double pool_ns[UMB_CURVE_ROWS_MAX];
    for (size_t i = 0; i < count; i++) { /* Insertion sort: few rows, nearly in order */
        size_t at = i;
        for (; at > 0 && rows[order[at - 1]].lines > rows[i].lines; at--) {
            order[at] = order[at - 1];
        }
        order[at] = i;
    }
    for (size_t i = 0; i < count; i++) {
        const int is_tie = i > 0 && rows[order[i]].lines <= rows[order[i - 1]].lines;
        double ns = row_ns[order[i]];
        size_t size = 1;
        while (pools > 0 && (pool_ns[pools - 1] >= ns || (is_tie && size == 1))) {
            pools--;
            ns = (ns * (double)size + pool_ns[pools] * (double)pool_size[pools]) /
                 (double)(size + pool_size[pools]);
            size += pool_size[pools];
        }
        pool_ns[pools] = ns;
        pool_size[pools++] = size;
    }
    calibration->count = count;
    for (size_t pool = 0, i = 0; pool < pools; pool++) {
        for (size_t end = i + pool_size[pool]; i < end; i++) {
            calibration->ns[order[i]] = pool_ns[pool];
        }
    }
}

static enum umb_status time_sample(const struct job *job, struct sample *sample,
                                   struct umb_error *error)
{
    struct umb_points points = {
        .positions = sample->positions, .format = UMB_POINT_F64, .count = POINTS};
    memcpy(points.origin, job->asset->canonical.content.origin, sizeof points.origin);
    return time_rows(job, &points, sample->ns, error);
}

static enum umb_status find_rows(struct job *job, struct umb_error *error)
{
    const struct umb__content *content = &job->asset->canonical.content;
    if (job->light >= content->light_count) {
        return umb_fail(error, UMB_E_NOT_FOUND, UMB__NO_LIGHT, job->light,
                        content->light_count - 1);
    }
    if (umb_asset_get_curve(job->asset, job->light, job->rows, &job->count) != UMB_OK) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "calibration: the asset carries no accuracy curve for light %u",
                        job->light);
    }
    const uint32_t first = content->lights[job->light].first_frustum;
    const struct umb__view *view = &job->asset->view;
    job->frustum = &content->frusta[first];
    job->tree = (struct umb__tree){.grid = view->grid + view->tops[first].first_cell,
                                   .nodes = view->nodes,
                                   .bricks = view->bricks,
                                   .log2_size = job->frustum->log2_size,
                                   .grid_log2 = view->tops[first].grid_log2};
    return UMB_OK;
}

/* Times the rows on drawn points, easy and hard ones, and interpolates between the two to points as
 * hard as the curve's. */
static enum umb_status time_drawn(struct job *job, struct umb_calibration *calibration,
                                  struct umb_error *error)
{
    if (!job->easy.positions || !job->hard.positions) {
        return umb_fail(error, UMB_E_NO_MEMORY, "calibration: out of memory for %d points", POINTS);
    }
    draw_points(job);
    UMB__TRY(time_sample(job, &job->easy, error));
    UMB__TRY(time_sample(job, &job->hard, error));
    const double far = hardness(job);
    double row_ns[UMB_CURVE_ROWS_MAX];
    for (size_t i = 0; i < job->count; i++) {
        const double easy = job->easy.ns[i], hard = job->hard.ns[i];
        row_ns[i] = hard > easy ? easy + far * (hard - easy) : easy;
    }
    conclude(job->rows, job->count, row_ns, calibration);
    return UMB_OK;
}

enum umb_status umb_calibrate(const struct umb_asset *asset, uint32_t light, double (*now_s)(void),
                              struct umb_calibration *calibration, struct umb_error *error)
{
    struct job job = {.asset = asset, .light = light, .now_s = now_s};
    memset(calibration, 0, sizeof *calibration);
    UMB__TRY(find_rows(&job, error));
    job.easy.positions = umb__alloc(asset->alloc, POINTS, sizeof *job.easy.positions);
    job.hard.positions = umb__alloc(asset->alloc, POINTS, sizeof *job.hard.positions);
    const enum umb_status status = time_drawn(&job, calibration, error);
    umb__free(asset->alloc, job.easy.positions);
    umb__free(asset->alloc, job.hard.positions);
    return status;
}

enum umb_status umb_calibrate_points(const struct umb_asset *asset, uint32_t light,
                                     const struct umb_points *points, double (*now_s)(void),
                                     struct umb_calibration *calibration, struct umb_error *error)
{
    struct job job = {.asset = asset, .light = light, .now_s = now_s};
    double row_ns[UMB_CURVE_ROWS_MAX];
    memset(calibration, 0, sizeof *calibration);
    UMB__TRY(find_rows(&job, error));
    if (points->count == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "calibration: no points");
    }
    UMB__TRY(time_rows(&job, points, row_ns, error));
    conclude(job.rows, job.count, row_ns, calibration);
    return UMB_OK;
}
