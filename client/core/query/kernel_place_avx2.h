/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_PLACE_AVX2_H
#define UMBRAGE_CORE_QUERY_KERNEL_PLACE_AVX2_H
/*
 * Placing a block four points at a time with AVX2: operation by operation what umb__move,
 * umb__to_voxel and umb__window_at do, in doubles, in the same order and without contraction, so
 * that every voxel index is the same. A group of four with a point that is not plainly inside the
 * frustum goes point by point instead.
 */
#include <immintrin.h>
#include "query/kernel_parts.h"

/* Three coordinates of four points. */
struct umb__four {
    __m256d axis[3];
};

static inline __m256d umb__dot_four(const struct umb__four *v, const double w[3])
{
    __m256d x = _mm256_mul_pd(v->axis[0], _mm256_set1_pd(w[0]));
    __m256d y = _mm256_mul_pd(v->axis[1], _mm256_set1_pd(w[1]));
    __m256d z = _mm256_mul_pd(v->axis[2], _mm256_set1_pd(w[2]));
    return _mm256_add_pd(_mm256_add_pd(x, y), z);
}

/* Twelve floats, x y z interleaved. */
static inline struct umb__four umb__load_four_f32(const uint8_t *at)
{
    __m128 a = _mm_loadu_ps((const float *)(const void *)at);
    __m128 b = _mm_loadu_ps((const float *)(const void *)(at + 16));
    __m128 c = _mm_loadu_ps((const float *)(const void *)(at + 32));
    __m128 xyxy = _mm_shuffle_ps(b, c, _MM_SHUFFLE(2, 1, 3, 2));
    __m128 yzyz = _mm_shuffle_ps(a, b, _MM_SHUFFLE(1, 0, 2, 1));
    struct umb__four four;
    four.axis[0] = _mm256_cvtps_pd(_mm_shuffle_ps(a, xyxy, _MM_SHUFFLE(2, 0, 3, 0)));
    four.axis[1] = _mm256_cvtps_pd(_mm_shuffle_ps(yzyz, xyxy, _MM_SHUFFLE(3, 1, 2, 0)));
    four.axis[2] = _mm256_cvtps_pd(_mm_shuffle_ps(yzyz, c, _MM_SHUFFLE(3, 0, 3, 1)));
    return four;
}

static inline struct umb__four umb__load_four(const struct umb_points *points, size_t i)
{
    if (points->format == UMB_POINT_F32) {
        return umb__load_four_f32((const uint8_t *)points->positions + 12 * i);
    }
    struct umb__four four;
    for (unsigned axis = 0; axis < 3; axis++) {
        four.axis[axis] = _mm256_set_pd(
            umb__coordinate(points, i + 3, axis), umb__coordinate(points, i + 2, axis),
            umb__coordinate(points, i + 1, axis), umb__coordinate(points, i, axis));
    }
    return four;
}

/* umb__move; returns the lanes whose normal faces away. */
static inline unsigned umb__move_four(const struct umb__query *q, const struct umb_points *points,
                                      size_t i, struct umb__four *p)
{
    struct umb__four n;
    __m256d unmoved[3], scale;
    for (unsigned axis = 0; axis < 3; axis++) {
        unmoved[axis] = p->axis[axis];
        p->axis[axis] =
            _mm256_sub_pd(p->axis[axis], _mm256_set1_pd(q->direction[axis] * q->no_normal_m));
    }
    if (!points->normals) {
        return 0;
    }
    n = umb__load_four_f32((const uint8_t *)points->normals + 12 * i);
    __m256d length2 = _mm256_mul_pd(n.axis[0], n.axis[0]);
    length2 = _mm256_add_pd(length2, _mm256_mul_pd(n.axis[1], n.axis[1]));
    length2 = _mm256_add_pd(length2, _mm256_mul_pd(n.axis[2], n.axis[2]));
    __m256d has =
        _mm256_and_pd(_mm256_cmp_pd(length2, _mm256_setzero_pd(), _CMP_GT_OQ),
                      _mm256_cmp_pd(length2, _mm256_set1_pd(UMB__LENGTH2_MAX), _CMP_LE_OQ));
    if (q->bias_mode == UMB_BIAS_AUTO) {
        __m256d sum[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            sum[axis] =
                _mm256_andnot_pd(_mm256_set1_pd(-0.0), umb__dot_four(&n, q->voxel_step[axis]));
        }
        scale = _mm256_mul_pd(_mm256_set1_pd(q->taps), _mm256_add_pd(sum[0], sum[1]));
        scale = _mm256_add_pd(scale, sum[2]);
        scale = _mm256_mul_pd(_mm256_set1_pd(0.5 * UMB__BIAS_SLACK), scale);
        scale = _mm256_div_pd(scale, length2);
    } else {
        scale = _mm256_div_pd(_mm256_set1_pd(q->bias_m), _mm256_sqrt_pd(length2));
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        __m256d moved = _mm256_add_pd(unmoved[axis], _mm256_mul_pd(n.axis[axis], scale));
        p->axis[axis] = _mm256_blendv_pd(p->axis[axis], moved, has);
    }
    __m256d away = _mm256_cmp_pd(umb__dot_four(&n, q->direction), _mm256_setzero_pd(), _CMP_GE_OQ);
    return (unsigned)_mm256_movemask_pd(_mm256_and_pd(away, has));
}

/* Lanes from `low` to below `high`. */
static inline __m256d umb__between_four(__m256d v, double low, double high)
{
    return _mm256_and_pd(_mm256_cmp_pd(v, _mm256_set1_pd(low), _CMP_GE_OQ),
                         _mm256_cmp_pd(v, _mm256_set1_pd(high), _CMP_LT_OQ));
}

/* Points index .. index + 3, as lanes i .. i + 3 of the block. Returns false, having done nothing
 * that counts, if one of them is not plainly inside and does not face away. */
static inline bool umb__place_four(const struct umb__query *q, const struct umb_points *points,
                                   size_t index, struct umb__block *block, uint32_t i,
                                   struct umb_query_stats *stats)
{
    struct umb__four p = umb__load_four(points, index), v;
    for (unsigned axis = 0; axis < 3; axis++) {
        double offset = points->origin[axis] - q->origin[axis];
        p.axis[axis] = _mm256_add_pd(_mm256_set1_pd(offset), p.axis[axis]);
    }
    unsigned away = umb__move_four(q, points, index, &p);
    for (unsigned axis = 0; axis < 3; axis++) {
        const double *m = q->world_to_voxel[axis];
        v.axis[axis] = _mm256_add_pd(umb__dot_four(&p, m), _mm256_set1_pd(m[3]));
    }
    int32_t size = (int32_t)1 << q->log2_size, half = q->taps / 2;
    __m256d inside = _mm256_and_pd(umb__between_four(v.axis[0], half, size - half),
                                   umb__between_four(v.axis[1], half, size - half));
    inside = _mm256_and_pd(inside, umb__between_four(v.axis[2], 0, size));
    unsigned look = (unsigned)_mm256_movemask_pd(inside) & ~away;
    if ((look | away) != 15) {
        return false;
    }
    /* All bits where a point is to be looked up, in four lanes of 32 bits. */
    __m128i which = _mm_and_si128(_mm_set1_epi32((int)look), _mm_setr_epi32(1, 2, 4, 8));
    which = _mm_cmpgt_epi32(which, _mm_setzero_si128());
    __m128i corner = _mm_set1_epi32(half); /* the window's first texel, not its centre */
    __m128i x = _mm_sub_epi32(_mm256_cvttpd_epi32(v.axis[0]), corner);
    __m128i y = _mm_sub_epi32(_mm256_cvttpd_epi32(v.axis[1]), corner);
    __m128i z = _mm256_cvttpd_epi32(v.axis[2]);
    _mm_storeu_si128((__m128i *)(void *)(block->x + i), _mm_and_si128(x, which));
    _mm_storeu_si128((__m128i *)(void *)(block->y + i), _mm_and_si128(y, which));
    _mm_storeu_si128((__m128i *)(void *)(block->z + i), _mm_and_si128(z, which));
    _mm_storeu_si128((__m128i *)(void *)(block->lit + i), _mm_setzero_si128());
    block->todo |= (uint64_t)look << i;
    stats->facing_away += (uint64_t)__builtin_popcount(away);
    return true;
}

static inline void umb__place_block_avx2(const struct umb__query *q,
                                         const struct umb_points *points, size_t first,
                                         struct umb__block *block, struct umb_query_stats *stats)
{
    uint32_t i = 0;
    block->todo = 0;
    for (; i + 4 <= block->size; i += 4) {
        if (!umb__stages_fit(q) || !umb__place_four(q, points, first + i, block, i, stats)) {
            for (uint32_t lane = i; lane < i + 4; lane++) {
                umb__place_point(q, points, first + lane, block, lane, stats);
            }
        }
    }
    for (; i < block->size; i++) {
        umb__place_point(q, points, first + i, block, i, stats);
    }
    for (; i % 8 != 0; i++) { /* the rest of what the grid stage takes at a time */
        block->x[i] = block->y[i] = block->z[i] = 0;
        block->lit[i] = 0;
    }
}

/* Eight cells of the grid, whose column, row and layer are given. */
static inline __m256i umb__gather_eight(const struct umb__query *q, __m256i x, __m256i y, __m256i z)
{
    __m128i g = _mm_cvtsi32_si128((int)q->grid_log2);
    __m256i index = _mm256_add_epi32(y, _mm256_sll_epi32(z, g));
    index = _mm256_add_epi32(x, _mm256_sll_epi32(index, g));
    return _mm256_i32gather_epi32((const int *)(const void *)q->grid, index, 4);
}

/* umb__grid_block, eight points at a time. */
static inline void umb__grid_block_avx2(const struct umb__query *q, struct umb__block *block,
                                        uint32_t value[UMB__BLOCK])
{
    const __m128i level = _mm_cvtsi32_si128((int)(q->log2_size - q->grid_log2));
    const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    const __m256i two = _mm256_set1_epi32(UMB__CELL_FIRST), reach = _mm256_set1_epi32(q->taps - 1);
    const __m256i total = _mm256_set1_epi32(q->taps * q->taps);
    uint64_t mixed = 0;
    for (uint32_t i = 0; i < block->size; i += 8) {
        __m256i x = _mm256_loadu_si256((const __m256i *)(const void *)(block->x + i));
        __m256i y = _mm256_loadu_si256((const __m256i *)(const void *)(block->y + i));
        __m256i z = _mm256_loadu_si256((const __m256i *)(const void *)(block->z + i));
        __m256i lit = _mm256_loadu_si256((const __m256i *)(const void *)(block->lit + i));
        z = _mm256_srl_epi32(z, level);
        __m256i cx = _mm256_srl_epi32(x, level), cy = _mm256_srl_epi32(y, level);
        __m256i cell = umb__gather_eight(q, cx, cy, z), same = _mm256_set1_epi32(-1);
        if (q->taps > 1) {
            __m256i right = _mm256_srl_epi32(_mm256_add_epi32(x, reach), level);
            __m256i down = _mm256_srl_epi32(_mm256_add_epi32(y, reach), level);
            same = _mm256_cmpeq_epi32(cell, umb__gather_eight(q, right, cy, z));
            same =
                _mm256_and_si256(same, _mm256_cmpeq_epi32(cell, umb__gather_eight(q, cx, down, z)));
            same = _mm256_and_si256(same,
                                    _mm256_cmpeq_epi32(cell, umb__gather_eight(q, right, down, z)));
        }
        __m256i uniform = _mm256_cmpeq_epi32(_mm256_min_epu32(cell, two), cell);
        uniform = _mm256_andnot_si256(_mm256_cmpeq_epi32(cell, two), uniform);
        unsigned todo = (unsigned)(block->todo >> i & 0xff);
        __m256i which = _mm256_set1_epi32((int)todo);
        which = _mm256_cmpeq_epi32(_mm256_and_si256(which, bits), bits);
        __m256i settled = _mm256_and_si256(_mm256_and_si256(uniform, same), which);
        /* A uniform cell's value is 1 if lit, else 0. */
        lit = _mm256_blendv_epi8(lit, _mm256_mullo_epi32(cell, total), settled);
        _mm256_storeu_si256((__m256i *)(void *)(block->lit + i), lit);
        _mm256_storeu_si256((__m256i *)(void *)(value + i), cell);
        unsigned done = (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(settled));
        mixed |= (uint64_t)(todo & ~done) << i;
    }
    block->todo = mixed;
}

#endif
