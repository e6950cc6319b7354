/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Every setting against the same samples (trade.h).
 *
 * Errors come from answers that are the same bits in every run, and are summed in the order of the
 * samples, so that a report's errors can be reproduced exactly. Times come from runs interleaved
 * over the settings, so that a machine's mood falls on all of them alike; CPU time of the one
 * thread where one thread is meant, wall time where all are.
 */
#define _GNU_SOURCE /* CLOCK_THREAD_CPUTIME_ID under strict POSIX flags */
#include "study/trade.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "study/parallel_for.h"
#include "study/study_progress.h"
#include "study/study_vec.h"
#include "study/traced_shadow.h"

#define TRUTH_BLOCK 64
#define CHECKED     1000 /* samples whose area truth is traced twice as finely as well */
#define AREA_RAYS   9    /* a side: 81 rays a point */
#define AREA_POINTS 2000
#define ALL_BLOCK   4096
#define ALL_POINTS  400000U /* what all threads do, so that starting them hardly counts; but at */
#define ALL_PASSES  16U     /* most this often the whole view */

static const uint32_t taps_quick[] = {1, 3, 9};
static const uint32_t taps_full[] = {1, 3, 5, 9, 17};

/* One setting on its way. */
struct probe {
    struct umbt_trade *trade;
    struct umbt_trade_result *result;
    const struct umbt_trade_bake *bake;
    struct umbt_truth truth;
    struct umb_query query;
    float *answers;     /* [points] */
    float *area;        /* [points of view and border] */
    uint8_t *undefined; /* likewise */
};

static double cpu_now_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static struct umb_points points_of(const struct umbt_trade *trade)
{
    return (struct umb_points){
        .positions = trade->points.positions,
        .format = UMB_POINT_F64,
        .normals = trade->points.normals,
        .count = trade->points.count,
    };
}

static void ask(const struct probe *probe, size_t first, size_t count,
                struct umb_query_stats *stats)
{
    const struct umb_points points = points_of(probe->trade);
    struct umb_answers answers = {.values = probe->answers};
    umb_query_run(&probe->query, &points, first, count, &answers);
    if (stats != NULL) {
        *stats = answers.stats;
    }
}

/* ---- errors ---- */

static void point_and_normal(const struct umbt_trade_points *points, size_t i, double normal[3])
{
    for (int k = 0; k < 3; k++) {
        normal[k] = (double)points->normals[i][k];
    }
    (void)umbt_normalize(normal);
}

static enum umb_status trace_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct probe *probe = user;
    const struct umbt_trade_points *points = &probe->trade->points;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double normal[3];
        point_and_normal(points, i, normal);
        probe->area[i] = umbt_truth_visibility(&probe->truth, points->positions[i], normal);
        probe->undefined[i] = 0;
        if (fabsf(probe->answers[i] - probe->area[i]) > 0.01F) {
            probe->undefined[i] =
                (uint8_t)umbt_truth_is_undefined(&probe->truth, points->positions[i], normal);
        }
    }
    return UMB_OK;
}

/* How well the area truth knows itself: against one with twice the rays a side. */
static double truth_error(const struct probe *probe)
{
    const struct umbt_trade_points *points = &probe->trade->points;
    const size_t surface = points->first[UMBT_TRADE_FREE];
    const size_t step = surface > CHECKED ? surface / CHECKED : 1;
    struct umbt_truth finer = probe->truth;
    double sum = 0.0, count = 0.0;
    finer.samples *= 2;
    for (size_t i = 0; i < surface; i += step) {
        double normal[3];
        point_and_normal(points, i, normal);
        const double difference =
            (double)umbt_truth_visibility(&finer, points->positions[i], normal) -
            (double)probe->area[i];
        sum += difference * difference;
        count += 1.0;
    }
    return count > 0.0 ? sqrt(sum / count) : 0.0;
}

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Sums against the area truth, over surface samples in defined space. */
static void sum_area(struct probe *probe)
{
    struct umbt_trade_result *result = probe->result;
    const size_t surface = probe->trade->points.first[UMBT_TRADE_FREE];
    double squares = 0.0, counts[3] = {0.0, 0.0, 0.0};
    static const double limits[3] = {0.01, 0.1, 0.5};
    for (size_t i = 0; i < surface; i++) {
        if (probe->undefined[i]) {
            result->undefined++;
            continue;
        }
        const double difference = fabs((double)probe->answers[i] - (double)probe->area[i]);
        result->judged++;
        squares += difference * difference;
        result->worst = difference > result->worst ? difference : result->worst;
        for (int k = 0; k < 3; k++) {
            counts[k] += difference > limits[k] ? 1.0 : 0.0;
        }
    }
    const double judged = result->judged > 0 ? (double)result->judged : 1.0;
    result->rms = sqrt(squares / judged);
    result->over_001 = counts[0] / judged;
    result->over_01 = counts[1] / judged;
    result->over_05 = counts[2] / judged;
}

/* Sums against the hard truth, and how far off the boundary is where the answer is wrong. `wrong`
 * is scratch: float[surface samples]. */
static void sum_hard(struct probe *probe, float *wrong)
{
    const struct umbt_trade_points *points = &probe->trade->points;
    struct umbt_trade_result *result = probe->result;
    size_t light = 0, shadow = 0, wrongs = 0, unknown = 0;
    for (size_t i = 0; i < points->first[UMBT_TRADE_FREE]; i++) {
        const int lit = probe->answers[i] >= 0.5F;
        if (probe->undefined[i] || lit == points->lit[i]) {
            continue;
        }
        light += lit ? 1U : 0U;
        shadow += lit ? 0U : 1U;
        if (isfinite(points->boundary_m[i])) {
            wrong[wrongs++] = points->boundary_m[i];
        } else {
            unknown++;
        }
    }
    const double judged = result->judged > 0 ? (double)result->judged : 1.0;
    result->false_light = (double)light / judged;
    result->false_shadow = (double)shadow / judged;
    result->off_unknown = wrongs + unknown > 0 ? (double)unknown / (double)(wrongs + unknown) : 0.0;
    if (wrongs > 0) {
        qsort(wrong, wrongs, sizeof *wrong, compare_floats);
        result->off_p50_m = (double)wrong[wrongs / 2];
        result->off_p95_m = (double)wrong[wrongs - 1 - wrongs / 20];
        result->off_max_m = (double)wrong[wrongs - 1];
    }
}

static enum umb_status probe_prepare(struct probe *probe, struct umb_error *error)
{
    const struct umbt_trade *trade = probe->trade;
    const struct umb_query_settings settings = {.taps = probe->result->taps};
    probe->bake = &trade->bakes[probe->result->bake];
    probe->truth = (struct umbt_truth){
        .rays = trade->scene.rays,
        .kind = UMBT_TRUTH_AREA,
        .settings = settings,
        .samples = (uint32_t)trade->options.truth_side,
        .diagonal_m = trade->scene.diagonal_m,
        .frustum = probe->bake->frustum,
        .closed = probe->bake->frustum.closed ? trade->scene.parts.closed : NULL,
    };
    memcpy(probe->truth.to_light, trade->points.to_light, sizeof probe->truth.to_light);
    memcpy(probe->truth.origin, probe->bake->info.origin, sizeof probe->truth.origin);
    return umb_query_prepare(probe->bake->asset, &settings, &probe->query, error);
}

static enum umb_status errors_find(struct probe *probe, float *wrong, struct umb_error *error)
{
    const struct umbt_trade_points *points = &probe->trade->points;
    struct umb_query_stats stats = {0};
    const double view = (double)points->first[UMBT_TRADE_BORDER];
    ask(probe, 0, points->first[UMBT_TRADE_BORDER], &stats);
    probe->result->nodes = (double)stats.nodes / view;
    probe->result->bricks = (double)stats.bricks / view;
    ask(probe, 0, points->count, NULL);
    const enum umb_status status =
        umbt_parallel_for((unsigned)probe->trade->options.threads, points->first[UMBT_TRADE_FREE],
                          TRUTH_BLOCK, trace_block, probe, error);
    if (status == UMB_OK) {
        sum_area(probe);
        sum_hard(probe, wrong);
        probe->result->truth_error = truth_error(probe);
    }
    return status;
}

/* ---- times ---- */

/* Times of one setting, a run each. */
struct times {
    double view[UMBT_TRADE_RUNS], free[UMBT_TRADE_RUNS], all[UMBT_TRADE_RUNS];
};

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double values[UMBT_TRADE_RUNS])
{
    qsort(values, UMBT_TRADE_RUNS, sizeof *values, compare_doubles);
    return values[UMBT_TRADE_RUNS / 2];
}

/* After median: the values are in order. */
static double spread(const double values[UMBT_TRADE_RUNS])
{
    const double middle = values[UMBT_TRADE_RUNS / 2];
    /* The two outermost runs of each side are the machine's, not the setting's. */
    return middle > 0.0 ? (values[UMBT_TRADE_RUNS - 2] - values[1]) / middle : 0.0;
}

static enum umb_status all_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct probe *probe = user;
    const size_t view = probe->trade->points.first[UMBT_TRADE_BORDER];
    float values[ALL_BLOCK];
    const struct umb_points points = points_of(probe->trade);
    (void)error;
    while (count > 0) { /* the view over and over */
        const size_t at = first % view;
        const size_t room = view - at < count ? view - at : count;
        struct umb_answers answers = {.values = values};
        struct umb_points part = points;
        part.positions = probe->trade->points.positions + at;
        part.normals = probe->trade->points.normals + at;
        part.count = room;
        umb_query_run(&probe->query, &part, 0, room, &answers);
        first += room;
        count -= room;
    }
    return UMB_OK;
}

static enum umb_status time_once(struct probe *probe, struct times *times, int run,
                                 struct umb_error *error)
{
    const struct umbt_trade_points *points = &probe->trade->points;
    const size_t view = points->first[UMBT_TRADE_BORDER];
    const size_t first_free = points->first[UMBT_TRADE_FREE];
    double start = cpu_now_s();
    ask(probe, 0, view, NULL);
    times->view[run] = 1e9 * (cpu_now_s() - start) / (double)view;
    start = cpu_now_s();
    ask(probe, first_free, points->count - first_free, NULL);
    times->free[run] = 1e9 * (cpu_now_s() - start) / (double)(points->count - first_free);
    const size_t passes = ALL_POINTS / view < ALL_PASSES ? ALL_POINTS / view + 1 : ALL_PASSES;
    start = umbt_now_s();
    const enum umb_status status = umbt_parallel_for(
        (unsigned)probe->trade->options.threads, passes * view, ALL_BLOCK, all_block, probe, error);
    times->all[run] = 1e9 * (umbt_now_s() - start) / (double)(passes * view);
    return status;
}

/* Rays on the same samples: one a point, and a window of them. Out: how many were stopped, so that
 * the compiler cannot leave them out. */
static int rays_once(const struct umbt_trade *trade, double view[UMBT_TRADE_RUNS],
                     double area[UMBT_TRADE_RUNS], double random[UMBT_TRADE_RUNS], int run,
                     const struct umbt_truth *truth)
{
    const struct umbt_trade_points *points = &trade->points;
    const size_t counts[2] = {points->first[UMBT_TRADE_BORDER],
                              points->count - points->first[UMBT_TRADE_FREE]};
    const size_t firsts[2] = {0, points->first[UMBT_TRADE_FREE]};
    const double reach = 2.0 * trade->scene.diagonal_m;
    int sum = 0;
    for (int set = 0; set < 2; set++) {
        double start = cpu_now_s();
        for (size_t i = firsts[set]; i < firsts[set] + counts[set]; i++) {
            sum += umbr_occluded(trade->scene.rays, points->positions[i], points->to_light,
                                 1e-5 * reach, reach);
        }
        (set == 0 ? view : random)[run] = 1e9 * (cpu_now_s() - start) / (double)counts[set];
    }
    const size_t some = counts[0] < AREA_POINTS ? counts[0] : AREA_POINTS;
    double start = cpu_now_s();
    for (size_t i = 0; i < some; i++) {
        double normal[3];
        point_and_normal(points, i, normal);
        sum += umbt_truth_visibility(truth, points->positions[i], normal) > 0.5F;
    }
    area[run] = 1e9 * (cpu_now_s() - start) / (double)some;
    return sum;
}

static enum umb_status times_take(struct umbt_trade *trade, struct probe *probes,
                                  struct times *times, struct umb_error *error)
{
    double view[UMBT_TRADE_RUNS], area[UMBT_TRADE_RUNS], random[UMBT_TRADE_RUNS];
    struct umbt_truth window = probes[0].truth;
    window.samples = AREA_RAYS;
    for (int run = 0; run < UMBT_TRADE_RUNS; run++) {
        for (uint32_t i = 0; i < trade->result_count; i++) {
            const enum umb_status status = time_once(&probes[i], &times[i], run, error);
            if (status != UMB_OK) {
                return status;
            }
        }
        trade->rays.stopped += rays_once(trade, view, area, random, run, &window);
    }
    for (uint32_t i = 0; i < trade->result_count; i++) {
        struct umbt_trade_result *result = &trade->results[i];
        result->ns_view = median(times[i].view);
        result->ns_free = median(times[i].free);
        result->ns_view_all = median(times[i].all);
        result->spread = spread(times[i].view);
    }
    trade->rays.ns_view = median(view);
    trade->rays.ns_free = median(random);
    trade->rays.ns_area = median(area);
    trade->rays.spread = spread(view);
    return UMB_OK;
}

/* ---- all settings ---- */

static void list_settings(struct umbt_trade *trade)
{
    const uint32_t *taps = trade->options.quick ? taps_quick : taps_full;
    const size_t count = trade->options.quick ? sizeof taps_quick / sizeof *taps_quick
                                              : sizeof taps_full / sizeof *taps_full;
    trade->result_count = 0;
    for (uint32_t b = 0; b < trade->bake_count; b++) {
        for (size_t t = 0; t < count && trade->bakes[b].asset != NULL; t++) {
            trade->results[trade->result_count++] =
                (struct umbt_trade_result){.bake = b, .taps = taps[t]};
        }
    }
}

static enum umb_status measure(struct umbt_trade *trade, struct probe *probes, struct times *times,
                               float *scratch, uint8_t *undefined, struct umb_error *error)
{
    const size_t count = trade->points.count;
    struct umbt_progress progress;
    enum umb_status status = UMB_OK;
    umbt_progress_start(&progress, "settings", trade->options.quiet);
    for (uint32_t i = 0; status == UMB_OK && i < trade->result_count; i++) {
        probes[i] = (struct probe){.trade = trade,
                                   .result = &trade->results[i],
                                   .answers = scratch,
                                   .area = scratch + count,
                                   .undefined = undefined};
        status = probe_prepare(&probes[i], error);
        if (status == UMB_OK) {
            status = errors_find(&probes[i], scratch + 2 * count, error);
        }
        umbt_progress_show(&progress, i + 1, trade->result_count);
    }
    umbt_progress_end(&progress);
    return status == UMB_OK ? times_take(trade, probes, times, error) : status;
}

enum umb_status umbt_trade_measure(struct umbt_trade *trade, struct umb_error *error)
{
    list_settings(trade);
    const struct umb_points points = points_of(trade);
    const size_t count = trade->points.count;
    struct probe *probes = calloc(trade->result_count, sizeof *probes);
    struct times *times = calloc(trade->result_count, sizeof *times);
    float *scratch = calloc(3 * count, sizeof *scratch);
    uint8_t *undefined = calloc(count, 1);
    enum umb_status status = umb_points_check(&points, error);
    if (probes == NULL || times == NULL || scratch == NULL || undefined == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%zu samples do not fit in memory", count);
    }
    if (status == UMB_OK) {
        status = measure(trade, probes, times, scratch, undefined, error);
    }
    free(probes);
    free(times);
    free(scratch);
    free(undefined);
    return status;
}
