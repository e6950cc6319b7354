/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Proving squares in one pass over the casters. Until the end the tile itself holds a square's
 * state: the two numbers of the pyramid hold the bounds, and the entry of `proven` holds flags.
 * Each thread takes a strip of whole rows of squares, and reads all casters.
 */
#include "bake/depth/proven_squares.h"

#include <math.h>

#include "tool/threads.h"
#include "bake/depth/cut_out.h"
#include "bake/depth/depth_perspective.h"

#define SQUARE (1 << UMBB_SQUARE_LOG2)

/* Distance in texels from a square within which a border counts. Any value above the rounding error
 * of a crossing is right. Under perspective it leaves out the edges along which triangles are cut,
 * one texel outside the map. */
#define BORDER_REACH         1.0
#define BORDER_REACH_MEETING 0.5

/* Flags of a square during the pass. */
enum {
    TOUCHED = 1, /* some texel is covered */
    MIDDLE = 2,  /* a front face covers the middle texel */
    BORDER = 4,  /* a border is within a texel */
};

/* Rows of a tile's squares. Texels are numbered in the frustum, squares in the tile. */
struct squares {
    const struct umbb_casters *casters;
    struct umbb_rays rays;
    struct umbb_tile *tile;
    int32_t across;
    int32_t first_row, end_row; /* range of rows of squares */
    int32_t top, bottom;        /* first and last row of texels */
    int32_t *front_most;        /* greatest lit of front faces */
    int32_t *far_least;         /* least lit of all other faces */
    struct umbb_proof *proofs;
};

/* A caster being added. */
struct face {
    const struct umbb_coverage *coverage;
    uint32_t caster;
    uint8_t kind;
    int front; /* 1: it surely faces the light */
};

static int32_t least(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

static int32_t most(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

/* Texels that the triangle covers in any of the rows first .. last. */
static void rows_reach(const struct umbb_coverage *c, int32_t first, int32_t last, int32_t *x_first,
                       int32_t *x_last)
{
    int32_t a, b;
    umbb_coverage_row(c, first, x_first, x_last);
    umbb_coverage_row(c, last, &a, &b);
    *x_first = least(*x_first, a);
    *x_last = most(*x_last, b);
    if (c->y[1] >= (double)first && c->y[1] <= (double)last + 1.0) {
        /* The middle corner lies in these rows. Crossings are clamped between corners, so no centre
         * beyond the corner is covered. */
        const double x = c->x[1] - 0.5;
        *x_first = least(*x_first, (int32_t)ceil(x));
        *x_last = most(*x_last, (int32_t)floor(x));
    }
}

/* Updates a square that the triangle touches in rows y0 .. y1, texels x0 .. x1. */
static void square_touch(struct squares *s, const struct face *face, size_t square,
                         const int32_t x[2], const int32_t y[2])
{
    const struct umbb_coverage *c = face->coverage;
    const int front = face->front;
    s->tile->proven[square] |= TOUCHED;
    /* The farthest texel for a front face, else the nearest. */
    const int32_t at_x = x[umbb_rays_grow(&s->rays, c->gradient_x) == front];
    const int32_t at_y = y[umbb_rays_grow(&s->rays, c->gradient_y) == front];
    const int32_t lit = umbb_rays_lit(&s->rays, c, umbb_coverage_row_z(c, at_y), at_x);
    if (front) {
        s->front_most[square] = most(s->front_most[square], lit);
        return;
    }
    s->far_least[square] = least(s->far_least[square], lit);
    if (umbb_rays_meet(&s->rays) && face->kind != UMBB_CASTER_OPEN) {
        struct umbb_proof *proof = &s->proofs[square];
        const int32_t far_x = x[0] + x[1] - at_x, far_y = y[0] + y[1] - at_y;
        const int32_t far = umbb_rays_lit(&s->rays, c, umbb_coverage_row_z(c, far_y), far_x);
        proof->back_least = least(proof->back_least, lit);
        proof->back_most = most(proof->back_most, far);
    }
}

/* Adds a triangle's fragments at the corner texels of the squares of a row, in texel row y, which
 * the triangle meets. lower: 1 for the squares' last texel row, 0 for their first. */
static void corners_touch(struct squares *s, const struct face *face, int32_t y, size_t lower)
{
    const struct umbb_tile *tile = s->tile;
    const struct umbb_cuts *cuts = s->casters->cuts;
    const uint32_t cut = umbb_cut_of(cuts, face->caster);
    const double row_z = umbb_coverage_row_z(face->coverage, y);
    int32_t span[2];
    const int front = umbb_coverage_row_within(face->coverage, y, tile->x0, tile->size, span);
    const size_t layer = umbb_layer_of(face->kind, front);
    struct umbb_proof *row =
        s->proofs + (size_t)((y - tile->y0) >> UMBB_SQUARE_LOG2) * (size_t)s->across;
    /* Corner texels are the first and the last of each square. */
    for (int32_t x = span[0]; x <= span[1]; x++) {
        const int32_t in_square = (x - tile->x0) & (SQUARE - 1);
        if (in_square != 0 && in_square != SQUARE - 1) {
            x += SQUARE - 2 - in_square;
            continue;
        }
        int32_t *nearest =
            row[(x - tile->x0) >> UMBB_SQUARE_LOG2].corners[2 * lower + (in_square != 0)];
        if (cut == UMBS_CUT_NONE || umbb_cut_casts(cuts, cut, x, y)) {
            nearest[layer] =
                least(nearest[layer], umbb_rays_lit(&s->rays, face->coverage, row_z, x));
        }
    }
}

/* Marks the square if a front face covers its middle texel. */
static void middle_touch(struct squares *s, const struct umbb_coverage *c, size_t square, int32_t x,
                         int32_t y)
{
    int32_t x_first, x_last;
    if (y >= c->row_first && y <= c->row_last) {
        umbb_coverage_row(c, y, &x_first, &x_last);
        if (x >= x_first && x <= x_last) {
            s->tile->proven[square] |= MIDDLE;
        }
    }
}

/* Finds the texels that rows first and last both cover, less one on either side for rounding. A
 * triangle is convex, so all rows between cover these texels too. */
static void rows_common(const struct umbb_coverage *c, int32_t first, int32_t last,
                        int32_t *x_first, int32_t *x_last)
{
    int32_t a, b;
    umbb_coverage_row(c, first, x_first, x_last);
    umbb_coverage_row(c, last, &a, &b);
    *x_first = most(*x_first, a) + 1;
    *x_last = least(*x_last, b) - 1;
}

/* Updates the squares of one row of squares that a front face covers completely. */
static void cover_squares(struct squares *s, const struct umbb_coverage *c, int32_t first)
{
    const struct umbb_tile *tile = s->tile;
    const int32_t ys[2] = {first, first + SQUARE - 1};
    const int32_t row = (first - tile->y0) >> UMBB_SQUARE_LOG2;
    int32_t left, right;
    rows_common(c, ys[0], ys[1], &left, &right);
    left = most(left, tile->x0);
    right = least(right, tile->x0 + tile->size - 1);
    for (int32_t x = (left + SQUARE - 1) & -SQUARE; x + SQUARE - 1 <= right; x += SQUARE) {
        const size_t square = (size_t)(row * s->across + ((x - tile->x0) >> UMBB_SQUARE_LOG2));
        /* The depth at the farthest texel bounds the face's lit in the square from above. */
        const int32_t at_x = umbb_rays_grow(&s->rays, c->gradient_x) ? x + SQUARE - 1 : x;
        const int32_t at_y = ys[umbb_rays_grow(&s->rays, c->gradient_y)];
        const int32_t lit = umbb_rays_lit(&s->rays, c, umbb_coverage_row_z(c, at_y), at_x);
        s->proofs[square].cover = least(s->proofs[square].cover, lit);
    }
}

static void add_triangle(struct squares *s, const struct face *face)
{
    const struct umbb_tile *tile = s->tile;
    const struct umbb_coverage *c = face->coverage;
    const int32_t top = most(c->row_first, s->top);
    const int32_t bottom = least(c->row_last, s->bottom);
    for (int32_t first = top; first <= bottom; first = (first | (SQUARE - 1)) + 1) {
        const int32_t last = least(first | (SQUARE - 1), bottom);
        const int32_t row = (first - tile->y0) >> UMBB_SQUARE_LOG2;
        int32_t left, right;
        /* Only a face that meets all rows of the row of squares can cover one of them. */
        if (face->front && last - first == SQUARE - 1) {
            cover_squares(s, c, first);
        }
        if (umbb_rays_meet(&s->rays) && (first & (SQUARE - 1)) == 0) {
            corners_touch(s, face, first, 0);
        }
        if (umbb_rays_meet(&s->rays) && (last & (SQUARE - 1)) == SQUARE - 1) {
            corners_touch(s, face, last, 1);
        }
        rows_reach(c, first, last, &left, &right);
        left = most(left, tile->x0);
        right = least(right, tile->x0 + tile->size - 1);
        for (int32_t x = left; x <= right; x = (x | (SQUARE - 1)) + 1) {
            const int32_t column = (x - tile->x0) >> UMBB_SQUARE_LOG2;
            const size_t square = (size_t)(row * s->across + column);
            const int32_t xs[2] = {x, least(x | (SQUARE - 1), right)}, ys[2] = {first, last};
            square_touch(s, face, square, xs, ys);
            if (face->front) {
                middle_touch(s, c, square, (x & -SQUARE) + SQUARE / 2,
                             (first & -SQUARE) + SQUARE / 2);
            }
        }
    }
}

/* Marks the squares within reach of an edge. */
static void add_border(struct squares *s, const double *a, const double *b)
{
    const struct umbb_tile *tile = s->tile;
    const double *upper = a[1] < b[1] ? a : b, *lower = a[1] < b[1] ? b : a;
    const double height = lower[1] - upper[1];
    const double tile_top = (double)tile->y0, tile_left = (double)tile->x0;
    const double reach = umbb_rays_meet(&s->rays) ? BORDER_REACH_MEETING : BORDER_REACH;
    for (int32_t row = s->first_row; row < s->end_row; row++) {
        const double top = tile_top + (double)(row * SQUARE) - reach;
        const double bottom = top + (double)SQUARE + 2.0 * reach;
        if (lower[1] < top || upper[1] > bottom) {
            continue;
        }
        /* The part of the edge within reach of the row of squares: start and end as shares of its
         * length. */
        const double from = upper[1] < top ? (top - upper[1]) / height : 0.0;
        const double to = lower[1] > bottom ? (bottom - upper[1]) / height : 1.0;
        const double x_from = upper[0] + from * (lower[0] - upper[0]);
        const double x_to = upper[0] + to * (lower[0] - upper[0]);
        /* Its range of x, with the reach on either side. */
        const double left = (x_from < x_to ? x_from : x_to) - reach - tile_left;
        const double right = (x_from < x_to ? x_to : x_from) + reach - tile_left;
        if (right < 0.0 || left >= (double)tile->size) {
            continue;
        }
        const int32_t first = left > 0.0 ? (int32_t)left >> UMBB_SQUARE_LOG2 : 0;
        const int32_t last =
            right < (double)tile->size ? (int32_t)right >> UMBB_SQUARE_LOG2 : s->across - 1;
        for (int32_t column = first; column <= last; column++) {
            tile->proven[row * s->across + column] |= BORDER;
        }
    }
}

/* Returns whether a triangle lies outside the strip, including the reach of its borders. */
static int is_beside(const struct squares *s, const double v[3][3])
{
    double low = v[0][1] < v[1][1] ? v[0][1] : v[1][1];
    double high = v[0][1] > v[1][1] ? v[0][1] : v[1][1];
    low = low < v[2][1] ? low : v[2][1];
    high = high > v[2][1] ? high : v[2][1];
    return high < (double)s->top - 2.0 || low > (double)s->bottom + 3.0;
}

static void add_caster(struct squares *s, uint32_t caster)
{
    const uint8_t marks = s->casters->marks[caster];
    const double(*v)[3] = s->casters->corners[caster];
    if (is_beside(s, v)) {
        return;
    }
    for (size_t edge = 0; edge < 3; edge++) {
        if (marks & 1U << edge) {
            add_border(s, v[edge], v[(edge + 1) % 3]);
        }
    }
    struct umbb_coverage coverage;
    if (umbb_perspective_prepare(s->casters, caster, &coverage)) {
        const struct face face = {&coverage, caster, umbb_caster_kind(s->casters, caster),
                                  (marks & UMBB_MARK_FRONT) != 0};
        add_triangle(s, &face);
    }
}

/*
 * Returns whether greatest lit and least end lie in the same multiples of 64 as their bounds, by
 * the corner texels.
 *
 * A back face beyond the last voxel ends nothing: its texels have end = lit. The frustum of a lamp
 * is fitted without its outermost texels, so such faces occur there.
 */
static int is_exact(const struct umbb_proof *proof, int32_t background, int32_t lit_bound,
                    int32_t end_bound)
{
    int32_t lit_most = 0, end_least = background;
    if (proof->back_most >= background) {
        return 0;
    }
    for (size_t corner = 0; corner < 4; corner++) {
        int32_t lit, end;
        umbb_texel_decide(proof->corners[corner], background, &lit, &end);
        lit_most = most(lit_most, lit);
        end_least = least(end_least, end);
    }
    return (lit_most + SQUARE - 1) / SQUARE == (lit_bound + SQUARE - 1) / SQUARE &&
           end_least / SQUARE == end_bound / SQUARE;
}

/* Turns a square's flags into the answer. */
static void decide(struct squares *s, size_t square)
{
    const int flags = s->tile->proven[square];
    const int32_t background = s->casters->size;
    int proven = 0;
    if (flags == 0) {
        s->front_most[square] = background;
        proven = 1;
    } else {
        /* Upper bound of `lit` in all texels of the square: from the nearest front face that covers
         * the whole square, or else from all front faces together. */
        const int whole = flags == (TOUCHED | MIDDLE);
        const struct umbb_proof *proof = &s->proofs[square];
        s->front_most[square] = whole ? least(s->front_most[square], proof->cover) : proof->cover;
        /* Proven if a multiple of 64 lies between this bound and the nearest other face. */
        const int32_t cut = (s->front_most[square] + SQUARE - 1) & -SQUARE;
        proven = s->far_least[square] < background && cut <= s->far_least[square];
        if (umbb_rays_meet(&s->rays)) {
            s->far_least[square] = proof->back_least; /* open faces end nothing */
            proven =
                proven && is_exact(proof, background, s->front_most[square], s->far_least[square]);
        }
    }
    s->tile->proven[square] = (uint8_t)proven;
}

/* State that all strips share. */
struct proof {
    const struct umbb_casters *casters;
    const uint32_t *list;
    size_t count;
    struct umbb_tile *tile;
    int32_t across, strips;
};

static void proof_clear(struct umbb_proof *proof, int32_t background)
{
    proof->cover = proof->back_least = background;
    proof->back_most = 0;
    for (size_t i = 0; i < 4 * (size_t)UMBB_LAYER_COUNT; i++) {
        proof->corners[i / UMBB_LAYER_COUNT][i % UMBB_LAYER_COUNT] = background;
    }
}

static void strip_job(void *user, uint32_t strip, unsigned thread)
{
    (void)thread;
    const struct proof *proof = user;
    const struct umbb_casters *casters = proof->casters;
    struct umbb_tile *tile = proof->tile;
    struct squares squares = {
        .casters = casters,
        .rays = umbb_rays_of(casters),
        .tile = tile,
        .across = proof->across,
        .first_row = proof->across * (int32_t)strip / proof->strips,
        .end_row = proof->across * ((int32_t)strip + 1) / proof->strips,
        .front_most = tile->max_lit[UMBB_SQUARE_LOG2],
        .far_least = tile->min_end[UMBB_SQUARE_LOG2],
        .proofs = tile->proofs,
    };
    squares.top = tile->y0 + squares.first_row * SQUARE;
    squares.bottom = tile->y0 + squares.end_row * SQUARE - 1;
    const size_t first = (size_t)squares.first_row * (size_t)squares.across;
    const size_t end = (size_t)squares.end_row * (size_t)squares.across;
    for (size_t square = first; square < end; square++) {
        tile->proven[square] = 0;
        squares.front_most[square] = 0;
        squares.far_least[square] = casters->size;
        proof_clear(&squares.proofs[square], casters->size);
    }
    for (size_t i = 0; casters->marks != NULL && i < proof->count; i++) {
        add_caster(&squares, proof->list == NULL ? (uint32_t)i : proof->list[i]);
    }
    for (size_t square = first; casters->marks != NULL && square < end; square++) {
        decide(&squares, square);
    }
}

void umbb_prove_squares(const struct umbb_casters *casters, const uint32_t *list, size_t count,
                        const struct umb_workers *workers, struct umbb_tile *tile)
{
    if (tile->proven == NULL) {
        return;
    }
    struct proof proof = {
        .casters = casters,
        .list = list,
        .count = count,
        .tile = tile,
        .across = tile->size >> UMBB_SQUARE_LOG2,
    };
    /* Two strips for each thread, because their work differs. */
    const unsigned threads = workers == NULL ? 1 : workers->count;
    proof.strips = threads == 1 ? 1 : least(proof.across, (int32_t)(2 * threads));
    umbu_workers_run(workers, strip_job, &proof, (uint32_t)proof.strips);
}
