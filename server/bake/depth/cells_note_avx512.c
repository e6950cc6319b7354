/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Notes with AVX-512: which cells a triangle covers, eight rows or eight cells at a time. The
 * operations are those of the predicate in the same order, never fused, so the bits are the same.
 * Rounding up and down is part of the conversion to integers.
 *
 * There are two steps, each over several triangles: first their bands of eight rows, then the cells
 * of 8x8 texels of those bands. The reason is the branches on a small triangle's coverage, which
 * the processor cannot predict: handled alone, each triangle would wait at each band for a wrong
 * guess.
 */
#include "bake/depth/depth_cells.h"

#include <string.h>

#ifdef __AVX512F__
#include "bake/depth/lane_extremes.h"

/* Bands found at a time: their records fit the first-level cache. */
#define BANDS_MAX ((size_t)64)

#define UP   (_MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC)
#define DOWN (_MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)

/* Values that all rows and cells of a triangle share. */
struct plane {
    const struct umbb_coverage *coverage;
    double x_min[3], x_max[3]; /* range of x of the edges 0-1, 1-2 and 0-2 */
    double left, right;        /* range of x of all corners */
    double corner_off;         /* x of corner 1, less x of the long edge at the same height */
    uint16_t number;           /* index among the notes' planes */
    /* Distance in x from a cell's first texel to the centres of its nearest and farthest column. */
    double near_x, far_x;
    size_t near_y, far_y; /* nearest and farthest row of a band */
};

/* A band: eight rows of texels that start at a multiple of eight. x counts from the canvas's first
 * texel. */
struct band {
    const struct plane *plane;
    size_t cell;         /* index of its first cell in the canvas */
    __m256i first, last; /* texels covered in each row; INT32_MAX .. -1 if there are none */
    double z[8];         /* third coordinate of each row at the anchor's x */
    int32_t least, most; /* least of first, greatest of last */
    uint64_t front;      /* a byte a row: all ones if the row goes to the canvas's front */
};

/* Returns x where the rows at `py` cross a short edge: edge 0-1 before corner 1, then edge 1-2. */
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

/* Bit mask of the rows row .. row + 7 that the triangle meets. */
static inline unsigned rows_met(const struct umbb_coverage *c, int32_t row)
{
    const int32_t above = c->row_first - row, below = row + 7 - c->row_last;
    return 0xffU << (above > 0 ? above : 0) & 0xffU >> (below > 0 ? below : 0);
}

/* Fills the band whose first row is `row`. At least one row of the band meets the triangle. */
static inline void band_find(const struct plane *k, const struct umbb_cells *cells, int32_t row,
                             struct band *band)
{
    const struct umbb_coverage *c = k->coverage;
    band->plane = k;
    band->cell = (size_t)((row - cells->y0) >> 3) * (size_t)(cells->n >> 3);
    const __m512d half = _mm512_set1_pd(0.5);
    const __m256i number =
        _mm256_add_epi32(_mm256_set1_epi32(row), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    const __m512d py = _mm512_add_pd(_mm512_cvtepi32_pd(number), half);
    /* The two crossings of each row: with a short edge (one) and with the long edge (two). */
    const __m512d one = cross_short(k, py);
    const __m512d below = _mm512_sub_pd(py, _mm512_set1_pd(c->y[0]));
    __m512d two =
        _mm512_add_pd(_mm512_set1_pd(c->x[0]), _mm512_mul_pd(below, _mm512_set1_pd(c->slope[2])));
    two = _mm512_max_pd(two, _mm512_set1_pd(k->x_min[2]));
    two = _mm512_min_pd(two, _mm512_set1_pd(k->x_max[2]));
    /* Third coordinate at the anchor's x, which all texels of a row share. */
    _mm512_storeu_pd(band->z, _mm512_add_pd(_mm512_set1_pd(c->anchor_z),
                                            _mm512_mul_pd(_mm512_set1_pd(c->gradient_y), below)));
    /* The covered centres lie between the crossings: round up to the first, down to the last
     * texel, then clip to the canvas. */
    const __m512d low = _mm512_sub_pd(_mm512_min_pd(one, two), half);
    const __m512d high = _mm512_sub_pd(_mm512_max_pd(one, two), half);
    const __m256i origin = _mm256_set1_epi32(cells->x0);
    const __m256i first = _mm256_max_epi32(
        _mm256_sub_epi32(_mm512_cvt_roundpd_epi32(low, UP), origin), _mm256_setzero_si256());
    const __m256i last =
        _mm256_min_epi32(_mm256_sub_epi32(_mm512_cvt_roundpd_epi32(high, DOWN), origin),
                         _mm256_set1_epi32(cells->n - 1));
    /* Uncovered: rows of no width, rows outside the triangle, spans outside the canvas. */
    const unsigned wide = _mm512_cmp_pd_mask(low, high, _CMP_LT_OQ);
    const unsigned inside = _mm256_cmple_epi32_mask(first, last);
    const __mmask8 covered = (__mmask8)(wide & inside & rows_met(c, row));
    band->first = _mm256_mask_mov_epi32(_mm256_set1_epi32(INT32_MAX), covered, first);
    band->last = _mm256_mask_mov_epi32(_mm256_set1_epi32(-1), covered, last);
    band->least = umbb_least_of_8(band->first);
    band->most = umbb_most_of_8(band->last);
    /* The order of the crossings tells if a row faces the light, as in umbb_coverage_row. Each row
     * that does gets a byte of ones. */
    const unsigned before = _mm512_cmp_pd_mask(one, two, _CMP_LT_OQ);
    const unsigned facing = c->odd ? ~before : before;
    band->front = (uint64_t)_mm_cvtsi128_si64(_mm_movm_epi8((__mmask16)(facing & 0xffU)));
}

/* Returns coverage masks of the eight cells that start at texel x of the canvas. A mask has a byte
 * for each row, with the first texel in the lowest bit. */
static inline __m512i cell_bits(const struct band *band, int32_t x)
{
    const __m256i zero = _mm256_setzero_si256();
    const __m256i left =
        _mm256_max_epi32(_mm256_sub_epi32(band->first, _mm256_set1_epi32(x)), zero);
    const __m256i right =
        _mm256_max_epi32(_mm256_sub_epi32(_mm256_set1_epi32(x + 63), band->last), zero);
    /* Shifts in a row's 64 texels; shift counts of 64 and more leave 0. */
    const __m512i all = _mm512_set1_epi64(-1);
    const __m512i rows = _mm512_and_si512(_mm512_sllv_epi64(all, _mm512_cvtepu32_epi64(left)),
                                          _mm512_srlv_epi64(all, _mm512_cvtepu32_epi64(right)));
    /* Transposes eight rows of eight bytes: first the bytes of two rows side by side, then these
     * pairs. */
    const __m512i pairs =
        _mm512_broadcast_i32x4(_mm_setr_epi8(0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15));
    const __m512i turn =
        _mm512_set_epi16(31, 23, 15, 7, 30, 22, 14, 6, 29, 21, 13, 5, 28, 20, 12, 4, 27, 19, 11, 3,
                         26, 18, 10, 2, 25, 17, 9, 1, 24, 16, 8, 0);
    return _mm512_permutexvar_epi16(turn, _mm512_shuffle_epi8(rows, pairs));
}

/* Returns lit of eight fragments of a triangle from their third coordinates, as umbb_rays_lit. */
static inline __m256i lit_of(const struct umbb_rays *rays, const struct umbb_coverage *c,
                             __m512d third)
{
    __m512d z = _mm512_max_pd(third, _mm512_set1_pd(c->z_min));
    z = _mm512_min_pd(z, _mm512_set1_pd(c->z_max));
    if (umbb_rays_meet(rays)) {
        z = _mm512_add_pd(_mm512_div_pd(_mm512_set1_pd(rays->scale), z),
                          _mm512_set1_pd(rays->offset));
        z = _mm512_min_pd(_mm512_max_pd(z, _mm512_setzero_pd()), _mm512_set1_pd(rays->size));
    }
    return _mm512_cvt_roundpd_epi32(_mm512_sub_pd(z, _mm512_set1_pd(0.5)), UP);
}

/* Returns a bound of lit in each of eight cells: the predicate's value at the nearest (or farthest)
 * texel. z: third coordinate of that texel's row at the anchor. off: distance from a cell's first
 * texel. */
static inline __m256i bounds(const struct umbb_rays *rays, const struct umbb_coverage *c, double z,
                             __m512d first_x, double off)
{
    const __m512d centre = _mm512_add_pd(first_x, _mm512_set1_pd(off));
    const __m512d slope = _mm512_mul_pd(_mm512_set1_pd(c->gradient_x),
                                        _mm512_sub_pd(centre, _mm512_set1_pd(c->x[0])));
    return lit_of(rays, c, _mm512_add_pd(_mm512_set1_pd(z), slope));
}

/* Parts of one triangle in eight neighbouring cells. */
struct found {
    __m512i bits;
    __m256i nearest, farthest; /* bounds of their lit */
    uint16_t plane;
};

static inline __m256i load(const void *from)
{
    return _mm256_loadu_si256((const __m256i *)from);
}

static inline void save(void *to, __m256i value)
{
    _mm256_storeu_si256((__m256i *)to, value);
}

/* Notes the parts, in the cells from `cell` on, that are not empty and not hidden. */
static inline void parts_add(struct umbb_cells *cells, struct umbb_cell_layer *layer, size_t cell,
                             const struct found *found)
{
    struct umbb_parts *parts = &cells->parts;
    const uint32_t number = cells->part_count;
    const __m512i all = _mm512_set1_epi64(-1);
    /* Keep the parts that cover texels and do not lie behind the cell's bound. */
    const __m256i far = load(layer->far + cell), first = load(layer->first + cell);
    const __mmask8 keep = _mm512_test_epi64_mask(found->bits, found->bits) &
                          _mm256_cmplt_epi32_mask(found->nearest, far);
    const __m256i link =
        _mm256_or_si256(first, _mm256_set1_epi32((int32_t)((uint32_t)found->plane << 16)));
    /* Write the kept parts without gaps, and link each to the former first part of its cell. */
    _mm512_storeu_si512(parts->bits + number, _mm512_maskz_compress_epi64(keep, found->bits));
    save(parts->nearest + number, _mm256_maskz_compress_epi32(keep, found->nearest));
    save(parts->link + number, _mm256_maskz_compress_epi32(keep, link));
    const __m256i numbers = _mm256_add_epi32(_mm256_set1_epi32((int32_t)number),
                                             _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    save(layer->first + cell, _mm256_mask_expand_epi32(first, keep, numbers));
    cells->part_count = number + (uint32_t)__builtin_popcount(keep);
    /* Lower the bounds of the cells: to that of one covering part, or of all parts that cover a
     * cell together. */
    const __m512i before = _mm512_loadu_si512(layer->covered + cell);
    const __m512i covered = _mm512_mask_or_epi64(before, keep, before, found->bits);
    const __m256i most_before = load(layer->most + cell);
    const __m256i most = _mm256_mask_max_epi32(most_before, keep, most_before, found->farthest);
    /* Cells that this part covers alone, and cells that all their parts cover together. */
    const __mmask8 alone = keep & _mm512_cmpeq_epi64_mask(found->bits, all);
    const __mmask8 together = keep & _mm512_cmpeq_epi64_mask(covered, all);
    __m256i bound = _mm256_mask_min_epi32(far, together, far, most);
    bound = _mm256_mask_min_epi32(bound, alone, bound, found->farthest);
    _mm512_storeu_si512(layer->covered + cell, covered);
    save(layer->most + cell, most);
    save(layer->far + cell, bound);
}

/* Notes the cells of a band, 64 texels at a time. */
static inline void band_note(struct umbb_cells *cells, const struct band *band,
                             struct umbb_cell_layer *front, struct umbb_cell_layer *back)
{
    const struct plane *k = band->plane;
    const struct umbb_coverage *c = k->coverage;
    const __m512d eight = _mm512_setr_pd(0.0, 8.0, 16.0, 24.0, 32.0, 40.0, 48.0, 56.0);
    /* Eight cells at a time, from the first covered one on. */
    for (int32_t x = band->least & ~7; x <= band->most; x += 64) {
        const __m512d first_x = _mm512_add_pd(_mm512_set1_pd((double)(cells->x0 + x)), eight);
        const __m512i bits = cell_bits(band, x);
        const size_t cell = band->cell + (size_t)(x >> 3);
        struct found found = {
            .bits = bits,
            .nearest = bounds(&cells->rays, c, band->z[k->near_y], first_x, k->near_x),
            .farthest = bounds(&cells->rays, c, band->z[k->far_y], first_x, k->far_x),
            .plane = k->number,
        };
        if (front != back) {
            /* The rows of a cell that face the light go to one layer, its other rows to the
             * other. */
            const __m512i to_front = _mm512_set1_epi64((int64_t)band->front);
            found.bits = _mm512_andnot_si512(to_front, bits);
            parts_add(cells, back, cell, &found);
            found.bits = _mm512_and_si512(to_front, bits);
        }
        parts_add(cells, front, cell, &found);
    }
}

static inline double least(double a, double b)
{
    return a < b ? a : b;
}

static inline double most(double a, double b)
{
    return a < b ? b : a;
}

static inline void plane_init(struct plane *k, const struct umbb_rays *rays,
                              const struct umbb_coverage *c)
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
    /* Where lit grows with x the nearest column is the first one. */
    k->far_x = umbb_rays_grow(rays, c->gradient_x) ? 7.5 : 0.5;
    k->near_x = 8.0 - k->far_x;
    k->far_y = umbb_rays_grow(rays, c->gradient_y) ? 7 : 0;
    k->near_y = 7 - k->far_y;
}

/* Depths from which a layer hides everything behind. */
struct hiding {
    const int32_t *far; /* `far` of the layer's cells */
    /* Greatest `far` in each band of cells; 0 after the last band, for loads of eight at a time. */
    int32_t band_far[UMBB_CANVAS_MAX / 8 + UMBB_CELLS_SLACK];
    int32_t all_far; /* greatest of these */
};

/* Plain C: the compiler handles a band in four registers. */
static void hiding_find(const struct umbb_cells *cells, enum umbb_layer layer,
                        struct hiding *hiding)
{
    const size_t across = (size_t)(cells->n >> 3);
    memset(hiding, 0, sizeof *hiding);
    hiding->far = cells->layers[layer].far;
    for (size_t band = 0; band < across; band++) {
        const int32_t *far = hiding->far + band * across;
        int32_t greatest = 0;
        for (size_t i = 0; i < across; i++) {
            greatest = far[i] > greatest ? far[i] : greatest;
        }
        hiding->band_far[band] = greatest;
        hiding->all_far = greatest > hiding->all_far ? greatest : hiding->all_far;
    }
}

/* Tolerance in texels, far above the rounding error of a crossing. */
#define SLACK 0.01

/* Cells of a band that are tested before the band counts as visible. */
#define CELLS_SEEN 8

/* Returns a bit mask of the lanes in which some `far` of cells `first` to `last` exceeds lit. */
static inline unsigned lanes_before(const struct hiding *hiding, size_t band, __m256i first,
                                    __m256i last, __m256i lit)
{
    const int32_t *far = hiding->far;
    /* Bands whose greatest `far` does not exceed lit are hidden as a whole. */
    const unsigned some = _mm256_cmplt_epi32_mask(lit, load(hiding->band_far + band));
    if (some == 0) {
        return 0;
    }
    /* Tests two cells without a branch, because many bands have at most two. */
    const __m256i next = _mm256_min_epi32(_mm256_add_epi32(first, _mm256_set1_epi32(1)), last);
    const __m256i two = _mm256_max_epi32(_mm256_i32gather_epi32(far, first, 4),
                                         _mm256_i32gather_epi32(far, next, 4));
    unsigned before = _mm256_cmpgt_epi32_mask(two, lit);
    unsigned left = _mm256_cmplt_epi32_mask(next, last) & ~before & some;
    /* Test the further cells of the bands that are still undecided. A band with more than
     * CELLS_SEEN cells counts as visible. */
    for (int i = 2; i < CELLS_SEEN && left != 0; i++) {
        first = _mm256_add_epi32(first, _mm256_set1_epi32(1));
        const __m256i at = _mm256_min_epi32(_mm256_add_epi32(first, _mm256_set1_epi32(1)), last);
        before |= _mm256_cmpgt_epi32_mask(_mm256_i32gather_epi32(far, at, 4), lit);
        left = _mm256_cmplt_epi32_mask(at, last) & ~before & some;
    }
    return before | left;
}

/* Eight bands of a triangle, one in each lane: their first rows, and a range of x that holds all
 * covered centres. */
struct eight {
    __m256i rows;
    __m512d left, right;
};

/*
 * Returns the eight bands from `row` on.
 *
 * Why all centres lie in the range: the triangle lies on one side of its long edge 0-2. Its
 * horizontal distance from the long edge is greatest in the row of corner 1 (corner_off) and falls
 * to 0 at both ends. So in each row the triangle lies between the long edge and the long edge moved
 * by corner_off. Over the eight rows of a band the long edge runs from `top` to `bottom`. SLACK
 * covers the rounding of crossings. No centre lies beyond the corners.
 */
static inline struct eight eight_bands(const struct plane *k, int32_t row)
{
    const struct umbb_coverage *c = k->coverage;
    const __m256i rows =
        _mm256_add_epi32(_mm256_set1_epi32(row), _mm256_setr_epi32(0, 8, 16, 24, 32, 40, 48, 56));
    const __m512d below = _mm512_sub_pd(
        _mm512_add_pd(_mm512_cvtepi32_pd(rows), _mm512_set1_pd(0.5)), _mm512_set1_pd(c->y[0]));
    const __m512d slope = _mm512_set1_pd(c->slope[2]);
    const __m512d top = _mm512_add_pd(_mm512_set1_pd(c->x[0]), _mm512_mul_pd(below, slope));
    const __m512d bottom = _mm512_add_pd(top, _mm512_mul_pd(_mm512_set1_pd(7.0), slope));
    const __m512d left = _mm512_add_pd(_mm512_min_pd(top, bottom),
                                       _mm512_set1_pd(least(k->corner_off, 0.0) - SLACK));
    const __m512d right =
        _mm512_add_pd(_mm512_max_pd(top, bottom), _mm512_set1_pd(most(k->corner_off, 0.0) + SLACK));
    /* min and max return the second operand for a NaN too. */
    return (struct eight){rows, _mm512_max_pd(left, _mm512_set1_pd(k->left)),
                          _mm512_min_pd(right, _mm512_set1_pd(k->right))};
}

/*
 * Returns a bound of lit in each band: no texel of the triangle lies before this bound.
 *
 * Why: all operations of the predicate, rounded or not, are monotone in x and in y. So the least
 * lit is that at the nearest row (near_y) and at the nearest end of the range of x. The row's y
 * is computed as in the predicate, because adding seven to `below` would round twice. The range of
 * x holds all centres, and may be too wide: then the bound is only lower.
 */
static inline __m256i eight_bounds(const struct plane *k, const struct umbb_rays *rays,
                                   const struct eight *bands)
{
    const struct umbb_coverage *c = k->coverage;
    const __m256i row = _mm256_add_epi32(bands->rows, _mm256_set1_epi32((int32_t)k->near_y));
    const __m512d below = _mm512_sub_pd(_mm512_add_pd(_mm512_cvtepi32_pd(row), _mm512_set1_pd(0.5)),
                                        _mm512_set1_pd(c->y[0]));
    const __m512d x =
        _mm512_sub_pd(k->near_x < 4.0 ? bands->left : bands->right, _mm512_set1_pd(c->x[0]));
    __m512d z = _mm512_add_pd(_mm512_set1_pd(c->anchor_z),
                              _mm512_mul_pd(_mm512_set1_pd(c->gradient_y), below));
    z = _mm512_add_pd(z, _mm512_mul_pd(_mm512_set1_pd(c->gradient_x), x));
    return lit_of(rays, c, z);
}

/* Columns of cells in which x lies, clipped to the canvas. */
static inline __m256i eight_columns(const struct umbb_cells *cells, __m512d x)
{
    const __m512d end = _mm512_set1_pd((double)(cells->n - 1));
    x = _mm512_sub_pd(x, _mm512_set1_pd((double)cells->x0));
    x = _mm512_min_pd(_mm512_max_pd(x, _mm512_setzero_pd()), end);
    return _mm256_srli_epi32(_mm512_cvttpd_epi32(x), 3);
}

/*
 * Returns a bit mask of the bands that the triangle may change: eight bands from row `row` on, or
 * fewer, down to row `last`. A band is left out if no cell in its range of x has a `far` behind the
 * band's bound of lit (eight_bounds). This test is quicker than making the band, and never leaves
 * out a band that would change a texel.
 */
static inline unsigned bands_seen(const struct plane *k, const struct umbb_cells *cells,
                                  const struct hiding hiding[2], int32_t row, int32_t last)
{
    const struct eight bands = eight_bands(k, row);
    const __m256i lit = eight_bounds(k, &cells->rays, &bands);
    /* Lanes after the last band read an existing cell; the mask at the end drops them. */
    const size_t at_band = (size_t)(row - cells->y0) >> 3;
    const int32_t count = ((last - row) >> 3) + 1, across = cells->n >> 3;
    const __m256i band =
        _mm256_min_epi32(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), _mm256_set1_epi32(count - 1));
    const __m256i at = _mm256_add_epi32(_mm256_mullo_epi32(band, _mm256_set1_epi32(across)),
                                        _mm256_set1_epi32((int32_t)at_band * across));
    const __m256i first = _mm256_add_epi32(at, eight_columns(cells, bands.left));
    const __m256i end = _mm256_add_epi32(at, eight_columns(cells, bands.right));
    unsigned seen = lanes_before(&hiding[0], at_band, first, end, lit);
    if (hiding[1].far != hiding[0].far) {
        seen |= lanes_before(&hiding[1], at_band, first, end, lit);
    }
    return count < 8 ? seen & ((1U << count) - 1U) : seen;
}

/* Returns the first row of the triangle's first band in a canvas, and sets *last to the last row.
 * Bands start at multiples of eight rows of the canvas. */
static inline int32_t rows_of(const struct umbb_coverage *c, const struct umbb_cells *cells,
                              int32_t *last)
{
    const int32_t bottom = cells->y0 + cells->n - 1;
    const int32_t row = c->row_first > cells->y0 ? c->row_first : cells->y0;
    *last = c->row_last < bottom ? c->row_last : bottom;
    return row - ((row - cells->y0) & 7);
}

/* Returns a bit mask of the bands that a triangle may change, at most UMBB_CANVAS_MAX / 8 of them.
 * hiding: bounds of the two layers, or NULL while too little is drawn to hide anything. */
static inline uint32_t triangle_seen(const struct plane *k, const struct umbb_cells *cells,
                                     const struct hiding *hiding)
{
    uint32_t seen = 0;
    int32_t last;
    const int32_t row = rows_of(k->coverage, cells, &last);
    if (hiding == NULL) {
        return row > last ? 0 : UINT32_MAX >> (31 - ((last - row) >> 3));
    }
    for (int32_t at = row; at <= last; at += 64) {
        seen |= bands_seen(k, cells, hiding, at, last) << ((at - row) >> 3);
    }
    return seen;
}

/* True if all of a triangle lies behind everything in both layers. */
static inline int triangle_hidden(const struct umbb_rays *rays, const struct umbb_coverage *c,
                                  const struct hiding *hiding)
{
    if (hiding == NULL) {
        return 0;
    }
    const int32_t nearest = umbb_rays_nearest(rays, c);
    return nearest >= hiding[0].all_far && nearest >= hiding[1].all_far;
}

/* Triangles being noted. */
struct work {
    size_t band_count, noted;
    uint32_t seen[UMBB_DRAW_MAX]; /* bit masks of bands */
    struct plane planes[UMBB_DRAW_MAX];
    struct band bands[BANDS_MAX];
};

/* Makes planes for triangles while there is room, and finds the bands that each triangle may
 * change. Returns the number of triangles handled. */
static size_t planes_take(struct work *work, struct umbb_cells *cells,
                          const struct umbb_coverage *coverages, size_t count,
                          const struct hiding *hiding)
{
    size_t taken = 0;
    for (; taken < count && cells->plane_count < UMBB_PLANES_MAX; taken++) {
        const struct umbb_coverage *c = &coverages[taken];
        struct plane *k = &work->planes[taken];
        k->coverage = c;
        work->seen[taken] = 0;
        if (triangle_hidden(&cells->rays, c, hiding)) {
            continue;
        }
        plane_init(k, &cells->rays, c);
        work->seen[taken] = triangle_seen(k, cells, hiding);
        k->number = (uint16_t)cells->plane_count;
        cells->planes[cells->plane_count] = (struct umbb_plane){
            .anchor_x = c->x[0],
            .anchor_y = c->y[0],
            .anchor_z = c->anchor_z,
            .gradient_x = c->gradient_x,
            .gradient_y = c->gradient_y,
            .z_min = c->z_min,
            .z_max = c->z_max,
            .lit_min = umbb_coverage_round(c->z_min),
            .lit_max = umbb_coverage_round(c->z_max),
        };
        /* A triangle without visible bands needs no plane: the next one overwrites it. */
        cells->plane_count += work->seen[taken] != 0;
    }
    return taken;
}

/* Notes the found bands while there is room; returns 0 if some are left. */
static int bands_note(struct work *work, struct umbb_cells *cells, const struct umbb_sides *sides)
{
    /* A band adds at most one part to each cell of a row of cells in both layers. */
    const uint32_t room = UMBB_PARTS_MAX - 2 * (uint32_t)(cells->n >> 3);
    size_t i = 0;
    for (; i < work->band_count && cells->part_count <= room; i++) {
        band_note(cells, &work->bands[i], &cells->layers[sides->front],
                  &cells->layers[sides->back]);
    }
    work->noted = i;
    return i == work->band_count;
}

/* Finds and notes the bands of triangles; returns 0 if there was no room for all. */
static int triangles_note(struct work *work, struct umbb_cells *cells,
                          const struct umbb_sides *sides, size_t count)
{
    work->band_count = 0;
    for (size_t i = 0; i < count; i++) {
        int32_t last;
        const struct plane *k = &work->planes[i];
        const int32_t row = rows_of(k->coverage, cells, &last);
        for (uint32_t bands = work->seen[i]; bands != 0; bands &= bands - 1) {
            if (work->band_count == BANDS_MAX) {
                if (!bands_note(work, cells, sides)) {
                    return 0;
                }
                work->band_count = 0;
            }
            band_find(k, cells, row + 8 * __builtin_ctz(bands), &work->bands[work->band_count++]);
        }
    }
    return bands_note(work, cells, sides);
}

size_t umbb__cells_note_avx512(struct umbb_cells *cells, const struct umbb_coverage *coverages,
                               size_t count, const struct umbb_sides *sides)
{
    struct work work;
    struct hiding hiding[2];
    if (sides->often_hidden) {
        hiding_find(cells, sides->front, &hiding[0]);
        hiding_find(cells, sides->back, &hiding[1]);
    }
    const size_t taken =
        planes_take(&work, cells, coverages, count, sides->often_hidden ? hiding : NULL);
    if (triangles_note(&work, cells, sides, taken)) {
        return taken;
    }
    /* The room ended at band `noted`. Returns the index of that band's triangle, which the caller
     * notes again from its first band. Parts that are noted twice do no harm, because a texel takes
     * the minimum. */
    return (size_t)(work.bands[work.noted].plane - work.planes);
}

#endif
