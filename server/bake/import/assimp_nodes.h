/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_NODES_H
#define UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_NODES_H
/* The node tree of an Assimp scene: instances of meshes, and lights. */
#include <assimp/scene.h>
#include "bake/import/import_job.h"

#define UMBB_NODE_DEPTH_MAX 1024U

/*
 * Walks the tree and appends to job->scene an instance for each mesh and a light for each light of
 * a node; with EXT_mesh_gpu_instancing as many instances as the node has places.
 *
 * In:    mesh_of: uint32[scene->mNumMeshes], the builder's mesh or UMBS_NO_INDEX for none.
 * Fails: E_BAD_SCENE (too deep, a transform that is not finite or not affine, instances that cannot
 *        be read), E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_assimp_nodes(const struct aiScene *scene, const uint32_t *mesh_of,
                                              struct umbb_import *job, enum umbb_kind kind,
                                              struct umb_error *error);

#endif
