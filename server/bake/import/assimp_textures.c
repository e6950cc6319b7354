/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Assimp 5.2.5 turns glTF's coordinates upside down (v counts up) and passes images of buffers as
 * texture "*N". It gives KHR_texture_transform as a transform about the centre of the image; this
 * file computes the original transform from that. It does not give that extension's texCoord.
 * Source: glTF 2.0, section 3.8; KHR_texture_transform.
 */
#include "bake/import/assimp_textures.h"

#include <assimp/GltfMaterial.h>
#include <assimp/cimport.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Limit of texture coordinates: products with sides stay finite in double and float. */
#define COORDINATE_MAX 1e30

/* Values of glTF samplers (OpenGL's). */
enum {
    GL_NEAREST = 9728,
};

static uint32_t wrap_of(enum aiTextureMapMode mode)
{
    switch (mode) {
    case aiTextureMapMode_Mirror:
        return UMBS_WRAP_MIRROR;
    case aiTextureMapMode_Clamp:
        return UMBS_WRAP_CLAMP;
    default:
        return UMBS_WRAP_REPEAT;
    }
}

/* Finds the image for Assimp's name of it: embedded bytes, or a file. */
static void find_bytes(const struct aiScene *scene, const struct aiString *path,
                       struct umbb_image *image)
{
    image->name = path->data;
    image->name_length = strnlen(path->data, sizeof path->data);
    if (path->data[0] == '*') {
        char *end;
        const unsigned long number = strtoul(path->data + 1, &end, 10);
        if (*end == '\0' && number < scene->mNumTextures &&
            scene->mTextures[number]->mHeight == 0 && scene->mTextures[number]->pcData != NULL) {
            image->bytes = scene->mTextures[number]->pcData;
            image->size = scene->mTextures[number]->mWidth;
        }
    }
}

static int is_coordinate(double value)
{
    return fabs(value) <= COORDINATE_MAX; /* false for NaN */
}

/* KHR_texture_transform: scale, then rotate, then move, in coordinates whose v counts down. */
static void find_mapping(const struct aiMaterial *source, struct umbb_uv_mapping *mapping)
{
    struct aiUVTransform found;
    memset(&found, 0, sizeof found);
    if (aiGetMaterialUVTransform(source, AI_MATKEY_UVTRANSFORM(aiTextureType_DIFFUSE, 0), &found) !=
        aiReturn_SUCCESS) {
        return;
    }
    const double sx = (double)found.mScaling.x, sy = (double)found.mScaling.y;
    const double angle = -(double)found.mRotation;
    const double c = angle == 0.0 ? 1.0 : cos(angle), s = angle == 0.0 ? 0.0 : sin(angle);
    const double x = (double)found.mTranslation.x - 0.5 * sx * (s - c + 1.0);
    const double y = 1.0 - sy - ((double)found.mTranslation.y - 0.5 * sy * (s + c - 1.0));
    /* With v = 1 - (v up), and v' alike: u' = c sx u + s sy v + x, v' = -s sx u + c sy v + y. */
    const double matrix[2][3] = {{c * sx, -s * sy, s * sy + x}, {s * sx, c * sy, 1.0 - c * sy - y}};
    mapping->moves = 1;
    for (int i = 0; i < 6; i++) {
        mapping->matrix[i / 3][i % 3] = matrix[i / 3][i % 3];
        if (!is_coordinate(matrix[i / 3][i % 3])) {
            mapping->moves = 0;
        }
    }
}

enum umb_status umbb_assimp_texture(const struct aiScene *scene, const struct aiMaterial *source,
                                    struct umbb_texture_table *table,
                                    struct umbs_material *material, struct umbb_uv_mapping *mapping,
                                    struct umb_error *error)
{
    struct aiString path = {0};
    unsigned set = 0;
    enum aiTextureMapMode modes[3] = {aiTextureMapMode_Wrap, aiTextureMapMode_Wrap,
                                      aiTextureMapMode_Wrap};
    memset(mapping, 0, sizeof *mapping);
    if (material->alpha_mode == UMBS_ALPHA_OPAQUE ||
        aiGetMaterialTexture(source, aiTextureType_DIFFUSE, 0, &path, NULL, &set, NULL, NULL, modes,
                             NULL) != aiReturn_SUCCESS) {
        return UMB_OK;
    }
    int filter = 0;
    unsigned count = 1;
    struct umbb_image image = {.wrap_s = wrap_of(modes[0]), .wrap_t = wrap_of(modes[1])};
    if (aiGetMaterialIntegerArray(source,
                                  AI_MATKEY_GLTF_MAPPINGFILTER_MAG(aiTextureType_DIFFUSE, 0),
                                  &filter, &count) == aiReturn_SUCCESS) {
        image.nearest = filter == GL_NEAREST;
    }
    find_bytes(scene, &path, &image);
    const enum umb_status status = umbb_texture_get(table, &image, &material->texture, error);
    if (status == UMB_OK && material->texture != UMBS_NO_INDEX) {
        mapping->set = set;
        find_mapping(source, mapping);
    }
    return status;
}

void umbb_assimp_uv(const struct umbb_uv_mapping *mapping, const struct aiMesh *mesh,
                    unsigned vertex, float uv[2])
{
    const struct aiVector3D *uvs =
        mapping->set < AI_MAX_NUMBER_OF_TEXTURECOORDS ? mesh->mTextureCoords[mapping->set] : NULL;
    double u = uvs != NULL ? (double)uvs[vertex].x : 0.0;
    double v = uvs != NULL ? (double)uvs[vertex].y : 0.0;
    if (mapping->moves && is_coordinate(u) && is_coordinate(v)) {
        const double *a = mapping->matrix[0], *b = mapping->matrix[1];
        const double moved = a[0] * u + a[1] * v + a[2];
        v = b[0] * u + b[1] * v + b[2];
        u = moved;
    }
    const int good = is_coordinate(u) && is_coordinate(v);
    uv[0] = good ? (float)u : 0.0F;
    uv[1] = good ? (float)v : 0.0F;
}
