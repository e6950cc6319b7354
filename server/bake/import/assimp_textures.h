/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_TEXTURES_H
#define UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_TEXTURES_H
/* Alpha of the base colour texture of glTF materials. */
#include <assimp/scene.h>

#include "bake/import/texture_table.h"

/* Mapping of a mesh's texture coordinates in Assimp to those of the scene. */
struct umbb_uv_mapping {
    unsigned set;        /* TEXCOORD_n */
    int moves;           /* 0: the matrix is the identity */
    double matrix[2][3]; /* KHR_texture_transform, v up */
};

/*
 * Gives a material that is not opaque its alpha texture.
 *
 * Out:   material: texture. mapping: for the coordinates of its meshes; without a texture set 0,
 *        unchanged.
 * Fails: as umbb_texture_get.
 */
UMB_CHECKED enum umb_status
umbb_assimp_texture(const struct aiScene *scene, const struct aiMaterial *source,
                    struct umbb_texture_table *table, struct umbs_material *material,
                    struct umbb_uv_mapping *mapping, struct umb_error *error);

/* Texture coordinates of a vertex; 0 0 if the mesh has none or they are not finite. */
void umbb_assimp_uv(const struct umbb_uv_mapping *mapping, const struct aiMesh *mesh,
                    unsigned vertex, float uv[2]);

#endif
