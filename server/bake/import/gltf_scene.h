/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_SCENE_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_SCENE_H
/*
 * State of reading one glTF scene. The walk over the nodes (gltf_reader.c) reads meshes and
 * materials where a node first shows them; what no node shows is not read.
 */
#include "bake/import/gltf.h"

/* Mapping of a mesh's texture coordinates to those of the image. */
struct umbb_gltf_mapping {
    int64_t set;         /* n of TEXCOORD_n */
    int moves;           /* 0: the matrix is the identity */
    double matrix[2][3]; /* KHR_texture_transform; v counts down, as in the file */
};

struct umbb_gltf_material {
    int is_read;
    uint32_t number; /* material of the builder */
    struct umbb_gltf_mapping mapping;
};

struct umbb_gltf_mesh {
    int is_read;
    uint32_t first, count; /* meshes of the builder: primitives with triangles */
};

struct umbb_gltf_scene {
    struct umbb_gltf file;
    struct umbb_faces faces;
    struct umbb_texture_table textures;
    struct umbb_gltf_material *materials; /* one for each of the file's materials */
    struct umbb_gltf_mesh *meshes;        /* one for each of the file's meshes */
    uint8_t *nodes;                       /* one for each of the file's nodes; 1: visited */
    unsigned bare;    /* number of primitives without coordinates for their texture */
    unsigned skinned; /* number of nodes with a skin */
    unsigned morphed; /* number of primitives with morph targets */
};

/*
 * Finds a material, and reads it at its first use: alpha mode, cut-off, factor and texture,
 * transmission, sides.
 *
 * Fails: E_BAD_SCENE (no such material, texture, image or sampler), E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_get_material(struct umbb_gltf_scene *scene, int64_t number,
                                                   const struct umbb_gltf_material **material,
                                                   struct umb_error *error);

/*
 * Finds a mesh, and reads it at its first use: a mesh of the builder for each primitive with
 * triangles. Points and lines cast no shadow.
 *
 * Fails: E_BAD_SCENE (no such mesh, accessors that cannot be read), E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_get_mesh(struct umbb_gltf_scene *scene, int64_t number,
                                               const struct umbb_gltf_mesh **mesh,
                                               struct umb_error *error);

/*
 * Appends the light of a node, if it has one (KHR_lights_punctual).
 *
 * In:    name: of the node. world: the node's transform, finite. A light shines along the node's
 *        -z; the node's scale does not change the light.
 * Fails: E_BAD_SCENE (no such light), E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_add_light(struct umbb_gltf_scene *scene, const json_t *node,
                                                const char *name, const double world[3][4],
                                                struct umb_error *error);

#endif
