/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing with AVX-512: what depth_draw_avx2.c does, eight rows or eight texels of doubles at a
 * time. The operations of the predicate in the same order, never fused, hence the same bits;
 * rounding up and down is part of the conversion to integers.
 *
 * Three steps over several triangles at once: their bands of eight rows, the cells of 8x8 texels of
 * those bands that are not hidden, the drawing of these cells. What a small triangle covers nobody
 * can predict; one triangle after the other would wait at each of its bands for what was guessed
 * wrongly. A cell's part of the triangle is 64 bits, a byte a row; cells are drawn without a branch
 * on those bits.
 */
#include "bake/depth/depth_draw.h"

#include <math.h>
#include <stddef.h>

#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512BW__) && defined(__AVX512DQ__)
#include <immintrin.h>

/* Below this a depth converts to int32_t without a clamp. */
#define DEPTH_MAX 1e9

/* Bands and cells under way: their records and the cells' texels fit the first-level cache. */
#define BANDS_MAX ((size_t)64)
#define CELLS_MAX ((size_t)64)

#define UP   (_MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC)
#define DOWN (_MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)

/* What all rows and texels of a triangle share. */
struct plane {
    const struct umbb_coverage *coverage;
    double x_min[3], x_max[3]; /* of the edges 0-1, 1-2 and 0-2 */
    double left, right;        /* of all corners */
    double corner_off;         /* x of corner 1, seen from the long edge in its row */
    __m512i lit_min, lit_max;
    double near_x, far_x; /* from a cell's first texel to the centre of its nearest column, .. */
    size_t near_y, far_y; /* the nearest and the farthest row of a band */
};

/* Eight rows of a canvas, from a multiple of eight on; x counts from the canvas's first texel. */
struct band {
    const struct plane *plane;
    size_t texels, far;  /* where its first cell's are in a layer and its far */
    __m256i first, last; /* texels covered; INT32_MAX .. -1 if there are none */
    double z[8];         /* of each row at the anchor's x */
    int32_t least, most; /* of first and last */
    uint64_t front;      /* a byte a row: all ones if it goes to the canvas's front */
};

/* x where rows at `py` cross the short edge, which is the lower one from corner 1 on. */
static inline __m512d cross_short(const struct plane *k, __m512d py)
{
    const struct umbb_coverage *c = k->coverage;
    const __mmask8 upper = _mm512_cmp_pd_mask(py, _mm512_set1_pd(c->y[1]), _CMP_GE_OQ);
    const __m512d xa =
        _mm512_mask_blend_pd(upper, _mm512_set1_pd(c->x[0]), _mm512_set1_pd(c->x[1]));
    const __m512d ya =
        _mm512_mask_blend_pd(upper, _mm512_set1_pd(c->y[0]), _mm512_set1_pd(c->y[1]));
    const __m512d slope =
        _mm512_mask_blend_pd(upper, _mm512_set1_pd(c->slope[0]), _mm512_set1_pd(c->slope[1]));
    const __m512d low =
        _mm512_mask_blend_pd(upper, _mm512_set1_pd(k->x_min[0]), _mm512_set1_pd(k->x_min[1]));
    const __m512d high =
        _mm512_mask_blend_pd(upper, _mm512_set1_pd(k->x_max[0]), _mm512_set1_pd(k->x_max[1]));
    const __m512d x = _mm512_add_pd(xa, _mm512_mul_pd(_mm512_sub_pd(py, ya), slope));
    /* max and min give their second operand if the first is a NaN, as the plain form does. */
    return _mm512_min_pd(_mm512_max_pd(x, low), high);
}

/* Bits of the rows row .. row + 7 that the triangle meets. */
static inline unsigned rows_met(const struct umbb_coverage *c, int32_t row)
{
    const int32_t above = c->row_first - row, below = row + 7 - c->row_last;
    return 0xffU << (above > 0 ? above : 0) & 0xffU >> (below > 0 ? below : 0);
}

static inline int32_t least_of(__m256i v)
{
    __m128i m = _mm_min_epi32(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));
    m = _mm_min_epi32(m, _mm_shuffle_epi32(m, 0x4e));
    m = _mm_min_epi32(m, _mm_shuffle_epi32(m, 0xb1));
    return _mm_cvtsi128_si32(m);
}

static inline int32_t most_of(__m256i v)
{
    __m128i m = _mm_max_epi32(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));
    m = _mm_max_epi32(m, _mm_shuffle_epi32(m, 0x4e));
    m = _mm_max_epi32(m, _mm_shuffle_epi32(m, 0xb1));
    return _mm_cvtsi128_si32(m);
}

/* The band of rows from `row` on; at least one of them meets the triangle. */
static inline void band_find(const struct plane *k, const struct umbb_canvas *canvas, int32_t row,
                             struct band *band)
{
    const struct umbb_coverage *c = k->coverage;
    band->plane = k;
    band->texels = (size_t)(row - canvas->y0) * (size_t)canvas->n;
    band->far = band->texels / 64;
    const __m512d half = _mm512_set1_pd(0.5);
    const __m256i number =
        _mm256_add_epi32(_mm256_set1_epi32(row), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    const __m512d py = _mm512_add_pd(_mm512_cvtepi32_pd(number), half);
    const __m512d one = cross_short(k, py);
    const __m512d below = _mm512_sub_pd(py, _mm512_set1_pd(c->y[0]));
    __m512d two =
        _mm512_add_pd(_mm512_set1_pd(c->x[0]), _mm512_mul_pd(below, _mm512_set1_pd(c->slope[2])));
    two = _mm512_max_pd(two, _mm512_set1_pd(k->x_min[2]));
    two = _mm512_min_pd(two, _mm512_set1_pd(k->x_max[2]));
    _mm512_storeu_pd(band->z, _mm512_add_pd(_mm512_set1_pd(c->anchor_z),
                                            _mm512_mul_pd(_mm512_set1_pd(c->gradient_y), below)));
    const __m512d low = _mm512_sub_pd(_mm512_min_pd(one, two), half);
    const __m512d high = _mm512_sub_pd(_mm512_max_pd(one, two), half);
    const __m256i origin = _mm256_set1_epi32(canvas->x0);
    const __m256i first = _mm256_max_epi32(
        _mm256_sub_epi32(_mm512_cvt_roundpd_epi32(low, UP), origin), _mm256_setzero_si256());
    const __m256i last =
        _mm256_min_epi32(_mm256_sub_epi32(_mm512_cvt_roundpd_epi32(high, DOWN), origin),
                         _mm256_set1_epi32(canvas->n - 1));
    /* Nothing: rows of no width, rows beside the triangle, spans beside the canvas. */
    const unsigned wide = _mm512_cmp_pd_mask(low, high, _CMP_LT_OQ);
    const unsigned inside = _mm256_cmple_epi32_mask(first, last);
    const __mmask8 covered = (__mmask8)(wide & inside & rows_met(c, row));
    band->first = _mm256_mask_mov_epi32(_mm256_set1_epi32(INT32_MAX), covered, first);
    band->last = _mm256_mask_mov_epi32(_mm256_set1_epi32(-1), covered, last);
    band->least = least_of(band->first);
    band->most = most_of(band->last);
    const unsigned before = _mm512_cmp_pd_mask(one, two, _CMP_LT_OQ);
    const unsigned facing = c->odd ? ~before : before;
    const __mmask16 front = (__mmask16)(canvas->front == canvas->back ? 0xffU : facing & 0xffU);
    band->front = (uint64_t)_mm_cvtsi128_si64(_mm_movm_epi8(front));
}

/* The texels of the cell from texel x of the canvas on that the triangle covers: a byte a row, the
 * first texel its lowest bit. */
static inline uint64_t cell_bits(const struct band *band, int32_t x)
{
    const __m256i all = _mm256_set1_epi32(0xff), zero = _mm256_setzero_si256();
    const __m256i left =
        _mm256_max_epi32(_mm256_sub_epi32(band->first, _mm256_set1_epi32(x)), zero);
    const __m256i right =
        _mm256_max_epi32(_mm256_sub_epi32(_mm256_set1_epi32(x + 7), band->last), zero);
    /* Counts of 32 and more shift everything out. */
    const __m256i bits =
        _mm256_and_si256(_mm256_sllv_epi32(all, left), _mm256_srlv_epi32(all, right));
    return (uint64_t)_mm_cvtsi128_si64(_mm256_cvtepi32_epi8(bits));
}

/* The part of the depth that depends on x, for the eight columns from texel x of the map on. */
static inline __m512d slopes_at(const struct plane *k, int32_t x)
{
    const struct umbb_coverage *c = k->coverage;
    const __m512d centre = _mm512_add_pd(_mm512_set1_pd((double)x),
                                         _mm512_setr_pd(0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5));
    return _mm512_mul_pd(_mm512_set1_pd(c->gradient_x),
                         _mm512_sub_pd(centre, _mm512_set1_pd(c->x[0])));
}

/* Added to a number below 2^31 in magnitude, rounding up, it leaves the next integer above in the
 * lower half of the sum's bits. */
#define INTEGER_MAGIC 6755399441055744.0 /* 1.5 * 2^52 */

/* The bits that hold lit of a row of a cell, not clamped. */
static inline __m512i row_sum(__m512d slopes, double z)
{
    const __m512d depth = _mm512_add_pd(_mm512_set1_pd(z), slopes);
    return _mm512_castpd_si512(_mm512_add_round_pd(_mm512_sub_pd(depth, _mm512_set1_pd(0.5)),
                                                   _mm512_set1_pd(INTEGER_MAGIC), UP));
}

/* Draws the texels of the bits of `bits`, two rows at a time. Clamping after rounding is the same
 * as before: rounding keeps the order. */
static inline void draw_cell(const struct plane *k, const struct band *band, __m512d slopes,
                             uint64_t bits, int32_t *cell)
{
    const __m512i lower_halves =
        _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    for (size_t i = 0; i < 8; i += 2, cell += 16, bits >>= 16) {
        __m512i lit = _mm512_permutex2var_epi32(row_sum(slopes, band->z[i]), lower_halves,
                                                row_sum(slopes, band->z[i + 1]));
        lit = _mm512_min_epi32(_mm512_max_epi32(lit, k->lit_min), k->lit_max);
        const __m512i old = _mm512_loadu_si512(cell);
        _mm512_storeu_si512(cell,
                            _mm512_mask_min_epi32(old, (__mmask16)(bits & 0xffffU), old, lit));
    }
}

/* The predicate's depth at a place of a band that no other of the cell's lies before (or behind):
 * every operation, rounded or not, is monotone in x and in y. */
static inline double bound(const struct plane *k, double row_z, double centre_x)
{
    const struct umbb_coverage *c = k->coverage;
    double z = row_z + c->gradient_x * (centre_x - c->x[0]);
    z = z > c->z_min ? z : c->z_min;
    return z < c->z_max ? z : c->z_max;
}

/* A cell to be drawn. */
struct cell {
    uint64_t bits; /* a byte a row */
    const struct band *band;
    int32_t *texels, *far;
    int32_t map_x; /* its first texel */
};

/* Triangles under way. */
struct work {
    const struct umbb_canvas *canvas;
    size_t band_count, cell_count;
    struct plane planes[UMBB_DRAW_MAX];
    struct band bands[BANDS_MAX];
    struct cell cells[CELLS_MAX];
};

static inline void draw_cells(struct work *work)
{
    for (size_t i = 0; i < work->cell_count; i++) {
        const struct cell *cell = &work->cells[i];
        const struct plane *k = cell->band->plane;
        draw_cell(k, cell->band, slopes_at(k, cell->map_x), cell->bits, cell->texels);
        if (cell->bits == UINT64_MAX) {
            const double z = bound(k, cell->band->z[k->far_y], (double)cell->map_x + k->far_x);
            const int32_t most = umbb_coverage_round(z);
            *cell->far = most < *cell->far ? most : *cell->far;
        }
    }
    work->cell_count = 0;
}

/* Adds the texels of `bits` of a band's cell, unless all of them are behind what is there. */
static inline void add_cell(struct work *work, const struct band *band, int32_t x, uint64_t bits,
                            int32_t *layer, int32_t *far)
{
    const struct plane *k = band->plane;
    struct cell *cell = &work->cells[work->cell_count];
    cell->bits = bits;
    cell->band = band;
    cell->texels = layer + band->texels + 8 * (size_t)x;
    cell->far = far + band->far + (x >> 3);
    cell->map_x = work->canvas->x0 + x;
    const double z = bound(k, band->z[k->near_y], (double)cell->map_x + k->near_x);
    /* Hidden: ceil(z - 0.5) >= far. */
    work->cell_count += (size_t)((bits != 0) & (z <= (double)*cell->far - 0.5));
}

static void draw_bands(struct work *work)
{
    const struct umbb_canvas *canvas = work->canvas;
    for (size_t i = 0; i < work->band_count; i++) {
        const struct band *band = &work->bands[i];
        for (int32_t x = band->least & ~7; x <= band->most; x += 8) {
            const uint64_t bits = cell_bits(band, x), back = bits & ~band->front;
            add_cell(work, band, x, bits & band->front, canvas->front, canvas->front_far);
            if (back != 0) {
                add_cell(work, band, x, back, canvas->back, canvas->back_far);
            }
            if (work->cell_count > CELLS_MAX - 2) {
                draw_cells(work);
            }
        }
    }
    draw_cells(work);
    work->band_count = 0;
}

static inline double least(double a, double b)
{
    return a < b ? a : b;
}

static inline double most(double a, double b)
{
    return a < b ? b : a;
}

/* Whether every depth computed for the cells of a triangle fits an integer without a clamp:
 * grazing triangles have slopes beyond all bounds. */
static inline int is_tame(const struct plane *k)
{
    const struct umbb_coverage *c = k->coverage;
    const double width = k->right - k->left;
    return fabs(c->anchor_z) + fabs(c->gradient_y) * (c->y[2] - c->y[0] + 9.0) +
               fabs(c->gradient_x) * (width + 9.0) <
           DEPTH_MAX;
}

static inline void plane_init(struct plane *k, const struct umbb_coverage *c)
{
    k->coverage = c;
    for (size_t edge = 0; edge < 3; edge++) {
        const double a = c->x[edge == 1], b = c->x[edge == 0 ? 1 : 2];
        k->x_min[edge] = least(a, b);
        k->x_max[edge] = most(a, b);
    }
    k->left = least(k->x_min[2], c->x[1]);
    k->right = most(k->x_max[2], c->x[1]);
    k->corner_off = c->x[1] - (c->x[0] + (c->y[1] - c->y[0]) * c->slope[2]);
    k->lit_min = _mm512_set1_epi32(umbb_coverage_round(c->z_min));
    k->lit_max = _mm512_set1_epi32(umbb_coverage_round(c->z_max));
    k->near_x = c->gradient_x < 0.0 ? 7.5 : 0.5;
    k->far_x = 8.0 - k->near_x;
    k->near_y = c->gradient_y < 0.0 ? 7 : 0;
    k->far_y = 7 - k->near_y;
}

/* Far above what rounding may do to a crossing (texels). */
#define SLACK 0.01

/* Cells of a band that are looked at to find it hidden. */
#define CELLS_SEEN 8

/* Bits of lanes where some of `far` from `first` to `last` is more than lit. */
static inline unsigned lanes_before(const int32_t *far, __m256i first, __m256i last, __m256i lit)
{
    /* Two cells without a branch, for the many that have no more. */
    const __m256i next = _mm256_min_epi32(_mm256_add_epi32(first, _mm256_set1_epi32(1)), last);
    const __m256i two = _mm256_max_epi32(_mm256_i32gather_epi32(far, first, 4),
                                         _mm256_i32gather_epi32(far, next, 4));
    unsigned before = _mm256_cmpgt_epi32_mask(two, lit);
    unsigned left = _mm256_cmplt_epi32_mask(next, last) & ~before;
    for (int i = 2; i < CELLS_SEEN && left != 0; i++) {
        first = _mm256_add_epi32(first, _mm256_set1_epi32(1));
        const __m256i at = _mm256_min_epi32(_mm256_add_epi32(first, _mm256_set1_epi32(1)), last);
        before |= _mm256_cmpgt_epi32_mask(_mm256_i32gather_epi32(far, at, 4), lit);
        left = _mm256_cmplt_epi32_mask(at, last) & ~before;
    }
    return before | left;
}

/*
 * Bits of the bands from `row` on, eight of them or those down to `last`, that the triangle may
 * change. The bounds are quicker to get than a band: at every row the triangle lies between its
 * long edge and that edge moved over corner 1.
 */
static inline unsigned bands_seen(const struct plane *k, const struct umbb_canvas *canvas,
                                  int32_t row, int32_t last)
{
    const struct umbb_coverage *c = k->coverage;
    const __m256i bands = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    const __m256i rows = _mm256_add_epi32(_mm256_set1_epi32(row), _mm256_slli_epi32(bands, 3));
    const __m512d below = _mm512_sub_pd(
        _mm512_add_pd(_mm512_cvtepi32_pd(rows), _mm512_set1_pd(0.5)), _mm512_set1_pd(c->y[0]));
    const __m512d slope = _mm512_set1_pd(c->slope[2]);
    const __m512d top = _mm512_add_pd(_mm512_set1_pd(c->x[0]), _mm512_mul_pd(below, slope));
    const __m512d bottom = _mm512_add_pd(top, _mm512_mul_pd(_mm512_set1_pd(7.0), slope));
    /* The second operand is also what a NaN becomes. */
    const __m512d left =
        _mm512_max_pd(_mm512_add_pd(_mm512_min_pd(top, bottom),
                                    _mm512_set1_pd(least(k->corner_off, 0.0) - SLACK)),
                      _mm512_set1_pd(k->left));
    const __m512d right = _mm512_min_pd(
        _mm512_add_pd(_mm512_max_pd(top, bottom), _mm512_set1_pd(most(k->corner_off, 0.0) + SLACK)),
        _mm512_set1_pd(k->right));
    /* Of the nearest row, as the predicate has it: seven more than `below` would round twice. */
    const __m256i near_row = _mm256_add_epi32(rows, _mm256_set1_epi32((int32_t)k->near_y));
    const __m512d near_below = _mm512_sub_pd(
        _mm512_add_pd(_mm512_cvtepi32_pd(near_row), _mm512_set1_pd(0.5)), _mm512_set1_pd(c->y[0]));
    const __m512d near_x = _mm512_sub_pd(k->near_x < 4.0 ? left : right, _mm512_set1_pd(c->x[0]));
    __m512d z = _mm512_add_pd(_mm512_set1_pd(c->anchor_z),
                              _mm512_mul_pd(_mm512_set1_pd(c->gradient_y), near_below));
    z = _mm512_add_pd(z, _mm512_mul_pd(_mm512_set1_pd(c->gradient_x), near_x));
    z = _mm512_min_pd(_mm512_max_pd(z, _mm512_set1_pd(c->z_min)), _mm512_set1_pd(c->z_max));
    const __m256i lit = _mm512_cvt_roundpd_epi32(_mm512_sub_pd(z, _mm512_set1_pd(0.5)), UP);
    const __m512d origin = _mm512_set1_pd((double)canvas->x0), zero = _mm512_setzero_pd();
    const __m512d end = _mm512_set1_pd((double)(canvas->n - 1));
    const __m512d first_x = _mm512_min_pd(_mm512_max_pd(_mm512_sub_pd(left, origin), zero), end);
    const __m512d last_x = _mm512_min_pd(_mm512_max_pd(_mm512_sub_pd(right, origin), zero), end);
    /* Bands beyond the last look at a cell that is there. */
    const __m256i band = _mm256_min_epi32(bands, _mm256_set1_epi32((last - row) >> 3));
    const __m256i at =
        _mm256_add_epi32(_mm256_mullo_epi32(band, _mm256_set1_epi32(canvas->n >> 3)),
                         _mm256_set1_epi32(((row - canvas->y0) >> 3) * (canvas->n >> 3)));
    const __m256i first = _mm256_add_epi32(at, _mm256_srli_epi32(_mm512_cvttpd_epi32(first_x), 3));
    const __m256i end_cell =
        _mm256_add_epi32(at, _mm256_srli_epi32(_mm512_cvttpd_epi32(last_x), 3));
    unsigned seen = lanes_before(canvas->front_far, first, end_cell, lit);
    if (canvas->back_far != canvas->front_far) {
        seen |= lanes_before(canvas->back_far, first, end_cell, lit);
    }
    const int32_t count = ((last - row) >> 3) + 1;
    return count < 8 ? seen & ((1U << count) - 1U) : seen;
}

/* The first row of a triangle's first band, and the last row, in a canvas. Bands start at multiples
 * of eight rows of the canvas. */
static inline int32_t rows_of(const struct umbb_coverage *c, const struct umbb_canvas *canvas,
                              int32_t *last)
{
    const int32_t bottom = canvas->y0 + canvas->n - 1;
    const int32_t row = c->row_first > canvas->y0 ? c->row_first : canvas->y0;
    *last = c->row_last < bottom ? c->row_last : bottom;
    return row - ((row - canvas->y0) & 7);
}

/* Bits of the bands of a triangle that it may change: at most UMBB_CANVAS_MAX / 8. */
static inline uint32_t triangle_seen(const struct plane *k, const struct umbb_canvas *canvas)
{
    uint32_t seen = 0;
    int32_t last;
    const int32_t row = rows_of(k->coverage, canvas, &last);
    if (canvas->fresh) {
        return row > last ? 0 : UINT32_MAX >> (31 - ((last - row) >> 3));
    }
    for (int32_t at = row; at <= last; at += 64) {
        seen |= bands_seen(k, canvas, at, last) << ((at - row) >> 3);
    }
    return seen;
}

static void draw(const struct umbb_coverage *coverages, size_t count,
                 const struct umbb_canvas *canvas)
{
    struct work work;
    uint32_t seen[UMBB_DRAW_MAX];
    work.canvas = canvas;
    work.band_count = 0;
    work.cell_count = 0;
    for (size_t i = 0; i < count; i++) {
        plane_init(&work.planes[i], &coverages[i]);
        seen[i] = 0;
        if (is_tame(&work.planes[i])) {
            seen[i] = triangle_seen(&work.planes[i], canvas);
        } else {
            umbb_draw_plain(&coverages[i], 1, canvas);
        }
    }
    for (size_t i = 0; i < count; i++) {
        int32_t last;
        const int32_t row = rows_of(&coverages[i], canvas, &last);
        for (uint32_t bands = seen[i]; bands != 0; bands &= bands - 1) {
            if (work.band_count == BANDS_MAX) {
                draw_bands(&work);
            }
            band_find(&work.planes[i], canvas, row + 8 * __builtin_ctz(bands),
                      &work.bands[work.band_count++]);
        }
    }
    draw_bands(&work);
}

umbb_draw_fn umbb_draw_avx512(void)
{
    const int has = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                    __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq");
    return has ? draw : NULL;
}

#else

umbb_draw_fn umbb_draw_avx512(void)
{
    return NULL;
}

#endif
