/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Times of every setting and of rays (study_probe.h). Runs are interleaved over the settings, so
 * that a disturbance of the machine affects all of them alike. Settings whose runs differ too much
 * are timed again. Times of one thread are its CPU time, times of all threads are wall time.
 */
#include "study/study_probe.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

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
#define ATTEMPTS   4 /* attempts at times whose runs agree */

/* Times of one setting, and of rays, a run each. */
struct times {
    double view[UMBT_STUDY_RUNS], free[UMBT_STUDY_RUNS], all[UMBT_STUDY_RUNS];
};
struct ray_times {
    double ns[UMBT_RAYS_WAYS][UMBT_STUDY_RUNS];
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

static enum umb_status time_once(struct umbt_probe *probe, struct times *times, int run,
                                 float *values, struct umb_error *error)
{
    const struct umbt_study_points *points = &probe->study->points;
    const size_t view = points->first[UMBT_STUDY_BORDER];
    const size_t first_free = points->first[UMBT_STUDY_FREE];
    double start = umbu_thread_cpu_s();
    umbt_probe_query(probe, 0, view, values);
    times->view[run] = 1e9 * (umbu_thread_cpu_s() - start) / (double)view;
    start = umbu_thread_cpu_s();
    umbt_probe_query(probe, first_free, points->count - first_free, values);
    times->free[run] = 1e9 * (umbu_thread_cpu_s() - start) / (double)(points->count - first_free);
    const size_t passes = all_passes(view, times->view[run]);
    start = umbu_clock_s();
    const enum umb_status status = umbu_range_run(probe->study->common.threads, passes * view,
                                                  ALL_BLOCK, all_block, probe, error);
    times->all[run] = 1e9 * (umbu_clock_s() - start) / (double)(passes * view);
    return status;
}

/* Traces one ray from each start, eight a call; the last few starts are left out. Returns the
 * number of rays that hit. */
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

/* Traces the rays of the first `count` samples of a set one way. Returns the number of hits. */
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
        if (way == UMBT_RAYS_AREA) {
            double normal[3];
            umbt_study_normal(points, i, normal);
            sum += umbt_truth_visibility(window, points->positions[i], normal) > 0.5F;
        } else if (way == UMBT_RAYS_AREA8) {
            sum += window_by_eight(study, window, i);
        } else {
            sum += umbr_occluded(study->common.scene.rays, points->positions[i], points->to_light,
                                 1e-5 * reach, reach);
        }
    }
    return sum;
}

/* Times each way of tracing rays once, on the samples of the queries. Returns the number of rays
 * that hit, so that the compiler cannot remove them. */
static int rays_once(const struct umbt_study *study, struct ray_times *times, int run,
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
        sum += trace(study, window, way, count);
        times->ns[way][run] = 1e9 * (umbu_thread_cpu_s() - start) / (double)count;
    }
    return sum;
}

/* Keeps a time if its runs are steadier than those of the time before. */
static void keep_steadier(double runs[UMBT_STUDY_RUNS], struct umbt_time *kept)
{
    const struct umbt_time time = umbt_median(runs, UMBT_STUDY_RUNS);
    *kept = time.spread < kept->spread ? time : *kept;
}

static void rays_conclude(struct umbt_time rays[UMBT_RAYS_WAYS], struct ray_times *times)
{
    struct umbt_time made[UMBT_RAYS_WAYS];
    for (int way = 0; way < UMBT_RAYS_WAYS; way++) {
        made[way] = umbt_median(times->ns[way], UMBT_STUDY_RUNS);
    }
    if (made[UMBT_RAYS_VIEW].spread < rays[UMBT_RAYS_VIEW].spread) {
        memcpy(rays, made, sizeof made);
    }
}

static int is_noisy(const struct umbt_study_result *result)
{
    return fmax(result->view.spread, fmax(result->free.spread, result->all.spread)) >
           UMBT_SPREAD_MAX;
}

/* Makes one attempt: interleaved runs of all settings whose times are not steady yet. */
static enum umb_status times_attempt(struct umbt_study *study, struct umbt_probe *probes,
                                     struct times *times, const struct umbt_truth *window,
                                     float *values, struct umb_error *error)
{
    struct ray_times rays;
    const int rays_too = study->rays[UMBT_RAYS_VIEW].spread > UMBT_SPREAD_MAX;
    for (int run = 0; run < UMBT_STUDY_RUNS; run++) {
        for (uint32_t i = 0; i < study->result_count; i++) {
            UMB__TRY(is_noisy(&study->results[i])
                         ? time_once(&probes[i], &times[i], run, values, error)
                         : UMB_OK);
        }
        if (rays_too) {
            study->stopped += rays_once(study, &rays, run, window);
        }
    }
    for (uint32_t i = 0; i < study->result_count; i++) {
        if (is_noisy(&study->results[i])) {
            keep_steadier(times[i].view, &study->results[i].view);
            keep_steadier(times[i].free, &study->results[i].free);
            keep_steadier(times[i].all, &study->results[i].all);
        }
    }
    if (rays_too) {
        rays_conclude(study->rays, &rays);
    }
    return UMB_OK;
}

enum umb_status umbt_study_times(struct umbt_study *study, struct umbt_probe *probes,
                                 struct umb_error *error)
{
    struct times *times = calloc(study->result_count, sizeof *times);
    float *values = malloc(study->points.count * sizeof *values);
    if (times == NULL || values == NULL) {
        free(times);
        free(values);
        return umb_fail(error, UMB_E_NO_MEMORY, "times of %u settings do not fit in memory",
                        study->result_count);
    }
    struct umbt_truth window = probes[0].truth;
    enum umb_status status = UMB_OK;
    window.samples = AREA_RAYS;
    study->rays[UMBT_RAYS_VIEW].spread = INFINITY;
    for (uint32_t i = 0; i < study->result_count; i++) {
        struct umbt_study_result *result = &study->results[i];
        result->view.spread = result->free.spread = result->all.spread = INFINITY;
    }
    for (int attempt = 0; attempt < ATTEMPTS && status == UMB_OK; attempt++) {
        status = times_attempt(study, probes, times, &window, values, error);
    }
    free(times);
    free(values);
    return status;
}
