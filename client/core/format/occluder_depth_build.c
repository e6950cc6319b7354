/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Codes squares of texels as planes, and joins squares to the tree. Only texels with end > lit are
 * coded; the DAG answers for the others.
 *
 * A plane meets a texel if the plane's height there, rounded down, is the texel's `lit`. A square
 * that no single plane meets gets several planes. Each plane starts from a block of 8x8 texels that
 * is planar, and is then turned to meet as many other blocks of the square as it can, so that a
 * roof is stored once a square. For a block that no single plane meets, a plane is chosen for each
 * texel, or the block gets a plane with residuals.
 */
#include "format/occluder_depth_build.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"

/* --- planes ----------------------------------------------------------------------------------- */

/*
 * Planes are fitted in integers: equal texels give equal planes everywhere.
 *
 * A fit seeks a plane (c + a x + b y) / one whose height, rounded down, is `lit` at every texel.
 * Let e = lit * one - a x - b y at a texel. For slopes a and b such a plane exists if the spread,
 * max e - min e, is below `one`; c = max e then gives it. The slopes start at those of least
 * squares. While the spread is slightly too large, the slopes are turned so that the e of the two
 * extreme texels come closer (relaxation of linear inequalities). If that fails, c = max e keeps
 * the rounded plane at or above every texel, and residuals count down from it.
 * Source: Agmon 1954, Motzkin and Schoenberg 1954 (relaxation).
 */
#define SLOPE_MAX   1024 /* Voxels a texel: the c of planes of 8x8 texels then fits 32 bits */
#define TURNS       16   /* Most turns of the slopes: twice as many save 0.5 % of the bytes */
#define NEAR_SPREAD 4    /* Spread in voxels beyond which the texels are not planar */

/* A set of texels, 0 <= x, y < 64. */
struct texels {
    int64_t one; /* Units of a plane's height for one voxel */
    uint32_t count;
    uint8_t x[4096], y[4096];
    int32_t lit[4096];
};

struct plane {
    int64_t a, b; /* Slopes, at most 1024 voxels a texel */
    int64_t c;    /* Offset, so that no texel of the set lies above the plane */
    /* Greatest height of the plane above a texel of the set, before rounding down */
    int64_t spread;
};

static void texels_add(struct texels *texels, uint32_t x, uint32_t y, int32_t lit)
{
    texels->x[texels->count] = (uint8_t)x;
    texels->y[texels->count] = (uint8_t)y;
    texels->lit[texels->count++] = lit;
}

static int64_t slope_of(double value, int64_t one)
{
    const double most = (double)SLOPE_MAX;
    const double kept = value > most ? most : value < -most ? -most : value;
    return (int64_t)floor(kept * (double)one + 0.5);
}

/* Computes the slopes of least squares. The sums are exact. */
static struct plane least_squares(const struct texels *t)
{
    int64_t n = t->count, x = 0, y = 0, v = 0, xx = 0, yy = 0, xy = 0, xv = 0, yv = 0;
    for (uint32_t i = 0; i < t->count; i++) {
        x += t->x[i];
        y += t->y[i];
        v += t->lit[i];
        xx += t->x[i] * t->x[i];
        yy += t->y[i] * t->y[i];
        xy += t->x[i] * t->y[i];
        xv += (int64_t)t->x[i] * t->lit[i];
        yv += (int64_t)t->y[i] * t->lit[i];
    }
    const double sxx = (double)(n * xx - x * x), syy = (double)(n * yy - y * y);
    const double sxy = (double)(n * xy - x * y);
    const double sxv = (double)(n * xv - x * v), syv = (double)(n * yv - y * v);
    const double det = sxx * syy - sxy * sxy;
    struct plane plane = {0};
    if (det > 0.0) {
        plane.a = slope_of((sxv * syy - syv * sxy) / det, t->one);
        plane.b = slope_of((syv * sxx - sxv * sxy) / det, t->one);
    } else if (sxx > 0.0) { /* All texels on one line */
        plane.a = slope_of(sxv / sxx, t->one);
    } else if (syy > 0.0) {
        plane.b = slope_of(syv / syy, t->one);
    }
    return plane;
}

/* Computes c and the spread of a plane whose slopes are given. Out: high, low: the texels of the
 * greatest and least e = lit * one - a x - b y. */
static void measure(const struct texels *t, struct plane *plane, uint32_t *high, uint32_t *low)
{
    int64_t most = INT64_MIN, least = INT64_MAX;
    for (uint32_t i = 0; i < t->count; i++) {
        const int64_t e = t->lit[i] * t->one - plane->a * t->x[i] - plane->b * t->y[i];
        if (e > most) {
            most = e;
            *high = i;
        }
        if (e < least) {
            least = e;
            *low = i;
        }
    }
    plane->c = most;
    plane->spread = most - least;
}

static int64_t clamped(int64_t slope, int64_t most)
{
    return slope > most ? most : slope < -most ? -most : slope;
}

/* Changes the slopes of a plane that nearly meets the set until it does, at most a few times. The
 * result is then the best plane found. */
static void turn_plane(const struct texels *texels, struct plane *plane)
{
    uint32_t high = 0, low = 0;
    struct plane at = *plane;
    measure(texels, &at, &high, &low);
    *plane = at;
    const int64_t one = texels->one;
    for (int turn = 0; turn < TURNS && at.spread >= one && at.spread < NEAR_SPREAD * one; turn++) {
        const int64_t dx = texels->x[high] - texels->x[low], dy = texels->y[high] - texels->y[low];
        const int64_t square = dx * dx + dy * dy; /* Not 0, since the texels differ */
        const int64_t too_much = at.spread - one + one / texels->count;
        at.a = clamped(at.a + too_much * dx / square, SLOPE_MAX * one);
        at.b = clamped(at.b + too_much * dy / square, SLOPE_MAX * one);
        measure(texels, &at, &high, &low);
        if (at.spread < plane->spread) {
            *plane = at;
        }
    }
}

/* Fits a plane to the set by least squares, then turns it. */
static struct plane fit_plane(const struct texels *texels)
{
    struct plane plane = least_squares(texels);
    turn_plane(texels, &plane);
    return plane;
}

/* --- squares ---------------------------------------------------------------------------------- */

/* Words of the longest possible square: length, reference, all planes, and residuals of all
 * blocks. */
#define SQUARE_WORDS_MAX                                                                           \
    (5 + UMB__OCCLUDER_DEPTH_PLANES_MAX * UMB__OCCLUDER_DEPTH_PLANE_WORDS +                        \
     64 * (1 + 5 + 2 * UMB__OCCLUDER_DEPTH_WIDTH_MAX))

/* Largest error in voxels of a plane that is still turned to meet a block. */
#define NEAR_BLOCK 2

/* A square under way. */
struct work {
    const int32_t (*lit)[64], (*end)[64];
    uint64_t coded[64]; /* Texels with end > lit of each block */
    struct texels set, other;
    struct plane planes[UMB__OCCLUDER_DEPTH_PLANES_MAX];
    uint64_t masks[UMB__OCCLUDER_DEPTH_PLANES_MAX]; /* Blocks that each plane answers */
    uint32_t plane_count;
    uint32_t *words; /* Words of the square: [0] its length, [1] its reference, records from [2]
                        on */
};

/* Adds to a set of texels those of a block that a mask selects, with their positions in the
 * square. */
static void add_block(const struct work *w, uint32_t block, uint64_t mask, struct texels *to)
{
    for (uint64_t left = mask; left; left &= left - 1) {
        const uint32_t i = (uint32_t)__builtin_ctzll(left);
        texels_add(to, block % 8 * 8 + i % 8, block / 8 * 8 + i / 8, w->lit[block][i]);
    }
}

/* Returns a mask of the texels of a block that a plane meets. */
static uint64_t met_by(const struct work *w, uint32_t block, const struct plane *plane)
{
    uint64_t met = 0;
    for (uint32_t i = 0; i < 64; i++) {
        const int64_t sum =
            plane->c + plane->a * (block % 8 * 8 + i % 8) + plane->b * (block / 8 * 8 + i / 8);
        met |= (uint64_t)(sum >> UMB__OCCLUDER_DEPTH_WIDE_SHIFT == w->lit[block][i]) << i;
    }
    return met;
}

/* Changes a plane's slopes so that it also meets the coded texels (end > lit) of one more block, if
 * that is possible. The plane still meets all texels of w->set, and the block is added to
 * w->set. */
static void take_in(struct work *w, uint32_t block, struct plane *plane)
{
    if ((met_by(w, block, plane) & w->coded[block]) == w->coded[block]) {
        add_block(w, block, w->coded[block], &w->set);
        return;
    }
    struct plane turned = *plane;
    uint32_t high, low;
    w->other.count = 0;
    w->other.one = w->set.one;
    add_block(w, block, w->coded[block], &w->other);
    measure(&w->other, &turned, &high, &low);
    if (turned.spread >= NEAR_BLOCK * w->set.one || turned.c < plane->c - NEAR_BLOCK * w->set.one ||
        turned.c > plane->c + NEAR_BLOCK * w->set.one) {
        return;
    }
    const uint32_t before = w->set.count;
    add_block(w, block, w->coded[block], &w->set);
    turned = *plane;
    turn_plane(&w->set, &turned);
    if (turned.spread < w->set.one) {
        *plane = turned;
    } else {
        w->set.count = before;
    }
}

/* Starts a plane at a block and turns it to meet as many other blocks as possible that no plane
 * meets yet. */
static void grow_plane(struct work *w, uint32_t first, uint64_t open)
{
    w->set.count = 0;
    w->set.one = (int64_t)1 << UMB__OCCLUDER_DEPTH_WIDE_SHIFT;
    add_block(w, first, w->coded[first], &w->set);
    struct plane plane = fit_plane(&w->set);
    if (plane.spread >= w->set.one) {
        return;
    }
    for (uint64_t left = open & ~((uint64_t)1 << first); left; left &= left - 1) {
        take_in(w, (uint32_t)__builtin_ctzll(left), &plane);
    }
    w->masks[w->plane_count] = 0;
    w->planes[w->plane_count++] = plane;
}

/* Finds the square's planes. Returns a mask of the blocks whose coded texels (end > lit) no single
 * plane meets. */
static uint64_t find_planes(struct work *w)
{
    uint64_t open = 0, tried = 0;
    for (uint32_t block = 0; block < 64; block++) {
        open |= (uint64_t)(w->coded[block] != 0) << block;
    }
    uint64_t rest = open; /* Blocks of which no plane meets all coded texels */
    while ((rest & ~tried) != 0 && w->plane_count < UMB__OCCLUDER_DEPTH_PLANES_MAX) {
        const uint32_t block = (uint32_t)__builtin_ctzll(rest & ~tried);
        const uint32_t before = w->plane_count;
        tried |= (uint64_t)1 << block;
        grow_plane(w, block, rest);
        for (uint64_t left = w->plane_count > before ? rest : 0; left; left &= left - 1) {
            const uint32_t at = (uint32_t)__builtin_ctzll(left);
            const uint64_t met = met_by(w, at, &w->planes[before]);
            if ((met & w->coded[at]) == w->coded[at]) {
                rest &= ~((uint64_t)1 << at);
            }
            if (~met == 0) {
                open &= ~((uint64_t)1 << at);
                w->masks[before] |= (uint64_t)1 << at;
            }
        }
    }
    return open;
}

/* Returns the number of bits that the numbers 0 .. most need. */
static uint32_t bits_of(uint64_t most)
{
    return most == 0 ? 0 : 64 - (uint32_t)__builtin_clzll(most);
}

/* Stores number `index` of an array of `width` bits each. In: a zeroed array. */
static void put_number(uint32_t *words, uint32_t width, uint32_t index, uint64_t number)
{
    const uint32_t bit = index * width;
    words[bit / 32] |= (uint32_t)(number << bit % 32);
    if (bit % 32 + width > 32) {
        words[bit / 32 + 1] |= (uint32_t)(number >> (32 - bit % 32));
    }
}

/* Writes for each texel of a block the number of the plane that answers it. Returns the words
 * written, 0 if some texel has no plane. */
static uint32_t put_choice(const struct work *w, uint32_t block, uint32_t *to)
{
    const uint32_t width = bits_of(w->plane_count);
    uint64_t left = w->coded[block];
    memset(to, 0, 2 * width * sizeof *to);
    for (uint32_t plane = 0; plane < w->plane_count && left; plane++) {
        const uint64_t met = met_by(w, block, &w->planes[plane]) & left;
        for (uint64_t each = met; each; each &= each - 1) {
            put_number(to, width, (uint32_t)__builtin_ctzll(each), plane + 1);
        }
        left &= ~met;
    }
    return left ? 0 : 2 * width;
}

static uint32_t *put64(uint64_t number, uint32_t *to)
{
    to[0] = (uint32_t)number;
    to[1] = (uint32_t)(number >> 32);
    return to + 2;
}

/* Writes a plane with 12 fraction bits and the residuals of texels t. Returns the words written.
 * In: mask: NULL for none. */
static uint32_t put_residuals(const struct texels *t, const struct plane *plane,
                              const uint64_t *mask, uint32_t *to)
{
    const uint32_t width = bits_of((uint64_t)(plane->spread >> UMB__OCCLUDER_DEPTH_SHIFT));
    uint32_t *next = to + 3;
    to[0] = (uint32_t)(int32_t)plane->c;
    to[1] = (uint32_t)(int32_t)plane->a;
    to[2] = (uint32_t)(int32_t)plane->b;
    next = mask ? put64(*mask, next) : next;
    memset(next, 0, 2 * width * sizeof *next);
    for (uint32_t i = 0; i < t->count && width > 0; i++) {
        const int64_t height = umb__occluder_depth_plane(to, t->x[i], t->y[i]);
        put_number(next, width, t->x[i] + 8U * t->y[i], (uint64_t)(height - t->lit[i]));
    }
    return (uint32_t)(next - to) + 2 * width;
}

/* Writes the record of a block that no single plane meets. Returns the words written. */
static uint32_t put_block(struct work *w, uint32_t block, uint32_t *to, uint32_t *kind)
{
    uint32_t count = put_choice(w, block, to);
    if (count > 0) {
        *kind = UMB__OCCLUDER_DEPTH_CHOICE + count / 2;
        return count;
    }
    struct texels *all = &w->set, *coded = &w->other;
    all->count = coded->count = 0;
    all->one = coded->one = (int64_t)1 << UMB__OCCLUDER_DEPTH_SHIFT;
    for (uint32_t i = 0; i < 64; i++) {
        texels_add(all, i % 8, i / 8, w->lit[block][i]);
        if (w->coded[block] >> i & 1) {
            texels_add(coded, i % 8, i / 8, w->lit[block][i]);
        }
    }
    const struct plane whole = fit_plane(all), part = fit_plane(coded);
    const uint32_t whole_width = bits_of((uint64_t)(whole.spread >> UMB__OCCLUDER_DEPTH_SHIFT));
    const uint32_t part_width = bits_of((uint64_t)(part.spread >> UMB__OCCLUDER_DEPTH_SHIFT));
    if (part_width + 1 < whole_width) {
        *kind = UMB__OCCLUDER_DEPTH_MASKED + part_width;
        return put_residuals(coded, &part, &w->coded[block], to);
    }
    *kind = whole_width;
    return put_residuals(all, &whole, NULL, to);
}

static uint32_t *put_plane(const struct plane *plane, uint32_t *to)
{
    to = put64((uint64_t)plane->c, to);
    to[0] = (uint32_t)(int32_t)plane->a;
    to[1] = (uint32_t)(int32_t)plane->b;
    return to + 2;
}

/* Writes a square of several planes behind its reference. */
static uint32_t *put_planes(struct work *w)
{
    const uint64_t rest = find_planes(w);
    uint32_t *next = w->words + 2;
    *next++ = w->plane_count;
    for (uint32_t i = 0; i < w->plane_count; i++) {
        next = put64(w->masks[i], put_plane(&w->planes[i], next));
    }
    next = put64(rest, next);
    uint32_t *reference = next;
    next += __builtin_popcountll(rest);
    for (uint64_t left = rest; left; left &= left - 1) {
        uint32_t kind;
        const uint32_t at = (uint32_t)(next - (w->words + 2));
        next += put_block(w, (uint32_t)__builtin_ctzll(left), next, &kind);
        *reference++ = kind << UMB__OCCLUDER_DEPTH_OFFSET_BITS | at;
    }
    w->words[1] = UMB__OCCLUDER_DEPTH_PLANES << UMB__OCCLUDER_DEPTH_OFFSET_BITS;
    return next;
}

/* Writes a square. Returns the number of words; 0 if no texel has undefined voxels. */
static size_t put_square(struct work *w)
{
    uint64_t any = 0;
    w->set.count = 0;
    w->set.one = (int64_t)1 << UMB__OCCLUDER_DEPTH_WIDE_SHIFT;
    for (uint32_t block = 0; block < 64; block++) {
        w->coded[block] = 0;
        for (uint32_t i = 0; i < 64; i++) {
            w->coded[block] |= (uint64_t)(w->end[block][i] > w->lit[block][i]) << i;
        }
        any |= w->coded[block];
        add_block(w, block, ~(uint64_t)0, &w->set);
    }
    if (any == 0) {
        return 0;
    }
    const struct plane plane = fit_plane(&w->set);
    w->words[1] = 0; /* Kind 0, word 0 of the square's records */
    w->plane_count = 0;
    const uint32_t *end =
        plane.spread < w->set.one ? put_plane(&plane, w->words + 2) : put_planes(w);
    w->words[0] = (uint32_t)(end - w->words);
    return w->words[0];
}

static size_t squares_across(const struct umb__occluder_depth *occluder_depth)
{
    return (size_t)1 << (occluder_depth->log2_size - 6);
}

enum umb_status umb__occluder_depth_init(struct umb__occluder_depth *occluder_depth,
                                         const struct umb_alloc *alloc, uint32_t log2_size,
                                         size_t max_bytes, struct umb_error *error)
{
    memset(occluder_depth, 0, sizeof *occluder_depth);
    if (log2_size < UMB_LEVEL_MIN || log2_size > UMB__OCCLUDER_DEPTH_LEVEL_MAX) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "front: 2^%u voxels a side, at most 2^%u",
                        log2_size, UMB__OCCLUDER_DEPTH_LEVEL_MAX);
    }
    occluder_depth->alloc = alloc;
    occluder_depth->log2_size = log2_size;
    occluder_depth->max_words = max_bytes / sizeof(uint32_t);
    const size_t count = squares_across(occluder_depth) * squares_across(occluder_depth);
    occluder_depth->square = umb__alloc_zeroed(alloc, count, sizeof *occluder_depth->square);
    return occluder_depth->square
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "front: no memory for %zu squares", count);
}

void umb__occluder_depth_finish(struct umb__occluder_depth *occluder_depth)
{
    umb__free(occluder_depth->alloc, occluder_depth->square);
    umb__free(occluder_depth->alloc, occluder_depth->words);
    memset(occluder_depth, 0, sizeof *occluder_depth);
}

size_t umb__occluder_depth_bytes(const struct umb__occluder_depth *occluder_depth)
{
    const size_t squares = occluder_depth->square
                               ? squares_across(occluder_depth) * squares_across(occluder_depth)
                               : 0;
    return (squares + occluder_depth->capacity) * sizeof(uint32_t);
}

static enum umb_status too_large(size_t max_words, struct umb_error *error)
{
    return umb_fail(
        error, UMB_E_LIMIT,
        "front: more than %zu KiB of first-occluder depth: lower the resolution or bake "
        "with --effect front=off",
        max_words >> 8);
}

/* Records the place of a square whose words were appended to those of the other squares. */
static enum umb_status note_square(struct umb__occluder_depth *occluder_depth, uint32_t x,
                                   uint32_t y, size_t count, struct umb_error *error)
{
    occluder_depth->square[y * squares_across(occluder_depth) + x] =
        (uint32_t)occluder_depth->count + 1;
    occluder_depth->count += count;
    return occluder_depth->count <= occluder_depth->max_words
               ? UMB_OK
               : too_large(occluder_depth->max_words, error);
}

enum umb_status umb__occluder_depth_add(struct umb__occluder_depth *occluder_depth, uint32_t x,
                                        uint32_t y, const int32_t (*lit)[64],
                                        const int32_t (*end)[64], struct umb_error *error)
{
    struct work *work = umb__alloc(occluder_depth->alloc, 1, sizeof *work);
    if (!work ||
        !umb__grow(occluder_depth->alloc, &occluder_depth->words, &occluder_depth->capacity,
                   occluder_depth->count + SQUARE_WORDS_MAX, sizeof *occluder_depth->words)) {
        umb__free(occluder_depth->alloc, work);
        return umb_fail(error, UMB_E_NO_MEMORY, "front: no memory for a square's planes");
    }
    work->lit = lit;
    work->end = end;
    work->words = occluder_depth->words + occluder_depth->count;
    const size_t count = put_square(work);
    umb__free(occluder_depth->alloc, work);
    return count > 0 ? note_square(occluder_depth, x, y, count, error) : UMB_OK;
}

const uint32_t *umb__occluder_depth_square(const struct umb__occluder_depth *occluder_depth,
                                           uint32_t x, uint32_t y)
{
    const uint32_t begin = occluder_depth->square[y * squares_across(occluder_depth) + x];
    return begin == 0 ? NULL : occluder_depth->words + begin - 1;
}

enum umb_status umb__occluder_depth_add_square(struct umb__occluder_depth *occluder_depth,
                                               uint32_t x, uint32_t y, const uint32_t *words,
                                               struct umb_error *error)
{
    if (!umb__grow(occluder_depth->alloc, &occluder_depth->words, &occluder_depth->capacity,
                   occluder_depth->count + words[0], sizeof *occluder_depth->words)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "front: no memory for a square's %u words",
                        words[0]);
    }
    memcpy(occluder_depth->words + occluder_depth->count, words, words[0] * sizeof *words);
    return note_square(occluder_depth, x, y, words[0], error);
}

/* --- joining the squares of all frusta -------------------------------------------------------- */

struct joiner {
    const struct umb__occluder_depth *occluder_depth;
    uint32_t *words; /* Joined words; NULL while they are only counted */
    uint64_t count;
};

/* Returns true if the square at (x, y) of a level has a record. In: x, y: in squares. */
static bool holds_any(const struct umb__occluder_depth *occluder_depth, uint32_t level, size_t x,
                      size_t y)
{
    const size_t across = squares_across(occluder_depth), side = (size_t)1 << (level - 6);
    for (size_t row = y * side; row < (y + 1) * side && row < across; row++) {
        for (size_t column = x * side; column < (x + 1) * side && column < across; column++) {
            if (occluder_depth->square[row * across + column]) {
                return true;
            }
        }
    }
    return false;
}

/* Copies a square's records; returns its reference. */
static uint32_t join_square(struct joiner *j, size_t x, size_t y)
{
    const struct umb__occluder_depth *occluder_depth = j->occluder_depth;
    const uint32_t *from = umb__occluder_depth_square(occluder_depth, (uint32_t)x, (uint32_t)y);
    const uint32_t base = (uint32_t)j->count, count = from[0] - 2;
    if (j->words) {
        uint32_t *to = j->words + base;
        memcpy(to, from + 2, count * sizeof *to);
        if (umb__occluder_depth_kind(from[1]) == UMB__OCCLUDER_DEPTH_PLANES) {
            uint32_t *rest = to + 1 + to[0] * UMB__OCCLUDER_DEPTH_PLANE_WORDS;
            const int references = __builtin_popcountll(umb__occluder_depth_mask(rest));
            for (int i = 0; i < references; i++) {
                rest[2 + i] += base;
            }
        }
    }
    j->count += count;
    return from[1] + base;
}

/* Writes a square's records. Returns the square's reference; 0: it has no record. */
static uint32_t join_level(struct joiner *j, uint32_t level, size_t x, size_t y)
{
    if (!holds_any(j->occluder_depth, level, x, y)) {
        return 0;
    }
    if (level == 6) {
        return join_square(j, x, y);
    }
    uint64_t mask = 0;
    for (unsigned child = 0; child < 64; child++) {
        const size_t cx = x * 8 + child % 8, cy = y * 8 + child / 8;
        mask |= (uint64_t)holds_any(j->occluder_depth, level - 3, cx, cy) << child;
    }
    const uint64_t start = j->count;
    if (j->words) {
        (void)put64(mask, j->words + start);
    }
    j->count += 2 + (unsigned)__builtin_popcountll(mask);
    uint64_t at = start + 2;
    for (unsigned child = 0; child < 64; child++) {
        if (mask >> child & 1) {
            const uint32_t made = join_level(j, level - 3, x * 8 + child % 8, y * 8 + child / 8);
            if (j->words) {
                j->words[at] = made;
            }
            at++;
        }
    }
    return UMB__OCCLUDER_DEPTH_DIVIDED << UMB__OCCLUDER_DEPTH_OFFSET_BITS | (uint32_t)start;
}

static uint64_t join_all(const struct umb__occluder_depth *occluder_depths, uint32_t count,
                         uint32_t *words)
{
    struct joiner j = {.words = words, .count = count};
    for (uint32_t i = 0; i < count; i++) {
        j.occluder_depth = &occluder_depths[i];
        const uint32_t root =
            occluder_depths[i].square
                ? join_level(&j, umb__occluder_depth_top(occluder_depths[i].log2_size), 0, 0)
                : 0;
        if (words) {
            words[i] = root;
        }
    }
    return j.count;
}

enum umb_status umb__occluder_depth_join(const struct umb__occluder_depth *occluder_depths,
                                         uint32_t count, uint32_t **words, uint64_t *word_count,
                                         struct umb_error *error)
{
    const uint64_t needed = join_all(occluder_depths, count, NULL);
    size_t allowed = 0;
    *words = NULL;
    *word_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        allowed += occluder_depths[i].max_words;
    }
    if (needed > allowed) {
        return too_large(allowed, error);
    }
    if (needed >= (uint64_t)1 << UMB__OCCLUDER_DEPTH_OFFSET_BITS) {
        return umb_fail(error, UMB_E_LIMIT, "front: %llu words, at most %u",
                        (unsigned long long)needed, 1U << UMB__OCCLUDER_DEPTH_OFFSET_BITS);
    }
    *words = umb__alloc(occluder_depths[0].alloc, (size_t)needed, sizeof **words);
    if (!*words) {
        return umb_fail(error, UMB_E_NO_MEMORY, "front: no memory for %llu words",
                        (unsigned long long)needed);
    }
    *word_count = join_all(occluder_depths, count, *words);
    return UMB_OK;
}

void umb__occluder_depth_words_free(const struct umb_alloc *alloc, uint32_t *words)
{
    umb__free(alloc, words);
}
