/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Times of every setting and of rays (study_probe.h). Runs are interleaved over the settings, so
 * that a disturbance of the machine affects all of them alike. The least of all runs counts
 * (struct umbt_time). Settings whose least runs differ are run again, but not with --quick. Times
 * of one thread are its CPU time, times of all threads are wall time. Where the processor counts
 * instructions, those of a point are counted too.
 */
#include "study/study_probe.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "tool/threads.h"
#include "study/study_math.h"
#include "tool/clock.h"

#define AREA_RAYS   9 /* rays a side: 81 rays a point */
#define AREA_POINTS 2000
#define ALL_BLOCK   4096
/* Limits of a run with all threads: points, views, and seconds of one thread. They are high enough
 * that the start of the threads hardly counts. */
#define ALL_POINTS 1000000U
#define ALL_PASSES 32U
#define ALL_S      0.02
#define ALL_RUNS   14 /* more do not steady wall time on a busy machine */
#define RUNS_MIN   14 /* runs from different moments, even if the first few agree */

/* Kinds of times of a setting. */
enum {
    VIEW,
    FREE,
    ALL,
    KINDS
};

/* Times of one setting, and of rays, a run each. */
struct times {
    double ns[KINDS][UMBT_STUDY_RUNS_MAX];
    size_t runs[KINDS];
};
struct ray_times {
    double ns[UMBT_RAYS_WAYS][UMBT_STUDY_RUNS_MAX];
    size_t runs;
};

static enum umb_status all_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct umbt_probe *probe = user;
    const size_t view = probe->study->points.first[UMBT_STUDY_BORDER];
    float values[ALL_BLOCK];
    (void)error;
    while (count > 0) { /* repeats the view */
        const size_t at = first % view;
        const size_t room = view - at < count ? view - at : count;
        umbt_probe_query(probe, at, room, values);
        first += room;
        count -= room;
    }
    return UMB_OK;
}

/* Returns the number of passes over the view that keep one thread busy for ALL_S seconds, limited
 * in points. */
static size_t all_passes(size_t view, double ns)
{
    const double wanted = fmin((double)ALL_POINTS, 1e9 * ALL_S / fmax(ns, 1.0)) / (double)view;
    return wanted >= (double)ALL_PASSES ? ALL_PASSES : 1 + (size_t)wanted;
}

/* Times one kind once. Out: ns. Fails: E_NO_MEMORY. */
static enum umb_status time_once(struct umbt_probe *probe, int kind, float *values, double *ns,
                                 struct umb_error *error)
{
    const struct umbt_study_points *points = &probe->study->points;
    const size_t view = points->first[UMBT_STUDY_BORDER];
    const size_t first = kind == FREE ? points->first[UMBT_STUDY_FREE] : 0;
    const size_t count = kind == FREE ? points->count - first : view;
    const size_t passes = kind == ALL ? all_passes(view, probe->result->view.ns) : 1;
    const double start = kind == ALL ? umbu_clock_s() : umbu_thread_cpu_s();
    if (kind == ALL) {
        UMB__TRY(umbu_range_run(probe->study->common.threads, passes * view, ALL_BLOCK, all_block,
                                probe, error));
    } else {
        umbt_probe_query(probe, first, count, values);
    }
    const double end = kind == ALL ? umbu_clock_s() : umbu_thread_cpu_s();
    *ns = 1e9 * (end - start) / (double)(passes * count);
    return UMB_OK;
}

/* Returns the place of a kind's time in a result. */
static struct umbt_time *time_of(struct umbt_study_result *result, int kind)
{
    return kind == VIEW ? &result->view : kind == FREE ? &result->free : &result->all;
}

/* Counts the instructions of a point of the view, at the least. */
static void instructions_count(struct umbt_probe *probe, int counter, float *values)
{
    const size_t view = probe->study->points.first[UMBT_STUDY_BORDER];
    double least = INFINITY;
    for (int i = 0; i < UMBT_LEAST_RUNS; i++) {
        const uint64_t before = umbt_instructions_read(counter);
        umbt_probe_query(probe, 0, view, values);
        least = fmin(least, (double)(umbt_instructions_read(counter) - before));
    }
    probe->result->instructions = counter >= 0 ? least / (double)view : (double)NAN;
}

/* Traces one ray from each start, eight a call; the last few starts are left out. Rays of parallel
 * light only. Returns the number of rays that hit. */
static int rays_by_eight(const struct umbt_study *study, const double (*starts)[3], size_t count,
                         double near, double far)
{
    int sum = 0;
    for (size_t i = 0; i + 8 <= count; i += 8) {
        uint8_t stopped[8];
        umbr_occluded8(study->common.scene.rays, starts + i, study->points.to_light, near, far,
                       stopped);
        for (int k = 0; k < 8; k++) {
            sum += stopped[k];
        }
    }
    return sum;
}

/* Traces the rays of a window of one sample, eight a call; the last call repeats a ray. Returns the
 * number of rays that hit. */
static int window_by_eight(const struct umbt_study *study, const struct umbt_truth *window,
                           size_t i)
{
    enum {
        RAYS = AREA_RAYS * AREA_RAYS,
        CALLS = (RAYS + 7) / 8
    };
    const double pitch = (double)window->settings.taps / AREA_RAYS;
    double normal[3], moved[3], starts[8 * CALLS][3];
    umbt_study_normal(&study->points, i, normal);
    if (!(umb__dot(normal, study->points.to_light) > 0.0)) {
        return 0;
    }
    umbt_truth_move(window, &window->frustum, study->points.positions[i], normal, moved);
    for (int k = 0; k < 8 * CALLS; k++) {
        const int ray = k < RAYS ? k : RAYS - 1;
        const double x = pitch * (ray % AREA_RAYS - AREA_RAYS / 2);
        const double y = pitch * (ray / AREA_RAYS - AREA_RAYS / 2);
        umbt_along(moved, x, window->frustum.voxel_step[0], starts[k]);
        umbt_along(starts[k], y, window->frustum.voxel_step[1], starts[k]);
    }
    return rays_by_eight(study, (const double(*)[3])starts, 8 * CALLS, 0.0,
                         2.0 * window->diagonal_m);
}

/* Traces the rays of the first `count` samples of a set, in one of the ways. Returns the number of
 * hits. */
static int trace(const struct umbt_study *study, const struct umbt_truth *window, int way,
                 size_t count)
{
    const struct umbt_study_points *points = &study->points;
    const double reach = 2.0 * study->common.scene.diagonal_m;
    const size_t first = way == UMBT_RAYS_FREE ? points->first[UMBT_STUDY_FREE] : 0;
    int sum = 0;
    if (way == UMBT_RAYS_VIEW8) {
        return rays_by_eight(study, (const double(*)[3])points->positions, count, 1e-5 * reach,
                             reach);
    }
    for (size_t i = first; i < first + count; i++) {
        double normal[3], towards[3];
        if (way == UMBT_RAYS_AREA) {
            umbt_study_normal(points, i, normal);
            sum += umbt_truth_visibility(window, points->positions[i], normal) > 0.5F;
        } else if (way == UMBT_RAYS_AREA8) {
            sum += window_by_eight(study, window, i);
        } else {
            const double far = umbt_study_towards(points, points->positions[i], towards);
            sum += umbr_occluded(study->common.scene.rays, points->positions[i], towards,
                                 1e-5 * reach, fmin(far, reach));
        }
    }
    return sum;
}

/* Returns 1 if a way of tracing can be used for the light: packets of rays need parallel light. */
static int way_exists(const struct umbt_study *study, int way)
{
    return study->points.lamp == NULL || (way != UMBT_RAYS_VIEW8 && way != UMBT_RAYS_AREA8);
}

/* Times each way of tracing rays once, on the samples of the queries. Returns the number of rays
 * that hit, so that the compiler cannot remove them. */
static int rays_once(const struct umbt_study *study, struct ray_times *times,
                     const struct umbt_truth *window)
{
    const struct umbt_study_points *points = &study->points;
    const size_t view = points->first[UMBT_STUDY_BORDER];
    int sum = 0;
    for (int way = 0; way < UMBT_RAYS_WAYS; way++) {
        const size_t count = way == UMBT_RAYS_FREE ? points->count - points->first[UMBT_STUDY_FREE]
                             : way < UMBT_RAYS_AREA || view < AREA_POINTS ? view
                                                                          : AREA_POINTS;
        const double start = umbu_thread_cpu_s();
        sum += way_exists(study, way) ? trace(study, window, way, count) : 0;
        times->ns[way][times->runs] = 1e9 * (umbu_thread_cpu_s() - start) / (double)count;
    }
    times->runs++;
    return sum;
}

static void rays_conclude(struct umbt_study *study, struct ray_times *times)
{
    for (int way = 0; way < UMBT_RAYS_WAYS; way++) {
        study->rays[way] = umbt_least(times->ns[way], times->runs);
        if (!way_exists(study, way)) {
            study->rays[way] = (struct umbt_time){(double)NAN, 0.0};
        }
    }
}

/* Measures once more each kind of time of one setting that is not steady yet. */
static enum umb_status setting_once(struct umbt_probe *probe, struct times *times, float *values,
                                    struct umb_error *error)
{
    for (int kind = 0; kind < KINDS; kind++) {
        struct umbt_time *time = time_of(probe->result, kind);
        const size_t most = kind == ALL ? ALL_RUNS : UMBT_STUDY_RUNS_MAX;
        const int again = time->spread > UMBT_SPREAD_STEADY && !probe->study->options.quick;
        const size_t wanted = again ? most : RUNS_MIN;
        if (times->runs[kind] < wanted) {
            double *ns = &times->ns[kind][times->runs[kind]++];
            UMB__TRY(time_once(probe, kind, values, ns, error));
            time->ns = time->ns > 0.0 ? fmin(time->ns, *ns) : *ns; /* decides the passes of ALL */
        }
    }
    return UMB_OK;
}

/* Makes one series: interleaved runs of all settings whose times are not steady yet. */
static enum umb_status times_series(struct umbt_study *study, struct umbt_probe *probes,
                                    struct times *times, struct ray_times *rays,
                                    const struct umbt_truth *window, float *values,
                                    struct umb_error *error)
{
    const int rays_too =
        rays->runs < RUNS_MIN ||
        (study->rays[UMBT_RAYS_VIEW].spread > UMBT_SPREAD_STEADY && !study->options.quick);
    for (int run = 0; run < UMBT_STUDY_RUNS; run++) {
        for (uint32_t i = 0; i < study->result_count; i++) {
            UMB__TRY(setting_once(&probes[i], &times[i], values, error));
        }
        study->stopped += rays_too ? rays_once(study, rays, window) : 0;
    }
    for (uint32_t i = 0; i < study->result_count; i++) {
        for (int kind = 0; kind < KINDS; kind++) {
            *time_of(&study->results[i], kind) = umbt_least(times[i].ns[kind], times[i].runs[kind]);
        }
    }
    rays_conclude(study, rays);
    return UMB_OK;
}

static enum umb_status times_measure(struct umbt_study *study, struct umbt_probe *probes,
                                     struct times *times, float *values, struct umb_error *error)
{
    struct umbt_truth window = probes[0].truth.rays;
    struct ray_times rays = {.runs = 0};
    window.samples = AREA_RAYS;
    for (uint32_t i = 0; i < study->result_count; i++) {
        for (int kind = 0; kind < KINDS; kind++) {
            *time_of(&study->results[i], kind) = (struct umbt_time){0.0, INFINITY};
        }
    }
    for (int series = 0; series < UMBT_STUDY_RUNS_MAX / UMBT_STUDY_RUNS; series++) {
        UMB__TRY(times_series(study, probes, times, &rays, &window, values, error));
    }
    const int counter = umbt_instructions_open(study->uncounted, sizeof study->uncounted);
    for (uint32_t i = 0; i < study->result_count; i++) {
        instructions_count(&probes[i], counter, values);
    }
    if (counter >= 0) {
        (void)close(counter);
    }
    return UMB_OK;
}

enum umb_status umbt_study_times(struct umbt_study *study, struct umbt_probe *probes,
                                 struct umb_error *error)
{
    struct times *times = calloc(study->result_count, sizeof *times);
    float *values = malloc(study->points.count * sizeof *values);
    const enum umb_status status =
        times != NULL && values != NULL
            ? times_measure(study, probes, times, values, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "times of %u settings do not fit in memory",
                       study->result_count);
    free(times);
    free(values);
    return status;
}
