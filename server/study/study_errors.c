/* SPDX-License-Identifier: Apache-2.0 */
/* Errors of a setting's answers against both truths; see study_probe.h. */
#include "study/study_probe.h"

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

/* Counts of judged samples. */
struct sides {
    size_t light, shadow, undecided, unknown;
    size_t wrong[2], judged[2]; /* of the view, of the border set */
};

/* Adds one sample. Returns its distance from the boundary: 0 if the answer is right. */
static float sample_add(const struct umbt_judged *judged, size_t i, struct sides *sides)
{
    const float off = judged->answers[i] - judged->sharp[i];
    const int set = i >= judged->border;
    sides->judged[set]++;
    if (fabsf(off) < 0.5F) {
        return 0.0F;
    }
    sides->wrong[set]++;
    sides->light += off > 0.5F;
    sides->shadow += off < -0.5F;
    sides->undecided += fabsf(off) == 0.5F;
    if (isfinite(judged->boundary_m[i])) {
        return judged->boundary_m[i];
    }
    sides->unknown++;
    return (float)judged->reach_m;
}

static double share(size_t part, size_t whole)
{
    return whole > 0 ? (double)part / (double)whole : 0.0;
}

/* Returns the least distance that a share of all samples does not exceed. */
static double quantile(const float *sorted, size_t count, double wanted)
{
    const double at = ceil(wanted * (double)count) - 1.0;
    return (double)sorted[at > 0.0 ? (size_t)at : 0];
}

void umbt_errors_edges(const struct umbt_judged *judged, float *off,
                       struct umbt_study_result *result)
{
    struct sides sides = {0};
    size_t count = 0;
    double sum = 0.0;
    for (size_t i = 0; i < judged->count; i++) {
        if (!judged->undefined[i]) {
            off[count] = sample_add(judged, i, &sides);
            sum += (double)off[count++];
        }
    }
    result->false_light = share(sides.light, count);
    result->false_shadow = share(sides.shadow, count);
    result->undecided = share(sides.undecided, count);
    result->off_unknown = share(sides.unknown, count);
    result->wrong = share(sides.wrong[0] + sides.wrong[1], count);
    result->wrong_view = share(sides.wrong[0], sides.judged[0]);
    result->wrong_border = share(sides.wrong[1], sides.judged[1]);
    if (count > 0) {
        qsort(off, count, sizeof *off, compare_floats);
        result->off_mean_m = sum / (double)count;
        result->off_p95_m = quantile(off, count, 0.95);
        result->off_p99_m = quantile(off, count, 0.99);
        result->off_max_m = (double)off[count - 1];
    }
}
