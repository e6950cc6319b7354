/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_OCCLUDER_DEPTH_FIT_H
#define UMBRAGE_CORE_FORMAT_OCCLUDER_DEPTH_FIT_H
/*
 * Planes through the depths of texels, in integers: equal texels give equal planes everywhere.
 *
 * A plane meets a texel if floor((c + a * x + b * y) / one) is its depth. A plane with c = the
 * greatest lit * one - a * x - b * y meets all texels of a set if its spread over them is below
 * `one`.
 */
#include <stdint.h>

/* A set of texels, 0 <= x, y < 64. */
struct umb__texels {
    int64_t one; /* Units of a plane's height for one voxel */
    uint32_t count;
    uint8_t x[4096], y[4096];
    int32_t lit[4096];
};

struct umb__plane {
    int64_t a, b; /* Slopes, at most 1024 voxels a texel */
    int64_t c;    /* Offset, so that no texel of the set lies above the plane */
    /* Greatest height of the plane above a texel of the set, before rounding down */
    int64_t spread;
};

static inline void umb__texels_add(struct umb__texels *texels, uint32_t x, uint32_t y, int32_t lit)
{
    texels->x[texels->count] = (uint8_t)x;
    texels->y[texels->count] = (uint8_t)y;
    texels->lit[texels->count++] = lit;
}

/* Fills in c and the spread for the plane's slopes. In: texels: at least one. */
void umb__plane_measure(const struct umb__texels *texels, struct umb__plane *plane);

/* Turns a plane that nearly meets the set until it meets the set, or until a few turns are done.
 * The result is then the best plane found. */
void umb__plane_turn(const struct umb__texels *texels, struct umb__plane *plane);

/* Fits a plane to the set by least squares, then turns it as umb__plane_turn does. */
struct umb__plane umb__plane_fit(const struct umb__texels *texels);

#endif
