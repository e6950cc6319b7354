/* SPDX-License-Identifier: Apache-2.0 */
/* Nodes of an Assimp scene (assimp_nodes.h). Float matrices are multiplied in doubles. */
#include "bake/import/assimp_nodes.h"

#include <math.h>
#include <stdlib.h>

#include "bake/import/assimp_lights.h"
#include "bake/import/gltf_instances.h"
#include "scene/scene_buffer.h"
#include "common/clean_text.h"

struct walk {
    const struct aiScene *scene;
    const uint32_t *mesh_of;
    const struct umbb_light_table *lights;
    struct umbb_gltf_instances *instances;
    struct umbs_scene_builder *builder;
    struct umb_error *error;
};

static enum umb_status bad_transform(const struct walk *walk, const struct aiNode *node)
{
    char name[80];
    umbs_text_clean(name, sizeof(name), node->mName.data, sizeof(node->mName.data));
    return umb_fail(walk->error, UMB_E_BAD_SCENE,
                    "transform of node '%s' is not finite, not affine or over %g", name,
                    UMBS_COORDINATE_MAX);
}

/* parent * m. Returns 0 if the result is not a usable affine transform. */
static int multiply(const double parent[3][4], const double m[3][4], double out[3][4])
{
    int good = 1;
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 4; column++) {
            double sum = column == 3 ? parent[row][3] : 0.0;
            for (int k = 0; k < 3; k++) {
                sum += parent[row][k] * m[k][column];
            }
            out[row][column] = sum;
            good &= fabs(sum) <= UMBS_COORDINATE_MAX; /* false for NaN */
        }
    }
    return good;
}

/* Multiplies by a node's transform. */
static int multiply_node(const double parent[3][4], const struct aiMatrix4x4 *node,
                         double out[3][4])
{
    const double m[3][4] = {
        {(double)node->a1, (double)node->a2, (double)node->a3, (double)node->a4},
        {(double)node->b1, (double)node->b2, (double)node->b3, (double)node->b4},
        {(double)node->c1, (double)node->c2, (double)node->c3, (double)node->c4},
    };
    const double last[4] = {(double)node->d1, (double)node->d2, (double)node->d3,
                            (double)node->d4 - 1.0};
    int good = 1;
    for (int k = 0; k < 4; k++) {
        good &= fabs(last[k]) <= 1e-6; /* tolerates the files' rounding */
    }
    return good && multiply(parent, m, out);
}

/* The meshes of a node that have triangles, by their numbers in the scene. */
struct shown {
    uint32_t *meshes; /* the caller frees it; NULL if there are none */
    size_t count;
};

static enum umb_status list_shown(const struct walk *walk, const struct aiNode *node,
                                  struct shown *shown)
{
    *shown = (struct shown){NULL, 0};
    if (node->mNumMeshes == 0) {
        return UMB_OK;
    }
    shown->meshes = calloc(node->mNumMeshes, sizeof *shown->meshes);
    if (shown->meshes == NULL) {
        return umb_fail(walk->error, UMB_E_NO_MEMORY, "a node's %u meshes: memory refused",
                        node->mNumMeshes);
    }
    for (unsigned i = 0; i < node->mNumMeshes; i++) {
        const unsigned mesh = node->mMeshes[i];
        if (mesh < walk->scene->mNumMeshes && walk->mesh_of[mesh] != UMBS_NO_INDEX) {
            shown->meshes[shown->count++] = walk->mesh_of[mesh];
        }
    }
    return UMB_OK;
}

static enum umb_status add_meshes(const struct walk *walk, const struct shown *shown,
                                  const double world[3][4])
{
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < shown->count; i++) {
        status = umbs_scene_add_instance(walk->builder, shown->meshes[i], world, walk->error);
    }
    return status;
}

/* Adds instances of the meshes at all places of a node. */
static enum umb_status add_places(const struct walk *walk, const struct aiNode *node,
                                  const struct umbb_gltf_places *places, const struct shown *shown,
                                  const double world[3][4])
{
    enum umb_status status = UMB_OK;
    for (size_t i = 0; status == UMB_OK && i < places->count; i++) {
        double local[3][4], place[3][4];
        status =
            umbb_gltf_place(places, i, local) && multiply(world, (const double(*)[4])local, place)
                ? add_meshes(walk, shown, (const double(*)[4])place)
                : bad_transform(walk, node);
    }
    return status;
}

/* Adds the node's meshes, once or at all its places. The limit of triangles ends the walk over
 * places; meshes without triangles would not reach it, so they are left out. In: number: in the
 * file. */
static enum umb_status add_instances(const struct walk *walk, const struct aiNode *node,
                                     uint32_t number, const double world[3][4])
{
    struct umbb_gltf_places places;
    struct shown shown;
    enum umb_status status = list_shown(walk, node, &shown);
    if (status == UMB_OK) {
        status = umbb_gltf_places_open(walk->instances, number, &places, walk->error);
    }
    if (status == UMB_OK && shown.count > 0) {
        status = places.count == 0 ? add_meshes(walk, &shown, world)
                                   : add_places(walk, node, &places, &shown, world);
    }
    free(shown.meshes);
    return status;
}

/* The tree must be that of the file, or instances would get wrong places. */
static enum umb_status check_children(const struct walk *walk, const struct aiNode *node,
                                      uint32_t number)
{
    return walk->instances->is_used &&
                   umbb_gltf_child_count(walk->instances, number) != node->mNumChildren
               ? umb_fail(walk->error, UMB_E_BAD_SCENE,
                          "EXT_mesh_gpu_instancing: a node has %u children, %zu in the file",
                          node->mNumChildren, umbb_gltf_child_count(walk->instances, number))
               : UMB_OK;
}

/* Depth is limited, so this recursion ends even if the tree has cycles. */
static enum umb_status walk_node(const struct walk *walk, const struct aiNode *node,
                                 uint32_t number, const double parent[3][4], unsigned depth)
{
    double world[3][4];
    if (depth > UMBB_NODE_DEPTH_MAX) {
        return umb_fail(walk->error, UMB_E_BAD_SCENE, "nodes nest deeper than %u",
                        UMBB_NODE_DEPTH_MAX);
    }
    if (!multiply_node(parent, &node->mTransformation, world)) {
        return bad_transform(walk, node);
    }
    enum umb_status status = check_children(walk, node, number);
    if (status == UMB_OK) {
        status = add_instances(walk, node, number, (const double(*)[4])world);
    }
    if (status == UMB_OK) {
        status = umbb_light_add(walk->lights, node, (const double(*)[4])world, walk->builder,
                                walk->error);
    }
    for (unsigned i = 0; status == UMB_OK && i < node->mNumChildren; i++) {
        status = walk_node(walk, node->mChildren[i], umbb_gltf_child(walk->instances, number, i),
                           (const double(*)[4])world, depth + 1);
    }
    return status;
}

enum umb_status umbb_assimp_nodes(const struct aiScene *scene, const uint32_t *mesh_of,
                                  struct umbb_import *job, enum umbb_kind kind,
                                  struct umb_error *error)
{
    static const double identity[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    struct umbb_gltf_instances instances = {0};
    struct umbb_light_table lights;
    enum umb_status status = umbb_light_table_init(&lights, scene, UMBB_NODE_DEPTH_MAX, error);
    if (status == UMB_OK) {
        status = umbb_gltf_instances_find(&instances, job, kind, error);
    }
    if (status == UMB_OK) {
        const struct walk walk = {scene, mesh_of, &lights, &instances, &job->scene, error};
        status = walk_node(&walk, scene->mRootNode, umbb_gltf_root(&instances), identity, 0);
    }
    umbb_gltf_instances_finish(&instances);
    umbb_light_table_finish(&lights);
    return status;
}
