/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing of noted cells with AVX-512. A cell's texels are four registers of two rows each. All
 * parts of the cell lower these registers, one part after the other. The operations are those of
 * the predicate in the same order, never fused, so the bits are the same.
 *
 * Parallel light: a register holds ceil(2 z) for each depth z. Then lit is half of ceil(2 z),
 * rounded down, because ceil(z - 0.5) = floor(ceil(2 z) / 2). Both roundings keep the order of
 * numbers. So minimum and clamp may come before the halving, which is done once a cell.
 *
 * Rays from one point: a register holds one row's greatest q (depth_perspective.h). lit never grows
 * with q, so the greatest q gives the least lit, and one division a texel is enough for all parts.
 */
#include "bake/depth/depth_cells.h"

#ifdef __AVX512F__
#include <immintrin.h>

#define UP (_MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC)

/* Rounding constant. Let z be below 2^30 in magnitude. Then the sum of z and the constant, rounded
 * up, holds ceil(2 z) in the lower 32 bits of its mantissa. */
#define HALF_MAGIC 3377699720527872.0 /* 1.5 * 2^51 */

/* Texels of a cell as twice their depth; two rows in each register. */
struct texels {
    __m512i rows[4];
};

/* A cell being drawn. */
struct place {
    __m512d x, y; /* centres of its columns and of its rows */
};

static inline struct place place_of(const struct umbb_cells *cells, size_t cell)
{
    const size_t across = (size_t)(cells->n >> 3);
    const __m512d centres = _mm512_setr_pd(0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5);
    const double x = (double)(cells->x0 + 8 * (int32_t)(cell % across));
    const double y = (double)(cells->y0 + 8 * (int32_t)(cell / across));
    return (struct place){_mm512_add_pd(_mm512_set1_pd(x), centres),
                          _mm512_add_pd(_mm512_set1_pd(y), centres)};
}

/* A register whose bits hold twice the depth of a row's texels. */
static inline __m512i row_sum(__m512d slopes, double z)
{
    const __m512d depth = _mm512_add_pd(_mm512_set1_pd(z), slopes);
    return _mm512_castpd_si512(_mm512_add_round_pd(depth, _mm512_set1_pd(HALF_MAGIC), UP));
}

static inline void part_draw(const struct umbb_plane *k, uint64_t bits, const struct place *place,
                             struct texels *texels)
{
    const __m512i lower_halves =
        _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const __m512d slopes = _mm512_mul_pd(_mm512_set1_pd(k->gradient_x),
                                         _mm512_sub_pd(place->x, _mm512_set1_pd(k->anchor_x)));
    const __m512d row_z =
        _mm512_add_pd(_mm512_set1_pd(k->anchor_z),
                      _mm512_mul_pd(_mm512_set1_pd(k->gradient_y),
                                    _mm512_sub_pd(place->y, _mm512_set1_pd(k->anchor_y))));
    const __m512i lit_min = _mm512_set1_epi32(2 * k->lit_min);
    const __m512i lit_max = _mm512_set1_epi32(2 * k->lit_max + 1);
    double z[8];
    _mm512_storeu_pd(z, row_z);
    /* Two rows a register: join the sums' lower halves, clamp, and lower the covered texels. */
    for (size_t i = 0; i < 4; i++, bits >>= 16) {
        __m512i lit = _mm512_permutex2var_epi32(row_sum(slopes, z[2 * i]), lower_halves,
                                                row_sum(slopes, z[2 * i + 1]));
        lit = _mm512_min_epi32(_mm512_max_epi32(lit, lit_min), lit_max);
        texels->rows[i] = _mm512_mask_min_epi32(texels->rows[i], (__mmask16)(bits & 0xffffU),
                                                texels->rows[i], lit);
    }
}

/* Draws a cell's parts; converts its texels to lit. */
static inline void cell_draw(const struct umbb_cells *cells, const struct umbb_cell_layer *layer,
                             size_t cell, const struct place *place, struct texels *texels)
{
    const struct umbb_parts *parts = &cells->parts;
    const int32_t far = layer->far[cell];
    for (size_t at = layer->first[cell]; at != 0;) {
        const uint32_t link = parts->link[at];
        if (parts->nearest[at] <= far) { /* equal: the bound may come from this part */
            part_draw(&cells->planes[link >> 16], parts->bits[at], place, texels);
        }
        at = link & 0xffffU;
    }
    for (size_t i = 0; i < 4; i++) {
        /* From twice the depth to lit. */
        texels->rows[i] = _mm512_srai_epi32(texels->rows[i], 1);
    }
}

static inline struct texels all_of(int32_t value)
{
    const __m512i v = _mm512_set1_epi32(value);
    return (struct texels){{v, v, v, v}};
}

/* Greatest q of each texel of a cell; 0 where nothing is drawn. A row in each register. */
struct reciprocals {
    __m512d rows[8];
};

static inline void part_draw_meeting(const struct umbb_plane *k, uint64_t bits,
                                     const struct place *place, struct reciprocals *most)
{
    const __m512d slopes = _mm512_mul_pd(_mm512_set1_pd(k->gradient_x),
                                         _mm512_sub_pd(place->x, _mm512_set1_pd(k->anchor_x)));
    const __m512d row_q =
        _mm512_add_pd(_mm512_set1_pd(k->anchor_z),
                      _mm512_mul_pd(_mm512_set1_pd(k->gradient_y),
                                    _mm512_sub_pd(place->y, _mm512_set1_pd(k->anchor_y))));
    const __m512d q_min = _mm512_set1_pd(k->z_min), q_max = _mm512_set1_pd(k->z_max);
    double row[8];
    _mm512_storeu_pd(row, row_q);
    for (size_t i = 0; i < 8; i++, bits >>= 8) {
        __m512d q = _mm512_add_pd(_mm512_set1_pd(row[i]), slopes);
        q = _mm512_min_pd(_mm512_max_pd(q, q_min), q_max); /* NaN becomes q_min */
        most->rows[i] =
            _mm512_mask_max_pd(most->rows[i], (__mmask8)(bits & 0xffU), most->rows[i], q);
    }
}

/* Returns lit of a row, as umbb_reciprocal_lit. q = 0 gives an infinite z, so the background. */
static inline __m256i reciprocal_lit(const struct umbb_rays *rays, __m512d q)
{
    __m512d z =
        _mm512_add_pd(_mm512_div_pd(_mm512_set1_pd(rays->scale), q), _mm512_set1_pd(rays->offset));
    z = _mm512_min_pd(_mm512_max_pd(z, _mm512_setzero_pd()), _mm512_set1_pd(rays->size));
    return _mm512_cvt_roundpd_epi32(_mm512_sub_pd(z, _mm512_set1_pd(0.5)), UP);
}

/* Two rows of texels. */
static inline __m512i two_rows(__m256i low, __m256i high)
{
    return _mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1);
}

/*
 * Converts q, the reciprocals of depth, to lit. Often all rows of a cell have the same lit values:
 * on walls along the columns, and where the surface's depth changes by less than a voxel over the
 * cell. The greatest and the least q of each column show that with two divisions, because lit never
 * grows with q.
 */
static inline void reciprocals_lit(const struct umbb_rays *rays, const struct reciprocals *q,
                                   struct texels *texels)
{
    __m512d most = q->rows[0], least = q->rows[0];
    for (size_t i = 1; i < 8; i++) {
        most = _mm512_max_pd(most, q->rows[i]);
        least = _mm512_min_pd(least, q->rows[i]);
    }
    const __m256i first = reciprocal_lit(rays, most), last = reciprocal_lit(rays, least);
    if (_mm256_cmpeq_epi32_mask(first, last) == 0xff) {
        *texels = (struct texels){{two_rows(first, first), two_rows(first, first),
                                   two_rows(first, first), two_rows(first, first)}};
        return;
    }
    for (size_t i = 0; i < 4; i++) {
        texels->rows[i] = two_rows(reciprocal_lit(rays, q->rows[2 * i]),
                                   reciprocal_lit(rays, q->rows[2 * i + 1]));
    }
}

/* cell_draw for rays that meet in one point. */
static inline void cell_draw_meeting(const struct umbb_cells *cells,
                                     const struct umbb_cell_layer *layer, size_t cell,
                                     const struct place *place, struct texels *texels)
{
    const struct umbb_parts *parts = &cells->parts;
    const int32_t far = layer->far[cell];
    const __m512d none = _mm512_setzero_pd();
    struct reciprocals most = {{none, none, none, none, none, none, none, none}};
    for (size_t at = layer->first[cell]; at != 0;) {
        const uint32_t link = parts->link[at];
        if (parts->nearest[at] <= far) {
            part_draw_meeting(&cells->planes[link >> 16], parts->bits[at], place, &most);
        }
        at = link & 0xffffU;
    }
    reciprocals_lit(&cells->rays, &most, texels);
}

/* Draws the parts of a layer's cell and converts them to lit. Texels without a part get the
 * background. */
static inline void layer_draw(const struct umbb_cells *cells, const struct umbb_cell_layer *layer,
                              size_t cell, const struct place *place, struct texels *texels)
{
    if (umbb_rays_meet(&cells->rays) && layer->first[cell] != 0) {
        cell_draw_meeting(cells, layer, cell, place, texels);
        return;
    }
    *texels = all_of(2 * cells->background);
    cell_draw(cells, layer, cell, place, texels);
}

static void draw(struct umbb_cells *cells, int32_t *layers)
{
    const size_t count = (size_t)(cells->n >> 3) * (size_t)(cells->n >> 3);
    for (int i = 0; i < cells->layer_count; i++, layers += 64 * count) {
        struct umbb_cell_layer *layer = &cells->layers[i];
        for (size_t cell = 0; cell < count; cell++) {
            if (layer->first[cell] == 0) {
                continue;
            }
            const struct place place = place_of(cells, cell);
            struct texels texels;
            layer_draw(cells, layer, cell, &place, &texels);
            for (size_t k = 0; k < 4; k++) {
                /* The layer keeps the least of its old texels and the new ones. */
                int32_t *at = layers + 64 * cell + 16 * k;
                _mm512_storeu_si512(at, _mm512_min_epi32(_mm512_loadu_si512(at), texels.rows[k]));
            }
            layer->first[cell] = 0;
        }
    }
    cells->plane_count = 0;
    cells->part_count = 1;
}

static inline __m512i most_of(const struct texels *t)
{
    return _mm512_max_epi32(_mm512_max_epi32(t->rows[0], t->rows[1]),
                            _mm512_max_epi32(t->rows[2], t->rows[3]));
}

static inline __m512i least_of(const struct texels *t)
{
    return _mm512_min_epi32(_mm512_min_epi32(t->rows[0], t->rows[1]),
                            _mm512_min_epi32(t->rows[2], t->rows[3]));
}

/* Number of cells whose places in the tile are prefetched: a tile is larger than the caches. */
#define AHEAD 4

static inline void texels_ask(const int32_t *to)
{
    for (size_t i = 0; i < 4; i++) {
        __builtin_prefetch(to + 16 * i, 1);
    }
}

static inline void texels_write(int32_t *to, const struct texels *texels)
{
    for (size_t i = 0; i < 4; i++) {
        _mm512_storeu_si512(to + 16 * i, texels->rows[i]);
    }
}

/* Writes cell `cell` of the notes to cell `to` of the tile, without the closed rule. */
static inline void open_store(const struct umbb_cells *cells, size_t cell, struct umbb_tile *tile,
                              size_t to)
{
    const struct umbb_cell_layer *layer = &cells->layers[UMBB_LAYER_OPEN];
    int32_t most = cells->background, least = cells->background;
    if (layer->first[cell] != 0) {
        const struct place place = place_of(cells, cell);
        struct texels texels;
        texels_ask(tile->lit + 64 * (to + AHEAD));
        layer_draw(cells, layer, cell, &place, &texels);
        texels_write(tile->lit + 64 * to, &texels);
        most = _mm512_reduce_max_epi32(most_of(&texels));
        least = _mm512_reduce_min_epi32(least_of(&texels));
    }
    tile->max_lit[UMB_LEVEL_BRICK][to] = most;
    tile->min_end[UMB_LEVEL_BRICK][to] = least;
}

/* Writes cell `cell` of the notes to cell `to` of the tile, with the closed rule. */
static inline void closed_store(const struct umbb_cells *cells, size_t cell, struct umbb_tile *tile,
                                size_t to)
{
    const struct umbb_cell_layer *layers = cells->layers;
    int32_t most = cells->background, least = cells->background;
    if ((layers[UMBB_LAYER_OPEN].first[cell] | layers[UMBB_LAYER_FRONT].first[cell] |
         layers[UMBB_LAYER_BACK].first[cell]) != 0) {
        const struct place place = place_of(cells, cell);
        const __m512i background = _mm512_set1_epi32(cells->background);
        struct texels nearest[UMBB_LAYER_COUNT], lit, end;
        for (size_t i = 0; i < UMBB_LAYER_COUNT; i++) {
            layer_draw(cells, &layers[i], cell, &place, &nearest[i]);
        }
        for (size_t i = 0; i < 4; i++) { /* as umbb_texel_decide */
            const __m512i front = nearest[UMBB_LAYER_FRONT].rows[i];
            const __m512i back = nearest[UMBB_LAYER_BACK].rows[i];
            lit.rows[i] =
                _mm512_min_epi32(front, _mm512_min_epi32(back, nearest[UMBB_LAYER_OPEN].rows[i]));
            const __mmask16 inside = _mm512_cmpeq_epi32_mask(front, lit.rows[i]) &
                                     _mm512_cmplt_epi32_mask(back, background);
            end.rows[i] = _mm512_mask_mov_epi32(lit.rows[i], inside, back);
        }
        texels_write(tile->lit + 64 * to, &lit);
        texels_write(tile->end + 64 * to, &end);
        most = _mm512_reduce_max_epi32(most_of(&lit));
        least = _mm512_reduce_min_epi32(least_of(&end));
    }
    tile->max_lit[UMB_LEVEL_BRICK][to] = most;
    tile->min_end[UMB_LEVEL_BRICK][to] = least;
}

static void store(const struct umbb_cells *cells, struct umbb_tile *tile, int32_t x, int32_t y)
{
    const size_t across = (size_t)(cells->n >> 3);
    for (size_t row = 0; row < across; row++) {
        const size_t to = umbb_tile_index(tile, x, y + 8 * (int32_t)row) / 64;
        for (size_t i = 0; i < across; i++) {
            if (tile->end == tile->lit) {
                open_store(cells, row * across + i, tile, to + i);
            } else {
                closed_store(cells, row * across + i, tile, to + i);
            }
        }
    }
}

const struct umbb_cells_steps umbb__cells_avx512 = {umbb__cells_note_avx512, draw, store};

#endif
