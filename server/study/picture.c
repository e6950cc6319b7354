/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pictures and their look; see picture.h. libpng's simplified interface encodes into memory: it
 * needs no longjmp, and the file is written in one step.
 */
#include "study/picture.h"

#include <math.h>
#include <png.h>
#include <stdlib.h>
#include <string.h>
#include "tool/output.h"

enum umb_status umbt_picture_init(struct umbt_picture *picture, uint32_t width, uint32_t height,
                                  struct umb_error *error)
{
    memset(picture, 0, sizeof *picture);
    picture->pixels = calloc((size_t)width * height, 3);
    if (picture->pixels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a picture of %ux%u pixels does not fit in memory",
                        width, height);
    }
    picture->width = width;
    picture->height = height;
    return UMB_OK;
}

void umbt_picture_finish(struct umbt_picture *picture)
{
    free(picture->pixels);
    memset(picture, 0, sizeof *picture);
}

enum umb_status umbt_picture_write(const struct umbt_picture *picture, const char *path,
                                   struct umb_error *error)
{
    png_image image;
    memset(&image, 0, sizeof image);
    image.version = PNG_IMAGE_VERSION;
    image.width = picture->width;
    image.height = picture->height;
    image.format = PNG_FORMAT_RGB;
    png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
    void *bytes = malloc(size);
    if (bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%s: %zu bytes for encoding do not fit in memory",
                        path, (size_t)size);
    }
    enum umb_status status = UMB_OK;
    if (!png_image_write_to_memory(&image, bytes, &size, 0, picture->pixels, 0, NULL)) {
        status = umb_fail(error, UMB_E_INTERNAL, "%s: libpng: %s", path, image.message);
    }
    png_image_free(&image);
    if (status == UMB_OK) {
        status = umbu_output_replace(path, UMBU_OUTPUT_COMMAND, bytes, size, error);
    }
    free(bytes);
    return status;
}

/* ---- the look; its constants were chosen by eye on the scenes ---- */

static const struct umbt_rgb palette[] = {
    {{0.52, 0.48, 0.42}}, /* limestone */
    {{0.47, 0.40, 0.33}}, /* sandstone */
    {{0.40, 0.44, 0.40}}, /* lichen */
    {{0.45, 0.46, 0.50}}, /* slate */
    {{0.50, 0.38, 0.31}}, /* brick, faded */
    {{0.54, 0.52, 0.48}}, /* plaster */
    {{0.37, 0.41, 0.46}}, /* lead */
    {{0.48, 0.46, 0.36}}, /* straw */
    {{0.43, 0.39, 0.39}}, /* porphyry */
    {{0.41, 0.45, 0.35}}, /* olive */
};

#define PALETTE_COUNT ((uint32_t)(sizeof palette / sizeof palette[0]))

static const struct umbt_rgb sun_color = {{1.16, 1.06, 0.90}};
static const struct umbt_rgb sky_light = {{0.24, 0.29, 0.38}};
static const struct umbt_rgb ground_light = {{0.21, 0.19, 0.16}};
static const double fog_sun = 0.8; /* share of the sun's colour that sunlit fog sends to the eye */
static const double fog_shade = 0.2; /* share of the ambient light that all fog sends */
static const struct umbt_rgb sky_zenith = {{0.36, 0.52, 0.74}};
static const struct umbt_rgb sky_horizon = {{0.74, 0.80, 0.86}};
static const struct umbt_rgb sky_below = {{0.47, 0.52, 0.57}};

static struct umbt_rgb mix(struct umbt_rgb a, struct umbt_rgb b, double t)
{
    struct umbt_rgb out;
    for (int k = 0; k < 3; k++) {
        out.c[k] = a.c[k] + t * (b.c[k] - a.c[k]);
    }
    return out;
}

struct umbt_rgb umbt_surface_color(uint32_t key)
{
    if (key == 0) {
        return palette[0]; /* the main surface is limestone */
    }
    /* Knuth's multiplicative hash, so that neighbouring keys differ. */
    const uint32_t hash = key * 2654435761U;
    struct umbt_rgb color = palette[(hash >> 16) % PALETTE_COUNT];
    const double tone = 0.92 + 0.16 * (double)((hash >> 8) & 0xffU) / 255.0;
    for (int k = 0; k < 3; k++) {
        color.c[k] *= tone;
    }
    return color;
}

struct umbt_rgb umbt_shade_light(struct umbt_rgb surface, const double light[3], double upward)
{
    const struct umbt_rgb ambient = mix(ground_light, sky_light, 0.5 + 0.5 * upward);
    struct umbt_rgb out;
    for (int k = 0; k < 3; k++) {
        out.c[k] = surface.c[k] * (light[k] * sun_color.c[k] + ambient.c[k]);
    }
    return out;
}

struct umbt_rgb umbt_shade(struct umbt_rgb surface, double visibility, double cosine, double upward)
{
    const double sun = visibility * fmax(cosine, 0.0), light[3] = {sun, sun, sun};
    return umbt_shade_light(surface, light, upward);
}

struct umbt_rgb umbt_fog_shade(struct umbt_rgb color, double through, double lit)
{
    const struct umbt_rgb shade = mix(ground_light, sky_light, 0.5);
    for (int k = 0; k < 3; k++) {
        color.c[k] = through * color.c[k] + fog_sun * lit * sun_color.c[k] +
                     fog_shade * (1.0 - through) * shade.c[k];
    }
    return color;
}

struct umbt_rgb umbt_sky(double upward)
{
    if (upward < 0.0) {
        return mix(sky_horizon, sky_below, fmin(1.0, -1.2 * upward));
    }
    return mix(sky_horizon, sky_zenith, fmin(1.0, sqrt(upward)));
}

double umbt_shoulder(double linear)
{
    /* Straight up to the knee, then an exponential with the same slope. */
    const double knee = 0.55;
    if (linear <= knee) {
        return fmax(linear, 0.0);
    }
    return knee + (1.0 - knee) * (1.0 - exp(-(linear - knee) / (1.0 - knee)));
}

uint8_t umbt_srgb8_dithered(double linear, double threshold)
{
    const double x = fmin(fmax(linear, 0.0), 1.0);
    const double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055;
    return (uint8_t)fmin(encoded * 255.0 + threshold, 255.0);
}

uint8_t umbt_srgb8(double linear)
{
    return umbt_srgb8_dithered(linear, 0.5);
}

double umbt_dither(uint32_t x, uint32_t y)
{
    uint32_t rank = 0;
    for (int bit = 0; bit < 3; bit++) {
        rank = rank << 2 | ((x ^ y) >> bit & 1U) << 1 | (y >> bit & 1U);
    }
    return ((double)rank + 0.5) / 64.0;
}
