/* SPDX-License-Identifier: Apache-2.0 */
/* See near_stage.h. */
#include "query/near_stage.h"

#include "format/near.h"

bool umb__near_is_undefined(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    const double size = (double)((uint32_t)1 << q->log2_size);
    double p[3], v[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] = points->origin[axis] - q->origin[axis] + umb__coordinate(points, i, axis);
    }
    if (!umb__move(q, points, i, p)) {
        return false;
    }
    umb__to_voxel(q, p, v);
    if (!(v[0] >= 0 && v[0] < size && v[1] >= 0 && v[1] < size && v[2] >= 0)) {
        return false; /* also for NaN */
    }
    const double last = size - 1;
    const uint32_t voxel[3] = {(uint32_t)v[0], (uint32_t)v[1],
                               (uint32_t)(v[2] < last ? v[2] : last)};
    return !umb__near_has(q->near_cells, q->log2_size, voxel);
}

static void near_run(const struct umb__query *q, const struct umb_points *points, size_t first,
                     size_t count, struct umb_answers *answers)
{
    q->near_inner(q, points, first, count, answers);
    for (size_t i = first; i < first + count; i++) {
        answers->stats.undefined += umb__near_is_undefined(q, points, i);
    }
}

void umb__near_set(struct umb__query *q, const struct umb_content *content)
{
    q->near_cells = content->near_cells + q->frustum * UMB__NEAR_WORDS;
    q->near_inner = q->run;
    q->run = q->window_run = near_run;
}
