/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_PICTURE_H
#define UMBRAGE_SERVER_STUDY_PICTURE_H
/*
 * 8-bit sRGB pictures, their PNG files, which appear whole or not at all, and their look: muted
 * surface colours, a warm sun by Lambert's law, a sky dome that tints ambient light cool from above
 * and warm from the ground, and a soft compression of highlights.
 *
 * Colours are linear RGB, 0..1 once displayed.
 */
#include <stdint.h>
#include "umbrage/status.h"

struct umbt_picture {
    uint32_t width, height; /* 1..16384 each */
    uint8_t *pixels;        /* uint8[height][width][3], sRGB, top row first */
};

/* Makes a black picture. Fails: E_NO_MEMORY. Owns: umbt_picture_finish. */
UMB_CHECKED enum umb_status umbt_picture_init(struct umbt_picture *picture, uint32_t width,
                                              uint32_t height, struct umb_error *error);
void umbt_picture_finish(struct umbt_picture *picture); /* a zeroed struct is allowed */

/* Writes a PNG, replacing path atomically. Fails: E_NO_MEMORY, E_INTERNAL (libpng),
 * E_CANNOT_CREATE, E_IO. */
UMB_CHECKED enum umb_status umbt_picture_write(const struct umbt_picture *picture, const char *path,
                                               struct umb_error *error);

struct umbt_rgb {
    double c[3];
};

/* Returns the surface colour of a group of triangles (a material or a part). Equal keys give equal
 * colours. */
struct umbt_rgb umbt_surface_color(uint32_t key);

/*
 * Returns the light that leaves a surface, before highlights are compressed (umbt_shoulder).
 *
 * In: light: light of each colour that reaches the surface; 1 = that of a sun right above it.
 *     upward: vertical component of the normal, -1..1.
 */
struct umbt_rgb umbt_shade_light(struct umbt_rgb surface, const double light[3], double upward);

/* Does umbt_shade_light for one white sun. visibility: visible share of the sun, 0..1. cosine: of
 * the angle to the sun; below 0 counts as 0. */
struct umbt_rgb umbt_shade(struct umbt_rgb surface, double visibility, double cosine,
                           double upward);

/* A colour seen through fog; through, lit: results of umbt_fog_look. */
struct umbt_rgb umbt_fog_shade(struct umbt_rgb color, double through, double lit);

/* Returns the sky behind the scene. upward: vertical component of the unit view direction. */
struct umbt_rgb umbt_sky(double upward);

/* Compresses highlights: 0 stays 0, the slope there is 1, and 1 is never reached. */
double umbt_shoulder(double linear);

/* Encodes one linear value (clamped to 0..1) as 8-bit sRGB. Source: IEC 61966-2-1. */
uint8_t umbt_srgb8(double linear);

/* Does umbt_srgb8, but rounds up where the fraction is at least 1 - threshold. With thresholds of
 * umbt_dither a slow gradient, such as the sky, has no bands. */
uint8_t umbt_srgb8_dithered(double linear, double threshold);

/* Returns the threshold of a pixel, above 0 and below 1: an ordered pattern of 8 x 8 (Bayer 1973).
 */
double umbt_dither(uint32_t x, uint32_t y);

#endif
