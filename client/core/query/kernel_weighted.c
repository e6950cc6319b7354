/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Weighs the texels of one window by their distance to the centre on both axes, for the Gaussian,
 * and for tents that the kernels leave out (kernel_tent_steps.h): those cut off by the frustum's
 * edge. Such weights are sums of boxes: the weight of a row is a sum of popcounts under nested
 * masks (0, 1, 2 ... texels around the centre), each times a whole number. The window's texels are
 * gathered once, as rows of bits, brick by brick. All sums are of integers: the same bits on all
 * machines.
 */
#include "query/stages.h"

#define HALF_MAX (UMB_TAPS_MAX / 2)

/*
 * Weights of the Gaussian with a standard deviation of taps / 6, by (taps - 1) / 2 and the distance
 * in texels. They are rounded to whole numbers, and the middle one takes the rest, so that a row
 * weighs GAUSSIAN_ROW: a power of two, for which shares are exact floats. Rounding, and the ends of
 * the bell that the window cuts off, change an answer by at most 0.006 from that of the unbounded
 * Gaussian (tests/unit/core/test_filters.c).
 */
#define GAUSSIAN_ROW 2048U
static const uint16_t GAUSSIAN[HALF_MAX + 1][HALF_MAX + 2] = {
    {2048},
    {1612, 218},
    {982, 478, 55},
    {702, 486, 161, 26},
    {546, 437, 224, 74, 16},
    {448, 385, 246, 117, 41, 11},
    {378, 340, 247, 145, 69, 26, 8},
    {330, 302, 238, 159, 91, 44, 18, 7},
    {288, 272, 225, 165, 107, 61, 31, 14, 5},
};

/* Rows of a window: bit i of bits[j] is texel (x + i, y + j). */
struct rows {
    int32_t x, y; /* First texel of the window; it may lie outside the frustum */
    uint64_t bits[UMB_TAPS_MAX];
};

/* Adds the texels of the window that lie in the brick-sized square at (bx, by). */
static void add_square(const struct umb__place *place, const struct umb__window *w, int32_t bx,
                       int32_t by, struct rows *rows)
{
    int32_t y0 = w->y0 > by ? w->y0 : by, y1 = w->y1 < by + 7 ? w->y1 : by + 7;
    for (int32_t y = y0; y <= y1; y++) {
        uint64_t row = place->lit ? 0xffU : 0;
        if (place->brick) {
            row = place->brick[w->z & 7] >> (8 * (y & 7)) & 0xffU;
        }
        /* Texels before the window's first one are cut off here, those behind it later. */
        rows->bits[y - rows->y] |= bx < rows->x ? row >> (rows->x - bx) : row << (bx - rows->x);
    }
}

/* Gathers the texels of the window around v. Texels outside the frustum are lit. In: w: the part of
 * the window inside the frustum. first: place of that part's first texel. */
static void gather(const struct umb__query *q, const struct umb__tree *tree, const double v[3],
                   const struct umb__window *w, struct umb__place first,
                   struct umb_volume_stats *read, struct rows *rows)
{
    const int32_t x = (int32_t)floor(v[0]) - q->taps / 2, y = (int32_t)floor(v[1]) - q->taps / 2;
    const int32_t bx0 = w->x0 & ~7, by0 = w->y0 & ~7;
    const uint64_t outside = ~((((uint64_t)2 << (w->x1 - w->x0)) - 1) << (w->x0 - x));
    rows->x = x;
    rows->y = y;
    for (int32_t j = 0; j < q->taps; j++) {
        rows->bits[j] = j < w->y0 - y || j > w->y1 - y ? UINT64_MAX : outside;
    }
    for (int32_t by = by0; by <= w->y1; by += 8) {
        for (int32_t bx = bx0; bx <= w->x1; bx += 8) {
            struct umb__place place = first;
            if (bx != bx0 || by != by0) {
                place = umb__tree_locate(tree, (uint32_t)bx, (uint32_t)by, (uint32_t)w->z, read);
            }
            add_square(&place, w, bx, by, rows);
        }
    }
}

/* Returns the sum of the weights of the lit texels. In: row: sum of the weights of all texels of a
 * row. */
UMB__INLINE uint32_t weigh(const struct umb__query *q, const struct rows *rows,
                           const uint16_t *weights, uint32_t row)
{
    const int32_t half = q->taps / 2;
    const uint64_t all = ((uint64_t)1 << q->taps) - 1;
    uint64_t before = 0;
    uint32_t sum = 0, row_sum = 0;
    for (int32_t j = 0; j < q->taps; j++) {
        const uint64_t bits = rows->bits[j] & all;
        if (bits != before) { /* Rows are often alike, or all lit */
            row_sum = bits == all ? row : 0;
            for (int32_t k = 0; k <= half && bits != all; k++) {
                const uint64_t within = (((uint64_t)2 << (2 * k)) - 1) << (half - k);
                const uint32_t step = (uint32_t)weights[k] - weights[k + 1];
                row_sum += step * (uint32_t)__builtin_popcountll(bits & within);
            }
            before = bits;
        }
        sum += row_sum * weights[j < half ? half - j : j - half];
    }
    return sum;
}

/* True if the whole window lies in the uniform cube around its first texel. */
static bool is_uniform(const struct umb__place *place, const struct umb__window *w)
{
    return !place->brick && w->outside == 0 && w->x0 >> place->level == w->x1 >> place->level &&
           w->y0 >> place->level == w->y1 >> place->level;
}

/* Returns the weight of the lit texels around a moved point. In: window: the point's window. */
UMB__INLINE uint32_t look_up(const struct umb__query *q, const double v[3],
                             const struct umb__window *window, const uint16_t *weights,
                             uint32_t row, struct umb_query_stats *stats)
{
    const struct umb__tree tree = umb__tree_of(q);
    struct umb_volume_stats read = {0};
    if (window->all_lit) {
        return q->total;
    }
    struct umb__place first = umb__tree_locate(&tree, (uint32_t)window->x0, (uint32_t)window->y0,
                                               (uint32_t)window->z, &read);
    uint32_t lit = first.lit ? q->total : 0;
    if (!is_uniform(&first, window)) {
        struct rows rows;
        gather(q, &tree, v, window, first, &read, &rows);
        lit = weigh(q, &rows, weights, row);
    }
    stats->nodes += read.nodes;
    stats->bricks += read.bricks;
    return lit;
}

uint32_t umb__weigh_tent(const struct umb__query *q, const double v[3],
                         const struct umb__window *window, struct umb_query_stats *stats)
{
    const uint32_t m = (uint32_t)(q->taps + 1) / 2;
    uint16_t weights[HALF_MAX + 2] = {0};
    for (uint32_t k = 0; k < m; k++) {
        weights[k] = (uint16_t)(m - k);
    }
    return look_up(q, v, window, weights, m * m, stats);
}

static void run_gaussian(const struct umb__query *query, const struct umb_points *points,
                         size_t first, size_t count, struct umb_answers *answers)
{
    const uint16_t *weights = GAUSSIAN[query->taps / 2];
    for (size_t i = first; i < first + count; i++) {
        double v[3];
        uint32_t lit = 0;
        if (umb__voxel_at(query, points, i, v)) {
            const struct umb__window window = umb__window_at(query, v, &answers->stats);
            lit = look_up(query, v, &window, weights, GAUSSIAN_ROW, &answers->stats);
        } else {
            answers->stats.facing_away++;
        }
        umb__store_answer(answers->values, query->format, i, lit, query->total);
    }
    answers->stats.points += count;
}

static uint32_t tent_total(int32_t taps)
{
    const uint32_t m = (uint32_t)(taps + 1) / 2;
    return m * m * m * m;
}

static uint32_t gaussian_total(int32_t taps)
{
    (void)taps;
    return GAUSSIAN_ROW * GAUSSIAN_ROW;
}

const struct umb__filter umb__filter_tent = {.info = {.name = "tent", .is_window = 1},
                                             .any_light = true,
                                             .is_tent = true,
                                             .total = tent_total};
const struct umb__filter umb__filter_gaussian = {.info = {.name = "gaussian", .is_window = 1},
                                                 .any_light = true,
                                                 .kernel = run_gaussian,
                                                 .total = gaussian_total};
