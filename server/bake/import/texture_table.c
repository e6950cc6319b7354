/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Textures by image (texture_table.h). A scene has few, so the table is searched linearly.
 *
 * libpng leaves a function by longjmp when it finds damage. All that the decoder changes lives in
 * one struct behind a pointer, so none of it is in a register at that moment.
 */
#include "bake/import/texture_table.h"

#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"
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
    /* The argument -1 means: of the chunks that libpng knows, only IHDR, PLTE, tRNS, IDAT and IEND
     * are read. Compressed text of a few kilobytes would expand to megabytes, a thousand times in
     * one image. */
    png_set_keep_unknown_chunks(d->png, PNG_HANDLE_CHUNK_NEVER, NULL, -1);
    png_read_info(d->png, d->info);
}

/* Asks libpng for 8 bits a channel and for alpha. Allocates a row. Returns 0 if the image has no
 * such channel. */
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
                        : UMBB_REFUSE(error, "PNG: %s", d->why);
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
        image->texels = NULL;
    }
    return status;
}

/* A texture requested before. */
struct known {
    struct umbb_image image; /* owns its name, has no bytes */
    uint32_t index;
};

void umbb_texture_table_finish(struct umbb_texture_table *table)
{
    struct known *known = table->known.data;
    for (size_t i = 0; i < table->known.count; i++) {
        free((char *)(uintptr_t)known[i].image.name);
    }
    free(known);
    memset(table, 0, sizeof *table);
}

static int is_same(const struct umbb_image *a, const struct umbb_image *b)
{
    return a->name_length == b->name_length && a->is_embedded == b->is_embedded &&
           a->luminance == b->luminance && a->wrap_s == b->wrap_s && a->wrap_t == b->wrap_t &&
           a->nearest == b->nearest && memcmp(a->name, b->name, a->name_length) == 0;
}

static int is_jpeg(const unsigned char *bytes, size_t size)
{
    return size >= 3 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff;
}

static int is_png(const unsigned char *bytes, size_t size)
{
    return size >= 8 && png_sig_cmp(bytes, 0, 8) == 0;
}

static int is_opaque(const struct umbb_alpha_image *image)
{
    const size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        if (image->texels[i] != UINT8_MAX) {
            return 0;
        }
    }
    return 1;
}

/* Reads the alpha of an image in memory. Fails: the errors of umbb_png_alpha. */
static enum umb_status decode_image(struct umbb_texture_table *table,
                                    const struct umbb_image *image, const void *bytes, size_t size,
                                    struct umbb_alpha_image *alpha, struct umb_error *error)
{
    const uint64_t left = UMBB_IMAGES_TEXELS_MAX - table->texels;
    if (is_jpeg(bytes, size)) { /* has no alpha */
        return image->luminance ? UMBB_REFUSE(error, "a JPEG as map_d is not read") : UMB_OK;
    }
    if (!is_png(bytes, size)) {
        return UMBB_REFUSE(error, "is neither PNG nor JPEG");
    }
    const enum umb_status status =
        umbb_png_alpha(bytes, size, left < UMBB_IMAGE_TEXELS_MAX ? left : UMBB_IMAGE_TEXELS_MAX,
                       image->luminance, alpha, error);
    /* A damaged image counts too: it may take as long as a good one. */
    table->texels += (uint64_t)alpha->width * alpha->height;
    return status;
}

/* Reads the alpha of an image from memory or its file. */
static enum umb_status read_image(struct umbb_texture_table *table, const struct umbb_image *image,
                                  struct umbb_alpha_image *alpha, struct umb_error *error)
{
    struct umbb_file file;
    const struct umbb_cursor uri = {image->name, image->name + image->name_length};
    if (image->bytes != NULL) {
        return decode_image(table, image, image->bytes, image->size, alpha, error);
    }
    UMB__TRY(umbb_file_map_uri(table->job, uri, &file, error));
    const enum umb_status status = decode_image(table, image, file.bytes, file.size, alpha, error);
    umbb_file_unmap(&file);
    return status;
}

/* Adds an image to the scene, unless it is opaque all over. An image that cannot be used becomes a
 * warning; one over a limit is an error. */
static enum umb_status add_image(struct umbb_texture_table *table, const struct umbb_image *image,
                                 uint32_t *index, struct umb_error *error)
{
    struct umbs_scene_builder *scene = &table->job->scene;
    struct umbb_alpha_image alpha = {0};
    struct umb_error why = {0};
    struct umbs_texture texture = {
        .wrap_s = image->wrap_s, .wrap_t = image->wrap_t, .nearest = image->nearest};
    enum umb_status status = read_image(table, image, &alpha, &why);
    if (status == UMB_E_NO_MEMORY || status == UMB_E_LIMIT) {
        return umb_fail(error, status, "%s", why.message);
    }
    if (status != UMB_OK) {
        char name[100];
        umbs_text_clean(name, sizeof name, image->name, image->name_length);
        umbs_scene_warn(scene, "image '%s': %s; what shows it is taken as opaque", name,
                        why.message);
        return UMB_OK;
    }
    if (alpha.texels != NULL && !is_opaque(&alpha)) {
        umbs_text_clean(texture.name, sizeof texture.name, image->name, image->name_length);
        texture.width = alpha.width;
        texture.height = alpha.height;
        status = umbs_scene_add_texture(scene, &texture, alpha.texels, error);
        *index = status == UMB_OK ? (uint32_t)scene->textures.count - 1 : UMBS_NO_INDEX;
    }
    free(alpha.texels);
    return status;
}

int umbb_texture_find(const struct umbb_texture_table *table, const struct umbb_image *image,
                      uint32_t *index)
{
    const struct known *known = table->known.data;
    *index = UMBS_NO_INDEX;
    for (size_t i = 0; i < table->known.count; i++) {
        if (is_same(&known[i].image, image)) {
            *index = known[i].index;
            return 1;
        }
    }
    return 0;
}

enum umb_status umbb_texture_get(struct umbb_texture_table *table, const struct umbb_image *image,
                                 uint32_t *index, struct umb_error *error)
{
    if (umbb_texture_find(table, image, index)) {
        return UMB_OK;
    }
    if (table->known.count >= UMBB_IMAGES_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "more than %u images with alpha", UMBB_IMAGES_MAX);
    }
    struct known known = {.image = *image};
    char *name = malloc(image->name_length + 1);
    if (name == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a texture");
    }
    known.image.name = memcpy(name, image->name, image->name_length);
    known.image.bytes = NULL;
    enum umb_status status = add_image(table, image, index, error);
    if (status == UMB_OK) {
        known.index = *index;
        status = umbs_array_add(&table->known, &known, sizeof known, error);
    }
    if (status != UMB_OK) {
        free(name);
    }
    return status;
}
