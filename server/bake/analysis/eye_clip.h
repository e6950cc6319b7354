/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_EYE_CLIP_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_EYE_CLIP_H
/*
 * Cutting triangles to the pyramid that a spot or point light sees, before the division by the
 * distance: Sutherland and Hodgman 1974, in homogeneous coordinates (X, Y, W).
 *
 * Watertight: two triangles cut a shared edge at the same point, bit for bit, since a cut always
 * goes from the end inside to the end outside.
 */
#include <stddef.h>

#define UMBB_CLIP_CORNERS_MAX 8 /* a triangle and five planes */

/* A pyramid: X within low[0] W .. high[0] W, Y within low[1] W .. high[1] W, W at least near. */
struct umbb_pyramid {
    double low[2], high[2];
    double near;
};

/* A convex polygon; empty if it has fewer than three corners. */
struct umbb_polygon {
    size_t count;
    double corners[UMBB_CLIP_CORNERS_MAX][3]; /* X, Y, W */
};

/* Cuts a triangle. In: triangle: X, Y, W of its corners. */
void umbb_eye_clip(const struct umbb_pyramid *pyramid, const double triangle[3][3],
                   struct umbb_polygon *polygon);

#endif
