/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_SEGMENT_WALK_H
#define UMBRAGE_CORE_QUERY_SEGMENT_WALK_H
/*
 * The walk of one line through one frustum, and the intervals that it makes.
 *
 * The line has a parameter s from 0 to 1 in which it crosses plane k of each axis at (place(k) -
 * start) * (1 / slope), where place never falls as k rises. For parallel light s is the segment's
 * own parameter and place(k) = k. Seen from a spot or point light, a segment is a straight line
 * across the light, and 1 / W, where W is the distance along the axis, is linear in s. Depth is
 * linear in W, so on the depth axis place(k) = -1 / (scale k + offset).
 *
 *     struct umb__intervals out = ...;
 *     umb__walk_line(&tree, axes, &line, &out);       for each line of a segment, in order
 *     umb__intervals_end(&out);
 */
#include "query/volume_parts.h"

/* One axis of a line in voxel space. */
struct umb__axis {
    double start;         /* Place at s = 0 */
    double slope;         /* Change of the place from s = 0 to s = 1 */
    double inverse;       /* Inverse of the slope; unused if step is 0 */
    int step;             /* Direction in which voxels are passed: -1, 0, 1 */
    int32_t last;         /* Largest voxel index */
    bool endless;         /* True if the last voxel continues beyond the frustum: z */
    double scale, offset; /* place(k) = -1 / (scale k + offset); scale 0: place(k) = k */
};

/* Part of a segment that a line covers, as parameters of the segment, and W at the line's two ends.
 * For parallel light the part is 0 to 1, and both W are 1. */
struct umb__line {
    double from, to;
    double near_w, far_w;
};

/* Lit intervals of one segment's lines. Zero it, then set answer, kept, kept_max and stats. */
struct umb__intervals {
    struct umb_segment_answer *answer;
    struct umb_interval *kept;
    size_t kept_max;
    struct umb_volume_stats *stats;
    bool lit;     /* True while an interval is open */
    double since; /* Parameter of the segment at which the open interval begins */
};

/* Makes an axis of parallel light, or an axis across a face. In: start: place of the line at
 * parameter 0. slope: places that the line crosses from parameter 0 to 1. */
struct umb__axis umb__axis_make(double start, double slope, uint32_t log2_size, bool endless);

/* Walks a line through a frustum. Space beside the frustum, and before its first voxel, is lit. */
void umb__walk_line(const struct umb__tree *tree, const struct umb__axis axes[3],
                    const struct umb__line *line, struct umb__intervals *intervals);

/* Sets the segment's state from t on. */
void umb__intervals_put(struct umb__intervals *out, bool lit, double t);

/* Closes an open interval at 1. */
void umb__intervals_end(struct umb__intervals *out);

#endif
