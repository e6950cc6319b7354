/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_LIGHTS_H
#define UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_LIGHTS_H
/*
 * Which light a node of an Assimp scene carries, and what it is in the world.
 *
 * aiLight names its node, which is ambiguous (names of glTF nodes need not be unique) and loses all
 * but one of the nodes that share a light. Assimp 5.2.5 also keeps a node's extensions as metadata,
 * with the light's number in the file. Its own list holds only lights that nodes use, in the order
 * in which it met them: a node's children before the node. The table rebuilds that order, proves
 * it by the names, and falls back on names alone where the proof fails.
 */
#include <assimp/scene.h>
#include "scene/scene_builder.h"

struct umbb_light_table {
    const struct aiScene *scene;
    struct umbs_array numbers; /* uint64_t: the file's number of scene->mLights[i] */
    int proven;                /* else go by names */
};

/* Looks at the tree. depth_max: deeper nodes are not looked at. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_light_table_init(struct umbb_light_table *table,
                                                  const struct aiScene *scene, unsigned depth_max,
                                                  struct umb_error *error);
void umbb_light_table_finish(struct umbb_light_table *table);

/*
 * Appends the light of a node, if it has one.
 *
 * In:    world: the node's transform, finite. A light shines along the node's -z; scale does not
 *        touch it (KHR_lights_punctual). Assimp has multiplied color and intensity: the largest
 *        component becomes the intensity.
 * Fails: E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_light_add(const struct umbb_light_table *table,
                                           const struct aiNode *node, const double world[3][4],
                                           struct umbs_scene_builder *builder,
                                           struct umb_error *error);

#endif
