/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_FLATTEN_H
#define UMBRAGE_SERVER_SCENE_SCENE_FLATTEN_H
/* Flattening of one instance. umbs_scene_flatten and the scene's hash share it, bit for bit. */
#include "scene/scene.h"

/*
 * Writes the world triangles first .. first + count - 1 of an instance.
 *
 * In:  first + count: at most the triangles of the instance's mesh.
 * Out: corners: double[count][3][3]; two corners have changed places if the transform mirrors.
 */
void umbs_scene_flatten_part(const struct umbs_scene_view *view,
                             const struct umbs_instance *instance, uint32_t first, uint32_t count,
                             double (*corners)[3][3]);

/* 1 if an instance's transform mirrors. The front faces of such an instance are wound the other way
 * (glTF 2.0, section 3.7.4), so two corners change places to keep outward solids outward. */
int umbs_instance_mirrors(const struct umbs_instance *instance);

#endif
