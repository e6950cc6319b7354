/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_PNG_ALPHA_H
#define UMBRAGE_SERVER_BAKE_IMPORT_PNG_ALPHA_H
/*
 * The alpha channel of a PNG, by libpng: 8 bits a texel for every kind of file (palettes, colour
 * keys and 16 bits included). Colours, profiles and text are ignored.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

/* Limits of texels: of one image, and of all images of a scene together. */
#define UMBB_IMAGE_TEXELS_MAX  (UINT64_C(1) << 28)
#define UMBB_IMAGES_TEXELS_MAX (UINT64_C(1) << 30)

struct umbb_alpha_image {
    uint8_t *texels; /* uint8[height][width], the lowest row first; NULL: the image has no alpha */
    uint32_t width, height;
};

/* 1 if the bytes begin as a PNG does. */
int umbb_is_png(const void *bytes, size_t size);

/*
 * Decodes an image.
 *
 * In:    max_texels: limit of the image. luminance: 1: an image without alpha gives its grey, or
 *        its green, instead (the meaning of map_d).
 * Out:   image: free texels.
 * Fails: E_LIMIT (max_texels, sides), E_BAD_SCENE (damaged), E_NO_MEMORY.
 * Trust: safe on hostile bytes.
 * Cost:  memory for one row, for interlaced images all rows.
 */
UMB_CHECKED enum umb_status umbb_png_alpha(const void *bytes, size_t size, uint64_t max_texels,
                                           int luminance, struct umbb_alpha_image *image,
                                           struct umb_error *error);

#endif
