/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_INSTANCES_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_INSTANCES_H
/*
 * EXT_mesh_gpu_instancing: a node whose mesh stands at many places, which are rows of accessors.
 * Assimp 5.2.5 ignores the extension and makes one node for each node of the file. So the two trees
 * are walked side by side, from the roots on.
 *
 *     umbb_gltf_instances_find(&instances, job, kind, &error);
 *     number = umbb_gltf_root(&instances, &count), then umbb_gltf_child(&instances, number, i)
 *     umbb_gltf_places_open(&instances, number, &places, &error);
 *     umbb_gltf_place(&places, i, local, &error)       i below places.count
 *     umbb_gltf_instances_finish(&instances);
 */
#include "bake/import/gltf_column.h"

#define UMBB_GLTF_NO_NODE    UINT32_MAX
#define UMBB_GLTF_MANY_ROOTS (UINT32_MAX - 1U) /* a node above them, which Assimp adds */

struct umbb_gltf_instances {
    struct umbs_array nodes, children, roots;
    struct umbb_gltf_columns columns;
    int is_used; /* 0: no node of the file has such instances, and the rest is empty */
};

/* Places of a node's mesh. */
struct umbb_gltf_places {
    uint32_t count; /* 0: the node has no such instances */
    int has_translation, has_rotation, has_scale;
    struct umbb_gltf_column translation, rotation, scale;
};

/* Reads all instances of the file. In: instances: zeroed. Fails: E_NO_MEMORY. Trust: safe on
 * hostile bytes. */
UMB_CHECKED enum umb_status umbb_gltf_instances_find(struct umbb_gltf_instances *instances,
                                                     const struct umbb_import *job,
                                                     enum umbb_kind kind, struct umb_error *error);
void umbb_gltf_instances_finish(struct umbb_gltf_instances *instances);

/* The file's node that is the scene's root, or one of the constants above. */
uint32_t umbb_gltf_root(const struct umbb_gltf_instances *instances);

/* Number of a node's children, and the node number of one of them. */
size_t umbb_gltf_child_count(const struct umbb_gltf_instances *instances, uint32_t node);
uint32_t umbb_gltf_child(const struct umbb_gltf_instances *instances, uint32_t node, size_t index);

/* Finds a node's places. Fails: E_BAD_SCENE (as umbb_gltf_column_open, or columns of different
 * lengths), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_gltf_places_open(struct umbb_gltf_instances *instances,
                                                  uint32_t node, struct umbb_gltf_places *places,
                                                  struct umb_error *error);

/* One place as a transform: scale, then rotation, then translation. Returns 0 if the rotation is no
 * rotation; values that are not finite stay so. */
int umbb_gltf_place(const struct umbb_gltf_places *places, size_t index, double local[3][4]);

#endif
