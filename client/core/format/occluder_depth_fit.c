/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Fits a plane (c + a x + b y) / one whose height, rounded down, is `lit` at every texel. Let e =
 * lit * one - a x - b y at a texel. For slopes a and b such a plane exists if the spread, max e -
 * min e, is below `one`; c = max e then gives it. The slopes start at those of least squares. While
 * the spread is slightly too large, the slopes are turned so that the e of the two extreme texels
 * come closer (relaxation of linear inequalities). If that fails, c = max e keeps the rounded plane
 * at or above every texel, and residuals count down from it.
 * Source: Agmon 1954, Motzkin and Schoenberg 1954 (relaxation).
 */
#include "format/occluder_depth_fit.h"

#include <math.h>

#define SLOPE_MAX   1024 /* Voxels a texel: the c of planes of 8x8 texels then fits 32 bits */
#define TURNS       16   /* Most turns of the slopes: twice as many save 0.5 % of the bytes */
#define NEAR_SPREAD 4    /* Spread in voxels beyond which the texels are not planar */

static int64_t slope_of(double value, int64_t one)
{
    const double most = (double)SLOPE_MAX;
    const double kept = value > most ? most : value < -most ? -most : value;
    return (int64_t)floor(kept * (double)one + 0.5);
}

/* Computes the slopes of least squares. The sums are exact. */
static struct umb__plane least_squares(const struct umb__texels *t)
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
    struct umb__plane plane = {0};
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

/* Computes c and the spread of a plane. Out: high, low: the texels of the greatest and least e. */
static void measure(const struct umb__texels *t, struct umb__plane *plane, uint32_t *high,
                    uint32_t *low)
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

void umb__plane_measure(const struct umb__texels *texels, struct umb__plane *plane)
{
    uint32_t high, low;
    measure(texels, plane, &high, &low);
}

void umb__plane_turn(const struct umb__texels *texels, struct umb__plane *plane)
{
    uint32_t high = 0, low = 0;
    struct umb__plane at = *plane;
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

struct umb__plane umb__plane_fit(const struct umb__texels *texels)
{
    struct umb__plane plane = least_squares(texels);
    umb__plane_turn(texels, &plane);
    return plane;
}
