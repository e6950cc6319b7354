/* SPDX-License-Identifier: Apache-2.0 */
/* The blocker search of penumbra.h. */
#include "format/occluder_depth.h"
#include "query/penumbra.h"
#include "query/slice_count.h"

/* A receiver at the centre of its own blocker is no distance from it: voxels, and no division by
 * nothing. */
#define GAP_MIN 0x1p-20

struct search {
    const struct umb__query *q;
    struct umb__tree tree;
    double v[3];        /* of the receiver */
    int64_t x, y;       /* its column */
    uint32_t last;      /* depth of the last blocker: the next one's is often near */
    double gaps, cover; /* sums: s^2 / g and s^2 / g^2 */
    uint32_t count;
    struct umb_volume_stats read;
};

/* First shadowed slice of a brick's column; 8 if there is none. */
static uint32_t slice_of(const uint64_t brick[8], uint32_t x, uint32_t y)
{
    uint32_t z = 0;
    while (z < 8 && umb__brick_voxel(brick, x, y, z)) {
        z++;
    }
    return z;
}

/* First shadowed voxel of a column whose voxel `high` is shadowed, by bisection; ends on any tree,
 * since what is left shrinks. */
static uint32_t first_shadowed(struct search *s, uint32_t x, uint32_t y, uint32_t high)
{
    uint32_t low = 0, probe = s->last < high ? s->last : high / 2;
    while (low < high) {
        const struct umb__place place = umb__tree_locate(&s->tree, x, y, probe, &s->read);
        const uint32_t side = (uint32_t)1 << place.level, from = probe & -side;
        const uint32_t lit = place.brick ? slice_of(place.brick, x, y) : place.lit ? side : 0;
        if (lit == 0) {
            high = from;
        } else if (lit == side) {
            low = from + side;
        } else {
            return from + lit < high ? from + lit : high;
        }
        probe = low + (high - low) / 2;
    }
    return high;
}

/* Finds a column's first occluder if it is not deeper than voxel `limit`. */
static bool find_blocker(struct search *s, uint32_t x, uint32_t y, uint32_t limit, uint32_t *depth)
{
    const struct umb__query *q = s->q;
    if (q->occluder_depth != NULL &&
        umb__occluder_depth_find(q->occluder_depth, q->occluder_depth_root, q->log2_size, x, y,
                                 depth)) {
        return *depth <= limit;
    }
    const struct umb__place place = umb__tree_locate(&s->tree, x, y, limit, &s->read);
    if (place.brick ? umb__brick_voxel(place.brick, x, y, limit) : place.lit) {
        return false;
    }
    *depth = first_shadowed(s, x, y, limit);
    return true;
}

/* Last voxel whose centre is at least `gap` before the receiver; below 0 if there is none. */
static double limit_of(const struct search *s, double gap)
{
    const double size = (double)((uint32_t)1 << s->q->log2_size);
    return fmin(floor(s->v[2] - gap - 0.5), size - 1);
}

/* Depth over which the cone takes to grow to texels so far away on an axis. */
static double gap_of(const struct search *s, unsigned axis, int64_t texel)
{
    const double away = fabs((double)texel + 0.5 - s->v[axis]) - 0.5;
    return away > 0 ? away / s->q->reach[axis] : 0;
}

/* Looks at one column that stands for stride * stride. */
static void add_sample(struct search *s, int64_t x, int64_t y, double stride)
{
    const int64_t size = (int64_t)1 << s->q->log2_size;
    const double limit = limit_of(s, fmax(gap_of(s, 0, x), gap_of(s, 1, y)));
    uint32_t depth;
    if (x < 0 || x >= size || y < 0 || y >= size || !(limit >= 0) ||
        !find_blocker(s, (uint32_t)x, (uint32_t)y, (uint32_t)limit, &depth)) {
        return;
    }
    const double gap = fmax(s->v[2] - ((double)depth + 0.5), GAP_MIN);
    s->gaps += stride * stride / gap;
    s->cover += stride * stride / gap / gap;
    s->last = depth;
    s->count++;
}

/* Columns at distances above `inner` strides, up to `outer`. */
static void add_ring(struct search *s, int64_t inner, int64_t outer, int64_t stride)
{
    for (int64_t j = -outer; j <= outer; j++) {
        const bool across = j < -inner || j > inner;
        for (int64_t i = -outer; i <= outer; i++) {
            if (!across && i == -inner) {
                i = inner + 1; /* over what the rings inside have looked at */
            }
            add_sample(s, s->x + i * stride, s->y + j * stride, (double)stride);
        }
    }
}

/* Whether no column up to `outer` texels away blocks by a voxel that the ring may be blocked by:
 * where columns stay shadowed, one slice says so. */
static bool is_clear(struct search *s, double limit, int64_t outer, struct umb_query_stats *stats)
{
    const struct umb__slice slice = {&s->tree, stats, (int64_t)limit};
    const struct umb__texels texels = {s->x - outer, s->x + outer, s->y - outer, s->y + outer};
    return s->q->occluder_depth == NULL && !umb__slice_has(&slice, texels, false);
}

struct umb__blockers umb__penumbra_search(const struct umb__query *q, const double v[3],
                                          struct umb_query_stats *stats)
{
    struct search s = {.q = q,
                       .tree = umb__tree_of(q),
                       .v = {v[0], v[1], v[2]},
                       .x = (int64_t)floor(v[0]),
                       .y = (int64_t)floor(v[1]),
                       .last = UINT32_MAX};
    const double reach = fmax(q->reach[0], q->reach[1]);
    add_sample(&s, s.x, s.y, 1);
    for (int64_t outer = 1; outer <= UMB__PENUMBRA_REACH_MAX; outer *= 2) {
        const int64_t inner = outer / 2, stride = outer > 4 ? outer / 4 : 1;
        /* The nearest texel of the ring is `inner` away from the receiver's own, or more. */
        const double limit = limit_of(&s, (double)inner / reach);
        if (!(limit >= 0)) {
            break; /* the cone ends before */
        }
        if (!is_clear(&s, limit, outer, stats)) {
            add_ring(&s, inner / stride, outer / stride, stride);
        }
    }
    stats->nodes += s.read.nodes;
    stats->bricks += s.read.bricks;
    return (struct umb__blockers){s.count > 0 ? s.gaps / s.cover : 0, s.count};
}
