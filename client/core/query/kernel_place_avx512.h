/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_PLACE_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_PLACE_AVX512_H
/*
 * Places a block sixteen points at a time with AVX-512. Fixed point is used where it provably gives
 * the same voxels as kernel_place_lanes.h, which places all other points.
 *
 * Fixed point: doubles from 2^20 to 2^21 have units of 2^-32. In the sum of 2^20 and a voxel
 * coordinate, the upper half of the bits is a constant plus the voxel's index, and the lower half
 * is the fraction. Conversions and most comparisons are then free. Three fused multiply-adds a
 * coordinate make the sum. They start from a constant that includes 2^20, the batch's origin and
 * the bias.
 *
 * Error: this sum differs from that of umb__to_voxel by roundings only. For points within `reach`
 * the absolute values of all terms add up to at most 2^20. The roundings, in units of 2^-32:
 *  - umb__to_voxel rounds each term at most six times: twice the position, once the product, three
 *    times the sum. Each time it is by at most 2^-53 of 2^20, half a unit: 3 units.
 *  - The constant rounds each term at most five times, and 2^20 is added: 3 units.
 *  - Each of the three additions rounds a number below 2^21: 1.5 units.
 *
 * Test: the two sums differ by less than UMB__FIXED_SLACK units, which are added to the constant.
 * If the fraction is at least twice that, the sum of umb__to_voxel has the same floor and is no
 * integer. If the index is also inside the frustum, so is the point. A window begins taps / 2
 * texels before the point's texel, and is inside if both its ends are. If the test fails for any
 * point of a block, the whole block is placed again by kernel_place_lanes.h. One coordinate in 2^27
 * is in such doubt.
 *
 * Normals of a given bias: points are moved along their normals n by lengths computed in floats (u
 * = 2^-24), added as voxels. n.n must be between 1/4 and 4, and N is the greatest |n_k|. A is the
 * sum of |m_k| over an axis's row m. The roundings: the product of the normal and a row rounds each
 * constant, one product and two fused ones, 4 u of the sum of its terms; the length, its quotient
 * by the root of n.n and the last product have 8 u. So the slack grows by 32 u times the length
 * times A, rounded up to a power of two, so that fractions are tested by their bits.
 *
 * Normals of the automatic bias (umb__lift_auto): all in doubles (w = 2^-53), with n.n between 1/4
 * and 4 and one reciprocal for all quotients. With l the lengths of a voxel's edges, a lift of
 * `most` voxels or less has |n.ez| >= |n| l2 / (sqrt(18) r), where r is (l0 + l1) / 2 over the
 * shorter of l0 and l1. That bounds the rounding of the quotients by 150 w r most voxels; queries
 * for which this bound is above half a unit do not use fixed point. Nor do queries with moves of
 * UMB__MOVE_MOST voxels along the normal, whose rounding is 10 w of their length. Each adds half a
 * unit, and so do the sums of the point and its move, of the step, of the two slopes and of the
 * lift: 12 units in all. Slopes add up to at most 2 most / taps, and multiply the error of a
 * fraction: the slack grows by that factor. Whether a lift is the longest is in doubt where the
 * rest is within 64 w of the sum of its terms' greatest values.
 *
 * Facing away: a normal faces away if its product with the light's direction d is not negative.
 * With D the sum of |d_k|, the product in floats is off by at most 4 u D N. Within 8 u D N of zero
 * it is computed again in doubles, as in umb__move.
 */
#include "query/kernel_lanes_avx512.h"
#include "query/kernel_place_lanes.h"

/* Slack in units of 2^-32 voxels: more than the error derived above. The second is the most that
 * normals may add: a thousandth of a voxel. */
#define UMB__FIXED_SLACK 16
#define UMB__FIXED_MOST  (1 << 22)
#define UMB__FLOATS_MOST 1e10 /* Largest number computed with in floats: nothing overflows */
#define UMB__MOVE_MOST   1e5  /* Voxels of an automatic move: it rounds by half a unit */
#define UMB__FIXED_BASE  (1 << 20)
#define UMB__FIXED_HIGH  0x41300000 /* Upper half of the bits of the double 2^20 */

struct umb__wide_placer {
    struct umb__lane_placer exact;
    bool fits;
    double reach; /* Largest absolute value of a coordinate in the batch */
    __m512d to_voxel[3][3], base[3];
    __m512i beyond; /* Bits that no index inside the frustum has */
    /* Number of texels before a window's centre, and from its first to its last */
    __m512i half, span;
    __m512i sure; /* Bits of which a sure fraction has at least one */
    /* For points with normals. */
    bool automatic; /* True: the bias is automatic */
    bool follows;   /* True: lifts count from the plane's depth at the centre of a texel */
    __m512 row[3][3];
    __m512 direction[3];
    __m512 doubt;      /* Largest product with the direction whose sign is in doubt */
    __m512 length;     /* Length of a given bias in metres */
    __m512d centre;    /* Fraction of the centre of a texel, in fixed point */
    double rest_doubt; /* Largest rest of a lift whose sign is in doubt */
};

/* Returns the nearest float; for numbers too large, any float. */
static inline float umb__float_of(double value)
{
    return (float)fmax(fmin(value, 1e30), -1e30);
}

/* Sets up the automatic bias. Returns its greatest length along a normal; infinite if the roundings
 * of the lift are too large. */
static inline double umb__wide_lift_init(const struct umb__query *q,
                                         struct umb__wide_placer *placer)
{
    const double half = 0.5 * UMB__BIAS_SLACK, most = umb__longest_lift(q);
    double sums[3], length[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *step = q->voxel_step[axis];
        sums[axis] = fabs(step[0]) + fabs(step[1]) + fabs(step[2]);
        length[axis] = umb__length(step);
    }
    const double longest = half * ((double)q->taps * (sums[0] + sums[1]) + sums[2]);
    const double least = fmin(length[0], length[1]);
    const double uneven = least > 0 ? (length[0] + length[1]) / 2 / least : INFINITY;
    placer->follows = q->taps > 1;
    placer->rest_doubt = 64 * 0x1p-53 * 2 * (longest + most * sums[2]); /* N is 2 at most */
    return 150 * 0x1p-53 * uneven * most <= 0.5 * 0x1p-32 ? longest : INFINITY;
}

/* Sets up the constants for points with normals. Returns the greatest length of a bias. */
static inline double umb__wide_mover_init(const struct umb__query *q,
                                          struct umb__wide_placer *placer)
{
    double light = 0;
    placer->automatic = q->bias_mode == UMB_BIAS_AUTO;
    placer->follows = false;
    for (unsigned axis = 0; axis < 3; axis++) {
        light += fabs(q->direction[axis]);
        placer->direction[axis] = _mm512_set1_ps(umb__float_of(q->direction[axis]));
        for (unsigned k = 0; k < 3; k++) {
            placer->row[axis][k] = _mm512_set1_ps(umb__float_of(q->world_to_voxel[axis][k]));
        }
    }
    placer->length = _mm512_set1_ps(umb__float_of(q->bias_m));
    placer->doubt = _mm512_set1_ps(umb__float_of(8 * 0x1p-24 * 2 * light)); /* N is 2 at most */
    const double longest = placer->automatic ? umb__wide_lift_init(q, placer) : fabs(q->bias_m);
    return light < UMB__FLOATS_MOST ? longest : INFINITY;
}

/* Returns the slack for normals: a power of two. In: voxels: greatest length of a bias in
 * voxels. */
static inline int32_t umb__wide_slack(const struct umb__query *q,
                                      const struct umb__wide_placer *placer, double voxels)
{
    const double slopes = placer->follows ? 2 * umb__longest_lift(q) / q->taps : 0;
    const double wanted = placer->automatic ? UMB__FIXED_SLACK * (1 + slopes)
                                            : UMB__FIXED_SLACK + 32 * 0x1p-24 * 0x1p32 * voxels;
    int32_t slack = UMB__FIXED_SLACK;
    while (slack < UMB__FIXED_MOST && slack < wanted) {
        slack *= 2;
    }
    return slack;
}

/* Sets up the placing of points along one voxel axis. Returns the constant to which a point's three
 * products are added. Raises *most to the largest voxel coordinate that such a sum can reach. */
static inline double umb__wide_base(const struct umb__query *q, const struct umb_points *points,
                                    unsigned axis, double longest, double *most)
{
    const double *m = q->world_to_voxel[axis];
    const double lift = longest > 0 ? 2 * umb__longest_lift(q) : 0; /* With its slopes */
    double base = m[3], far = fabs(m[3]) + lift, steep = 0;
    for (unsigned k = 0; k < 3; k++) {
        const double offset = points->origin[k] - q->origin[k];
        const double push = points->normals == NULL ? q->direction[k] * q->no_normal_m : 0;
        base += m[k] * (offset - push);
        far += fabs(m[k]) * (fabs(offset) + fabs(push) + 2 * longest);
        steep += fabs(m[k]);
    }
    *most = (0.999 * UMB__FIXED_BASE - far) / steep;
    return base;
}

static inline void umb__wide_placer_init(const struct umb__query *q,
                                         const struct umb_points *points,
                                         struct umb__wide_placer *placer)
{
    double reach = INFINITY, steepest = 0;
    umb__lane_placer_init(q, points, &placer->exact);
    const double bias = umb__wide_mover_init(q, placer);
    const double longest = points->normals != NULL ? bias : 0;
    placer->fits = q->log2_size < 20 && placer->exact.fits;
    double base[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *m = q->world_to_voxel[axis];
        double most;
        base[axis] = umb__wide_base(q, points, axis, longest, &most);
        placer->fits &= most > 0; /* Also false for NaN */
        reach = most < reach ? most : reach;
        steepest = fmax(steepest, fabs(m[0]) + fabs(m[1]) + fabs(m[2]));
        for (unsigned k = 0; k < 3; k++) {
            placer->to_voxel[axis][k] = _mm512_set1_pd(m[k]);
        }
    }
    const int32_t slack =
        longest > 0 ? umb__wide_slack(q, placer, steepest * longest) : UMB__FIXED_SLACK;
    placer->fits &= slack < UMB__FIXED_MOST && steepest < UMB__FLOATS_MOST;
    placer->fits &= !placer->automatic || steepest * longest < UMB__MOVE_MOST;
    placer->fits &= longest < UMB__FLOATS_MOST; /* Also false for NaN */
    placer->sure = _mm512_set1_epi32(-2 * slack);
    placer->centre = _mm512_set1_pd(0.5 + slack * 0x1p-32);
    for (unsigned axis = 0; axis < 3; axis++) {
        placer->base[axis] = _mm512_set1_pd(base[axis] + (UMB__FIXED_BASE + slack * 0x1p-32));
    }
    placer->reach = reach;
    placer->beyond = _mm512_set1_epi32(-((int32_t)1 << q->log2_size));
    placer->half = _mm512_set1_epi32(q->taps / 2);
    placer->span = _mm512_set1_epi32(q->taps - 1);
}

/* Coordinates of sixteen points, by axis; low: of the first eight. */
struct umb__sixteen {
    __m512d low[3], high[3];
    __mmask16 near; /* points within reach */
};

/*
 * Returns the point that each lane holds after umb__split_floats. Blends separate x, y and z there:
 * a blend leaves each value in the lane into which it was loaded, so the points are in this mixed
 * order. Shuffles, for which processors have the fewest units, only bring a point's y and z into
 * the lane of its x. The order is restored when the two halves of the voxels are joined, which
 * takes a shuffle anyway.
 */
static inline __m512i umb__mixed(void)
{
    return _mm512_setr_epi32(0, 11, 6, 1, 12, 7, 2, 13, 8, 3, 14, 9, 4, 15, 10, 5);
}

/* Returns the lane that holds each point. */
static inline __m512i umb__mixed_back(void)
{
    return _mm512_setr_epi32(0, 3, 6, 9, 12, 15, 2, 5, 8, 11, 14, 1, 4, 7, 10, 13);
}

/* Separates the coordinates of sixteen points x0 y0 z0 x1 .. in floats, into the lanes of
 * umb__mixed(). */
static inline void umb__split_floats(const uint8_t *at, __m512 axis[3])
{
    const __mmask16 first = 0x9249, second = 0x2492, third = 0x4924; /* Every third lane */
    __m512 a = _mm512_loadu_ps(at), b = _mm512_loadu_ps(at + 64);
    __m512 c = _mm512_loadu_ps(at + 128);
    /* In registers: otherwise compilers reload memory for every blend. */
    __asm__("" : "+v"(a), "+v"(b), "+v"(c));
    const __m512 y = _mm512_mask_mov_ps(_mm512_mask_mov_ps(a, first, b), third, c);
    const __m512 z = _mm512_mask_mov_ps(_mm512_mask_mov_ps(a, second, b), first, c);
    const __m512i y_bits = _mm512_castps_si512(y), z_bits = _mm512_castps_si512(z);
    axis[0] = _mm512_mask_mov_ps(_mm512_mask_mov_ps(a, third, b), second, c);
    axis[1] = _mm512_castsi512_ps(_mm512_alignr_epi32(y_bits, y_bits, 1));
    axis[2] = _mm512_castsi512_ps(_mm512_alignr_epi32(z_bits, z_bits, 2));
}

/* Returns a mask of points, one bit each, from a mask of lanes. */
static inline __mmask16 umb__in_order(__mmask16 lanes)
{
    const __m512i back = umb__mixed_back();
    return _mm512_movepi32_mask(_mm512_permutexvar_epi32(back, _mm512_movm_epi32(lanes)));
}

static inline void umb__widen(__m512 floats, __m512d *low, __m512d *high)
{
    float eights[16] __attribute__((aligned(64)));
    _mm512_store_ps(eights, floats); /* Loads that convert need no shuffle */
    *low = _mm512_cvtps_pd(_mm256_load_ps(eights));
    *high = _mm512_cvtps_pd(_mm256_load_ps(eights + 8));
}

/* Mode of _mm512_range for the greater absolute value; if one is NaN, the other counts. */
#define UMB__GREATER_LENGTH 0xb

static inline void umb__sixteen_f32(const struct umb__wide_placer *placer, const uint8_t *at,
                                    struct umb__sixteen *to)
{
    __m512 p[3];
    umb__split_floats(at, p);
    const __m512 far = _mm512_range_ps(_mm512_range_ps(p[0], p[1], UMB__GREATER_LENGTH), p[2],
                                       UMB__GREATER_LENGTH);
    to->near = _mm512_cmp_ps_mask(far, _mm512_set1_ps((float)placer->reach), _CMP_LT_OQ);
    for (unsigned axis = 0; axis < 3; axis++) {
        umb__widen(p[axis], &to->low[axis], &to->high[axis]);
    }
}

static inline __mmask8 umb__within_reach(const struct umb__wide_placer *placer, const __m512d p[3])
{
    const __m512d far = _mm512_range_pd(_mm512_range_pd(p[0], p[1], UMB__GREATER_LENGTH), p[2],
                                        UMB__GREATER_LENGTH);
    return _mm512_cmp_pd_mask(far, _mm512_set1_pd(placer->reach), _CMP_LT_OQ);
}

static inline void umb__sixteen_f64(const struct umb__wide_placer *placer, const uint8_t *at,
                                    struct umb__sixteen *to)
{
    const __m512i low = _mm512_cvtepi32_epi64(_mm512_castsi512_si256(umb__mixed()));
    const __m512i high = _mm512_cvtepi32_epi64(_mm512_extracti32x8_epi32(umb__mixed(), 1));
    __m512d first[3], last[3];
    umb__lanes_load_f64(at, first);
    umb__lanes_load_f64(at + 192, last);
    for (unsigned axis = 0; axis < 3; axis++) {
        to->low[axis] = _mm512_permutex2var_pd(first[axis], low, last[axis]);
        to->high[axis] = _mm512_permutex2var_pd(first[axis], high, last[axis]);
    }
    to->near =
        (__mmask16)(umb__within_reach(placer, to->low) | umb__within_reach(placer, to->high) << 8);
}

static inline __m512 umb__dot_floats(const __m512 v[3], const __m512 w[3])
{
    return _mm512_fmadd_ps(v[2], w[2], _mm512_fmadd_ps(v[1], w[1], v[0] * w[0]));
}

/* Moves of eight points off their surface, in voxels. */
struct umb__eight_steps {
    __m512d step[3];
    __m512d slope[2]; /* Set only for lifts that count from the centre of a texel */
};

/* Moves of sixteen points. */
struct umb__sixteen_steps {
    struct umb__eight_steps low, high;
    __mmask16 usable; /* Points whose normal meets the conditions of the file's first comment */
    __mmask16 away;   /* Usable points that face away */
};

/* Returns the points whose normal faces away, as umb__move computes it. */
static inline __mmask16 umb__face_away(const struct umb__lane_placer *placer, const __m512 n[3])
{
    __m512d low[3], high[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        umb__widen(n[axis], &low[axis], &high[axis]);
    }
    const __m512d zero = _mm512_setzero_pd();
    const unsigned first = UMB__LANES_AT_LEAST(umb__lanes_dot(low, placer->direction), zero);
    const unsigned second = UMB__LANES_AT_LEAST(umb__lanes_dot(high, placer->direction), zero);
    return (__mmask16)(first | second << 8);
}

static inline __m512d umb__dot_eight(const __m512d v[3], const __m512d w[3])
{
    return _mm512_fmadd_pd(v[2], w[2], _mm512_fmadd_pd(v[1], w[1], v[0] * w[0]));
}

/* Returns 1 / a to some roundings: each step doubles the 14 good bits. */
static inline __m512d umb__reciprocal(__m512d a)
{
    const __m512d two = _mm512_set1_pd(2);
    __m512d r = _mm512_rcp14_pd(a);
    r = r * _mm512_fnmadd_pd(a, r, two);
    return r * _mm512_fnmadd_pd(a, r, two);
}

/* Moves points along their normals by the rest of the longest lift. In: more: points with a
 * rest. */
static inline void umb__move_eight(const struct umb__wide_placer *placer, const __m512d n[3],
                                   __mmask8 more, __m512d rest, struct umb__eight_steps *to)
{
    const struct umb__query *q = placer->exact.plain.query;
    const __m512d scale = _mm512_maskz_mov_pd(more, rest / umb__dot_eight(n, n));
    const __m512d zero = _mm512_setzero_pd();
    const __m512d lift = _mm512_set1_pd(umb__longest_lift(q));
    to->step[2] = _mm512_mask_sub_pd(to->step[2], more, zero, lift);
    for (unsigned axis = 0; axis < 3; axis++) {
        to->step[axis] += umb__dot_eight(n, placer->to_voxel[axis]) * scale;
    }
    to->slope[0] = _mm512_mask_mov_pd(to->slope[0], more, zero);
    to->slope[1] = _mm512_mask_mov_pd(to->slope[1], more, zero);
}

/* Does what umb__lift_auto does, for eight points. Returns the points whose lift is in doubt. */
UMB__INLINE __mmask8 umb__lift_eight(const struct umb__wide_placer *placer, const __m512d n[3],
                                     struct umb__eight_steps *to)
{
    const struct umb__query *q = placer->exact.plain.query;
    const double taps = (double)q->taps, follows = placer->follows ? 1 : 0;
    const __m512d half = _mm512_set1_pd(0.5 * UMB__BIAS_SLACK), zero = _mm512_setzero_pd();
    const __m512d most = _mm512_set1_pd(umb__longest_lift(q));
    __m512d along[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        along[axis] = umb__dot_eight(n, placer->exact.voxel_step[axis]);
    }
    const __m512d across = _mm512_abs_pd(along[0]) + _mm512_abs_pd(along[1]);
    const __m512d depth = _mm512_abs_pd(along[2]), over = umb__reciprocal(depth);
    const __m512d rest = half * (_mm512_set1_pd(taps) * across + depth) - most * depth;
    const __mmask8 more = _mm512_cmp_pd_mask(rest, zero, _CMP_GT_OQ);
    const __m512d doubt = _mm512_set1_pd(placer->rest_doubt);
    to->step[0] = to->step[1] = zero;
    to->step[2] =
        zero - half * (_mm512_set1_pd(taps - follows) * across * over + _mm512_set1_pd(1));
    to->slope[0] = along[0] * over;
    to->slope[1] = along[1] * over;
    if (more) {
        umb__move_eight(placer, n, more, rest, to);
    }
    return _mm512_cmp_pd_mask(_mm512_abs_pd(rest), doubt, _CMP_NGT_UQ);
}

/* Computes the moves of sixteen points for a given bias. */
static inline void umb__given_sixteen(const struct umb__wide_placer *placer, const __m512 n[3],
                                      __m512 length2, struct umb__sixteen_steps *to)
{
    const __m512 scale = placer->length / _mm512_sqrt_ps(length2);
    for (unsigned axis = 0; axis < 3; axis++) {
        const __m512 step = umb__dot_floats(n, placer->row[axis]) * scale;
        umb__widen(step, &to->low.step[axis], &to->high.step[axis]);
    }
}

UMB__INLINE void umb__step_sixteen(const struct umb__wide_placer *placer, const uint8_t *normals,
                                   struct umb__sixteen_steps *to)
{
    __m512 n[3];
    umb__split_floats(normals, n);
    const __m512 length2 = umb__dot_floats(n, n);
    to->usable = _mm512_cmp_ps_mask(length2, _mm512_set1_ps(0.25F), _CMP_GE_OQ);
    to->usable = _mm512_mask_cmp_ps_mask(to->usable, length2, _mm512_set1_ps(4), _CMP_LE_OQ);
    const __m512 facing = umb__dot_floats(n, placer->direction);
    to->away = _mm512_cmp_ps_mask(facing, _mm512_setzero_ps(), _CMP_GE_OQ);
    const __mmask16 close =
        _mm512_mask_cmp_ps_mask(to->usable, _mm512_abs_ps(facing), placer->doubt, _CMP_LE_OQ);
    if (close) {
        to->away = umb__face_away(&placer->exact, n);
    }
    to->away &= to->usable;
    if (!placer->automatic) {
        umb__given_sixteen(placer, n, length2, to);
        return;
    }
    __m512d low[3], high[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        umb__widen(n[axis], &low[axis], &high[axis]);
    }
    const unsigned first = umb__lift_eight(placer, low, &to->low);
    const unsigned second = umb__lift_eight(placer, high, &to->high);
    to->usable &= (__mmask16) ~(first | second << 8) | to->away;
}

/* Computes the voxel coordinates of eight points in fixed point (see the file's first comment). In:
 * steps: moves of the points; NULL for points without normals. Returns the least fraction of each
 * point. */
static inline __m512i umb__fix(const struct umb__wide_placer *placer, const __m512d p[3],
                               const struct umb__eight_steps *steps, __m512i fixed[3])
{
    const __m512i fraction = _mm512_set1_epi64(0xffffffff);
    for (unsigned axis = 0; axis < 3; axis++) {
        const __m512d *m = placer->to_voxel[axis];
        __m512d sum = placer->base[axis];
        if (steps != NULL) {
            sum += steps->step[axis];
        }
        for (unsigned k = 0; k < 2 && axis == 2 && steps != NULL && placer->follows; k++) {
            const __m512d floor = _mm512_castsi512_pd(_mm512_andnot_si512(fraction, fixed[k]));
            const __m512d at = _mm512_castsi512_pd(fixed[k]) - floor;
            sum = _mm512_fmadd_pd(placer->centre - at, steps->slope[k], sum);
        }
        sum = _mm512_fmadd_pd(p[0], m[0], sum);
        sum = _mm512_fmadd_pd(p[1], m[1], sum);
        fixed[axis] = _mm512_castpd_si512(_mm512_fmadd_pd(p[2], m[2], sum));
    }
    return _mm512_min_epu32(_mm512_min_epu32(fixed[0], fixed[1]), fixed[2]);
}

/* Result so far of the test that every point of a block has a certain voxel inside the frustum. */
struct umb__placed {
    __m512i least;  /* Least fractions, in the even lanes */
    __m512i ends;   /* Bits that are set in any index of a voxel */
    __mmask16 near; /* Lanes whose points were all within reach, or faced away */
};

static inline bool umb__all_placed(const struct umb__wide_placer *placer,
                                   const struct umb__placed *placed)
{
    const __mmask16 even = 0x5555;
    return placed->near == 0xffff &&
           _mm512_mask_testn_epi32_mask(even, placed->least, placer->sure) == 0 &&
           _mm512_test_epi32_mask(placed->ends, placer->beyond) == 0;
}

/* Stores sixteen points into the lanes of the block from i on. steps: NULL for points without
 * normals. Points that face away get voxel 0, 0, 0 and are shadowed. */
UMB__INLINE void umb__place_sixteen(const struct umb__wide_placer *placer,
                                    const struct umb__sixteen *p,
                                    const struct umb__sixteen_steps *steps, bool windows,
                                    struct umb__block *block, uint32_t i,
                                    struct umb__placed *placed)
{
    const __m512i back = umb__mixed_back(), one = _mm512_set1_epi32(1);
    const __m512i odd = _mm512_add_epi32(_mm512_add_epi32(back, back), one); /* upper halves */
    const __m512i high = _mm512_set1_epi32(UMB__FIXED_HIGH), none = _mm512_set1_epi32(-1);
    __m512i first[3], second[3], v[3], ends = _mm512_setzero_si512();
    __m512i least_first = umb__fix(placer, p->low, steps ? &steps->low : NULL, first);
    __m512i least_second = umb__fix(placer, p->high, steps ? &steps->high : NULL, second);
    for (unsigned axis = 0; axis < 3; axis++) {
        v[axis] = _mm512_permutex2var_epi32(first[axis], odd, second[axis]);
        v[axis] ^= high;
        if (windows && axis < 2) {
            v[axis] = _mm512_sub_epi32(v[axis], placer->half);
            ends |= _mm512_add_epi32(v[axis], placer->span);
        }
        ends |= v[axis];
    }
    placed->near &= steps ? (__mmask16)((p->near & steps->usable) | steps->away) : p->near;
    if (steps) {
        const __mmask16 seen = (__mmask16)~steps->away;
        const __mmask16 in_order = steps->away ? umb__in_order(seen) : seen;
        least_first = _mm512_mask_mov_epi64(none, (__mmask8)seen, least_first);
        least_second = _mm512_mask_mov_epi64(none, (__mmask8)(seen >> 8), least_second);
        ends = _mm512_maskz_mov_epi32(in_order, ends);
        for (unsigned axis = 0; axis < 3; axis++) {
            v[axis] = _mm512_maskz_mov_epi32(in_order, v[axis]);
        }
        _mm512_storeu_si512(block->lit + i, _mm512_setzero_si512());
    }
    placed->least = _mm512_min_epu32(placed->least, _mm512_min_epu32(least_first, least_second));
    placed->ends |= ends;
    _mm512_store_si512(block->x + i, v[0]);
    _mm512_store_si512(block->y + i, v[1]);
    _mm512_store_si512(block->z + i, v[2]);
}

/*
 * Prefetches the points of a later block. Hardware prefetchers follow the contiguous points by
 * themselves, but not beyond the end of a page. A prefetch beyond the batch is harmless. Always
 * inlined: gcc would drop a call of a function that only prefetches.
 */
#define UMB__READ_AHEAD 2048U /* bytes */

UMB__INLINE void umb__ask_for_points(const uint8_t *at, size_t bytes)
{
    for (size_t line = 0; line < bytes; line += 64) {
        __builtin_prefetch((const void *)((uintptr_t)at + UMB__READ_AHEAD + line));
    }
}

/* Places a whole block: fills in its voxels, and the answers of points without a look-up. Returns
 * false if the block must be placed by another function. */
UMB__INLINE bool umb__place_sixteens(const struct umb__wide_placer *placer, size_t first,
                                     struct umb__form form, struct umb__block *block,
                                     struct umb_query_stats *stats)
{
    const struct umb_points *points = placer->exact.plain.points;
    const size_t bytes = form.f32 ? 12 : 24;
    const uint8_t *at = (const uint8_t *)points->positions + bytes * first;
    const uint8_t *normals = form.normals ? (const uint8_t *)points->normals + 12 * first : NULL;
    struct umb__placed placed = {_mm512_set1_epi32(-1), _mm512_setzero_si512(), 0xffff};
    uint64_t away = 0;
    umb__ask_for_points(at, bytes * UMB__BLOCK);
    if (form.normals) {
        umb__ask_for_points(normals, 12 * UMB__BLOCK);
    }
    for (uint32_t i = 0; i < UMB__BLOCK; i += 16) {
        struct umb__sixteen p;
        struct umb__sixteen_steps steps;
        if (form.f32) {
            umb__sixteen_f32(placer, at + bytes * i, &p);
        } else {
            umb__sixteen_f64(placer, at + bytes * i, &p);
        }
        if (form.normals) {
            umb__step_sixteen(placer, normals + 12 * (size_t)i, &steps);
            away |= (uint64_t)(steps.away ? umb__in_order(steps.away) : 0) << i;
        }
        umb__place_sixteen(placer, &p, form.normals ? &steps : NULL, form.windows, block, i,
                           &placed);
    }
    if (!umb__all_placed(placer, &placed)) {
        return false;
    }
    block->todo = ~away;
    stats->facing_away += umb__count_bits(away);
    return true;
}

UMB__INLINE bool umb__place_form(const struct umb__wide_placer *placer, size_t first, bool windows,
                                 struct umb__block *block, struct umb_query_stats *stats)
{
    const struct umb_points *points = placer->exact.plain.points;
    const bool f32 = points->format == UMB_POINT_F32;
    if (points->normals != NULL) {
        return f32 ? umb__place_sixteens(placer, first,
                                         (struct umb__form){true, true, false, windows}, block,
                                         stats)
                   : umb__place_sixteens(placer, first,
                                         (struct umb__form){false, true, false, windows}, block,
                                         stats);
    }
    return f32 ? umb__place_sixteens(placer, first, (struct umb__form){true, false, false, windows},
                                     block, stats)
               : umb__place_sixteens(
                     placer, first, (struct umb__form){false, false, false, windows}, block, stats);
}

UMB__INLINE void umb__wide_place_block(const struct umb__wide_placer *placer, size_t first,
                                       bool windows, struct umb__block *block,
                                       struct umb_query_stats *stats)
{
    if (!placer->fits || block->size != UMB__BLOCK ||
        !umb__place_form(placer, first, windows, block, stats)) {
        umb__lane_place_block(&placer->exact, first, block, stats);
    }
}

/* Places the points of queries of one tap. */
static inline void umb__wide_place_points(const struct umb__wide_placer *placer, size_t first,
                                          struct umb__block *block, struct umb_query_stats *stats)
{
    umb__wide_place_block(placer, first, false, block, stats);
}

/* Places the points of queries of any number of taps. */
static inline void umb__wide_place_windows(const struct umb__wide_placer *placer, size_t first,
                                           struct umb__block *block, struct umb_query_stats *stats)
{
    umb__wide_place_block(placer, first, true, block, stats);
}

#endif
