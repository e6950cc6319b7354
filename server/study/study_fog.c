/* SPDX-License-Identifier: Apache-2.0 */
/* Light shafts; see study_fog.h. */
#include "study/study_fog.h"

#include <math.h>
#include <string.h>
#include "base/try.h"
#include "study/study_math.h"

#define INTERVALS 256 /* most intervals of a view ray; a ray with more is halved */

enum umb_status umbt_fog_make(const struct umb_asset *asset, uint32_t light, double density,
                              struct umbt_fog *fog, struct umb_error *error)
{
    fog->density = density;
    UMB__TRY(umb_volume_prepare(asset, light, &fog->volume, error));
    /* A lamp's falloff is not known, but would dominate the fog: only parallel light is allowed. */
    return umb_volume_check_parallel(&fog->volume, error);
}

/* The lit integral over the part [from, to] of a ray. */
static double lit_between(const struct umbt_fog *fog, const double eye[3], const double way[3],
                          double from, double to)
{
    const double depth = fog->density * umb__length(way);
    struct umb_interval intervals[INTERVALS];
    struct umb_segment_answer answer;
    struct umb_segment_answers answers = {
        .segments = &answer, .intervals = intervals, .interval_max = INTERVALS};
    double ends[6], sum = 0.0;
    for (int k = 0; k < 3; k++) {
        ends[k] = way[k] * from;
        ends[3 + k] = way[k] * to;
    }
    struct umb_segments segments = {.ends = ends, .format = UMB_POINT_F64, .count = 1};
    memcpy(segments.origin, eye, sizeof segments.origin);
    umb_volume_segments(&fog->volume, &segments, 0, 1, &answers);
    if (answer.interval_count > INTERVALS) {
        /* Halving ends: a piece as long as a voxel crosses few voxels. */
        const double middle = 0.5 * (from + to);
        return lit_between(fog, eye, way, from, middle) + lit_between(fog, eye, way, middle, to);
    }
    for (uint64_t i = 0; i < answer.interval_count; i++) {
        const double begin = from + (to - from) * intervals[i].begin;
        const double end = from + (to - from) * intervals[i].end;
        sum += exp(-depth * begin) - exp(-depth * end);
    }
    return sum;
}

void umbt_fog_look(const struct umbt_fog *fog, const double eye[3], const double end[3],
                   double *through, double *lit)
{
    double way[3];
    umb__subtract(end, eye, way);
    *through = exp(-fog->density * umb__length(way));
    *lit = lit_between(fog, eye, way, 0.0, 1.0);
}
