/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See segment_walk.h: from cube to cube through the tree, from voxel to voxel within bricks.
 *
 * One expression, crossing() below, gives the parameter at which the line crosses the plane k of an
 * axis. The value does not depend on earlier steps (nothing is summed up), and rounding keeps it
 * monotone in k. So the line leaves a cube of any size exactly where it leaves the cube's last
 * voxel, and the walk equals a march through all voxels bit for bit, for any tree.
 *
 * Invariant: on every axis the voxel is the one that holds parameter s, crossing(entry) <= s <
 * crossing(exit). Hence each step ends later than it began, passes at least one plane of the
 * frustum, and the walk ends after at most three times its side.
 */
#include "query/segment_walk.h"

#define LEAST_W 0x1p-1000 /* Least W: planes behind the light count as in it */

struct walk {
    const struct umb__tree *tree;
    struct umb__axis axes[3];
    int32_t voxel[3];
    double t, end; /* Range of the line's parameter inside the frustum */
    const struct umb__line *line;
    struct umb__intervals *out;
};

static inline double crossing(const struct umb__axis *axis, int32_t plane)
{
    double place = (double)plane;
    if (axis->scale != 0) { /* Each operation is monotone, and so is their composition */
        double w = axis->scale * place + axis->offset;
        place = -1 / (w > LEAST_W ? w : LEAST_W);
    }
    return (place - axis->start) * axis->inverse;
}

/* Coordinate at s, about. */
static inline double coordinate(const struct umb__axis *axis, double s)
{
    double place = axis->start + s * axis->slope;
    if (axis->scale == 0) {
        return place;
    }
    return ((place < 0 ? -1 / place : INFINITY) - axis->offset) / axis->scale;
}

/* Returns the parameter at which the segment leaves voxels low..high. */
static inline double leaving(const struct umb__axis *axis, int32_t low, int32_t high)
{
    if (axis->step == 0 || (axis->step > 0 && axis->endless && high == axis->last)) {
        return INFINITY;
    }
    return crossing(axis, axis->step > 0 ? high + 1 : low);
}

/* True if the segment is in `voxel` or behind it at t. */
static inline bool has_reached(const struct umb__axis *axis, int32_t voxel, double t)
{
    return crossing(axis, axis->step > 0 ? voxel : voxel + 1) <= t;
}

/*
 * Returns the index, on one axis, of the voxel in which the line is at parameter t: `from` or a
 * later voxel, inside the frustum.
 *
 * start + t * slope is off by less than a voxel unless the coordinates are beyond 2^50. If it is
 * off by more, or on the wrong side of a plane, bisection finds the voxel by the crossings alone.
 */
static int32_t voxel_at(const struct umb__axis *axis, double t, int32_t from)
{
    if (axis->step == 0) {
        return from;
    }
    int32_t near = from, far = axis->step > 0 ? axis->last : 0; /* near is reached */
    double guess = coordinate(axis, t);
    double low = axis->step > 0 ? from : far, high = axis->step > 0 ? far : from;
    int32_t voxel = (int32_t)(guess > low ? guess < high ? guess : high : low); /* also NaN */
    if ((voxel == near || has_reached(axis, voxel, t)) &&
        (voxel == far || !has_reached(axis, voxel + axis->step, t))) {
        return voxel;
    }
    while (near != far) { /* The distance at least halves each time */
        int32_t middle = near + (far - near + axis->step) / 2;
        if (has_reached(axis, middle, t)) {
            near = middle;
        } else {
            far = middle - axis->step;
        }
    }
    return near;
}

static void close_interval(struct umb__intervals *out, double t)
{
    struct umb_segment_answer *answer = out->answer;
    out->lit = false;
    if (!(t > out->since)) {
        return; /* The interval became empty by rounding to the segment's parameter */
    }
    if (answer->interval_count < out->kept_max) {
        out->kept[answer->interval_count] = (struct umb_interval){out->since, t};
    }
    answer->interval_count++;
    answer->lit += t - out->since;
}

void umb__intervals_put(struct umb__intervals *out, bool lit, double t)
{
    if (lit && !out->lit) {
        out->lit = true;
        out->since = t;
    } else if (!lit && out->lit) {
        close_interval(out, t);
    }
}

void umb__intervals_end(struct umb__intervals *out)
{
    if (out->lit) {
        close_interval(out, 1);
    }
}

/* Returns the segment's parameter where the line's is s. */
static double segment_parameter(const struct umb__line *line, double s)
{
    double u = s; /* As for parallel light, where the code below changes nothing */
    if (s <= 0 || s >= 1) {
        return s <= 0 ? line->from : line->to;
    }
    if (line->near_w != line->far_w) {
        double w = line->far_w - s * (line->far_w - line->near_w);
        u = w > 0 ? s * line->near_w / w : 1; /* 0 by rounding alone */
    }
    return fmin(line->from + u * (line->to - line->from), line->to);
}

/* Sets the line's state from s on. */
static inline void put_state(struct walk *walk, bool lit, double s)
{
    if (lit != walk->out->lit) {
        umb__intervals_put(walk->out, lit, segment_parameter(walk->line, s));
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
            while (leave[k] <= t) { /* Once, unless planes are nearer than doubles can tell apart */
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

struct umb__axis umb__axis_make(double start, double slope, uint32_t log2_size, bool endless)
{
    struct umb__axis axis = {.start = start,
                             .slope = slope,
                             .inverse = slope != 0 ? 1 / slope : INFINITY,
                             .last = ((int32_t)1 << log2_size) - 1,
                             .endless = endless};
    axis.step = !isfinite(axis.inverse) ? 0 : slope > 0 ? 1 : -1;
    return axis;
}

/* Narrows the range [t, end) of parameters to the part inside the frustum on one axis. */
static void clip_axis(const struct umb__axis *axis, double *t, double *end)
{
    int32_t size = axis->last + 1;
    if (axis->step == 0) {
        double at = coordinate(axis, 0);
        bool inside = at >= 0 && (axis->endless || at < size);
        *end = inside ? *end : -1;
        return;
    }
    if (axis->step > 0 || !axis->endless) {
        *t = fmax(*t, crossing(axis, axis->step > 0 ? 0 : size));
    }
    *end = fmin(*end, leaving(axis, 0, axis->last));
}

/* Returns the first voxel on an axis that holds t >= 0. In: t: a parameter at which the line is
 * inside the frustum on this axis. */
static int32_t first_voxel(const struct umb__axis *axis, double t)
{
    if (axis->step == 0) {
        double at = coordinate(axis, 0);
        return at > axis->last ? axis->last : (int32_t)at;
    }
    return voxel_at(axis, t, axis->step > 0 ? 0 : axis->last);
}

void umb__walk_line(const struct umb__tree *tree, const struct umb__axis axes[3],
                    const struct umb__line *line, struct umb__intervals *intervals)
{
    struct walk walk = {.tree = tree,
                        .axes = {axes[0], axes[1], axes[2]},
                        .end = 1,
                        .line = line,
                        .out = intervals};
    for (unsigned k = 0; k < 3; k++) {
        clip_axis(&walk.axes[k], &walk.t, &walk.end);
    }
    if (walk.t > 0 || walk.t >= walk.end) {
        put_state(&walk, true, 0); /* it begins outside */
    }
    if (walk.t >= walk.end) {
        return;
    }
    for (unsigned k = 0; k < 3; k++) {
        walk.voxel[k] = first_voxel(&walk.axes[k], walk.t);
    }
    do {
        struct umb__place place =
            umb__tree_locate(tree, (uint32_t)walk.voxel[0], (uint32_t)walk.voxel[1],
                             (uint32_t)walk.voxel[2], intervals->stats);
        if (place.brick) {
            cross_brick(&walk, place.brick);
        } else {
            cross_cube(&walk, &place);
        }
    } while (walk.t < walk.end);
    if (walk.end < 1) {
        put_state(&walk, true, walk.end);
    }
}
