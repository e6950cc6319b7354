/* SPDX-License-Identifier: Apache-2.0 */
/* See receiver_mask_stage.h. */
#include "query/receiver_mask_stage.h"

#include "format/receiver_mask.h"

bool umb__receiver_mask_is_undefined(const struct umb__query *q, const struct umb_points *points,
                                     size_t i)
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
    return !umb__receiver_mask_has(q->receiver_mask_cells, q->log2_size, voxel);
}

static void receiver_mask_run(const struct umb__query *q, const struct umb_points *points,
                              size_t first, size_t count, struct umb_answers *answers)
{
    q->receiver_mask_inner(q, points, first, count, answers);
    for (size_t i = first; i < first + count; i++) {
        answers->stats.undefined += umb__receiver_mask_is_undefined(q, points, i);
    }
}

void umb__receiver_mask_set(struct umb__query *q, const struct umb__content *content)
{
    q->receiver_mask_cells = content->receiver_mask_cells + q->frustum * UMB__RECEIVER_MASK_WORDS;
    q->receiver_mask_inner = q->run;
    q->run = q->window_run = receiver_mask_run;
}
