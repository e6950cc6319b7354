/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_TEXTURE_TABLE_H
#define UMBRAGE_SERVER_BAKE_IMPORT_TEXTURE_TABLE_H
/*
 * Textures of a scene by their image and wrap modes; each image is decoded once for each
 * combination.
 *
 * An image that is missing, damaged or of another format than PNG and JPEG becomes a warning, and
 * its users cast as if it were opaque: a scene without its pictures still casts shadows. An image
 * over a limit is an error.
 */
#include "bake/import/import_job.h"

/* Limit of image names in one scene, usable or not. */
#define UMBB_IMAGES_MAX 4096U

/* Zero it, but for `job`, before its first use. */
struct umbb_texture_table {
    struct umbb_import *job; /* borrowed: its scene receives the textures */
    struct umbs_array known; /* array of struct known, in the order of first use */
    uint64_t texels;         /* number of texels decoded so far, damaged images included */
};

/* An image, as a scene refers to it. */
struct umbb_image {
    const char *name; /* file name; of an embedded image a name that no other of them has */
    size_t name_length;
    int is_embedded;   /* 1: the name is no file's */
    const void *bytes; /* encoded image; NULL: the image is in the file of that name */
    size_t size;
    int luminance;                    /* see umbb_png_alpha */
    uint32_t wrap_s, wrap_t, nearest; /* see umbs_texture */
};

void umbb_texture_table_finish(struct umbb_texture_table *table);

/* Finds a texture requested before; the image needs no bytes. Returns 0 if there is none. */
int umbb_texture_find(const struct umbb_texture_table *table, const struct umbb_image *image,
                      uint32_t *index);

/*
 * Finds or adds a texture.
 *
 * Out:   index: in scene->textures, or UMBS_NO_INDEX: alpha is 1 all over.
 * Fails: E_LIMIT (texels, UMBB_IMAGES_MAX), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_texture_get(struct umbb_texture_table *table,
                                             const struct umbb_image *image, uint32_t *index,
                                             struct umb_error *error);

/* Limits of texels: of one image, and of all images of a scene together. */
#define UMBB_IMAGE_TEXELS_MAX  (UINT64_C(1) << 28)
#define UMBB_IMAGES_TEXELS_MAX (UINT64_C(1) << 30)

struct umbb_alpha_image {
    uint8_t *texels; /* uint8[height][width], the lowest row first; NULL: the image has no alpha */
    uint32_t width, height;
};

/*
 * Decodes the alpha channel of a PNG by libpng: 8 bits a texel for every kind of file (palettes,
 * colour keys and 16 bits included). Colours, profiles and text are ignored.
 *
 * In:    max_texels: limit of the image. luminance: 1: an image without alpha gives its grey, or
 *        its green, instead (the meaning of map_d).
 * Out:   image: free texels. After a failure texels is NULL, and the sides are those of the header.
 * Fails: E_LIMIT (max_texels, sides), E_BAD_SCENE (damaged), E_NO_MEMORY.
 * Trust: safe on hostile bytes.
 * Cost:  memory for one row, for interlaced images all rows.
 */
UMB_CHECKED enum umb_status umbb_png_alpha(const void *bytes, size_t size, uint64_t max_texels,
                                           int luminance, struct umbb_alpha_image *image,
                                           struct umb_error *error);

#endif
