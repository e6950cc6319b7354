/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The texels that filter windows read are bounded by boxes. The bias moves point p of a triangle by
 * at most `reach`, and the window adds half the taps. So the window of p can read texel t only if p
 * lies within a box of that size around t. Inside the box the triangle lies between two depths. For
 * a point on the triangle's plane the bias moves the whole window to the light's side of that
 * plane, half a voxel or more away.
 */
#include "bake/build/static_rule.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/depth/coverage.h"
#include "base/vec.h"
#include "format/receiver_mask.h"
#include "umbrage/query.h"

#define MET_LIT      1U            /* first, or within a voxel of the first, at some texel */
#define MET_SHADOW   2U            /* not first at some texel */
#define POLYGON_MAX  8             /* most corners of a triangle cut by four lines */
#define BIAS_SLACK   (65.0 / 64.0) /* slack of automatic biases, as in client/core/query */
#define WINDOW_HALF  (UMB_TAPS_MAX / 2 + 1.0) /* half of the widest window, and half a texel */
#define SURVEY_SHARE ((size_t)256)            /* triangles of a tile's survey in one slice */
/* Voxels of depth by which a point without a normal is moved for the widest window (query.c). */
#define NO_NORMAL (BIAS_SLACK * (2 * UMB_TAPS_MAX + 1) / (2 * sqrt(3.0)))
#define VERTICAL  1e-6 /* share of a normal's length along z below which a triangle is edge on */

/*
 * Sets reach to the greatest distance in voxels, on each axis, by which the automatic bias moves a
 * point. edge: lengths e of a voxel's edges.
 *
 * For a unit normal n the bias must clear s = (taps (|nx ex| + |ny ey|) + |nz ez|) / 2 metres along
 * n. It does so by a lift along the light. If the longest lift is too short, a move along n clears
 * the rest. So the moves are at most s nx / ex, s ny / ey, and s nz / ez plus the longest lift.
 * Products of two components of n are at most 1/2. The result also covers points without a normal
 * (query.c), and has one voxel more for rounding.
 */
static void set_reach(const double edge[3], struct umbb_static *rule)
{
    const double taps = UMB_TAPS_MAX, half = 0.5 * BIAS_SLACK;
    double *reach = rule->reach;
    const double x = half * (taps * (1 + edge[1] / (2 * edge[0])) + edge[2] / (2 * edge[0]));
    const double y = half * (taps * (1 + edge[0] / (2 * edge[1])) + edge[2] / (2 * edge[1]));
    const double z = half * (taps * (edge[0] + edge[1]) / (2 * edge[2]) + 1);
    rule->longest_lift = (2 * taps - 0.5) * (edge[0] + edge[1]) / 2 / edge[2];
    reach[0] = x + 1;
    reach[1] = y + 1;
    reach[2] = fmax(z + rule->longest_lift, NO_NORMAL) + 1;
}

/* Returns the greatest distance in voxels by which the bias moves a triangle's points towards the
 * light. In: n: a normal of the triangle in voxel space. */
static double find_lift(const struct umbb_static *rule, const double n[3])
{
    const double across = fabs(n[0]) + fabs(n[1]), depth = fabs(n[2]);
    const double half = 0.5 * BIAS_SLACK * (UMB_TAPS_MAX * across + depth);
    /* A shorter lift leaves no rest to move along n. */
    return half < rule->longest_lift * depth
               ? fmin(fmax(half / depth, NO_NORMAL) + 1, rule->reach[2])
               : rule->reach[2];
}

/* A polygon and its number of corners. */
struct polygon {
    double at[POLYGON_MAX][3];
    int count;
};

/* Cuts p to the part with sign * coordinate <= sign * limit (Sutherland and Hodgman 1974). */
static void cut(struct polygon *p, int axis, double sign, double limit)
{
    struct polygon out;
    out.count = 0;
    for (int i = 0; i < p->count; i++) {
        const double *a = p->at[i], *b = p->at[(i + 1) % p->count];
        const double da = sign * (limit - a[axis]), db = sign * (limit - b[axis]);
        if (da >= 0 && out.count < POLYGON_MAX) {
            memcpy(out.at[out.count++], a, sizeof out.at[0]);
        }
        if ((da < 0) != (db < 0) && out.count < POLYGON_MAX) {
            for (int k = 0; k < 3; k++) {
                out.at[out.count][k] = a[k] + (b[k] - a[k]) * (da / (da - db));
            }
            out.at[out.count++][axis] = limit;
        }
    }
    *p = out;
}

static void bounds_of(const double (*corners)[3], int count, double low[3], double high[3])
{
    for (int k = 0; k < 3; k++) {
        low[k] = high[k] = corners[0][k];
        for (int i = 1; i < count; i++) {
            low[k] = corners[i][k] < low[k] ? corners[i][k] : low[k];
            high[k] = corners[i][k] > high[k] ? corners[i][k] : high[k];
        }
    }
}

/* Floor, clamped to 0 .. count - 1. */
static uint32_t clamp_floor(double v, uint32_t count)
{
    return !(v >= 1) ? 0 : v >= count ? count - 1 : (uint32_t)v;
}

/* Marks all cells that may contain look-ups of a box's points. reach: greatest distance in voxels
 * by which the bias moves a point. */
static void mark_box(const struct umbb_static *rule, const double low[3], const double high[3],
                     const double reach[3], uint64_t *cells)
{
    const uint32_t across = 1U << UMB__RECEIVER_MASK_LOG2;
    const double cell = (double)rule->casters->size / across;
    uint32_t first[3], last[3];
    for (int k = 0; k < 3; k++) {
        first[k] = clamp_floor((low[k] - reach[k]) / cell, across);
        last[k] = clamp_floor((high[k] + (k < 2 ? reach[k] : 1)) / cell, across);
    }
    const uint64_t row = UINT64_MAX << first[0] & UINT64_MAX >> (across - 1 - last[0]);
    for (uint32_t z = first[2]; z <= last[2]; z++) {
        for (uint32_t y = first[1]; y <= last[1]; y++) {
            cells[umb__receiver_mask_word(y, z)] |= row;
        }
    }
}

/* Marks the cells that may contain look-ups of a triangle's points. */
static void mark_cells(const struct umbb_static *rule, const double corners[3][3], uint64_t *cells)
{
    const uint32_t across = 1U << UMB__RECEIVER_MASK_LOG2;
    const double cell = (double)rule->casters->size / across;
    double low[3], high[3], n[3];
    bounds_of(corners, 3, low, high);
    umb__triangle_cross(corners, n);
    const double reach[3] = {rule->reach[0], rule->reach[1], find_lift(rule, n)};
    if (high[0] - low[0] <= cell && high[1] - low[1] <= cell && high[2] - low[2] <= cell) {
        mark_box(rule, low, high, reach, cells); /* cutting it into cells would hardly mark fewer */
        return;
    }
    const uint32_t x1 = clamp_floor((high[0] + reach[0]) / cell, across);
    const uint32_t y1 = clamp_floor((high[1] + reach[1]) / cell, across);
    for (uint32_t y = clamp_floor((low[1] - reach[1]) / cell, across); y <= y1; y++) {
        for (uint32_t x = clamp_floor((low[0] - reach[0]) / cell, across); x <= x1; x++) {
            struct polygon p = {.count = 3};
            double from[3], to[3];
            memcpy(p.at, corners, 3 * sizeof p.at[0]);
            cut(&p, 0, -1, x * cell - reach[0]);
            cut(&p, 0, 1, (x + 1) * cell + reach[0]);
            cut(&p, 1, -1, y * cell - reach[1]);
            cut(&p, 1, 1, (y + 1) * cell + reach[1]);
            if (p.count == 0) {
                continue;
            }
            bounds_of((const double(*)[3])p.at, p.count, from, to);
            const uint32_t last = clamp_floor((to[2] + 1) / cell, across);
            for (uint32_t z = clamp_floor((from[2] - reach[2]) / cell, across); z <= last; z++) {
                cells[umb__receiver_mask_word(y, z)] |= UINT64_C(1) << x;
            }
        }
    }
}

enum umb_status umbb_static_init(struct umbb_static *rule, const struct umbb_casters *casters,
                                 const struct umb_frustum_info *frustum, uint64_t *cells,
                                 struct umb_error *error)
{
    const double edge[3] = {umb__length(frustum->voxel_step[0]),
                            umb__length(frustum->voxel_step[1]),
                            umb__length(frustum->voxel_step[2])};
    *rule = (struct umbb_static){.casters = casters};
    set_reach(edge, rule);
    rule->met = calloc(casters->count + 1, sizeof *rule->met);
    rule->list = malloc((casters->count + 1) * sizeof *rule->list);
    if (rule->met == NULL || rule->list == NULL) {
        umbb_static_finish(rule);
        return umb_fail(error, UMB_E_NO_MEMORY, "static rule: memory for %zu triangles refused",
                        casters->count);
    }
    memset(cells, 0, UMB__RECEIVER_MASK_WORDS * sizeof *cells);
    for (size_t i = 0; i < casters->count; i++) {
        mark_cells(rule, casters->corners[i], cells);
    }
    return UMB_OK;
}

void umbb_static_finish(struct umbb_static *rule)
{
    free(rule->met);
    free(rule->list);
    memset(rule, 0, sizeof *rule);
}

/* 1 if a triangle's box, widened, meets the tile's square. */
static int is_near_tile(const double corners[3][3], const struct umbb_tile *tile, double x,
                        double y)
{
    double low[3], high[3];
    bounds_of(corners, 3, low, high);
    return high[0] + x >= tile->x0 && low[0] - x <= tile->x0 + tile->size &&
           high[1] + y >= tile->y0 && low[1] - y <= tile->y0 + tile->size;
}

/* lit of texel (x, y) of the tile. */
static int32_t lit_at(const struct umbb_tile *tile, int32_t x, int32_t y)
{
    const size_t at = umbb_tile_index(tile, x, y);
    return tile->min_end[UMB_LEVEL_BRICK][at / 64] >= tile->background ? tile->background
                                                                       : tile->lit[at];
}

/* Compares a row of texels with a triangle; returns MET_ flags. */
static uint8_t survey_row(const struct umbb_tile *tile, const struct umbb_coverage *coverage,
                          int32_t row)
{
    const double row_z = umbb_coverage_row_z(coverage, row);
    int32_t span[2];
    uint8_t met = 0;
    (void)umbb_coverage_row_within(coverage, row, tile->x0, tile->size, span);
    for (int32_t x = span[0]; x <= span[1] && (met & MET_SHADOW) == 0; x++) {
        const int32_t lit = umbb_coverage_lit(coverage, row_z, x);
        met |= lit > lit_at(tile, x - tile->x0, row - tile->y0) + 1 ? MET_SHADOW : MET_LIT;
    }
    return met;
}

struct survey {
    struct umbb_static *rule;
    const struct umbb_tile *tile;
    int (*cancelled)(void);
};

/* Surveys a share of the triangles, each of which belongs to one slice only. */
static void survey_job(void *user, uint32_t job, unsigned thread)
{
    const struct survey *survey = user;
    struct umbb_static *rule = survey->rule;
    const struct umbb_tile *tile = survey->tile;
    const struct umbb_casters *casters = rule->casters;
    const size_t first = (size_t)job * SURVEY_SHARE, left = casters->count - first;
    const size_t end = first + (left < SURVEY_SHARE ? left : SURVEY_SHARE);
    (void)thread;
    if (survey->cancelled != NULL && survey->cancelled()) {
        return;
    }
    for (size_t i = first; i < end; i++) {
        struct umbb_coverage coverage;
        if ((rule->met[i] & MET_SHADOW) != 0 || !is_near_tile(casters->corners[i], tile, 0, 0) ||
            !umbb_coverage_prepare(casters->corners[i], casters->size, &coverage)) {
            continue;
        }
        int32_t row, last;
        umbb_coverage_rows_within(&coverage, tile->y0, tile->size, &row, &last);
        for (; row <= last; row++) {
            rule->met[i] |= survey_row(tile, &coverage, row);
        }
        rule->met[i] = (rule->met[i] & MET_SHADOW) != 0 ? MET_SHADOW : rule->met[i];
    }
}

void umbb_static_survey(struct umbb_static *rule, const struct umbb_tile *tile,
                        struct umbu_threads *jobs, int (*cancelled)(void))
{
    struct survey survey = {rule, tile, cancelled};
    const size_t count = (rule->casters->count + SURVEY_SHARE - 1) / SURVEY_SHARE;
    umbu_threads_start(jobs, survey_job, &survey, (uint32_t)count);
    umbu_threads_wait(jobs, NULL, NULL);
}

void umbb_static_begin(struct umbb_static *rule, const struct umbb_tile *tile)
{
    const struct umbb_casters *casters = rule->casters;
    const double x = rule->reach[0] + WINDOW_HALF, y = rule->reach[1] + WINDOW_HALF;
    rule->list_count = 0;
    for (size_t i = 0; i < casters->count; i++) {
        if (rule->met[i] != MET_LIT && is_near_tile(casters->corners[i], tile, x, y)) {
            rule->list[rule->list_count++] = (uint32_t)i;
        }
    }
}

/* An asked triangle, prepared for tests at texels. */
struct asked {
    double low[3], high[3];
    double anchor[3];   /* one of its corners */
    double gradient[2]; /* gradient of its depth */
    int is_vertical;    /* 1: seen edge on, no gradient */
    double lift;        /* greatest distance in voxels by which the triangle's points move towards
                           the light */
};

static void asked_init(struct asked *asked, const struct umbb_static *rule,
                       const double corners[3][3])
{
    double n[3];
    bounds_of(corners, 3, asked->low, asked->high);
    memcpy(asked->anchor, corners[0], sizeof asked->anchor);
    umb__triangle_cross(corners, n);
    asked->is_vertical = !(fabs(n[2]) > VERTICAL * umb__length(n));
    asked->gradient[0] = asked->is_vertical ? 0 : -n[0] / n[2];
    asked->gradient[1] = asked->is_vertical ? 0 : -n[1] / n[2];
    asked->lift = find_lift(rule, n);
}

/*
 * Computes the range of depths of the windows that belong to the triangle's points and read texel
 * centre (x, y). Returns 0 if there are no such windows.
 */
static int window_depths(const struct asked *asked, const double reach[3], const double centre[2],
                         double *least, double *most)
{
    double low = asked->anchor[2], high = low, plane = low;
    for (int k = 0; k < 2; k++) {
        double from = centre[k] - reach[k] - WINDOW_HALF, to = centre[k] + reach[k] + WINDOW_HALF;
        from = from > asked->low[k] ? from : asked->low[k];
        to = to < asked->high[k] ? to : asked->high[k];
        if (from > to) {
            return 0;
        }
        const double g = asked->gradient[k];
        low += g * ((g > 0 ? from : to) - asked->anchor[k]);
        high += g * ((g > 0 ? to : from) - asked->anchor[k]);
        plane += g * (centre[k] - asked->anchor[k]);
    }
    if (asked->is_vertical) {
        *least = asked->low[2] - asked->lift;
        *most = asked->high[2];
        return 1;
    }
    /* The corners of the box may lie far off the triangle, where the depth of a steep plane has no
     * limit. */
    low = low < asked->high[2] ? low : asked->high[2];
    *least = (low > asked->low[2] ? low : asked->low[2]) - asked->lift;
    *most = high < asked->high[2] ? high : asked->high[2];
    *most = *most < plane - 0.5 ? *most : plane - 0.5;
    return 1;
}

/* The texels of a band: rows y0 .. y0 + UMBB_STATIC_BAND - 1 of a tile. */
struct band {
    struct umbb_tile *tile;
    const int32_t *before; /* [texels] the former `end` */
    int32_t y0;
};

/* Finds the first and last of the numbers start .. start + count - 1 within low..high. first >
 * last: there are none. */
static void whole_range(double low, double high, int32_t start, int32_t count, int32_t *first,
                        int32_t *last)
{
    const double from = floor(low) - start, to = ceil(high) - start;
    *first = from > 0 ? (from < count ? (int32_t)from : count) : 0;
    *last = to < count - 1 ? (to >= 0 ? (int32_t)to : -1) : count - 1;
}

/* Lowers `end` to the voxels that a triangle's windows may read. */
static void ask(const struct umbb_static *rule, const struct band *band, uint32_t triangle)
{
    struct umbb_tile *tile = band->tile;
    struct asked asked;
    int32_t x0, x1, y0, y1;
    const double x = rule->reach[0] + WINDOW_HALF, y = rule->reach[1] + WINDOW_HALF;
    asked_init(&asked, rule, rule->casters->corners[triangle]);
    whole_range(asked.low[1] - y, asked.high[1] + y, tile->y0 + band->y0, UMBB_STATIC_BAND, &y0,
                &y1);
    whole_range(asked.low[0] - x, asked.high[0] + x, tile->x0, tile->size, &x0, &x1);
    const size_t start = umbb_tile_index(tile, 0, band->y0);
    for (int32_t j = y0; j <= y1; j++) {
        for (int32_t i = x0; i <= x1; i++) {
            const size_t at = umbb_tile_index(tile, i, band->y0 + j);
            const int32_t before = band->before[at - start];
            const double centre[2] = {tile->x0 + i + 0.5, tile->y0 + band->y0 + j + 0.5};
            double least, most;
            if (tile->end[at] <= before ||
                !window_depths(&asked, rule->reach, centre, &least, &most) || most < before) {
                continue;
            }
            const int32_t end = least < before ? before : (int32_t)least;
            tile->end[at] = end < tile->end[at] ? end : tile->end[at];
        }
    }
}

/* Writes the texels of blocks that the pyramid marks as background. */
static void fill_background(struct umbb_tile *tile, size_t from, size_t to)
{
    for (size_t block = from / 64; block < to / 64; block++) {
        if (tile->min_end[UMB_LEVEL_BRICK][block] < tile->background) {
            continue;
        }
        for (size_t i = block * 64; i < (block + 1) * 64; i++) {
            tile->lit[i] = tile->end[i] = tile->background;
        }
    }
}

int umbb_static_band(const struct umbb_static *rule, struct umbb_tile *tile, uint32_t number)
{
    const size_t count = (size_t)tile->size * UMBB_STATIC_BAND, start = number * count;
    int32_t *before = malloc(count * sizeof *before);
    if (before == NULL) {
        return 0;
    }
    const struct band band = {tile, before, (int32_t)number * UMBB_STATIC_BAND};
    fill_background(tile, start, start + count);
    memcpy(before, tile->end + start, count * sizeof *before);
    for (size_t i = start; i < start + count; i++) {
        tile->end[i] = tile->background;
    }
    for (size_t i = 0; i < rule->list_count; i++) {
        ask(rule, &band, rule->list[i]);
    }
    free(before);
    for (int32_t x = 0; x < tile->size >> 3; x += UMBB_STATIC_BAND >> 3) {
        umbb_tile_reduce(tile, x, band.y0 >> 3, UMBB_STATIC_BAND >> 3);
    }
    return 1;
}
