/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_PLACE_AVX512_H
#define UMBRAGE_CORE_QUERY_KERNEL_PLACE_AVX512_H
/*
 * Placing a block sixteen points at a time with AVX-512, for one tap: in fixed point where that
 * surely gives the voxels of kernel_place_lanes.h, and by kernel_place_lanes.h elsewhere.
 *
 * Doubles from 2^20 to 2^21 have units of 2^-32. So the sum of a voxel coordinate and 2^20 has the
 * voxel's index in the upper half of its bits, below a constant, and the fraction in the lower
 * half: what converting and comparing takes most of is free. The sum is made by three fused
 * multiplications and additions a coordinate, of the point as it is given; that the batch's origin
 * is added and what pushes points is taken off stands in the constant to which they are added. This
 * is not the sum that umb__to_voxel makes, with its roundings, but near it. Let a point be as near
 * as `reach` says: no sum of the absolute values of what is added up is above 2^20.
 *  - umb__to_voxel rounds each of its terms six times at most (twice the position, once the
 * product, three times their sum), by 2^-53 of 2^20, half a unit, in the worst case: 3 units.
 *  - The constant rounds each of its terms five times at most, and 2^20 is added: 3 units.
 *  - Each of the three additions rounds a number below 2^21: 1.5 units.
 * So the two differ by less than UMB__FIXED_SLACK units, which is added, too. If the fraction is
 * not below twice that, then the sum that umb__to_voxel makes has the same floor, and is no
 * integer; if moreover the index is inside the frustum, then so is the point. A block of which a
 * point may be otherwise is placed anew: what is in doubt is one coordinate in 2^27.
 */
#include "query/kernel_lanes_avx512.h"
#include "query/kernel_place_lanes.h"

#define UMB__FIXED_SLACK 16 /* units of 2^-32 voxels; twice what the argument above needs */
#define UMB__FIXED_BASE  (1 << 20)
#define UMB__FIXED_HIGH  0x41300000 /* the upper half of 2^20's bits */

struct umb__wide_placer {
    struct umb__lane_placer exact;
    bool fits;
    double reach; /* no coordinate is further from 0, as the batch gives them */
    __m512d to_voxel[3][3], base[3];
    __m512i beyond; /* bits that no index inside has */
};

static inline void umb__wide_placer_init(const struct umb__query *q,
                                         const struct umb_points *points,
                                         struct umb__wide_placer *placer)
{
    double reach = INFINITY;
    umb__lane_placer_init(q, points, &placer->exact);
    placer->fits = points->normals == NULL && q->log2_size < 20;
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *m = q->world_to_voxel[axis];
        double base = m[3], far = fabs(m[3]), steep = 0;
        for (unsigned k = 0; k < 3; k++) {
            const double offset = points->origin[k] - q->origin[k];
            const double push = q->direction[k] * q->no_normal_m;
            base += m[k] * (offset - push);
            far += fabs(m[k]) * (fabs(offset) + fabs(push));
            steep += fabs(m[k]);
            placer->to_voxel[axis][k] = _mm512_set1_pd(m[k]);
        }
        const double most = (0.999 * UMB__FIXED_BASE - far) / steep;
        placer->fits &= most > 0; /* nor if it is not a number */
        reach = most < reach ? most : reach;
        base += UMB__FIXED_BASE + UMB__FIXED_SLACK * 0x1p-32;
        placer->base[axis] = _mm512_set1_pd(base);
    }
    placer->reach = reach;
    placer->beyond = _mm512_set1_epi32(-((int32_t)1 << q->log2_size));
}

/* Coordinates of sixteen points, by axis; low: of the first eight. */
struct umb__sixteen {
    __m512d low[3], high[3];
    __mmask16 near; /* points within reach */
};

/* From x0 y0 z0 x1 .., forty-eight floats. */
static inline void umb__split_floats(const uint8_t *at, __m512 axis[3])
{
    const __m512 a = _mm512_loadu_ps(at), b = _mm512_loadu_ps(at + 64);
    const __m512 c = _mm512_loadu_ps(at + 128);
    const __m512i x = _mm512_setr_epi32(0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 1, 4, 7, 10, 13);
    const __m512i y = _mm512_setr_epi32(1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 2, 5, 8, 11, 14);
    const __m512i z = _mm512_setr_epi32(2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 3, 6, 9, 12, 15);
    axis[0] = _mm512_mask_permutexvar_ps(_mm512_permutex2var_ps(a, x, b), 0xf800, x, c);
    axis[1] = _mm512_mask_permutexvar_ps(_mm512_permutex2var_ps(a, y, b), 0xf800, y, c);
    axis[2] = _mm512_mask_permutexvar_ps(_mm512_permutex2var_ps(a, z, b), 0xfc00, z, c);
}

static inline void umb__widen(__m512 floats, __m512d *low, __m512d *high)
{
    float eights[16] __attribute__((aligned(64)));
    _mm512_store_ps(eights, floats); /* loads that convert need no shuffle */
    *low = _mm512_cvtps_pd(_mm256_load_ps(eights));
    *high = _mm512_cvtps_pd(_mm256_load_ps(eights + 8));
}

#define UMB__GREATER_LENGTH                                                                        \
    0xb /* of two numbers, or of one and none: the greater absolute value                          \
         */

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
    umb__lanes_load_f64(at, to->low);
    umb__lanes_load_f64(at + 192, to->high);
    to->near =
        (__mmask16)(umb__within_reach(placer, to->low) | umb__within_reach(placer, to->high) << 8);
}

/* Voxel coordinates of eight points, as fixed[axis] says above; returns the least fractions. */
static inline __m512i umb__fix(const struct umb__wide_placer *placer, const __m512d p[3],
                               __m512i fixed[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        const __m512d *m = placer->to_voxel[axis];
        __m512d sum = _mm512_fmadd_pd(p[0], m[0], placer->base[axis]);
        sum = _mm512_fmadd_pd(p[1], m[1], sum);
        fixed[axis] = _mm512_castpd_si512(_mm512_fmadd_pd(p[2], m[2], sum));
    }
    return _mm512_min_epu32(_mm512_min_epu32(fixed[0], fixed[1]), fixed[2]);
}

/* Puts sixteen points into lanes i .. of the block; returns those whose voxels are sure and inside
 * the frustum. */
static inline __attribute__((always_inline)) __mmask16
umb__place_sixteen(const struct umb__wide_placer *placer, const struct umb__sixteen *p,
                   struct umb__block *block, uint32_t i)
{
    const __m512i even =
        _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const __m512i odd =
        _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    const __m512i high = _mm512_set1_epi32(UMB__FIXED_HIGH);
    const __m512i sure = _mm512_set1_epi32(-2 * UMB__FIXED_SLACK); /* bits: set in sure fractions */
    __m512i first[3], second[3], v[3];
    const __m512i least_first = umb__fix(placer, p->low, first);
    const __m512i least_second = umb__fix(placer, p->high, second);
    const __m512i least = _mm512_permutex2var_epi32(least_first, even, least_second);
    __mmask16 good = _mm512_mask_test_epi32_mask(p->near, least, sure);
    for (unsigned axis = 0; axis < 3; axis++) {
        v[axis] = _mm512_permutex2var_epi32(first[axis], odd, second[axis]);
        v[axis] = _mm512_xor_si512(v[axis], high);
    }
    const __m512i any = _mm512_or_si512(_mm512_or_si512(v[0], v[1]), v[2]);
    good = _mm512_mask_testn_epi32_mask(good, any, placer->beyond);
    _mm512_storeu_si512(block->x + i, v[0]);
    _mm512_storeu_si512(block->y + i, v[1]);
    _mm512_storeu_si512(block->z + i, v[2]);
    _mm512_storeu_si512(block->lit + i, _mm512_setzero_si512());
    return good;
}

/*
 * Points come in lines behind one another, which processors fetch ahead by themselves, but not
 * beyond the end of a page: so each block asks for what a later one reads; who asks for more than
 * there is asks in vain. Inlined always: of a function that does nothing else, gcc thinks that it
 * does nothing.
 */
#define UMB__READ_AHEAD 2048U /* bytes */

static inline __attribute__((always_inline)) void umb__ask_for_points(const uint8_t *at,
                                                                      size_t bytes)
{
    for (size_t line = 0; line < bytes; line += 64) {
        __builtin_prefetch((const void *)((uintptr_t)at + UMB__READ_AHEAD + line));
    }
}

/* A whole block; returns the points that are good. */
static inline __attribute__((always_inline)) uint64_t
umb__place_sixteens(const struct umb__wide_placer *placer, size_t first, bool f32,
                    struct umb__block *block)
{
    const size_t bytes = f32 ? 12 : 24;
    const uint8_t *at = (const uint8_t *)placer->exact.plain.points->positions + bytes * first;
    uint64_t good = 0;
    umb__ask_for_points(at, bytes * UMB__BLOCK);
    for (uint32_t i = 0; i < UMB__BLOCK; i += 16) {
        struct umb__sixteen p;
        if (f32) {
            umb__sixteen_f32(placer, at + bytes * i, &p);
        } else {
            umb__sixteen_f64(placer, at + bytes * i, &p);
        }
        good |= (uint64_t)umb__place_sixteen(placer, &p, block, i) << i;
    }
    return good;
}

static inline void umb__wide_place_block(const struct umb__wide_placer *placer, size_t first,
                                         struct umb__block *block, struct umb_query_stats *stats)
{
    if (placer->fits && block->size == UMB__BLOCK) {
        const bool f32 = placer->exact.plain.points->format == UMB_POINT_F32;
        block->todo = f32 ? umb__place_sixteens(placer, first, true, block)
                          : umb__place_sixteens(placer, first, false, block);
        if (block->todo == UINT64_MAX) {
            return;
        }
    }
    umb__lane_place_block(&placer->exact, first, block, stats);
}

#endif
