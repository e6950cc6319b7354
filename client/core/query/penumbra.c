/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Penumbras of suns: percentage closer soft shadows (Fernando 2005) on the DAG. A search finds the
 * blockers in the cone of the light's rays to the receiver. Their distance gives the width of the
 * penumbra, and a box of that width at the receiver's depth gives the answer. Lamps have the same
 * search in a space of their own (lamp_penumbra.c).
 *
 * The box lies at one depth, and a sloping receiver would shadow itself under it. So the box is
 * moved towards the light until the receiver's plane is behind all of it. The move is along the
 * light, not along the normal, so that no edge is displaced. Only on surfaces that graze the light
 * could the box move past the blockers. There it moves at most half the way to them.
 */
#include "base/try.h"
#include "query/first_occluder.h"
#include "query/lamp_penumbra.h"
#include "query/slice_count.h"
#include "query/stages.h"

/* Greatest distance in texels of a searched column from the receiver: a power of two. */
#define REACH_MAX ((UMB_PENUMBRA_TAPS_MAX + 1) / 2)

/* Width of the box with the area of a disc of radius 1: sqrt(pi). */
#define BOX_OF_DISC 1.7724538509055161

/* Least distance in voxels of a blocker. A receiver at the centre of its own blocker has distance
 * 0, which would be a divisor. */
#define GAP_MIN 0x1p-20

struct search {
    const struct umb__query *q;
    struct umb__occluders occluders;
    double v[3];        /* Position of the receiver in voxel space */
    int64_t x, y;       /* Column of the receiver */
    double gaps, cover; /* Sums of s^2 / g and of s^2 / g^2 over the samples that block */
};

/* Returns the last voxel whose centre is at least `gap` before the receiver; below 0: none. */
static double limit_of(const struct search *s, double gap)
{
    const double size = (double)((uint32_t)1 << s->q->log2_size);
    return fmin(floor(s->v[2] - gap - 0.5), size - 1);
}

/* Returns the least distance before the receiver, in voxels of depth, at which the cone of the
 * light's rays reaches texel `texel` of an axis. */
static double gap_of(const struct search *s, unsigned axis, int64_t texel)
{
    const double away = fabs((double)texel + 0.5 - s->v[axis]) - 0.5;
    return away > 0 ? away / s->q->reach[axis] : 0;
}

/* Samples one column, which stands for stride * stride columns. */
static void add_sample(struct search *s, int64_t x, int64_t y, double stride)
{
    const int64_t size = (int64_t)1 << s->q->log2_size;
    const double limit = limit_of(s, fmax(gap_of(s, 0, x), gap_of(s, 1, y)));
    uint32_t depth;
    if (x < 0 || x >= size || y < 0 || y >= size || !(limit >= 0) ||
        !umb__first_occluder(&s->occluders, (uint32_t)x, (uint32_t)y, (uint32_t)limit, &depth)) {
        return;
    }
    const double gap = fmax(s->v[2] - ((double)depth + 0.5), GAP_MIN);
    s->gaps += stride * stride / gap;
    s->cover += stride * stride / gap / gap;
}

/* Samples columns at distances above `inner` strides, up to `outer`. */
static void add_ring(struct search *s, int64_t inner, int64_t outer, int64_t stride)
{
    for (int64_t j = -outer; j <= outer; j++) {
        const bool across = j < -inner || j > inner;
        for (int64_t i = -outer; i <= outer; i++) {
            if (!across && i == -inner) {
                i = inner + 1; /* Skips the columns of the inner rings */
            }
            add_sample(s, s->x + i * stride, s->y + j * stride, (double)stride);
        }
    }
}

/* Returns whether no column up to `outer` texels away has a blocker at voxel `limit` or before.
 * Where columns stay shadowed behind their first occluder, one slice proves that. */
static bool is_clear(struct search *s, double limit, int64_t outer, struct umb_query_stats *stats)
{
    const struct umb__slice slice = {&s->occluders.tree, stats, (int64_t)limit};
    const struct umb__texels texels = {s->x - outer, s->x + outer, s->y - outer, s->y + outer};
    return s->q->occluder_depth == NULL && !umb__slice_has(&slice, texels, false);
}

/*
 * Searches the cone of a directional light's rays to a receiver for first occluders. In: v: voxel
 * space, |v| < 2^30.
 *
 * A column blocks if its first shadowed voxel's centre lies inside the cone, widened by half a
 * texel: |x + 1/2 - v.x| - 1/2 <= reach.x * (v.z - centre), and the same in y. Columns are sampled
 * in square rings around the receiver's, at distances 0, 1, 2, 3..4, 5..8, 9..16 ... texels; the
 * ring that ends at 4 * s takes every s-th texel, 56 of them. A sample at depth distance g (at
 * least 2^-20 voxels) that stands for s * s texels covers s * s / g^2 of the light's disc, and has
 * this weight in the mean distance. In open frusta one slice proves that a ring has no occluders,
 * for a few node reads.
 *
 * Returns the depth in voxels between receiver and blockers; 0 if nothing blocks.
 */
static double blocker_gap(const struct umb__query *q, const double v[3],
                          struct umb_query_stats *stats)
{
    struct search s = {.q = q,
                       .occluders = {.tree = umb__tree_of(q),
                                     .occluder_depth = q->occluder_depth,
                                     .occluder_depth_root = q->occluder_depth_root,
                                     .last = UINT32_MAX},
                       .v = {v[0], v[1], v[2]},
                       .x = (int64_t)floor(v[0]),
                       .y = (int64_t)floor(v[1])};
    const double reach = fmax(q->reach[0], q->reach[1]);
    add_sample(&s, s.x, s.y, 1);
    for (int64_t outer = 1; outer <= REACH_MAX; outer *= 2) {
        const int64_t inner = outer / 2, stride = outer > 4 ? outer / 4 : 1;
        /* All texels of the ring are at least `inner` away from the receiver's own texel. */
        const double limit = limit_of(&s, (double)inner / reach);
        if (!(limit >= 0)) {
            break; /* the cone ends before */
        }
        if (!is_clear(&s, limit, outer, stats)) {
            add_ring(&s, inner / stride, outer / stride, stride);
        }
    }
    stats->nodes += s.occluders.read.nodes;
    stats->bricks += s.occluders.read.bricks;
    return s.cover > 0 ? s.gaps / s.cover : 0;
}

/* Greatest coordinate in voxels that is looked up. Points beyond it, or with NaN, are lit; the
 * limit is far below that of int64_t. */
#define FAR_VOXELS 0x1p30

/* Slope of the receiver's plane: voxels of depth that it gains per texel in x and in y, never
 * negative. */
struct slope {
    double x, y;
};

/* Returns the slope of a point. The plane n.p = const rises by -n.ex / n.ez voxels a texel. A point
 * without a normal has the normal (1,1,1) in voxels. The slope is 0 if the bias is the caller's. */
static struct slope slope_of(const struct umb__query *q, const struct umb_points *points, size_t i)
{
    double n[3], along[3];
    if (q->bias_mode != UMB_BIAS_AUTO) {
        return (struct slope){0, 0};
    }
    (void)umb__normal(points, i, n);
    for (unsigned k = 0; k < 3; k++) {
        along[k] = fabs(umb__dot(n, q->voxel_step[k]));
    }
    const bool known = along[2] > 0 && along[0] <= UMB__LENGTH2_MAX && along[1] <= UMB__LENGTH2_MAX;
    return known ? (struct slope){along[0] / along[2], along[1] / along[2]} : (struct slope){1, 1};
}

/* Returns the width in texels of the box for a gap of depth between receiver and blocker, at least
 * the query's taps. */
static double width_of(const struct umb__query *q, unsigned axis, double gap)
{
    const double width = BOX_OF_DISC * q->reach[axis] * gap;
    return fmax((double)q->taps, fmin(width, UMB_PENUMBRA_TAPS_MAX));
}

/* Makes the box for a gap between receiver and blocker. Out: z: depth of the box's slice. */
static struct umb__real_box box_of(const struct umb__query *q, const double v[3],
                                   struct slope slope, double gap, int64_t *z)
{
    const struct umb__real_box box = {(int64_t)floor(v[0]), (int64_t)floor(v[1]),
                                      width_of(q, 0, gap), width_of(q, 1, gap)};
    const double taps = (double)q->taps;
    /* The bias moves the point far enough for a window of `taps` texels. A box of this width
     * touches up to two texels more, so the look-up is lifted for the difference. */
    double lift =
        gap > 0 ? 0.5 * (slope.x * (box.width + 2.0 - taps) + slope.y * (box.height + 2.0 - taps))
                : 0;
    lift = fmin(lift, 0.5 * gap);
    *z = (int64_t)floor(v[2] - lift);
    return box;
}

/* Returns whether the receiver is in full shadow whatever the blocker: if the widest box, at the
 * depth nearest to the light, has no lit texel. Only for columns that stay shadowed behind their
 * first occluder. */
static bool is_umbra(const struct umb__query *q, const double v[3], struct slope slope,
                     const struct umb__tree *tree, struct umb_query_stats *stats)
{
    struct umb__slice slice = {tree, stats, 0};
    const struct umb__real_box box = box_of(q, v, slope, v[2], &slice.z);
    const int64_t x = (int64_t)(box.width / 2) + 1, y = (int64_t)(box.height / 2) + 1;
    const struct umb__texels texels = {box.x - x, box.x + x, box.y - y, box.y + y};
    return q->occluder_depth == NULL && !umb__slice_has(&slice, texels, true);
}

/* Returns the lit share of the light's disc that a moved point sees. */
static double penumbra(const struct umb__query *q, const double v[3], struct slope slope,
                       struct umb_query_stats *stats)
{
    const struct umb__tree tree = umb__tree_of(q);
    struct umb__slice slice = {&tree, stats, 0};
    if (is_umbra(q, v, slope, &tree, stats)) {
        return 0;
    }
    const double gap = blocker_gap(q, v, stats);
    const struct umb__real_box box = box_of(q, v, slope, gap, &slice.z);
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
    for (size_t i = first; i < first + count; i++) {
        double v[3], share = 0;
        if (umb__voxel_at(query, points, i, v)) {
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

/* Returns the angular diameter that penumbras use, in radians. */
static double extent_of(const struct umb__plan *plan)
{
    return plan->settings->light_extent > 0 ? plan->settings->light_extent : plan->light->extent;
}

/* Checks that a directional light has an angular extent. */
static enum umb_status check_sun(const struct umb__plan *plan, struct umb_error *error)
{
    const double extent = extent_of(plan);
    return extent > 0 && extent <= UMB_EXTENT_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_UNSUPPORTED,
                          "filter: penumbra: light %u is %g rad across, must be above 0 and at "
                          "most %g; give its extent",
                          plan->settings->light, extent, UMB_EXTENT_MAX);
}

/* Checks that the light has an extent, and that first occluders are known. */
static enum umb_status check(const struct umb__plan *plan, struct umb_error *error)
{
    UMB__TRY(plan->light->kind == UMB_LIGHT_DIRECTIONAL ? check_sun(plan, error)
                                                        : umb__lamp_penumbra_check(plan, error));
    if (plan->frustum->closed && plan->content->occluder_depth == NULL) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "filter: penumbra: light %u was baked under the closed rule, which leaves "
                        "out the depth of first occluders; bake with --effect front=on, or "
                        "--closed off",
                        plan->settings->light);
    }
    return UMB_OK;
}

/* Computes the tangent of 0..1/2 as a continued fraction (Lambert 1761), which gives the same bits
 * on all machines. libm does not promise that. */
static double tangent(double x)
{
    double rest = 17;
    for (int odd = 15; odd > 0; odd -= 2) {
        rest = odd - x * x / rest;
    }
    return x / rest;
}

static void set(const struct umb__plan *plan, struct umb__query *q)
{
    const double slope = tangent(extent_of(plan) / 2);
    const double depth_m = umb__length(q->voxel_step[2]);
    q->occluder_depth = plan->frustum->closed ? plan->content->occluder_depth : NULL;
    if (plan->light->kind != UMB_LIGHT_DIRECTIONAL) {
        return; /* The faces' own roots are read where they are used */
    }
    for (unsigned axis = 0; axis < 2; axis++) {
        q->reach[axis] = slope * depth_m / umb__length(q->voxel_step[axis]);
    }
    if (q->occluder_depth != NULL) {
        q->occluder_depth_root = q->occluder_depth[q->frustum];
    }
}

const struct umb__filter umb__filter_penumbra = {
    .info = {.name = "penumbra", .has_extent = 1},
    .any_light = true,
    .lamp_run = umb__lamp_penumbra,
    .partial = "filter: penumbra: more light may widen one, so that a partial asset cannot tell "
               "what it knows; ask the whole",
    .check = check,
    .kernel = umb__kernel_penumbra,
    .set = set,
    .slice = 512, /* points of 0.3 to 5 us each */
    .work = 32,   /* under a narrow light */
    .work_radian = 900,
    .work_lamp = 300, /* 10 to 60 us */
};
