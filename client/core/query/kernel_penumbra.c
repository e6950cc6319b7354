/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Percentage closer soft shadows: search, penumbra, box (penumbra.h).
 *
 * The box lies at one depth, and a receiver that slopes under it would shadow itself. So its depth
 * is brought towards the light until the receiver's plane is behind the whole box. Along the light,
 * not along the normal: the box stays where it is across the light, and no edge is displaced. It
 * cannot pass the blockers but on grazing surfaces, since it is half as wide as a cone of the light
 * is high; there it goes half the way to them at most.
 */
#include "query/penumbra.h"
#include "query/slice_count.h"

/* Positions beyond are lit, and far from what an int64_t holds; also what a NaN is. */
#define FAR_VOXELS 0x1p30

/* Slope of the receiver: voxels of depth over a texel, its worst on each axis. */
struct slope {
    double x, y;
};

/* The plane n.p = const rises by -n.ex / n.ez voxels a texel. Without a normal, and where the bias
 * is the caller's: (1,1,1) in voxels, and none. */
static struct slope slope_of(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    float raw[3] = {0, 0, 0};
    double along[3];
    if (q->bias_mode != UMB_BIAS_AUTO) {
        return (struct slope){0, 0};
    }
    if (points->normals) {
        memcpy(raw, (const uint8_t *)points->normals + 12 * i, sizeof raw);
    }
    for (unsigned k = 0; k < 3; k++) {
        const double *step = q->voxel_step[k];
        along[k] =
            fabs((double)raw[0] * step[0] + (double)raw[1] * step[1] + (double)raw[2] * step[2]);
    }
    const bool known = along[2] > 0 && along[0] <= UMB__LENGTH2_MAX && along[1] <= UMB__LENGTH2_MAX;
    return known ? (struct slope){along[0] / along[2], along[1] / along[2]} : (struct slope){1, 1};
}

/* Texels across that a light's cone has after a gap of depth, at least the query's taps. */
static double width_of(const struct umb__query *q, unsigned axis, double gap)
{
    const double width = UMB__PENUMBRA_BOX * q->reach[axis] * gap;
    return fmax((double)q->taps, fmin(width, UMB_PENUMBRA_TAPS_MAX));
}

/* The box around a receiver behind a gap, and the depth of its slice. */
static struct umb__real_box box_of(const struct umb__query *q, const double v[3],
                                   struct slope slope, double gap, int64_t *z)
{
    const struct umb__real_box box = {(int64_t)floor(v[0]), (int64_t)floor(v[1]),
                                      width_of(q, 0, gap), width_of(q, 1, gap)};
    const double taps = (double)q->taps;
    /* The move off the surface was made for `taps`; a box covers a texel more than it is wide on
     * either side, in part. */
    double lift =
        gap > 0 ? 0.5 * (slope.x * (box.width + 2.0 - taps) + slope.y * (box.height + 2.0 - taps))
                : 0;
    lift = fmin(lift, 0.5 * gap);
    *z = (int64_t)floor(v[2] - lift);
    return box;
}

/* Whether the receiver is in full shadow, whatever blocks: so is then the widest box at the depth
 * nearest to the light. Only where columns stay shadowed. */
static bool is_umbra(const struct umb__query *q, const double v[3], struct slope slope,
                     const struct umb__tree *tree, struct umb_query_stats *stats)
{
    struct umb__slice slice = {tree, stats, 0};
    const struct umb__real_box box = box_of(q, v, slope, v[2], &slice.z);
    const int64_t x = (int64_t)(box.width / 2) + 1, y = (int64_t)(box.height / 2) + 1;
    const struct umb__texels texels = {box.x - x, box.x + x, box.y - y, box.y + y};
    return q->occluder_depth == NULL && !umb__slice_has(&slice, texels, true);
}

/* Lit share of the light's disc that a moved point sees. */
static double penumbra(const struct umb__query *q, const double v[3], struct slope slope,
                       struct umb_query_stats *stats)
{
    const struct umb__tree tree = umb__tree_of(q);
    struct umb__slice slice = {&tree, stats, 0};
    if (is_umbra(q, v, slope, &tree, stats)) {
        return 0;
    }
    const struct umb__blockers blockers = umb__penumbra_search(q, v, stats);
    const struct umb__real_box box = box_of(q, v, slope, blockers.gap, &slice.z);
    return umb__slice_share(&slice, &box);
}

static void count_place(const struct umb__query *q, const double v[3],
                        struct umb_query_stats *stats)
{
    const double s = (double)((uint32_t)1 << q->log2_size);
    const bool outside = !(v[0] >= 0 && v[0] < s && v[1] >= 0 && v[1] < s);
    stats->outside += outside;
    stats->before += !outside && !(v[2] >= 0);
    stats->behind += !outside && v[2] >= s;
}

void umb__kernel_penumbra(const struct umb__query *query, const struct umb_points *points,
                          size_t first, size_t count, struct umb_answers *answers)
{
    double offset[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        offset[axis] = points->origin[axis] - query->origin[axis];
    }
    for (size_t i = first; i < first + count; i++) {
        double p[3], v[3], share = 0;
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] = offset[axis] + umb__coordinate(points, i, axis);
        }
        if (umb__move(query, points, i, p)) {
            umb__to_voxel(query, p, v);
            count_place(query, v, &answers->stats);
            const bool near = fabs(v[0]) < FAR_VOXELS && fabs(v[1]) < FAR_VOXELS && v[2] >= 0 &&
                              v[2] < FAR_VOXELS;
            share = near ? penumbra(query, v, slope_of(query, points, i), &answers->stats) : 1;
        } else {
            answers->stats.facing_away++;
        }
        umb__store_share(answers->values, query->format, i, share);
    }
    answers->stats.points += count;
}
