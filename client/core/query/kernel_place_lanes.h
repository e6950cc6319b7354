/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_PLACE_LANES_H
#define UMBRAGE_CORE_QUERY_KERNEL_PLACE_LANES_H
/*
 * Places a block many points at a time, a point a lane. Its operations are those of umb__move,
 * umb__to_voxel and umb__window_at, in doubles, in the same order and without contraction, so that
 * every voxel index is the same. If one of eight points is not clearly inside the frustum, all
 * eight go point by point.
 *
 * Lanes are vectors that take the operators of C. A file includes kernel_lanes_avx2.h (four lanes),
 * kernel_lanes_avx512.h (eight) or kernel_lanes_simd128.h (two) before this one. With few lanes it
 * pays to test whether a mask selects no lane or every lane (UMB__LANES_NONE, UMB__LANES_ALL), and
 * to skip the work for the lanes that are not there. With many lanes both tests are always false.
 */
#include "query/kernel_parts.h"

/* Constants of a query and its points, set up once for a batch; all lanes are equal. */
struct umb__lane_placer {
    struct umb__placer plain;
    bool fits;
    bool still;           /* True: offset and push are 0 */
    umb__lanes offset[3]; /* The batch's origin minus the asset's */
    umb__lanes push[3];   /* Bias towards the light, for points without a normal */
    umb__lanes to_voxel[3][4];
    umb__lanes voxel_step[3][3]; /* World vectors of a voxel. This and `direction` serve points with
                                    normals only */
    umb__lanes direction[3];
    umb__eight half;  /* Number of texels before a window's centre */
    umb__eight reach; /* Number of texels from a window's first to its last */
    umb__eight_shift log2_size;
};

static inline void umb__lane_placer_init(const struct umb__query *q,
                                         const struct umb_points *points,
                                         struct umb__lane_placer *placer)
{
    umb__placer_init(q, points, &placer->plain);
    placer->fits = umb__stages_fit(q);
    placer->still = q->no_normal_m == 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        placer->still &= points->origin[axis] == q->origin[axis];
        placer->offset[axis] = UMB__LANES_OF(points->origin[axis] - q->origin[axis]);
        placer->push[axis] = UMB__LANES_OF(q->direction[axis] * q->no_normal_m);
        placer->direction[axis] = UMB__LANES_OF(q->direction[axis]);
        for (unsigned k = 0; k < 4; k++) {
            placer->to_voxel[axis][k] = UMB__LANES_OF(q->world_to_voxel[axis][k]);
        }
        for (unsigned k = 0; k < 3; k++) {
            placer->voxel_step[axis][k] = UMB__LANES_OF(q->voxel_step[axis][k]);
        }
    }
    placer->half = umb__eight_of(q->taps / 2);
    placer->reach = umb__eight_of(q->taps - 1);
    placer->log2_size = umb__eight_shift_of(q->log2_size);
}

static inline umb__lanes umb__lanes_dot(const umb__lanes v[3], const umb__lanes w[3])
{
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2];
}

/* The form of a batch; callers pass constants. */
struct umb__form {
    bool f32, normals;
    bool still;   /* True: points are relative to the asset's origin and have no bias, so they are
                     transformed directly */
    bool windows; /* True: any number of taps; false: one (AVX-512) */
};

/* As struct umb__lift, with a point in each lane. */
struct umb__lanes_lift {
    umb__lanes depth, slope[2];
};

/* Does what umb__lift_auto does, with a point in each lane. Returns the move along n in units of
 * n. */
UMB__INLINE umb__lanes umb__lift_lanes(const struct umb__lane_placer *placer, const umb__lanes n[3],
                                       umb__lanes length2, struct umb__lanes_lift *lift)
{
    const struct umb__query *q = placer->plain.query;
    const umb__lanes zero = UMB__LANES_OF(0);
    umb__lanes along[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        along[axis] = umb__lanes_dot(n, placer->voxel_step[axis]);
    }
    const double taps = (double)q->taps, follows = q->taps > 1 ? 1 : 0;
    const umb__lanes across = UMB__LANES_ABS(along[0]) + UMB__LANES_ABS(along[1]);
    const umb__lanes depth = UMB__LANES_ABS(along[2]), most = UMB__LANES_OF(umb__longest_lift(q));
    const umb__lanes half = UMB__LANES_OF(0.5 * UMB__BIAS_SLACK);
    const umb__lanes rest = half * (UMB__LANES_OF(taps) * across + depth) - most * depth;
    const umb__lane_mask more = UMB__LANES_ABOVE(rest, zero);
    const umb__lanes exact = half * (UMB__LANES_OF(taps - follows) * across + depth) / depth;
    lift->depth = exact;
    for (unsigned axis = 0; axis < 2; axis++) {
        lift->slope[axis] = UMB__LANES_OF(follows) * along[axis] / depth;
    }
    if (UMB__LANES_NONE(more)) {
        return zero;
    }
    lift->depth = UMB__LANES_SELECT(more, most, exact);
    for (unsigned axis = 0; axis < 2; axis++) {
        lift->slope[axis] = UMB__LANES_SELECT(more, zero, lift->slope[axis]);
    }
    return UMB__LANES_SELECT(more, rest / length2, zero);
}

/* Moves points with normals as umb__move does. Returns the lanes whose normal faces away. */
UMB__INLINE unsigned umb__move_lanes(const struct umb__lane_placer *placer, size_t i,
                                     umb__lanes p[3], struct umb__lanes_lift *lift)
{
    const struct umb__query *q = placer->plain.query;
    const uint8_t *normals = placer->plain.points->normals;
    const umb__lanes zero = UMB__LANES_OF(0);
    umb__lanes n[3], scale;
    umb__lanes_load_f32(normals + 12 * i, n);
    const umb__lanes length2 = umb__lanes_dot(n, n);
    umb__lane_mask has =
        UMB__MASK_AND(UMB__LANES_ABOVE(length2, zero),
                      UMB__LANES_AT_LEAST(UMB__LANES_OF(UMB__LENGTH2_MAX), length2));
    const bool all = UMB__LANES_ALL(has);
    *lift = (struct umb__lanes_lift){zero, {zero, zero}};
    if (q->bias_mode == UMB_BIAS_AUTO) {
        scale = umb__lift_lanes(placer, n, length2, lift);
        if (!all) {
            lift->depth = UMB__LANES_SELECT(has, lift->depth, zero);
            lift->slope[0] = UMB__LANES_SELECT(has, lift->slope[0], zero);
            lift->slope[1] = UMB__LANES_SELECT(has, lift->slope[1], zero);
        }
    } else {
        scale = UMB__LANES_OF(q->bias_m) / UMB__LANES_SQRT(length2);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const umb__lanes moved = p[axis] + n[axis] * scale;
        p[axis] = all ? moved : UMB__LANES_SELECT(has, moved, p[axis] - placer->push[axis]);
    }
    umb__lane_mask away = UMB__LANES_AT_LEAST(umb__lanes_dot(n, placer->direction), zero);
    return UMB__MASK_BITS(UMB__MASK_AND(away, has));
}

/* Does what umb__lift_depth does, with a point in each lane. In: v: not negative. at: v,
 * truncated. */
UMB__INLINE umb__lanes umb__lift_depths(const struct umb__lanes_lift *lift, const umb__lanes v[3],
                                        const umb__lane_ints at[3])
{
    const umb__lanes half = UMB__LANES_OF(0.5);
    return lift->slope[0] * (half - (v[0] - UMB__LANES_FROM_INTS(at[0]))) +
           lift->slope[1] * (half - (v[1] - UMB__LANES_FROM_INTS(at[1]))) - lift->depth;
}

/* First texels of windows, with a point in each lane; and bits of the points that are negative or
 * face away. A coordinate beyond 32 bits is INT32_MIN or INT32_MAX. One that is NaN is INT32_MIN,
 * or its lane is in `negative`. */
struct umb__placed_lanes {
    umb__lane_ints axis[3];
    unsigned negative, away;
};

UMB__INLINE struct umb__placed_lanes umb__place_lanes(const struct umb__lane_placer *placer,
                                                      size_t index, struct umb__form form)
{
    const uint8_t *positions = placer->plain.points->positions;
    struct umb__placed_lanes to = {.away = 0};
    struct umb__lanes_lift lift;
    umb__lanes p[3], v[3];
    if (form.f32) {
        umb__lanes_load_f32(positions + 12 * index, p);
    } else {
        umb__lanes_load_f64(positions + 24 * index, p);
    }
    for (unsigned axis = 0; axis < 3 && !form.still; axis++) {
        p[axis] = placer->offset[axis] + p[axis];
    }
    if (form.normals) {
        to.away = umb__move_lanes(placer, index, p, &lift);
    } else if (!form.still) {
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] -= placer->push[axis];
        }
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const umb__lanes *m = placer->to_voxel[axis];
        v[axis] = umb__lanes_dot(p, m) + m[3];
        to.axis[axis] = UMB__LANES_TRUNCATE(v[axis]);
    }
    if (form.normals) {
        v[2] += umb__lift_depths(&lift, v, to.axis);
        to.axis[2] = UMB__LANES_TRUNCATE(v[2]);
    }
    to.negative = umb__lanes_negative(v[0], v[1], v[2]);
    return to;
}

/*
 * Places points index .. index + 7 as lanes i .. i + 7 of the block. Returns the lanes with a
 * look-up in the low byte, and those that face away in the next byte. A lane in neither has a point
 * that is not clearly inside; then all eight lanes are unspecified. A window lies inside if both
 * its ends are below the frustum's size. The size is a power of two, so a test of bits shows that.
 */
UMB__INLINE unsigned umb__place_eight(const struct umb__lane_placer *placer, size_t index,
                                      struct umb__form form, struct umb__block *block, uint32_t i)
{
    umb__lane_ints part[3][8 / UMB__LANES];
    unsigned negative = 0, away = 0;
    for (unsigned k = 0; k < 8 / UMB__LANES; k++) {
        const struct umb__placed_lanes placed =
            umb__place_lanes(placer, index + k * UMB__LANES, form);
        for (unsigned axis = 0; axis < 3; axis++) {
            part[axis][k] = placed.axis[axis];
        }
        negative |= placed.negative << k * UMB__LANES;
        away |= placed.away << k * UMB__LANES;
    }
    umb__eight v[3], ends;
    v[2] = ends = umb__join_ints(part[2]);
    for (unsigned axis = 0; axis < 2; axis++) {
        /* The window's first texel, not its centre. */
        v[axis] = umb__eight_sub(umb__join_ints(part[axis]), placer->half);
        ends = umb__eight_or(ends, v[axis]);
        ends = umb__eight_or(ends, umb__eight_add(v[axis], placer->reach));
    }
    unsigned look = umb__eight_below(ends, placer->log2_size) & ~negative & ~away;
    for (unsigned axis = 0; axis < 3 && away; axis++) {
        v[axis] = umb__eight_clear(v[axis], away); /* Points without a look-up: voxel 0, 0, 0 */
    }
    umb__eight_store(block->x + i, v[0]);
    umb__eight_store(block->y + i, v[1]);
    umb__eight_store(block->z + i, v[2]);
    umb__eight_store((int32_t *)block->lit + i, umb__eight_of(0));
    return look | away << 8;
}

/* Places groups of eight points again, point by point. In: others: bits of points; a group is
 * placed again if one of its points has a bit. */
static inline void umb__place_again(const struct umb__lane_placer *placer, size_t first,
                                    uint64_t others, struct umb__block *block,
                                    struct umb_query_stats *stats)
{
    while (others) {
        const uint32_t i = umb__first_bit(others) & ~7U;
        const uint64_t eight = (uint64_t)0xff << i;
        block->todo &= ~eight;
        umb__place_points(&placer->plain, first + i, block, i, i + 8, stats);
        others &= ~eight;
    }
}

/* Places a block by groups of eight points. Points that must be placed one by one are rare. They
 * are placed after the loop, which therefore has no call and keeps its constants in registers. */
UMB__INLINE void umb__place_eights(const struct umb__lane_placer *placer, size_t first,
                                   struct umb__form form, struct umb__block *block,
                                   struct umb_query_stats *stats)
{
    uint64_t look = 0, away = 0, others = 0;
    uint32_t i = 0;
    for (; i + 8 <= block->size; i += 8) {
        const unsigned lanes = umb__place_eight(placer, first + i, form, block, i);
        const unsigned eight = lanes & 0xff, behind = lanes >> 8;
        look |= (uint64_t)eight << i;
        away |= (uint64_t)((eight | behind) == 0xff ? behind : 0) << i;
        others |= (uint64_t)(~(eight | behind) & 0xff) << i;
    }
    block->todo = look;
    stats->facing_away += umb__count_bits(away);
    if (others) {
        umb__place_again(placer, first, others, block, stats);
    }
    umb__place_points(&placer->plain, first + i, block, i, block->size, stats);
}

static inline void umb__lane_place_block(const struct umb__lane_placer *placer, size_t first,
                                         struct umb__block *block, struct umb_query_stats *stats)
{
    const struct umb_points *points = placer->plain.points;
    const bool f32 = points->format == UMB_POINT_F32, normals = points->normals != NULL;
    if (!placer->fits) {
        umb__place_block(&placer->plain, first, block, stats);
        return;
    }
    if (f32 && !normals && placer->still) {
        umb__place_eights(placer, first, (struct umb__form){true, false, true, false}, block,
                          stats);
    } else if (f32) {
        umb__place_eights(placer, first, (struct umb__form){true, normals, false, false}, block,
                          stats);
    } else {
        umb__place_eights(placer, first, (struct umb__form){false, normals, false, false}, block,
                          stats);
    }
    umb__pad_block(block);
}

#endif
