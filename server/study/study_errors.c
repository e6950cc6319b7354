/* SPDX-License-Identifier: Apache-2.0 */
/* See study_errors.h. */
#include "study/study_errors.h"

#include <math.h>
#include <stdlib.h>

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

void umbt_errors_area(const struct umbt_judged *judged, struct umbt_study_result *result)
{
    static const double limits[3] = {0.01, 0.1, 0.5};
    double squares = 0.0, counts[3] = {0.0, 0.0, 0.0};
    for (size_t i = 0; i < judged->count; i++) {
        if (judged->undefined[i]) {
            result->undefined++;
            continue;
        }
        const double difference = fabs((double)judged->answers[i] - (double)judged->area[i]);
        result->judged++;
        squares += difference * difference;
        result->worst = difference > result->worst ? difference : result->worst;
        for (int k = 0; k < 3; k++) {
            counts[k] += difference > limits[k] ? 1.0 : 0.0;
        }
    }
    const double count = result->judged > 0 ? (double)result->judged : 1.0;
    result->rms = sqrt(squares / count);
    result->over_001 = counts[0] / count;
    result->over_01 = counts[1] / count;
    result->over_05 = counts[2] / count;
}

/* Statistics of the distances of wrong answers, in any order. */
static void distances_conclude(float *wrong, size_t wrongs, struct umbt_study_result *result)
{
    qsort(wrong, wrongs, sizeof *wrong, compare_floats);
    result->off_p50_m = (double)wrong[wrongs / 2];
    result->off_p95_m = (double)wrong[wrongs - 1 - wrongs / 20];
    result->off_max_m = (double)wrong[wrongs - 1];
}

void umbt_errors_edges(const struct umbt_judged *judged, float *wrong,
                       struct umbt_study_result *result)
{
    size_t light = 0, shadow = 0, undecided = 0, wrongs = 0, unknown = 0;
    for (size_t i = 0; i < judged->count; i++) {
        const int says_lit = judged->answers[i] > 0.5F, says_shadowed = judged->answers[i] < 0.5F;
        if (judged->undefined[i] || (judged->lit[i] ? says_lit : says_shadowed)) {
            continue;
        }
        light += (size_t)says_lit;
        shadow += (size_t)says_shadowed;
        undecided += !says_lit && !says_shadowed;
        if (isfinite(judged->boundary_m[i])) {
            wrong[wrongs++] = judged->boundary_m[i];
        } else {
            unknown++;
        }
    }
    const double count = result->judged > 0 ? (double)result->judged : 1.0;
    result->false_light = (double)light / count;
    result->false_shadow = (double)shadow / count;
    result->undecided = (double)undecided / count;
    result->off_unknown = wrongs + unknown > 0 ? (double)unknown / (double)(wrongs + unknown) : 0.0;
    if (wrongs > 0) {
        distances_conclude(wrong, wrongs, result);
    }
}
