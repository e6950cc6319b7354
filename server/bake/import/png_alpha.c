/* SPDX-License-Identifier: Apache-2.0 */
/*
 * libpng leaves a function by longjmp when it finds damage. All that it changes lives in one struct
 * behind a pointer, so none of it is in a register at that moment.
 */
#include "bake/import/texture_table.h"

#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_buffer.h"

#define CHUNK_BYTES_MAX 8000000U /* limit of an ancillary chunk that libpng may expand */

struct decoder {
    png_structp png;
    png_infop info;
    const unsigned char *bytes;
    size_t size, at;
    unsigned char *rows; /* one row, or all of an interlaced image */
    size_t row_bytes;
    int passes, channels, channel;
    char why[96];
    int no_memory;
};

int umbb_is_png(const void *bytes, size_t size)
{
    return size >= 8 && png_sig_cmp(bytes, 0, 8) == 0;
}

static void take_bytes(png_structp png, png_bytep to, size_t count)
{
    struct decoder *d = png_get_io_ptr(png);
    if (count > d->size - d->at) {
        png_error(png, "the file ends too early");
    }
    memcpy(to, d->bytes + d->at, count);
    d->at += count;
}

static void leave(png_structp png, png_const_charp message)
{
    struct decoder *d = png_get_error_ptr(png);
    size_t length = strnlen(message, sizeof d->why - 1);
    memcpy(d->why, message, length);
    d->why[length] = '\0';
    d->no_memory |= strstr(message, "emory") != NULL;
    png_longjmp(png, 1);
}

static void pass_over(png_structp png, png_const_charp message)
{
    (void)png;
    (void)message;
}

/* Reads everything before the texels. */
static void read_header(struct decoder *d)
{
    png_set_read_fn(d->png, d, take_bytes);
    /* decode checks the sides: its message tells a limit from damage. */
    png_set_user_limits(d->png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
    png_set_chunk_malloc_max(d->png, CHUNK_BYTES_MAX);
    png_set_keep_unknown_chunks(d->png, PNG_HANDLE_CHUNK_NEVER, NULL, 0);
    png_read_info(d->png, d->info);
}

/* Asks for 8 bits and alpha. Returns 0 if the image has no such channel. Allocates a row. */
static int begin(struct decoder *d, int luminance)
{
    const int kind = png_get_color_type(d->png, d->info);
    const int has_alpha =
        (kind & PNG_COLOR_MASK_ALPHA) != 0 || png_get_valid(d->png, d->info, PNG_INFO_tRNS) != 0;
    if (!has_alpha && !luminance) {
        return 0;
    }
    png_set_expand(d->png);
    png_set_scale_16(d->png);
    d->passes = png_set_interlace_handling(d->png);
    png_read_update_info(d->png, d->info);
    d->channels = png_get_channels(d->png, d->info);
    d->row_bytes = png_get_rowbytes(d->png, d->info);
    d->channel = has_alpha ? d->channels - 1 : d->channels >= 3 ? 1 : 0;
    return 1;
}

/* Copies the wanted channel out of a row of the file; row 0 is the highest. */
static void store_row(const struct decoder *d, const unsigned char *row, uint32_t y,
                      struct umbb_alpha_image *image)
{
    uint8_t *to = image->texels + (size_t)(image->height - 1 - y) * image->width;
    const size_t step = (size_t)d->channels;
    for (size_t x = 0; x < image->width; x++) {
        to[x] = row[x * step + (size_t)d->channel];
    }
}

static void read_rows(struct decoder *d, struct umbb_alpha_image *image)
{
    const size_t stride = d->passes > 1 ? d->row_bytes : 0;
    for (int pass = 0; pass < d->passes; pass++) {
        for (uint32_t y = 0; y < image->height; y++) {
            unsigned char *row = d->rows + y * stride;
            png_read_row(d->png, row, NULL);
            if (pass == d->passes - 1) {
                store_row(d, row, y, image);
            }
        }
    }
}

static enum umb_status refuse(const struct decoder *d, struct umb_error *error)
{
    return d->no_memory ? umb_fail(error, UMB_E_NO_MEMORY, "out of memory for an image")
                        : umb_fail(error, UMB_E_BAD_SCENE, "PNG: %s", d->why);
}

/* The part of decoding that may end in a longjmp. */
static enum umb_status decode(struct decoder *d, uint64_t max_texels, int luminance,
                              struct umbb_alpha_image *image, struct umb_error *error)
{
    if (setjmp(png_jmpbuf(d->png)) != 0) {
        return refuse(d, error);
    }
    read_header(d);
    image->width = png_get_image_width(d->png, d->info);
    image->height = png_get_image_height(d->png, d->info);
    const uint64_t texels = (uint64_t)image->width * image->height;
    if (texels > max_texels) {
        return umb_fail(error, UMB_E_LIMIT, "an image has %u x %u texels, limit %llu", image->width,
                        image->height, (unsigned long long)max_texels);
    }
    if (image->width > UMBS_TEXTURE_SIDE_MAX || image->height > UMBS_TEXTURE_SIDE_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "an image has %u x %u texels, limit %u a side",
                        image->width, image->height, UMBS_TEXTURE_SIDE_MAX);
    }
    if (!begin(d, luminance)) {
        return UMB_OK;
    }
    const uint64_t rows = d->passes > 1 ? image->height : 1;
    d->rows = calloc((size_t)rows, d->row_bytes); /* sides are at most 65536, texels 8 bytes */
    image->texels = malloc((size_t)texels);
    if (d->rows == NULL || image->texels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for an image");
    }
    read_rows(d, image);
    return UMB_OK;
}

enum umb_status umbb_png_alpha(const void *bytes, size_t size, uint64_t max_texels, int luminance,
                               struct umbb_alpha_image *image, struct umb_error *error)
{
    struct decoder d = {.bytes = bytes, .size = size, .why = "damaged"};
    memset(image, 0, sizeof *image);
    enum umb_status status = UMB_E_NO_MEMORY;
    d.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &d, leave, pass_over);
    d.info = d.png != NULL ? png_create_info_struct(d.png) : NULL;
    if (d.info != NULL) {
        status = decode(&d, max_texels, luminance, image, error);
    } else {
        (void)umb_fail(error, status, "out of memory for an image");
    }
    png_destroy_read_struct(&d.png, &d.info, NULL);
    free(d.rows);
    if (status != UMB_OK) {
        free(image->texels);
        memset(image, 0, sizeof *image);
    }
    return status;
}
