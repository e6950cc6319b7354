/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_SEGMENT_WALK_H
#define UMBRAGE_CORE_QUERY_SEGMENT_WALK_H
/*
 * The walk of one line through one frustum, and the intervals that it makes.
 *
 * The line has a parameter s from 0 to 1 in which it crosses plane k of each axis at
 * (place(k) - start) * (1 / slope), where place never falls as k rises. For parallel light s is the
 * segment's own parameter and place(k) = k. Seen from a spot or point light a segment stays one
 * across the light, and the inverse of its distance W along the axis is linear in s; depth is
 * linear in W, so that there place(k) = -1 / (scale k + offset).
 *
 *     struct umb__intervals out = ...;
 *     umb__walk_line(&tree, axes, &line, &out);       for each line of a segment, in order
 *     umb__intervals_end(&out);
 */
#include "query/volume_parts.h"

/* One axis of a line in voxel space. */
struct umb__axis {
    double start;         /* place at 0 */
    double slope;         /* places from 0 to 1 */
    double inverse;       /* 1 / slope; unused if step is 0 */
    int step;             /* -1, 0, 1 */
    int32_t last;         /* largest voxel index */
    bool endless;         /* the last voxel goes on beyond the frustum: z */
    double scale, offset; /* place(k) = -1 / (scale k + offset); scale 0: place(k) = k */
};

/* Which part of its segment a line is: s is u of [from, to], by 1 / near and 1 / far if those
 * differ (the W of its ends); parallel light: from 0, to 1, near and far 1. */
struct umb__line {
    double from, to;
    double near_w, far_w;
};

/* What the lines of a segment make together; zero it but for answer, kept, kept_max and stats. */
struct umb__intervals {
    struct umb_segment_answer *answer;
    struct umb_interval *kept;
    size_t kept_max;
    struct umb_volume_stats *stats;
    bool lit; /* an interval is open, since: */
    double since;
};

/* An axis of parallel light, or across a face; start: place at 0, slope: places from 0 to 1. */
struct umb__axis umb__axis_make(double start, double slope, uint32_t log2_size, bool endless);

/* Walks a line through a frustum; outside of it, and before its first voxel, it is lit. */
void umb__walk_line(const struct umb__tree *tree, const struct umb__axis axes[3],
                    const struct umb__line *line, struct umb__intervals *intervals);

/* Walks a segment before a spot or point light. In: p: its ends, minus the asset's origin. */
void umb__walk_faces(const struct umb__volume *volume, const double p[2][3],
                     struct umb__intervals *out);

/* The segment has this state from t on. */
void umb__intervals_put(struct umb__intervals *out, bool lit, double t);

/* Closes what is open, at 1. */
void umb__intervals_end(struct umb__intervals *out);

#endif
