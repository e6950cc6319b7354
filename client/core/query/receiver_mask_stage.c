/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The stage of assets baked under the static rule. The answers of the other stages stay as they
 * are. Points whose look-up lies in no cell that holds receivers (format/receiver_mask.h) are
 * counted as undefined. Three kinds of points are not counted: points shadowed by their normal,
 * points before the first voxel, and points beyond the frustum in x or y. The last kind counts as
 * outside, even if the point's window reaches into the frustum.
 */
#include "format/receiver_mask.h"
#include "query/stages.h"

bool umb__receiver_mask_is_undefined(const struct umb__query *q, const struct umb_points *points,
                                     size_t i)
{
    const double size = (double)((uint32_t)1 << q->log2_size);
    double v[3];
    if (!umb__voxel_at(q, points, i, v) ||
        !(v[0] >= 0 && v[0] < size && v[1] >= 0 && v[1] < size && v[2] >= 0)) {
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

static bool applies(const struct umb__plan *plan)
{
    return plan->content->receiver_mask_cells != NULL;
}

static void set(const struct umb__plan *plan, struct umb__query *q)
{
    q->receiver_mask_cells =
        plan->content->receiver_mask_cells + q->frustum * UMB__RECEIVER_MASK_WORDS;
    q->receiver_mask_inner = q->run;
    q->run = receiver_mask_run;
}

const struct umb__stage umb__receiver_mask_stage = {applies, set};
