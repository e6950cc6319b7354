/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing with AVX2: the operations of umbb_coverage_row and umbb_coverage_lit in the same order on
 * four rows or four texels at a time, without fused multiply-add, so the bits are the same. max and
 * min return their second operand if the first is a NaN, as the comparisons of the plain form do.
 *
 * A triangle is drawn in bands of eight rows, and a band in cells of 8x8 texels, which lie together
 * in memory. A loop along each row would end every row of a small triangle in an unpredictable
 * branch. Lanes outside a row's span are set to INT32_MAX, so the minimum writes back the old
 * number.
 *
 * A cell is skipped if no part of the triangle can lie before the cell's present content. The test
 * is exact: all operations of the predicate, rounded or not, are monotone in x and in y, so the
 * predicate's own value at the nearest corner of the cell bounds its values at all other texels.
 */
#include "bake/depth/depth_kernels.h"

#include <math.h>

#ifdef __AVX2__
#include "bake/depth/lane_extremes.h"

/* Below this a depth converts to int32_t without a clamp. */
#define DEPTH_MAX 1e9

/* Values that all rows of a triangle share. */
struct edges {
    __m256d x[2], y[2], slope[2]; /* lines of the short edges: below and above corner 1 */
    __m256d x_min[2], x_max[2];
    __m256d long_slope, long_min,
        long_max; /* range of x of the long edge, which starts where the lower short one does */
    __m256d gradient_y, anchor_z;
    __m128i row_first, row_last;
    __m128i origin, right; /* the canvas's first texel; its last, counted from the first */
};

/* A band: eight rows of a canvas, from a multiple of eight on. x counts from the canvas's first
 * texel. */
struct band {
    /* Texels covered in each row; last is less than first if there are none. */
    int32_t first[8], last[8];
    double z[8];
    int32_t least, most;      /* least of first, greatest of last, over rows that cover texels */
    int32_t most_first;       /* greatest of first over all eight rows */
    int32_t least_last;       /* least of last over all eight rows */
    unsigned covered, before; /* a bit a row: covers texels; meets its short edge first */
};

/* Values that all texels of a triangle share. */
struct plane {
    const struct umbb_coverage *coverage;
    const struct umbb_rays *rays;
    int meet; /* umbb_rays_meet(rays) */
    __m256d gradient, anchor_x;
    __m256i lit_min, lit_max; /* of parallel light */
    double near_x;            /* x from a cell's first texel to the centre of its nearest column */
    size_t near_y;            /* nearest row of a band */
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
    e->row_first = _mm_set1_epi32(c->row_first);
    e->row_last = _mm_set1_epi32(c->row_last);
    e->origin = _mm_set1_epi32(canvas->x0);
    e->right = _mm_set1_epi32(canvas->n - 1);
}

/* Spans of four rows, empty ones as INT32_MAX .. -1. */
struct spans {
    __m128i first, last;
    int before;
};

/* Computes the spans of four rows from `row` on, and their depths at the anchor's x into z. */
static inline struct spans four_rows(const struct edges *e, int32_t row, double z[4])
{
    const __m256d half = _mm256_set1_pd(0.5);
    const __m128i number = _mm_add_epi32(_mm_set1_epi32(row), _mm_setr_epi32(0, 1, 2, 3));
    const __m256d py = _mm256_add_pd(_mm256_cvtepi32_pd(number), half);
    /* The crossing with a short edge, clamped to its corners: the lower edge from corner 1 on. */
    const __m256d upper = _mm256_cmp_pd(py, e->y[1], _CMP_GE_OQ);
    const __m256d xa = _mm256_blendv_pd(e->x[0], e->x[1], upper);
    const __m256d ya = _mm256_blendv_pd(e->y[0], e->y[1], upper);
    const __m256d slope = _mm256_blendv_pd(e->slope[0], e->slope[1], upper);
    __m256d one = _mm256_add_pd(xa, _mm256_mul_pd(_mm256_sub_pd(py, ya), slope));
    one = _mm256_max_pd(one, _mm256_blendv_pd(e->x_min[0], e->x_min[1], upper));
    one = _mm256_min_pd(one, _mm256_blendv_pd(e->x_max[0], e->x_max[1], upper));
    /* The crossing with the long edge, and the depth of each row at the anchor's x. */
    const __m256d below = _mm256_sub_pd(py, e->y[0]);
    __m256d two = _mm256_add_pd(e->x[0], _mm256_mul_pd(below, e->long_slope));
    two = _mm256_max_pd(two, e->long_min);
    two = _mm256_min_pd(two, e->long_max);
    _mm256_storeu_pd(z, _mm256_add_pd(e->anchor_z, _mm256_mul_pd(e->gradient_y, below)));
    const __m256d low = _mm256_sub_pd(_mm256_min_pd(one, two), half);
    const __m256d high = _mm256_sub_pd(_mm256_max_pd(one, two), half);
    /* Covered texels, counted from the canvas's first one and clipped to the canvas. */
    __m128i first = _mm256_cvttpd_epi32(_mm256_ceil_pd(low));
    __m128i last = _mm256_cvttpd_epi32(_mm256_floor_pd(high));
    first = _mm_max_epi32(_mm_sub_epi32(first, e->origin), _mm_setzero_si128());
    last = _mm_min_epi32(_mm_sub_epi32(last, e->origin), e->right);
    /* Uncovered: rows of no width, rows outside the triangle, spans outside the canvas. */
    const __m256 narrow = _mm256_castpd_ps(_mm256_cmp_pd(low, high, _CMP_GE_OQ));
    __m128i none = _mm_castps_si128(
        _mm_shuffle_ps(_mm256_castps256_ps128(narrow), _mm256_extractf128_ps(narrow, 1), 0x88));
    none = _mm_or_si128(none, _mm_cmpgt_epi32(e->row_first, number));
    none = _mm_or_si128(none, _mm_cmpgt_epi32(number, e->row_last));
    none = _mm_or_si128(none, _mm_cmpgt_epi32(first, last));
    return (struct spans){
        .first = _mm_or_si128(first, _mm_srli_epi32(none, 1)),
        .last = _mm_or_si128(last, none),
        .before = _mm256_movemask_pd(_mm256_cmp_pd(one, two, _CMP_LT_OQ)),
    };
}

/* Makes the band of rows from `row` on. */
static inline void band_find(const struct edges *edges, int32_t row, struct band *band)
{
    const struct spans a = four_rows(edges, row, band->z);
    const struct spans b = four_rows(edges, row + 4, band->z + 4);
    _mm_storeu_si128((__m128i *)(void *)band->first, a.first);
    _mm_storeu_si128((__m128i *)(void *)(band->first + 4), b.first);
    _mm_storeu_si128((__m128i *)(void *)band->last, a.last);
    _mm_storeu_si128((__m128i *)(void *)(band->last + 4), b.last);
    band->least = umbb_least_of_4(_mm_min_epi32(a.first, b.first));
    band->most_first = umbb_most_of_4(_mm_max_epi32(a.first, b.first));
    band->most = umbb_most_of_4(_mm_max_epi32(a.last, b.last));
    band->least_last = umbb_least_of_4(_mm_min_epi32(a.last, b.last));
    /* `last` is negative in uncovered rows. */
    band->covered = 0xffU & ~((unsigned)_mm_movemask_ps(_mm_castsi128_ps(a.last)) |
                              (unsigned)_mm_movemask_ps(_mm_castsi128_ps(b.last)) << 4);
    band->before = (unsigned)a.before | (unsigned)b.before << 4;
}

/* lit of four depths, which fit an integer without a clamp. */
static inline __m128i four_lit(__m256d z)
{
    return _mm256_cvttpd_epi32(_mm256_ceil_pd(_mm256_sub_pd(z, _mm256_set1_pd(0.5))));
}

/* Returns lit for four third coordinates under rays that meet in one point, as umbb_reciprocal_lit
 * does. */
static inline __m128i four_reciprocals_lit(const struct plane *k, __m256d q)
{
    q = _mm256_max_pd(q, _mm256_set1_pd(k->coverage->z_min));
    q = _mm256_min_pd(q, _mm256_set1_pd(k->coverage->z_max));
    __m256d z = _mm256_add_pd(_mm256_div_pd(_mm256_set1_pd(k->rays->scale), q),
                              _mm256_set1_pd(k->rays->offset));
    z = _mm256_min_pd(_mm256_max_pd(z, _mm256_setzero_pd()), _mm256_set1_pd(k->rays->size));
    return four_lit(z);
}

/* The part of the depth that depends on x, for the eight columns of a cell. */
struct slopes {
    __m256d low, high;
};

static inline struct slopes slopes_at(const struct plane *k, int32_t x)
{
    const __m256d centre =
        _mm256_add_pd(_mm256_set1_pd((double)x), _mm256_set_pd(3.5, 2.5, 1.5, 0.5));
    /* Centres are multiples of one half below 2^31: adding four to them is exact. */
    const __m256d next = _mm256_add_pd(centre, _mm256_set1_pd(4.0));
    return (struct slopes){
        .low = _mm256_mul_pd(k->gradient, _mm256_sub_pd(centre, k->anchor_x)),
        .high = _mm256_mul_pd(k->gradient, _mm256_sub_pd(next, k->anchor_x)),
    };
}

/* Returns lit of a row of a cell. The clamp may follow the rounding, because rounding keeps the
 * order of numbers. */
static inline __m256i row_lit(const struct plane *k, const struct slopes *s, double z)
{
    const __m256d row_z = _mm256_set1_pd(z);
    if (k->meet) {
        const __m128i first = four_reciprocals_lit(k, _mm256_add_pd(row_z, s->low));
        const __m128i next = four_reciprocals_lit(k, _mm256_add_pd(row_z, s->high));
        return _mm256_inserti128_si256(_mm256_castsi128_si256(first), next, 1);
    }
    const __m128i low = four_lit(_mm256_add_pd(row_z, s->low));
    const __m128i high = four_lit(_mm256_add_pd(row_z, s->high));
    const __m256i lit = _mm256_inserti128_si256(_mm256_castsi128_si256(low), high, 1);
    return _mm256_min_epi32(_mm256_max_epi32(lit, k->lit_min), k->lit_max);
}

static inline __m256i load(const int32_t *from)
{
    return _mm256_loadu_si256((const __m256i *)(const void *)from);
}

static inline void save(int32_t *to, __m256i value)
{
    _mm256_storeu_si256((__m256i *)(void *)to, value);
}

/* Draws a cell that the triangle covers completely; returns its greatest number. */
static inline int32_t draw_whole_cell(const struct plane *k, const struct slopes *s,
                                      const double z[8], int32_t *cell)
{
    __m256i most = _mm256_setzero_si256();
    for (size_t i = 0; i < 8; i++) {
        const __m256i value = _mm256_min_epi32(row_lit(k, s, z[i]), load(cell + 8 * i));
        save(cell + 8 * i, value);
        most = _mm256_max_epi32(most, value);
    }
    return umbb_most_of_8(most);
}

/* Draws the rows of `rows` (a bit mask) in the cell that starts at texel x of the canvas. */
static inline void draw_part_cell(const struct plane *k, const struct slopes *s,
                                  const struct band *band, unsigned rows, int32_t x, int32_t *cell)
{
    const __m256i lanes =
        _mm256_add_epi32(_mm256_set1_epi32(x), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    for (; rows != 0; rows &= rows - 1) {
        const size_t i = (size_t)__builtin_ctz(rows);
        const __m256i outside =
            _mm256_or_si256(_mm256_cmpgt_epi32(_mm256_set1_epi32(band->first[i]), lanes),
                            _mm256_cmpgt_epi32(lanes, _mm256_set1_epi32(band->last[i])));
        /* A shift turns all ones into INT32_MAX. */
        const __m256i value =
            _mm256_or_si256(row_lit(k, s, band->z[i]), _mm256_srli_epi32(outside, 1));
        save(cell + 8 * i, _mm256_min_epi32(value, load(cell + 8 * i)));
    }
}

/* True if the triangle cannot bring any texel of the cell before `far`. */
static inline int is_hidden(const struct plane *k, const struct band *band, int32_t x, int32_t far)
{
    const struct umbb_coverage *c = k->coverage;
    double z = band->z[k->near_y] + c->gradient_x * (((double)x + k->near_x) - c->x[0]);
    z = z > c->z_min ? z : c->z_min;
    z = z < c->z_max ? z : c->z_max;
    if (k->meet) {
        return umbb_reciprocal_lit(k->rays, z) >= far;
    }
    return z > (double)far - 0.5; /* ceil(z - 0.5) >= far */
}

/* Draws the cells of a band whose rows all go to one layer. */
static inline void draw_band(const struct plane *k, const struct band *band,
                             const struct umbb_canvas *canvas, int32_t *layer, int32_t *far)
{
    for (int32_t x = band->least & ~7; x <= band->most; x += 8) {
        /* A cell that is covered completely also gets a new bound. */
        int32_t *const cell_far = far + (x >> 3);
        if (is_hidden(k, band, canvas->x0 + x, *cell_far)) {
            continue;
        }
        const struct slopes slopes = slopes_at(k, canvas->x0 + x);
        int32_t *const cell = layer + 8 * (size_t)x;
        if (band->most_first <= x && band->least_last >= x + 7) {
            *cell_far = draw_whole_cell(k, &slopes, band->z, cell);
        } else {
            draw_part_cell(k, &slopes, band, band->covered, x, cell);
        }
    }
}

/* Draws the cells of a band of which some rows face the light and others do not. */
static void draw_mixed_band(const struct plane *k, const struct band *band,
                            const struct umbb_canvas *canvas, size_t line, unsigned front)
{
    for (int32_t x = band->least & ~7; x <= band->most; x += 8) {
        const struct slopes slopes = slopes_at(k, canvas->x0 + x);
        const size_t cell = line + 8 * (size_t)x;
        draw_part_cell(k, &slopes, band, band->covered & front, x, canvas->front + cell);
        draw_part_cell(k, &slopes, band, band->covered & ~front, x, canvas->back + cell);
    }
}

/* Returns whether every depth computed for the cells of a triangle fits an integer without a clamp.
 * Under parallel light the depths of a grazing triangle may not fit, because its slope has no
 * limit. */
static inline int is_tame(const struct umbb_rays *rays, const struct umbb_coverage *c)
{
    if (umbb_rays_meet(rays)) {
        return 1;
    }
    const double left = c->x[0] < c->x[1] ? c->x[0] : c->x[1];
    const double right = c->x[0] > c->x[1] ? c->x[0] : c->x[1];
    const double width = (right > c->x[2] ? right : c->x[2]) - (left < c->x[2] ? left : c->x[2]);
    return fabs(c->anchor_z) + fabs(c->gradient_y) * (c->y[2] - c->y[0] + 9.0) +
               fabs(c->gradient_x) * (width + 9.0) <
           DEPTH_MAX;
}

static void draw_one(const struct umbb_coverage *coverage, const struct umbb_canvas *canvas)
{
    const int32_t bottom = canvas->y0 + canvas->n - 1;
    const int32_t last = coverage->row_last < bottom ? coverage->row_last : bottom;
    int32_t row = coverage->row_first > canvas->y0 ? coverage->row_first : canvas->y0;
    if (row > last) {
        return;
    }
    if (!is_tame(&canvas->rays, coverage)) {
        umbb_draw_plain(coverage, 1, canvas);
        return;
    }
    struct edges edges;
    edges_init(&edges, coverage, canvas);
    const struct plane plane = {
        .coverage = coverage,
        .rays = &canvas->rays,
        .meet = umbb_rays_meet(&canvas->rays),
        .gradient = _mm256_set1_pd(coverage->gradient_x),
        .anchor_x = _mm256_set1_pd(coverage->x[0]),
        .lit_min = _mm256_set1_epi32(umbb_coverage_round(coverage->z_min)),
        .lit_max = _mm256_set1_epi32(umbb_coverage_round(coverage->z_max)),
        .near_x = umbb_rays_grow(&canvas->rays, coverage->gradient_x) ? 0.5 : 7.5,
        .near_y = umbb_rays_grow(&canvas->rays, coverage->gradient_y) ? 0 : 7,
    };
    const size_t width = (size_t)canvas->n;
    /* Bands start at multiples of eight rows of the canvas. */
    for (row -= (row - canvas->y0) & 7; row <= last; row += 8) {
        struct band band;
        band_find(&edges, row, &band);
        const unsigned front = coverage->odd ? ~band.before : band.before;
        const size_t line = (size_t)(row - canvas->y0);
        if ((band.covered & ~front) == 0) {
            draw_band(&plane, &band, canvas, canvas->front + line * width,
                      canvas->front_far + line / 8 * (width / 8));
        } else if ((band.covered & front) == 0 || canvas->front == canvas->back) {
            draw_band(&plane, &band, canvas, canvas->back + line * width,
                      canvas->back_far + line / 8 * (width / 8));
        } else {
            draw_mixed_band(&plane, &band, canvas, line * width, front);
        }
    }
}

void umbb__draw_avx2(const struct umbb_coverage *coverages, size_t count,
                     const struct umbb_canvas *canvas)
{
    for (size_t i = 0; i < count; i++) {
        draw_one(&coverages[i], canvas);
    }
}

void umbb__far_avx2(const int32_t *layer, int32_t n, int32_t *far)
{
    const size_t blocks = (size_t)(n >> 3) * (size_t)(n >> 3);
    for (size_t block = 0; block < blocks; block++, layer += 64) {
        __m256i most = load(layer);
        for (size_t i = 8; i < 64; i += 8) {
            most = _mm256_max_epi32(most, load(layer + i));
        }
        far[block] = umbb_most_of_8(most);
    }
}

/* One 8x8 block: decides, stores, reduces. */
static inline void store_square(const int32_t *layers, size_t texels, struct umbb_tile *tile,
                                size_t square)
{
    int32_t *lit_to = tile->lit + square * 64, *end_to = tile->end + square * 64;
    const __m256i background = _mm256_set1_epi32(tile->background);
    __m256i most = _mm256_setzero_si256(), fewest = _mm256_set1_epi32(INT32_MAX);
    for (size_t y = 0; y < 8; y++, layers += 8) {
        __m256i lit = load(layers + UMBB_LAYER_OPEN * texels), end = lit;
        if (end_to != lit_to) {
            const __m256i front = load(layers + UMBB_LAYER_FRONT * texels);
            const __m256i back = load(layers + UMBB_LAYER_BACK * texels);
            lit = _mm256_min_epi32(front, _mm256_min_epi32(back, lit));
            const __m256i inside = _mm256_and_si256(_mm256_cmpeq_epi32(front, lit),
                                                    _mm256_cmpgt_epi32(background, back));
            end = _mm256_blendv_epi8(lit, back, inside);
            save(end_to + 8 * y, end);
        }
        save(lit_to + 8 * y, lit);
        most = _mm256_max_epi32(most, lit);
        fewest = _mm256_min_epi32(fewest, end);
    }
    tile->max_lit[UMB_LEVEL_BRICK][square] = umbb_most_of_8(most);
    tile->min_end[UMB_LEVEL_BRICK][square] = umbb_least_of_8(fewest);
}

void umbb__store_avx2(const int32_t *layers, int32_t n, struct umbb_tile *tile, int32_t x0,
                      int32_t y0)
{
    const size_t width = (size_t)n, texels = width * width;
    for (int32_t y = 0; y < n; y += 8) {
        for (int32_t x = 0; x < n; x += 8) {
            const size_t square = umbb_tile_index(tile, x0 + x, y0 + y) / 64;
            store_square(layers + (size_t)y * width + 8 * (size_t)x, texels, tile, square);
        }
    }
}

#endif
