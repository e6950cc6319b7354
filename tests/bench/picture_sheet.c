/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Joins pictures of one size into a sheet, each under its name:
 *
 *     picture_sheet OUT.png COLUMNS NAME=FILE.png...
 *
 * An empty NAME labels nothing. Exit 0: written; 1: a file cannot be used; 2: called wrongly.
 */
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study/picture_text.h"

enum {
    GAP = 4,
    TITLE = UMBT_LABEL_HEIGHT + 1,
    COLUMNS_MAX = 8,
};

static int picture_read(const char *path, struct umbt_picture *picture)
{
    png_image image = {.version = PNG_IMAGE_VERSION};
    if (!png_image_begin_read_from_file(&image, path)) {
        (void)fprintf(stderr, "picture_sheet: %s: %s\n", path, image.message);
        return 0;
    }
    image.format = PNG_FORMAT_RGB;
    if (umbt_picture_init(picture, image.width, image.height, NULL) != UMB_OK ||
        !png_image_finish_read(&image, NULL, picture->pixels, 0, NULL)) {
        (void)fprintf(stderr, "picture_sheet: %s: %s\n", path, image.message);
        png_image_free(&image);
        return 0;
    }
    return 1;
}

/* Puts picture number `i` into the sheet, which the first picture makes. */
static int tile_put(struct umbt_picture *sheet, int i, int count, int columns, const char *argument)
{
    struct umbt_picture picture = {0};
    char name[64];
    const char *file = strchr(argument, '=');
    if (file == NULL || !picture_read(file + 1, &picture)) {
        umbt_picture_finish(&picture);
        return 0;
    }
    (void)snprintf(name, sizeof name, "%.*s", (int)(file - argument), argument);
    const uint32_t width = picture.width + GAP, height = picture.height + TITLE + GAP;
    const uint32_t rows = (uint32_t)((count + columns - 1) / columns);
    int good = 1;
    if (i == 0) {
        good = umbt_picture_init(sheet, (uint32_t)columns * width - GAP, rows * height - GAP,
                                 NULL) == UMB_OK;
        memset(sheet->pixels, 255, good ? (size_t)3 * sheet->width * sheet->height : 0);
    }
    const uint32_t x = (uint32_t)(i % columns) * width, y = (uint32_t)(i / columns) * height;
    good = good && x + picture.width <= sheet->width && y + TITLE + picture.height <= sheet->height;
    for (uint32_t row = 0; good && row < picture.height; row++) {
        memcpy(&sheet->pixels[3 * ((size_t)(y + TITLE + row) * sheet->width + x)],
               &picture.pixels[3 * (size_t)row * picture.width], (size_t)3 * picture.width);
    }
    if (good) {
        umbt_label_draw(sheet, x, y, 1, name);
    } else {
        (void)fprintf(stderr, "picture_sheet: %s: of another size, or no memory\n", file + 1);
    }
    umbt_picture_finish(&picture);
    return good;
}

int main(int argc, char **argv)
{
    struct umbt_picture sheet = {0};
    struct umb_error error = {0};
    const long columns = argc > 3 ? strtol(argv[2], NULL, 10) : 0;
    if (columns < 1 || columns > COLUMNS_MAX) {
        (void)fputs("usage: picture_sheet OUT.png COLUMNS NAME=FILE.png...\n", stderr);
        return 2;
    }
    int good = 1;
    for (int i = 3; i < argc && good; i++) {
        good = tile_put(&sheet, i - 3, argc - 3, (int)columns, argv[i]);
    }
    if (good && umbt_picture_write(&sheet, argv[1], &error) != UMB_OK) {
        (void)fprintf(stderr, "picture_sheet: %s\n", error.message);
        good = 0;
    }
    umbt_picture_finish(&sheet);
    return !good;
}
