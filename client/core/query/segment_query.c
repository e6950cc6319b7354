/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Lit stretches of segments: a walk from cube to cube through the tree, from voxel to voxel within
 * bricks.
 *
 * Where the segment crosses the plane k of an axis is one expression, crossing() below, whoever
 * asks: it does not depend on the steps taken before (nothing is summed up), and rounding keeps it
 * monotone in k. So a cube of any size is left exactly where the last of its voxels would be, and
 * the walk equals a march through all voxels bit for bit, whatever the tree looks like.
 *
 * Invariant: on every axis the voxel is the one that holds parameter t, crossing(entry) <= t <
 * crossing(exit). Hence each step ends later than it began, passes at least one plane of the
 * frustum, and the walk ends after at most three times its side.
 */
#include "query/volume_parts.h"

/* One axis of a segment in voxel space. */
struct axis {
    double start;   /* voxels */
    double slope;   /* voxels from 0 to 1 */
    double inverse; /* 1 / slope; unused if step is 0 */
    int step;       /* -1, 0, 1 */
    int32_t last;   /* largest voxel index */
    bool endless;   /* the last voxel goes on beyond the frustum: z */
};

struct walk {
    const struct umb__volume *volume;
    struct axis axes[3];
    int32_t voxel[3];
    double t, end; /* the segment is inside the frustum from t to end */
    /* The stretches so far. */
    struct umb_segment_answer *answer;
    struct umb_stretch *kept;
    size_t kept_max;
    bool lit; /* a stretch is open, since: */
    double since;
    struct umb_volume_stats *stats;
};

static inline double crossing(const struct axis *axis, int32_t plane)
{
    return ((double)plane - axis->start) * axis->inverse;
}

/* Where the segment leaves voxels low..high. */
static inline double leaving(const struct axis *axis, int32_t low, int32_t high)
{
    if (axis->step == 0 || (axis->step > 0 && axis->endless && high == axis->last)) {
        return INFINITY;
    }
    return crossing(axis, axis->step > 0 ? high + 1 : low);
}

/* True if the segment is in `voxel` or behind it at t. */
static inline bool has_reached(const struct axis *axis, int32_t voxel, double t)
{
    return crossing(axis, axis->step > 0 ? voxel : voxel + 1) <= t;
}

/*
 * Index of the voxel that holds t, which is `from` or one that comes later, inside the frustum.
 *
 * start + t * slope is off by less than a voxel unless the coordinates are beyond 2^50; then, and
 * where it rounds to the wrong side of a plane, bisection finds the voxel by the crossings alone.
 */
static int32_t voxel_at(const struct axis *axis, double t, int32_t from)
{
    if (axis->step == 0) {
        return from;
    }
    int32_t near = from, far = axis->step > 0 ? axis->last : 0; /* near is reached */
    double guess = floor(axis->start + t * axis->slope);
    double low = axis->step > 0 ? from : far, high = axis->step > 0 ? far : from;
    int32_t voxel = (int32_t)(guess < low ? low : guess > high ? high : guess);
    if ((voxel == near || has_reached(axis, voxel, t)) &&
        (voxel == far || !has_reached(axis, voxel + axis->step, t))) {
        return voxel;
    }
    while (near != far) { /* the distance at least halves each time */
        int32_t middle = near + (far - near + axis->step) / 2;
        if (has_reached(axis, middle, t)) {
            near = middle;
        } else {
            far = middle - axis->step;
        }
    }
    return near;
}

static void close_stretch(struct walk *walk, double t)
{
    struct umb_segment_answer *answer = walk->answer;
    if (answer->stretch_count < walk->kept_max) {
        walk->kept[answer->stretch_count] = (struct umb_stretch){walk->since, t};
    }
    answer->stretch_count++;
    answer->lit += t - walk->since;
    walk->lit = false;
}

/* The segment has this state from t on. */
static inline void put_state(struct walk *walk, bool lit, double t)
{
    if (lit && !walk->lit) {
        walk->lit = true;
        walk->since = t;
    } else if (!lit && walk->lit) {
        close_stretch(walk, t);
    }
}

/* Walks through a brick, voxel by voxel. */
static void cross_brick(struct walk *walk, const uint64_t brick[8])
{
    int32_t *voxel = walk->voxel;
    double leave[3];
    const int32_t base[3] = {voxel[0] & ~7, voxel[1] & ~7, voxel[2] & ~7};
    for (unsigned k = 0; k < 3; k++) {
        leave[k] = leaving(&walk->axes[k], voxel[k], voxel[k]);
    }
    for (;;) {
        put_state(
            walk,
            umb__brick_voxel(brick, (uint32_t)voxel[0], (uint32_t)voxel[1], (uint32_t)voxel[2]),
            walk->t);
        double t = fmin(fmin(leave[0], leave[1]), leave[2]);
        walk->t = t;
        if (t >= walk->end) {
            return;
        }
        bool inside = true;
        for (unsigned k = 0; k < 3; k++) {
            while (leave[k] <= t) { /* once, unless planes are nearer than doubles tell apart */
                voxel[k] += walk->axes[k].step;
                leave[k] = leaving(&walk->axes[k], voxel[k], voxel[k]);
            }
            inside = inside && (voxel[k] & ~7) == base[k];
        }
        if (!inside) {
            return;
        }
    }
}

/* Crosses a uniform cube in one step. */
static void cross_cube(struct walk *walk, const struct umb__place *place)
{
    int32_t side = (int32_t)1 << place->level;
    double t = INFINITY;
    for (unsigned k = 0; k < 3; k++) {
        int32_t low = walk->voxel[k] & -side;
        t = fmin(t, leaving(&walk->axes[k], low, low + side - 1));
    }
    put_state(walk, place->lit, walk->t);
    walk->t = t;
    if (t < walk->end) {
        for (unsigned k = 0; k < 3; k++) {
            walk->voxel[k] = voxel_at(&walk->axes[k], t, walk->voxel[k]);
        }
    }
}

static struct axis make_axis(double start, double slope, uint32_t log2_size, bool endless)
{
    struct axis axis = {.start = start,
                        .slope = slope,
                        .inverse = slope != 0 ? 1 / slope : INFINITY,
                        .last = ((int32_t)1 << log2_size) - 1,
                        .endless = endless};
    axis.step = !isfinite(axis.inverse) ? 0 : slope > 0 ? 1 : -1;
    return axis;
}

/* Narrows [t, end) to where an axis is inside the frustum. */
static void clip_axis(const struct axis *axis, double *t, double *end)
{
    int32_t size = axis->last + 1;
    if (axis->step == 0) {
        bool inside = axis->start >= 0 && (axis->endless || axis->start < size);
        *end = inside ? *end : -1;
        return;
    }
    if (axis->step > 0 || !axis->endless) {
        *t = fmax(*t, crossing(axis, axis->step > 0 ? 0 : size));
    }
    *end = fmin(*end, leaving(axis, 0, axis->last));
}

/* The first voxel that holds t >= 0 on an axis that is inside the frustum there. */
static int32_t first_voxel(const struct axis *axis, double t)
{
    if (axis->step == 0) {
        return axis->start > axis->last ? axis->last : (int32_t)axis->start;
    }
    return voxel_at(axis, t, axis->step > 0 ? 0 : axis->last);
}

static void walk_segment(struct walk *walk)
{
    walk->end = 1;
    for (unsigned k = 0; k < 3; k++) {
        clip_axis(&walk->axes[k], &walk->t, &walk->end);
    }
    if (walk->t > 0 || walk->t >= walk->end) {
        put_state(walk, true, 0); /* it begins outside */
    }
    if (walk->t < walk->end) {
        for (unsigned k = 0; k < 3; k++) {
            walk->voxel[k] = first_voxel(&walk->axes[k], walk->t);
        }
        do {
            struct umb__place place =
                umb__tree_locate(&walk->volume->tree, (uint32_t)walk->voxel[0],
                                 (uint32_t)walk->voxel[1], (uint32_t)walk->voxel[2], walk->stats);
            if (place.brick) {
                cross_brick(walk, place.brick);
            } else {
                cross_cube(walk, &place);
            }
        } while (walk->t < walk->end);
        if (walk->end < 1) {
            put_state(walk, true, walk->end);
        }
    }
    if (walk->lit) {
        close_stretch(walk, 1);
    }
}

/* Ends of segment i in voxels, start and difference; returns its length in metres. */
static double segment_in_voxels(const struct umb__volume *volume,
                                const struct umb_segments *segments, size_t i, double start[3],
                                double slope[3])
{
    double p[2][3], end[3], length2 = 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        double offset = segments->origin[axis] - volume->origin[axis];
        for (unsigned k = 0; k < 2; k++) {
            p[k][axis] =
                offset + umb__scalar_at(segments->ends, segments->format, 6 * i + 3 * k + axis);
        }
        double d = p[1][axis] - p[0][axis];
        length2 += d * d;
    }
    umb__volume_to_voxel(volume, p[0], start);
    umb__volume_to_voxel(volume, p[1], end);
    for (unsigned axis = 0; axis < 3; axis++) {
        slope[axis] = end[axis] - start[axis];
    }
    return sqrt(length2);
}

static bool all_finite(const double a[3], const double b[3])
{
    return isfinite(a[0]) && isfinite(a[1]) && isfinite(a[2]) && isfinite(b[0]) && isfinite(b[1]) &&
           isfinite(b[2]);
}

void umb_segments_run(const struct umb_volume *volume, const struct umb_segments *segments,
                      size_t first, size_t count, struct umb_segment_answers *answers)
{
    const struct umb__volume v = umb__volume_of(volume);
    for (size_t i = first; i < first + count; i++) {
        double start[3], slope[3];
        double length_m = segment_in_voxels(&v, segments, i, start, slope);
        struct walk walk = {
            .volume = &v,
            .answer = &answers->segments[i],
            .kept = answers->stretch_max ? answers->stretches + i * answers->stretch_max : NULL,
            .kept_max = answers->stretch_max,
            .stats = &answers->stats,
        };
        *walk.answer = (struct umb_segment_answer){0};
        if (all_finite(start, slope)) {
            for (unsigned k = 0; k < 3; k++) {
                walk.axes[k] = make_axis(start[k], slope[k], v.tree.log2_size, k == 2);
            }
            walk_segment(&walk);
        } else {
            close_stretch(&walk, 1);
        }
        walk.answer->lit_m = walk.answer->lit * length_m;
    }
}

/* Checks pairs of points; name: what they are. */
static enum umb_status check_pairs(const struct umb_segments *segments, const char *name,
                                   struct umb_error *error)
{
    /* A segment is two points that stand side by side. */
    struct umb_points points = {
        .positions = segments->ends, .format = segments->format, .count = 2 * segments->count};
    memcpy(points.origin, segments->origin, sizeof points.origin);
    struct umb_error bad = {0};
    enum umb_status status = umb_points_check(&points, &bad);
    if (status == UMB_OK) {
        return UMB_OK;
    }
    for (size_t i = 0; i < 6 * segments->count; i++) {
        double value = umb__scalar_at(segments->ends, segments->format, i);
        if (!isfinite(value)) {
            return umb_fail(error, status, "%s[%zu].%c%zu: %g, must be finite", name, i / 6,
                            "xyz"[i % 3], i / 3 % 2, value);
        }
    }
    return umb_fail(error, status, "%s", bad.message);
}

enum umb_status umb_segments_check(const struct umb_segments *segments, struct umb_error *error)
{
    return check_pairs(segments, "segments", error);
}

enum umb_status umb_corners_check(const struct umb_segments *corners, struct umb_error *error)
{
    return check_pairs(corners, "boxes", error);
}
