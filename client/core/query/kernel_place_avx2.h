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

/* What placing needs of a query and its points, once for a batch: equal lanes each. */
struct umb__placer_avx2 {
    struct umb__placer plain;
    bool fits;
    bool still;        /* offset and push are 0 */
    __m256d offset[3]; /* the batch's origin less the asset's */
    __m256d push[3];   /* towards the light, for points without a normal */
    __m256d to_voxel[3][4];
    __m256d voxel_step[3][3]; /* these two: only if the points have normals */
    __m256d direction[3];
    __m256i half, reach; /* texels before a window's centre, and from its first to its last */
    __m128i log2_size;
};

static inline void umb__placer_init_avx2(const struct umb__query *q,
                                         const struct umb_points *points,
                                         struct umb__placer_avx2 *placer)
{
    umb__placer_init(q, points, &placer->plain);
    placer->fits = umb__stages_fit(q);
    placer->still = q->no_normal_m == 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        placer->still &= points->origin[axis] == q->origin[axis];
        placer->offset[axis] = _mm256_set1_pd(points->origin[axis] - q->origin[axis]);
        placer->push[axis] = _mm256_set1_pd(q->direction[axis] * q->no_normal_m);
        placer->direction[axis] = _mm256_set1_pd(q->direction[axis]);
        for (unsigned k = 0; k < 4; k++) {
            placer->to_voxel[axis][k] = _mm256_set1_pd(q->world_to_voxel[axis][k]);
        }
        for (unsigned k = 0; k < 3; k++) {
            placer->voxel_step[axis][k] = _mm256_set1_pd(q->voxel_step[axis][k]);
        }
    }
    placer->half = _mm256_set1_epi32(q->taps / 2);
    placer->reach = _mm256_set1_epi32(q->taps - 1);
    placer->log2_size = _mm_cvtsi32_si128((int)q->log2_size);
}

static inline __m256d umb__dot_four(const struct umb__four *v, const __m256d w[3])
{
    __m256d x = _mm256_mul_pd(v->axis[0], w[0]);
    __m256d y = _mm256_mul_pd(v->axis[1], w[1]);
    __m256d z = _mm256_mul_pd(v->axis[2], w[2]);
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

/* What forms a batch has, constants where they are used. `still`: points are relative to the
 * asset's origin and nothing pushes them, so that they are what is transformed. */
struct umb__form {
    bool f32, normals, still;
};

static inline struct umb__four umb__load_four(const struct umb_points *points, size_t i, bool f32)
{
    if (f32) {
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

/* umb__move for points with normals; returns the lanes whose normal faces away. */
static inline unsigned umb__move_four(const struct umb__placer_avx2 *placer, size_t i,
                                      struct umb__four *p)
{
    const struct umb__query *q = placer->plain.query;
    const uint8_t *normals = placer->plain.points->normals;
    struct umb__four n = umb__load_four_f32(normals + 12 * i);
    __m256d length2 = _mm256_mul_pd(n.axis[0], n.axis[0]), scale;
    length2 = _mm256_add_pd(length2, _mm256_mul_pd(n.axis[1], n.axis[1]));
    length2 = _mm256_add_pd(length2, _mm256_mul_pd(n.axis[2], n.axis[2]));
    __m256d has =
        _mm256_and_pd(_mm256_cmp_pd(length2, _mm256_setzero_pd(), _CMP_GT_OQ),
                      _mm256_cmp_pd(length2, _mm256_set1_pd(UMB__LENGTH2_MAX), _CMP_LE_OQ));
    if (q->bias_mode == UMB_BIAS_AUTO) {
        __m256d sum[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            sum[axis] =
                _mm256_andnot_pd(_mm256_set1_pd(-0.0), umb__dot_four(&n, placer->voxel_step[axis]));
        }
        scale = _mm256_mul_pd(_mm256_set1_pd(q->taps), _mm256_add_pd(sum[0], sum[1]));
        scale = _mm256_add_pd(scale, sum[2]);
        scale = _mm256_mul_pd(_mm256_set1_pd(0.5 * UMB__BIAS_SLACK), scale);
        scale = _mm256_div_pd(scale, length2);
    } else {
        scale = _mm256_div_pd(_mm256_set1_pd(q->bias_m), _mm256_sqrt_pd(length2));
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        __m256d pushed = _mm256_sub_pd(p->axis[axis], placer->push[axis]);
        __m256d moved = _mm256_add_pd(p->axis[axis], _mm256_mul_pd(n.axis[axis], scale));
        p->axis[axis] = _mm256_blendv_pd(pushed, moved, has);
    }
    __m256d away =
        _mm256_cmp_pd(umb__dot_four(&n, placer->direction), _mm256_setzero_pd(), _CMP_GE_OQ);
    return (unsigned)_mm256_movemask_pd(_mm256_and_pd(away, has));
}

/* Texels of four points, and a bit for each that is negative or faces away. */
struct umb__placed_four {
    __m128i axis[3]; /* INT32_MIN where a coordinate is beyond 32 bits or not a number */
    unsigned negative, away;
};

static inline __attribute__((always_inline)) struct umb__placed_four
umb__place_four(const struct umb__placer_avx2 *placer, size_t index, struct umb__form form)
{
    struct umb__four p = umb__load_four(placer->plain.points, index, form.f32), v;
    struct umb__placed_four to = {.away = 0};
    for (unsigned axis = 0; axis < 3 && !form.still; axis++) {
        p.axis[axis] = _mm256_add_pd(placer->offset[axis], p.axis[axis]);
    }
    if (form.normals) {
        to.away = umb__move_four(placer, index, &p);
    } else if (!form.still) {
        for (unsigned axis = 0; axis < 3; axis++) {
            p.axis[axis] = _mm256_sub_pd(p.axis[axis], placer->push[axis]);
        }
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const __m256d *m = placer->to_voxel[axis];
        v.axis[axis] = _mm256_add_pd(umb__dot_four(&p, m), m[3]);
        to.axis[axis] = _mm256_cvttpd_epi32(v.axis[axis]);
    }
    __m256d negative = _mm256_or_pd(_mm256_or_pd(v.axis[0], v.axis[1]), v.axis[2]);
    to.negative = (unsigned)_mm256_movemask_pd(negative);
    return to;
}

static inline __m256i umb__join_fours(__m128i low, __m128i high)
{
    return _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
}

/* Voxel 0, 0, 0 in the lanes of points that are not to be looked up. */
static inline void umb__clear_lanes(__m256i v[3], unsigned away)
{
    const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    __m256i cleared = _mm256_and_si256(_mm256_set1_epi32((int)away), bits);
    for (unsigned axis = 0; axis < 3; axis++) {
        v[axis] = _mm256_andnot_si256(_mm256_cmpeq_epi32(cleared, bits), v[axis]);
    }
}

/*
 * Points index .. index + 7, as lanes i .. i + 7 of the block. Returns the lanes to be looked up in
 * the low byte, in the next those that face away. If they are not all eight, a point is neither
 * plainly inside nor faces away, and what stands in the block means nothing: a window lies inside
 * if no bit from the frustum's size up is set in any of its ends.
 */
static inline __attribute__((always_inline)) unsigned
umb__place_eight(const struct umb__placer_avx2 *placer, size_t index, struct umb__form form,
                 struct umb__block *block, uint32_t i)
{
    const struct umb__placed_four a = umb__place_four(placer, index, form);
    const struct umb__placed_four b = umb__place_four(placer, index + 4, form);
    __m256i v[3], ends;
    v[2] = ends = umb__join_fours(a.axis[2], b.axis[2]);
    for (unsigned axis = 0; axis < 2; axis++) {
        /* The window's first texel, not its centre. */
        v[axis] = _mm256_sub_epi32(umb__join_fours(a.axis[axis], b.axis[axis]), placer->half);
        ends = _mm256_or_si256(ends, v[axis]);
        ends = _mm256_or_si256(ends, _mm256_add_epi32(v[axis], placer->reach));
    }
    __m256i beyond = _mm256_srl_epi32(ends, placer->log2_size);
    __m256i inside = _mm256_cmpeq_epi32(beyond, _mm256_setzero_si256());
    unsigned away = a.away | b.away << 4;
    unsigned look = (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(inside)) &
                    ~(a.negative | b.negative << 4) & ~away;
    if (away) {
        umb__clear_lanes(v, away);
    }
    _mm256_storeu_si256((__m256i *)(void *)(block->x + i), v[0]);
    _mm256_storeu_si256((__m256i *)(void *)(block->y + i), v[1]);
    _mm256_storeu_si256((__m256i *)(void *)(block->z + i), v[2]);
    _mm256_storeu_si256((__m256i *)(void *)(block->lit + i), _mm256_setzero_si256());
    return look | away << 8;
}

static inline __attribute__((always_inline)) void
umb__place_eights(const struct umb__placer_avx2 *placer, size_t first, struct umb__form form,
                  struct umb__block *block, struct umb_query_stats *stats)
{
    const struct umb__placer *plain = &placer->plain;
    uint64_t todo = 0;
    uint32_t i = 0;
    for (; i + 8 <= block->size; i += 8) {
        unsigned lanes = umb__place_eight(placer, first + i, form, block, i);
        unsigned look = lanes & 0xff, away = lanes >> 8;
        if ((look | away) != 0xff) {
            block->todo = 0;
            umb__place_points(plain, first + i, block, i, i + 8, stats);
            look = (unsigned)(block->todo >> i);
        } else {
            stats->facing_away += umb__count_bits(away);
        }
        todo |= (uint64_t)look << i;
    }
    block->todo = todo;
    umb__place_points(plain, first + i, block, i, block->size, stats);
}

static inline void umb__place_block_avx2(const struct umb__placer_avx2 *placer, size_t first,
                                         struct umb__block *block, struct umb_query_stats *stats)
{
    const struct umb_points *points = placer->plain.points;
    const bool f32 = points->format == UMB_POINT_F32, normals = points->normals != NULL;
    if (!placer->fits) {
        umb__place_block(&placer->plain, first, block, stats);
        return;
    }
    if (f32 && !normals && placer->still) {
        umb__place_eights(placer, first, (struct umb__form){true, false, true}, block, stats);
    } else if (f32) {
        umb__place_eights(placer, first, (struct umb__form){true, normals, false}, block, stats);
    } else {
        umb__place_eights(placer, first, (struct umb__form){false, normals, false}, block, stats);
    }
    umb__pad_block(block);
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
static inline void umb__grid_block_avx2(const struct umb__query *q, struct umb__block *block)
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
        __m256i cell = umb__gather_eight(q, cx, cy, z);
        __m256i right = _mm256_srl_epi32(_mm256_add_epi32(x, reach), level);
        __m256i down = _mm256_srl_epi32(_mm256_add_epi32(y, reach), level);
        __m256i same = _mm256_cmpeq_epi32(cell, umb__gather_eight(q, right, cy, z));
        same = _mm256_and_si256(same, _mm256_cmpeq_epi32(cell, umb__gather_eight(q, cx, down, z)));
        same =
            _mm256_and_si256(same, _mm256_cmpeq_epi32(cell, umb__gather_eight(q, right, down, z)));
        __m256i uniform = _mm256_cmpeq_epi32(_mm256_min_epu32(cell, two), cell);
        uniform = _mm256_andnot_si256(_mm256_cmpeq_epi32(cell, two), uniform);
        unsigned todo = (unsigned)(block->todo >> i & 0xff);
        __m256i which = _mm256_set1_epi32((int)todo);
        which = _mm256_cmpeq_epi32(_mm256_and_si256(which, bits), bits);
        __m256i settled = _mm256_and_si256(_mm256_and_si256(uniform, same), which);
        /* A uniform cell's value is 1 if lit, else 0. */
        lit = _mm256_blendv_epi8(lit, _mm256_mullo_epi32(cell, total), settled);
        _mm256_storeu_si256((__m256i *)(void *)(block->lit + i), lit);
        unsigned done = (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(settled));
        mixed |= (uint64_t)(todo & ~done) << i;
    }
    block->todo = mixed;
}

#endif
