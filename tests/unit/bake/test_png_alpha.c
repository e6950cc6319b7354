/* SPDX-License-Identifier: Apache-2.0 */
/* Alpha channels of PNG files: every form of file, and hostile files. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bake/import/texture_table.h"
#include "make_png.h"

enum {
    WIDTH = 13,
    HEIGHT = 7,
};

/* Returns the alpha that a texel has in these files, in 16 steps. */
static uint8_t step_at(uint32_t x, uint32_t y)
{
    return (uint8_t)((5 * x + 3 * y) % 16);
}

/* Decodes, and compares with 17 times step_at. */
static void expect_steps(const struct made_png *made, int luminance)
{
    struct umbb_alpha_image image;
    struct umb_error error = {0};
    assert_int_equal(
        umbb_png_alpha(made->bytes, made->size, UMBB_IMAGE_TEXELS_MAX, luminance, &image, &error),
        UMB_OK);
    assert_int_equal(image.width, WIDTH);
    assert_int_equal(image.height, HEIGHT);
    assert_non_null(image.texels);
    for (uint32_t y = 0; y < HEIGHT; y++) {
        for (uint32_t x = 0; x < WIDTH; x++) { /* the lowest row of the image comes first */
            assert_int_equal(image.texels[(HEIGHT - 1 - y) * WIDTH + x], 17 * step_at(x, y));
        }
    }
    free(image.texels);
}

/* Returns one value of a texel, packed as a form of file requires. */
static void put_value(unsigned char *row, const struct png_form *form, uint32_t x, unsigned step)
{
    const unsigned bytes = form->depth == 16 ? 2 : 1;
    const unsigned channels = form->color == PNG_COLOR_TYPE_RGB_ALPHA    ? 4
                              : form->color == PNG_COLOR_TYPE_GRAY_ALPHA ? 2
                              : form->color == PNG_COLOR_TYPE_RGB        ? 3
                                                                         : 1;
    if (form->depth == 4) {
        row[x / 2] = (unsigned char)(row[x / 2] | step << (x % 2 == 0 ? 4 : 0));
        return;
    }
    const unsigned value = form->color == PNG_COLOR_TYPE_PALETTE ? step : 17 * step;
    const unsigned channel = channels == 3 ? 1 : channels - 1;
    memset(row + (size_t)x * channels * bytes, (int)value, bytes);
    memset(row + ((size_t)x * channels + channel) * bytes, (int)value, bytes);
}

static struct made_png make_steps(const struct png_form *form)
{
    static unsigned char pixels[HEIGHT][WIDTH * 8];
    unsigned char *rows[HEIGHT];
    memset(pixels, 0, sizeof pixels);
    for (uint32_t y = 0; y < HEIGHT; y++) {
        rows[y] = pixels[y];
        for (uint32_t x = 0; x < WIDTH; x++) {
            put_value(rows[y], form, x, step_at(x, y));
        }
    }
    return make_png(WIDTH, HEIGHT, form, rows);
}

static void every_form_of_alpha_is_read(void **state)
{
    (void)state;
    static const struct png_form forms[] = {
        {PNG_COLOR_TYPE_RGB_ALPHA, 8, PNG_INTERLACE_NONE, 0},
        {PNG_COLOR_TYPE_RGB_ALPHA, 16, PNG_INTERLACE_NONE, 0},
        {PNG_COLOR_TYPE_RGB_ALPHA, 8, PNG_INTERLACE_ADAM7, 0},
        {PNG_COLOR_TYPE_GRAY_ALPHA, 8, PNG_INTERLACE_NONE, 0},
        {PNG_COLOR_TYPE_GRAY_ALPHA, 16, PNG_INTERLACE_ADAM7, 0},
        {PNG_COLOR_TYPE_PALETTE, 8, PNG_INTERLACE_NONE, 16},
        {PNG_COLOR_TYPE_PALETTE, 4, PNG_INTERLACE_ADAM7, 16},
    };
    for (size_t i = 0; i < sizeof forms / sizeof forms[0]; i++) {
        struct made_png made = make_steps(&forms[i]);
        expect_steps(&made, 0);
        expect_steps(&made, 1);
        free(made.bytes);
    }
}

static void images_without_alpha_have_none_or_their_grey(void **state)
{
    (void)state;
    static const struct png_form forms[] = {
        {PNG_COLOR_TYPE_GRAY, 8, PNG_INTERLACE_NONE, 0},
        {PNG_COLOR_TYPE_GRAY, 4, PNG_INTERLACE_NONE, 0},
        {PNG_COLOR_TYPE_RGB, 8, PNG_INTERLACE_NONE, 0},
    };
    for (size_t i = 0; i < sizeof forms / sizeof forms[0]; i++) {
        struct umbb_alpha_image image;
        struct made_png made = make_steps(&forms[i]);
        expect_steps(&made, 1);
        assert_int_equal(
            umbb_png_alpha(made.bytes, made.size, UMBB_IMAGE_TEXELS_MAX, 0, &image, NULL), UMB_OK);
        assert_null(image.texels);
        free(made.bytes);
    }
}

/* Changes the width and height in a header, and makes its checksum right. */
static void set_sides(const struct made_png *made, uint32_t width, uint32_t height)
{
    unsigned long crc = 0xffffffffUL;
    for (int i = 0; i < 4; i++) {
        made->bytes[16 + i] = (unsigned char)(width >> (24 - 8 * i));
        made->bytes[20 + i] = (unsigned char)(height >> (24 - 8 * i));
    }
    for (size_t i = 12; i < 29; i++) {
        crc ^= made->bytes[i];
        for (int k = 0; k < 8; k++) {
            crc = crc & 1 ? crc >> 1 ^ 0xedb88320UL : crc >> 1;
        }
    }
    crc ^= 0xffffffffUL;
    for (int i = 0; i < 4; i++) {
        made->bytes[29 + i] = (unsigned char)(crc >> (24 - 8 * i));
    }
}

static void images_over_the_limit_are_refused_before_they_are_decoded(void **state)
{
    (void)state;
    const struct png_form form = {PNG_COLOR_TYPE_RGB_ALPHA, 8, PNG_INTERLACE_NONE, 0};
    struct made_png made = make_steps(&form);
    struct umbb_alpha_image image;
    struct umb_error error = {0};
    assert_int_equal(umbb_png_alpha(made.bytes, made.size, WIDTH * HEIGHT - 1, 0, &image, &error),
                     UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "13 x 7 texels, limit 90"));
    static const struct {
        uint32_t width, height;
        const char *why;
    } sides[] = {
        {40000, 40000, "40000 x 40000 texels, limit 268435456"},
        {65537, 1, "65537 x 1 texels, limit 65536 a side"},
        {1, 70000, "1 x 70000 texels, limit 65536 a side"},
        {2147483647, 2147483647, "2147483647 x 2147483647 texels, limit 268435456"},
    };
    for (size_t i = 0; i < sizeof sides / sizeof sides[0]; i++) {
        set_sides(&made, sides[i].width, sides[i].height);
        assert_int_equal(
            umbb_png_alpha(made.bytes, made.size, UMBB_IMAGE_TEXELS_MAX, 0, &image, &error),
            UMB_E_LIMIT);
        assert_non_null(strstr(error.message, sides[i].why));
        assert_null(image.texels);
    }
    free(made.bytes);
}

/* One PNG may hold a thousand texts, each of kilobytes that expand to megabytes. */
static void compressed_texts_are_not_expanded(void **state)
{
    (void)state;
    enum {
        BEFORE = 33, /* signature and IHDR */
        TEXTS = 60,
        TEXT_BYTES = 7900000,
    };
    struct made_png made = {NULL, 0, 0};
    char key[] = "k", *text = malloc(TEXT_BYTES);
    assert_non_null(text);
    memset(text, 'a', TEXT_BYTES);
    text[TEXT_BYTES - 1] = '\0';
    png_text entry = {.compression = PNG_TEXT_COMPRESSION_zTXt, .key = key, .text = text};
    entry.text_length = TEXT_BYTES - 1;
    unsigned char row[4] = {0, 0, 0, 9};
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    assert_non_null(info);
    png_set_write_fn(png, &made, made_png_append, made_png_flush);
    png_set_IHDR(png, info, 1, 1, 8, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_text(png, info, &entry, 1);
    png_write_info(png, info);
    png_write_row(png, row);
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    free(text);
    assert_memory_equal(made.bytes + BEFORE + 4, "zTXt", 4);
    const unsigned char *length = made.bytes + BEFORE;
    const size_t chunk = 12 + ((size_t)length[1] << 16 | (size_t)length[2] << 8 | length[3]);
    const size_t size = made.size + (TEXTS - 1) * chunk;
    unsigned char *bytes = malloc(size);
    assert_non_null(bytes);
    memcpy(bytes, made.bytes, BEFORE);
    for (size_t i = 0; i < TEXTS; i++) {
        memcpy(bytes + BEFORE + i * chunk, made.bytes + BEFORE, chunk);
    }
    memcpy(bytes + BEFORE + TEXTS * chunk, made.bytes + BEFORE + chunk, made.size - BEFORE - chunk);
    struct umbb_alpha_image image;
    struct umb_error error = {0};
    const clock_t start = clock();
    assert_int_equal(umbb_png_alpha(bytes, size, 1, 0, &image, &error), UMB_OK);
    assert_true(clock() - start < CLOCKS_PER_SEC / 2); /* expanded they take 2 seconds */
    assert_int_equal(image.texels[0], 9);
    free(image.texels);
    free(bytes);
    free(made.bytes);
}

/* Decodes a copy in a block of exactly its size. */
static void decode_block(const unsigned char *bytes, size_t size)
{
    struct umbb_alpha_image image;
    struct umb_error error = {0};
    unsigned char *block = malloc(size > 0 ? size : 1);
    assert_non_null(block);
    memcpy(block, bytes, size);
    const enum umb_status status = umbb_png_alpha(block, size, 1 << 20, 0, &image, &error);
    assert_true(status == UMB_OK || status == UMB_E_BAD_SCENE || status == UMB_E_LIMIT);
    assert_true(status == UMB_OK || (image.texels == NULL && error.message[0] != '\0'));
    free(image.texels);
    free(block);
}

static void every_prefix_and_every_flipped_bit_is_survived(void **state)
{
    (void)state;
    static const struct png_form forms[] = {
        {PNG_COLOR_TYPE_RGB_ALPHA, 8, PNG_INTERLACE_ADAM7, 0},
        {PNG_COLOR_TYPE_PALETTE, 4, PNG_INTERLACE_NONE, 16},
    };
    for (size_t i = 0; i < sizeof forms / sizeof forms[0]; i++) {
        struct made_png made = make_steps(&forms[i]);
        for (size_t size = 0; size < made.size; size++) {
            decode_block(made.bytes, size);
        }
        for (size_t bit = 0; bit < 8 * made.size; bit++) {
            made.bytes[bit / 8] ^= (unsigned char)(1U << bit % 8);
            decode_block(made.bytes, made.size);
            made.bytes[bit / 8] ^= (unsigned char)(1U << bit % 8);
        }
        free(made.bytes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_form_of_alpha_is_read),
        cmocka_unit_test(compressed_texts_are_not_expanded),
        cmocka_unit_test(images_without_alpha_have_none_or_their_grey),
        cmocka_unit_test(images_over_the_limit_are_refused_before_they_are_decoded),
        cmocka_unit_test(every_prefix_and_every_flipped_bit_is_survived),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
