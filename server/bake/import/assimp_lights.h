/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_LIGHTS_H
#define UMBRAGE_SERVER_BAKE_IMPORT_ASSIMP_LIGHTS_H
/*
 * The light of a node of an Assimp scene, in world space.
 *
 * aiLight names its node, which is ambiguous: names of glTF nodes need not be unique. It also loses
 * all but one of the nodes that share a light. Assimp 5.2.5 keeps a node's extensions as metadata
 * too, with the light's number in the file. Its own list holds only lights that nodes use, in the
 * order of its walk: a node's children before the node. The table rebuilds that order and proves it
 * by the names. If the proof fails, it uses names alone.
 */
#include <assimp/scene.h>
#include "scene/scene_builder.h"

struct umbb_light_table {
    const struct aiScene *scene;
    struct umbs_array numbers; /* uint64_t: the file's number of scene->mLights[i] */
    int proven;                /* 1: numbers are proven; 0: names are used */
};

/* Builds the table from the tree. depth_max: deeper nodes are ignored. Fails: E_NO_MEMORY. */
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
