/* SPDX-License-Identifier: Apache-2.0 */
/* See study_truth.h. */
#include "study/study_truth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tool/threads.h"

#define BLOCK   64
#define CHECKED 1000 /* samples that are also traced with twice the rays a side */

struct tracing {
    const struct umbt_study_points *points;
    const struct umbt_truth *truth;
    float *values;
};

static float trace(const struct umbt_truth *truth, const struct umbt_study_points *points, size_t i)
{
    double normal[3];
    umbt_study_normal(points, i, normal);
    return umbt_truth_visibility(truth, points->positions[i], normal);
}

static enum umb_status trace_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct tracing *tracing = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        tracing->values[i] = trace(tracing->truth, tracing->points, i);
    }
    return UMB_OK;
}

/* Estimates the truth's own error, against one with twice the rays a side. */
static double own_error(const struct tracing *tracing)
{
    const size_t surface = tracing->points->first[UMBT_STUDY_FREE];
    const size_t step = surface > CHECKED ? surface / CHECKED : 1;
    struct umbt_truth finer = *tracing->truth;
    double sum = 0.0, count = 0.0;
    finer.samples *= 2;
    for (size_t i = 0; i < surface; i += step) {
        const double difference =
            (double)trace(&finer, tracing->points, i) - (double)tracing->values[i];
        sum += difference * difference;
        count += 1.0;
    }
    return count > 0.0 ? sqrt(sum / count) : 0.0;
}

/* True if both trace the same rays. */
static int is_same(const struct umbt_truth *a, const struct umbt_truth *b)
{
    return a->kind == b->kind && a->settings.taps == b->settings.taps &&
           memcmp(a->frustum.world_to_voxel, b->frustum.world_to_voxel,
                  sizeof a->frustum.world_to_voxel) == 0 &&
           memcmp(a->frustum.voxel_step, b->frustum.voxel_step, sizeof a->frustum.voxel_step) ==
               0 &&
           memcmp(a->origin, b->origin, sizeof a->origin) == 0;
}

enum umb_status umbt_truths_get(struct umbt_study_truths *truths, const struct umbt_probe *probe,
                                const struct umbt_study_truth **truth, struct umb_error *error)
{
    const size_t surface = probe->study->points.first[UMBT_STUDY_FREE];
    for (uint32_t i = 0; i < truths->count; i++) {
        if (is_same(&truths->list[i].rays, &probe->truth)) {
            *truth = &truths->list[i];
            return UMB_OK;
        }
    }
    struct umbt_study_truth *made = &truths->list[truths->count]; /* at most one a setting */
    made->rays = probe->truth;
    made->values = malloc((surface + 1) * sizeof *made->values);
    if (made->values == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "the truth of %zu samples does not fit in memory",
                        surface);
    }
    truths->count++;
    struct tracing tracing = {&probe->study->points, &made->rays, made->values};
    const enum umb_status status = umbu_range_run((unsigned)probe->study->options.threads, surface,
                                                  BLOCK, trace_block, &tracing, error);
    made->error = own_error(&tracing);
    *truth = made;
    return status;
}

void umbt_truths_finish(struct umbt_study_truths *truths)
{
    for (uint32_t i = 0; i < truths->count; i++) {
        free(truths->list[i].values);
    }
    truths->count = 0;
}
