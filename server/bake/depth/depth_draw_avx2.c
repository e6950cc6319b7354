/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing with AVX2: the operations of umbb_coverage_row and umbb_coverage_lit in the same order on
 * four rows or four texels at a time, without fused multiply-add, hence the same bits. max and min
 * give their second operand if the first is a NaN, as the comparisons of the plain form do.
 *
 * A span's last vector may reach up to three texels beyond its end: those lanes are set to
 * INT32_MAX, so that the minimum writes back what was there.
 *
 * Triangles of a fine mesh cover a dozen rows of a few texels each: what is paid a row and a span
 * counts, not what is paid a texel.
 */
#include "bake/depth/depth_draw.h"

#include <stddef.h>

#ifdef __AVX2__
#include <immintrin.h>

/* What all rows of a triangle share. */
struct edges {
    __m256d x[2], y[2], slope[2]; /* of the short edges: below and above corner 1 */
    __m256d x_min[2], x_max[2];
    __m256d long_slope, long_min,
        long_max; /* the long edge starts where the lower short one does */
    __m256d gradient_y, anchor_z;
    __m128i left, right; /* of the canvas */
};

/* Four rows. */
struct rows {
    int32_t first[4], last[4];
    double z[4];
    int before; /* bit a row: the short edge's crossing is the first */
};

/* What all texels of a triangle share. */
struct plane {
    __m256d gradient, anchor_x, z_min, z_max, half;
};

static inline void edges_init(struct edges *e, const struct umbb_coverage *c,
                              const struct umbb_canvas *canvas)
{
    for (int i = 0; i < 2; i++) {
        const __m256d a = _mm256_set1_pd(c->x[i]), b = _mm256_set1_pd(c->x[i + 1]);
        e->x[i] = a;
        e->y[i] = _mm256_set1_pd(c->y[i]);
        e->slope[i] = _mm256_set1_pd(c->slope[i]);
        e->x_min[i] = _mm256_min_pd(a, b);
        e->x_max[i] = _mm256_max_pd(a, b);
    }
    const __m256d end = _mm256_set1_pd(c->x[2]);
    e->long_slope = _mm256_set1_pd(c->slope[2]);
    e->long_min = _mm256_min_pd(e->x[0], end);
    e->long_max = _mm256_max_pd(e->x[0], end);
    e->gradient_y = _mm256_set1_pd(c->gradient_y);
    e->anchor_z = _mm256_set1_pd(c->anchor_z);
    e->left = _mm_set1_epi32(canvas->x0);
    e->right = _mm_set1_epi32(canvas->x0 + canvas->n - 1);
}

static inline void rows_find(const struct edges *e, int32_t row, struct rows *out)
{
    const __m256d half = _mm256_set1_pd(0.5);
    const __m256d py =
        _mm256_add_pd(_mm256_set1_pd((double)row), _mm256_set_pd(3.5, 2.5, 1.5, 0.5));
    const __m256d upper = _mm256_cmp_pd(py, e->y[1], _CMP_GE_OQ);
    const __m256d xa = _mm256_blendv_pd(e->x[0], e->x[1], upper);
    const __m256d ya = _mm256_blendv_pd(e->y[0], e->y[1], upper);
    const __m256d slope = _mm256_blendv_pd(e->slope[0], e->slope[1], upper);
    __m256d one = _mm256_add_pd(xa, _mm256_mul_pd(_mm256_sub_pd(py, ya), slope));
    one = _mm256_max_pd(one, _mm256_blendv_pd(e->x_min[0], e->x_min[1], upper));
    one = _mm256_min_pd(one, _mm256_blendv_pd(e->x_max[0], e->x_max[1], upper));
    const __m256d below = _mm256_sub_pd(py, e->y[0]);
    __m256d two = _mm256_add_pd(e->x[0], _mm256_mul_pd(below, e->long_slope));
    two = _mm256_max_pd(two, e->long_min);
    two = _mm256_min_pd(two, e->long_max);
    const __m256d low = _mm256_sub_pd(_mm256_min_pd(one, two), half);
    const __m256d high = _mm256_sub_pd(_mm256_max_pd(one, two), half);
    const __m128i first = _mm256_cvttpd_epi32(_mm256_ceil_pd(low));
    const __m128i last = _mm256_cvttpd_epi32(_mm256_floor_pd(high));
    /* Rows of no width get an end before any start. */
    const __m256 apart = _mm256_castpd_ps(_mm256_cmp_pd(low, high, _CMP_LT_OQ));
    const __m128 wide =
        _mm_shuffle_ps(_mm256_castps256_ps128(apart), _mm256_extractf128_ps(apart, 1), 0x88);
    const __m128i end = _mm_blendv_epi8(_mm_set1_epi32(INT32_MIN), last, _mm_castps_si128(wide));
    _mm_storeu_si128((__m128i *)(void *)out->first, _mm_max_epi32(first, e->left));
    _mm_storeu_si128((__m128i *)(void *)out->last, _mm_min_epi32(end, e->right));
    _mm256_storeu_pd(out->z, _mm256_add_pd(e->anchor_z, _mm256_mul_pd(e->gradient_y, below)));
    out->before = _mm256_movemask_pd(_mm256_cmp_pd(one, two, _CMP_LT_OQ));
}

static inline __m128i four_lit(const struct plane *k, __m256d row_z, __m256d centre)
{
    __m256d z = _mm256_mul_pd(k->gradient, _mm256_sub_pd(centre, k->anchor_x));
    z = _mm256_add_pd(row_z, z);
    z = _mm256_max_pd(z, k->z_min);
    z = _mm256_min_pd(z, k->z_max);
    return _mm256_cvttpd_epi32(_mm256_ceil_pd(_mm256_sub_pd(z, k->half)));
}

/* Texels x .. last of a row into `at`, which is x's number. */
static inline void span(const struct plane *k, double z, int32_t x, int32_t last, int32_t *at)
{
    const __m256d row_z = _mm256_set1_pd(z), step = _mm256_set1_pd(4.0);
    /* Centres are multiples of one half below 2^31: adding four to them is exact. */
    __m256d centre = _mm256_add_pd(_mm256_set1_pd((double)x), _mm256_set_pd(3.5, 2.5, 1.5, 0.5));
    int32_t left = last - x + 1;
    for (; left > 0; left -= 4, at += 4) {
        /* All ones, shifted to INT32_MAX, in lanes beyond the end. */
        const __m128i beyond =
            _mm_srli_epi32(_mm_cmpgt_epi32(_mm_set_epi32(4, 3, 2, 1), _mm_set1_epi32(left)), 1);
        const __m128i lit = _mm_or_si128(four_lit(k, row_z, centre), beyond);
        const __m128i old = _mm_loadu_si128((const __m128i *)(const void *)at);
        _mm_storeu_si128((__m128i *)(void *)at, _mm_min_epi32(lit, old));
        centre = _mm256_add_pd(centre, step);
    }
}

static void draw(const struct umbb_coverage *coverage, const struct umbb_canvas *canvas)
{
    const int32_t bottom = canvas->y0 + canvas->n - 1;
    const int32_t last = coverage->row_last < bottom ? coverage->row_last : bottom;
    int32_t row = coverage->row_first > canvas->y0 ? coverage->row_first : canvas->y0;
    if (row > last) {
        return;
    }
    struct edges edges;
    edges_init(&edges, coverage, canvas);
    const struct plane plane = {
        .gradient = _mm256_set1_pd(coverage->gradient_x),
        .anchor_x = edges.x[0],
        .z_min = _mm256_set1_pd(coverage->z_min),
        .z_max = _mm256_set1_pd(coverage->z_max),
        .half = _mm256_set1_pd(0.5),
    };
    int32_t *const layers[2] = {canvas->back, canvas->front};
    ptrdiff_t line = (ptrdiff_t)(row - canvas->y0) * (ptrdiff_t)canvas->n;
    while (row <= last) {
        struct rows rows;
        rows_find(&edges, row, &rows);
        const int front = coverage->odd ? ~rows.before : rows.before;
        const int32_t count = last - row < 3 ? last - row + 1 : 4;
        for (int32_t i = 0; i < count; i++, line += canvas->n) {
            if (rows.first[i] <= rows.last[i]) {
                span(&plane, rows.z[i], rows.first[i], rows.last[i],
                     layers[front >> i & 1] + line + (rows.first[i] - canvas->x0));
            }
        }
        row += 4;
    }
}

umbb_draw_fn umbb_draw_avx2(void)
{
    return __builtin_cpu_supports("avx2") ? draw : NULL;
}

#else

umbb_draw_fn umbb_draw_avx2(void)
{
    return NULL;
}

#endif
