/* SPDX-License-Identifier: Apache-2.0 */
/* Nodes of an Assimp scene (assimp_nodes.h). Float matrices are multiplied in doubles. */
#include "bake/import/assimp_nodes.h"

#include <math.h>

#include "bake/import/assimp_lights.h"
#include "common/scene_buffer.h"
#include "common/scene_text.h"

struct walk {
    const struct aiScene *scene;
    const uint32_t *mesh_of;
    const struct umbb_light_table *lights;
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

/* parent * node, in doubles. Returns 0 if the result is no usable affine transform. */
static int multiply(const double parent[3][4], const struct aiMatrix4x4 *node, double out[3][4])
{
    const double m[4][4] = {
        {(double)node->a1, (double)node->a2, (double)node->a3, (double)node->a4},
        {(double)node->b1, (double)node->b2, (double)node->b3, (double)node->b4},
        {(double)node->c1, (double)node->c2, (double)node->c3, (double)node->c4},
        {(double)node->d1, (double)node->d2, (double)node->d3, (double)node->d4},
    };
    int good = 1;
    for (int k = 0; k < 4; k++) {
        good &= fabs(m[3][k] - (k == 3 ? 1.0 : 0.0)) <= 1e-6; /* the files' rounding */
    }
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

/* Depth is limited, so this recursion ends even if the tree were no tree. */
static enum umb_status walk_node(const struct walk *walk, const struct aiNode *node,
                                 const double parent[3][4], unsigned depth)
{
    double world[3][4];
    if (depth > UMBB_NODE_DEPTH_MAX) {
        return umb_fail(walk->error, UMB_E_BAD_SCENE, "nodes nest deeper than %u",
                        UMBB_NODE_DEPTH_MAX);
    }
    if (!multiply(parent, &node->mTransformation, world)) {
        return bad_transform(walk, node);
    }
    enum umb_status status = UMB_OK;
    for (unsigned i = 0; status == UMB_OK && i < node->mNumMeshes; i++) {
        unsigned mesh = node->mMeshes[i];
        if (mesh < walk->scene->mNumMeshes && walk->mesh_of[mesh] != UMBS_NO_INDEX) {
            status = umbs_scene_add_instance(walk->builder, walk->mesh_of[mesh],
                                             (const double(*)[4])world, walk->error);
        }
    }
    if (status == UMB_OK) {
        status = umbb_light_add(walk->lights, node, (const double(*)[4])world, walk->builder,
                                walk->error);
    }
    for (unsigned i = 0; status == UMB_OK && i < node->mNumChildren; i++) {
        status = walk_node(walk, node->mChildren[i], (const double(*)[4])world, depth + 1);
    }
    return status;
}

enum umb_status umbb_assimp_nodes(const struct aiScene *scene, const uint32_t *mesh_of,
                                  struct umbs_scene_builder *builder, struct umb_error *error)
{
    static const double identity[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    struct umbb_light_table lights;
    enum umb_status status = umbb_light_table_init(&lights, scene, UMBB_NODE_DEPTH_MAX, error);
    if (status == UMB_OK) {
        const struct walk walk = {scene, mesh_of, &lights, builder, error};
        status = walk_node(&walk, scene->mRootNode, identity, 0);
    }
    umbb_light_table_finish(&lights);
    return status;
}
