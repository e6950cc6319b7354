/* SPDX-License-Identifier: Apache-2.0 */
/* Textures by image (texture_table.h). A scene has few, so the table is searched linearly. */
#include "bake/import/texture_table.h"

#include <stdlib.h>
#include <string.h>

#include "common/clean_text.h"

/* A texture requested before. */
struct known {
    struct umbb_image image; /* owns its name, has no bytes */
    uint32_t index;
};

void umbb_texture_table_init(struct umbb_texture_table *table, struct umbb_import *job)
{
    memset(table, 0, sizeof *table);
    table->job = job;
}

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
    return a->name_length == b->name_length && a->luminance == b->luminance &&
           a->wrap_s == b->wrap_s && a->wrap_t == b->wrap_t && a->nearest == b->nearest &&
           memcmp(a->name, b->name, a->name_length) == 0;
}

static int is_jpeg(const unsigned char *bytes, size_t size)
{
    return size >= 3 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff;
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

/* Warns that an image cannot be used. */
static void warn(struct umbb_texture_table *table, const struct umbb_image *image, const char *why)
{
    char name[100];
    umbs_text_clean(name, sizeof name, image->name, image->name_length);
    umbs_scene_warn(&table->job->scene, "image '%s': %s; what shows it is taken as opaque", name,
                    why);
}

/* Adds a decoded image to the scene, unless it is opaque all over. */
static enum umb_status add_texture(struct umbb_texture_table *table, const struct umbb_image *image,
                                   const struct umbb_alpha_image *alpha, uint32_t *index,
                                   struct umb_error *error)
{
    struct umbs_scene_builder *scene = &table->job->scene;
    struct umbs_texture texture = {
        .width = alpha->width,
        .height = alpha->height,
        .wrap_s = image->wrap_s,
        .wrap_t = image->wrap_t,
        .nearest = image->nearest,
    };
    if (alpha->texels == NULL || is_opaque(alpha)) {
        return UMB_OK;
    }
    umbs_text_clean(texture.name, sizeof texture.name, image->name, image->name_length);
    const enum umb_status status = umbs_scene_add_texture(scene, &texture, alpha->texels, error);
    *index = status == UMB_OK ? (uint32_t)scene->textures.count - 1 : UMBS_NO_INDEX;
    return status;
}

/* Decodes an image in memory. */
static enum umb_status decode(struct umbb_texture_table *table, const struct umbb_image *image,
                              const void *bytes, size_t size, uint32_t *index,
                              struct umb_error *error)
{
    struct umbb_alpha_image alpha;
    struct umb_error why = {0};
    const uint64_t left = UMBB_IMAGES_TEXELS_MAX - table->texels;
    if (is_jpeg(bytes, size)) { /* has no alpha */
        if (image->luminance) {
            warn(table, image, "a JPEG as map_d is not read");
        }
        return UMB_OK;
    }
    if (!umbb_is_png(bytes, size)) {
        warn(table, image, "is neither PNG nor JPEG");
        return UMB_OK;
    }
    enum umb_status status =
        umbb_png_alpha(bytes, size, left < UMBB_IMAGE_TEXELS_MAX ? left : UMBB_IMAGE_TEXELS_MAX,
                       image->luminance, &alpha, &why);
    if (status == UMB_E_BAD_SCENE) {
        warn(table, image, why.message);
        return UMB_OK;
    }
    if (status != UMB_OK) {
        return umb_fail(error, status, "%s", why.message);
    }
    table->texels += (uint64_t)alpha.width * alpha.height;
    status = add_texture(table, image, &alpha, index, error);
    free(alpha.texels);
    return status;
}

/* Reads an image from memory or its file. */
static enum umb_status read_image(struct umbb_texture_table *table, const struct umbb_image *image,
                                  uint32_t *index, struct umb_error *error)
{
    const struct umbb_import *job = table->job;
    struct umbb_file file;
    struct umb_error why = {0};
    if (image->bytes != NULL) {
        return decode(table, image, image->bytes, image->size, index, error);
    }
    enum umb_status status = umbb_file_map_uri(&job->folder, image->name, image->name_length,
                                               job->max_input_bytes, &file, &why);
    if (status == UMB_E_NO_MEMORY || status == UMB_E_LIMIT) {
        return umb_fail(error, status, "%s", why.message);
    }
    if (status != UMB_OK) {
        warn(table, image, why.message);
        return UMB_OK;
    }
    status = decode(table, image, file.bytes, file.size, index, error);
    umbb_file_unmap(&file);
    return status;
}

enum umb_status umbb_texture_get(struct umbb_texture_table *table, const struct umbb_image *image,
                                 uint32_t *index, struct umb_error *error)
{
    const struct known *known = table->known.data;
    *index = UMBS_NO_INDEX;
    for (size_t i = 0; i < table->known.count; i++) {
        if (is_same(&known[i].image, image)) {
            *index = known[i].index;
            return UMB_OK;
        }
    }
    if (table->known.count >= UMBB_IMAGES_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "more than %u images with alpha", UMBB_IMAGES_MAX);
    }
    struct known *room = umbs_array_reserve(&table->known, 1, sizeof *room);
    char *name = malloc(image->name_length + 1);
    if (room == NULL || name == NULL) {
        free(name);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a texture");
    }
    enum umb_status status = read_image(table, image, index, error);
    if (status != UMB_OK) {
        free(name);
        return status;
    }
    memcpy(name, image->name, image->name_length);
    *room = (struct known){*image, *index};
    room->image.name = name;
    room->image.bytes = NULL;
    table->known.count++;
    return UMB_OK;
}
