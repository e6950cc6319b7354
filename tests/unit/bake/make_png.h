/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_UNIT_BAKE_MAKE_PNG_H
#define UMBRAGE_TESTS_UNIT_BAKE_MAKE_PNG_H
/* PNG files for tests, in every form that can hold an alpha channel. Include after cmocka.h. */
#include <png.h>
#include <stdlib.h>
#include <string.h>

struct made_png {
    unsigned char *bytes;
    size_t size, capacity;
};

static inline void made_png_append(png_structp png, png_bytep data, size_t count)
{
    struct made_png *made = png_get_io_ptr(png);
    if (made->size + count > made->capacity) {
        made->capacity = 2 * (made->size + count);
        made->bytes = realloc(made->bytes, made->capacity);
        assert_non_null(made->bytes);
    }
    memcpy(made->bytes + made->size, data, count);
    made->size += count;
}

static inline void made_png_flush(png_structp png)
{
    (void)png;
}

struct png_form {
    int color, depth, interlace;
    int palette_alpha; /* entries of the palette: entry i is 17 i opaque */
};

/* Writes rows as they are: packed for the form, the highest first. Free bytes. */
static inline struct made_png make_png(uint32_t width, uint32_t height, const struct png_form *form,
                                       unsigned char **rows)
{
    struct made_png made = {NULL, 0, 0};
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    assert_non_null(info);
    png_set_write_fn(png, &made, made_png_append, made_png_flush);
    png_set_IHDR(png, info, width, height, form->depth, form->color, form->interlace,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (form->color == PNG_COLOR_TYPE_PALETTE) {
        png_color colors[16];
        png_byte alphas[16];
        memset(colors, 0, sizeof colors);
        for (int i = 0; i < 16; i++) {
            alphas[i] = (png_byte)(17 * i);
        }
        png_set_PLTE(png, info, colors, 16);
        png_set_tRNS(png, info, alphas, form->palette_alpha, NULL);
    }
    png_write_info(png, info);
    png_write_image(png, rows);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    return made;
}

/* An RGBA image with the given alpha, uint8[height][width], the highest row first. */
static inline struct made_png make_rgba_png(uint32_t width, uint32_t height, const uint8_t *alpha)
{
    const struct png_form form = {PNG_COLOR_TYPE_RGB_ALPHA, 8, PNG_INTERLACE_NONE, 0};
    unsigned char *pixels = calloc((size_t)width * height, 4);
    unsigned char **rows = calloc(height, sizeof *rows);
    assert_non_null(pixels);
    assert_non_null(rows);
    for (uint32_t y = 0; y < height; y++) {
        rows[y] = pixels + (size_t)4 * width * y;
        for (uint32_t x = 0; x < width; x++) {
            rows[y][4 * x + 3] = alpha[y * width + x];
        }
    }
    struct made_png made = make_png(width, height, &form, rows);
    free(rows);
    free(pixels);
    return made;
}

#endif
