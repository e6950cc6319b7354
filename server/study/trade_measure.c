/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Every setting against the same samples (trade.h).
 *
 * Errors come from answers that are the same bits in every run, and are summed in the order of the
 * samples, so that a report's errors can be reproduced exactly. Times come from runs interleaved
 * over the settings, so that a machine's mood falls on all of them alike; CPU time of the one
 * thread where one thread is meant, wall time where all are.
 */
#include "study/trade_probe.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "study/parallel_for.h"
#include "study/study_progress.h"
#include "study/study_vec.h"
#include "study/traced_shadow.h"
#include "study/trade_errors.h"
#include "umbrage/curve.h"

#define TRUTH_BLOCK 64
#define CHECKED     1000 /* samples whose area truth is traced twice as finely as well */

static const uint32_t taps_quick[] = {1, 3, 9};
static const uint32_t taps_full[] = {1, 3, 5, 9, 17};
static const uint32_t levels[] = {3, 5}; /* coarse rows, of one tap */

struct umb_points umbt_trade_points_all(const struct umbt_trade *trade)
{
    return (struct umb_points){
        .positions = trade->points.positions,
        .format = UMB_POINT_F64,
        .normals = trade->points.normals,
        .count = trade->points.count,
    };
}

void umbt_trade_ask(const struct umbt_probe *probe, size_t first, size_t count,
                    struct umb_query_stats *stats)
{
    const struct umb_points points = umbt_trade_points_all(probe->trade);
    struct umb_answers answers = {.values = probe->answers};
    umb_query_run(&probe->query, &points, first, count, &answers);
    if (stats != NULL) {
        *stats = answers.stats;
    }
}

/* ---- errors ---- */

void umbt_trade_normal(const struct umbt_trade_points *points, size_t i, double normal[3])
{
    for (int k = 0; k < 3; k++) {
        normal[k] = (double)points->normals[i][k];
    }
    (void)umbt_normalize(normal);
}

static enum umb_status trace_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct umbt_probe *probe = user;
    const struct umbt_trade_points *points = &probe->trade->points;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double normal[3];
        umbt_trade_normal(points, i, normal);
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
static double truth_error(const struct umbt_probe *probe)
{
    const struct umbt_trade_points *points = &probe->trade->points;
    const size_t surface = points->first[UMBT_TRADE_FREE];
    const size_t step = surface > CHECKED ? surface / CHECKED : 1;
    struct umbt_truth finer = probe->truth;
    double sum = 0.0, count = 0.0;
    finer.samples *= 2;
    for (size_t i = 0; i < surface; i += step) {
        double normal[3];
        umbt_trade_normal(points, i, normal);
        const double difference =
            (double)umbt_truth_visibility(&finer, points->positions[i], normal) -
            (double)probe->area[i];
        sum += difference * difference;
        count += 1.0;
    }
    return count > 0.0 ? sqrt(sum / count) : 0.0;
}

static enum umb_status probe_prepare(struct umbt_probe *probe, struct umb_error *error)
{
    const struct umbt_trade *trade = probe->trade;
    const struct umb_query_settings settings = {.taps = probe->result->taps,
                                                .level = probe->result->level};
    probe->bake = &trade->bakes[probe->result->bake];
    probe->truth = (struct umbt_truth){
        .rays = trade->scene.rays,
        .kind = UMBT_TRUTH_AREA,
        .settings = {.taps = probe->result->taps},
        .samples = (uint32_t)trade->options.truth_side,
        .diagonal_m = trade->scene.diagonal_m,
        .frustum = probe->bake->frustum,
        .closed = probe->bake->frustum.closed ? trade->scene.parts.closed : NULL,
    };
    memcpy(probe->truth.to_light, trade->points.to_light, sizeof probe->truth.to_light);
    memcpy(probe->truth.origin, probe->bake->info.origin, sizeof probe->truth.origin);
    return umb_query_prepare(probe->bake->asset, &settings, &probe->query, error);
}

static enum umb_status errors_find(struct umbt_probe *probe, float *wrong, struct umb_error *error)
{
    const struct umbt_trade_points *points = &probe->trade->points;
    struct umb_query_stats stats = {0};
    const double view = (double)points->first[UMBT_TRADE_BORDER];
    umbt_trade_ask(probe, 0, points->first[UMBT_TRADE_BORDER], &stats);
    probe->result->nodes = (double)stats.nodes / view;
    probe->result->bricks = (double)stats.bricks / view;
    umbt_trade_ask(probe, 0, points->count, NULL);
    const enum umb_status status =
        umbt_parallel_for((unsigned)probe->trade->options.threads, points->first[UMBT_TRADE_FREE],
                          TRUTH_BLOCK, trace_block, probe, error);
    if (status == UMB_OK) {
        const struct umbt_judged judged = {points->first[UMBT_TRADE_FREE],
                                           probe->answers,
                                           probe->area,
                                           points->lit,
                                           points->boundary_m,
                                           probe->undefined};
        umbt_errors_area(&judged, probe->result);
        umbt_errors_edges(&judged, wrong, probe->result);
        probe->result->truth_error = truth_error(probe);
    }
    return status;
}

/* ---- all settings ---- */

static void add_setting(struct umbt_trade *trade, uint32_t bake, uint32_t taps, uint32_t level)
{
    if (trade->result_count < UMBT_TRADE_SETTINGS_MAX) {
        trade->results[trade->result_count++] =
            (struct umbt_trade_result){.bake = bake, .taps = taps, .level = level};
    }
}

static void list_settings(struct umbt_trade *trade)
{
    const uint32_t *taps = trade->options.quick ? taps_quick : taps_full;
    const size_t count = trade->options.quick ? sizeof taps_quick / sizeof *taps_quick
                                              : sizeof taps_full / sizeof *taps_full;
    trade->result_count = 0;
    for (uint32_t b = 0; b < trade->bake_count; b++) {
        const struct umbt_trade_bake *bake = &trade->bakes[b];
        for (size_t t = 0; t < count && bake->asset != NULL; t++) {
            add_setting(trade, b, taps[t], 0);
        }
        for (size_t l = 0; l < sizeof levels / sizeof *levels && bake->asset != NULL; l++) {
            if (levels[l] <= umb_level_max(bake->frustum.log2_size)) {
                add_setting(trade, b, 1, levels[l]);
            }
        }
    }
}

static enum umb_status measure(struct umbt_trade *trade, struct umbt_probe *probes, float *scratch,
                               uint8_t *undefined, struct umb_error *error)
{
    const size_t count = trade->points.count;
    struct umbt_progress progress;
    enum umb_status status = UMB_OK;
    umbt_progress_start(&progress, "settings", trade->options.quiet);
    for (uint32_t i = 0; status == UMB_OK && i < trade->result_count; i++) {
        probes[i] = (struct umbt_probe){.trade = trade,
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
    return status == UMB_OK ? umbt_trade_times(trade, probes, error) : status;
}

enum umb_status umbt_trade_measure(struct umbt_trade *trade, struct umb_error *error)
{
    list_settings(trade);
    const struct umb_points points = umbt_trade_points_all(trade);
    const size_t count = trade->points.count;
    struct umbt_probe *probes = calloc(trade->result_count, sizeof *probes);
    float *scratch = calloc(3 * count, sizeof *scratch);
    uint8_t *undefined = calloc(count, 1);
    enum umb_status status = umb_points_check(&points, error);
    if (probes == NULL || scratch == NULL || undefined == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%zu samples do not fit in memory", count);
    }
    if (status == UMB_OK) {
        status = measure(trade, probes, scratch, undefined, error);
    }
    free(probes);
    free(scratch);
    free(undefined);
    return status;
}
