/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pictures and PNG files. libpng's simplified interface encodes into memory: it needs no longjmp,
 * and the file is written in one step.
 */
#include "study/picture.h"

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
