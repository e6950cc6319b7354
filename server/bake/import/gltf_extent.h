/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_EXTENT_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_EXTENT_H
/*
 * Extents of lights in glTF. KHR_lights_punctual knows lights without an extent only, so files give
 * it in the `extras` of the light's node, or else of the light itself:
 *
 *     umbrage_angle: radians        a directional light's angular diameter
 *     umbrage_diameter: metres      a spot or point light's diameter
 *     umbrage_shape: "rectangle"    with umbrage_width and umbrage_height, metres: a spot or point
 *                                   light becomes an area light that shines along the node's -z;
 *                                   the width lies along its x, the height along its y
 *     umbrage_shape: "disc"         with umbrage_diameter, metres: the same, round
 *
 * The node's scale does not change the light.
 */
#include "bake/import/gltf.h"

/*
 * Reads the extent of a light.
 *
 * In:    node, punctual: the light's node, and the light of KHR_lights_punctual. world: transform
 *        of the node. light: with name, kind and direction.
 * Out:   extent: zeroed if the file gives none. light->kind: changed by umbrage_shape.
 * Fails: E_BAD_SCENE, naming the light, the key, the value and its limits.
 */
UMB_CHECKED enum umb_status umbb_gltf_extent(const json_t *node, const json_t *punctual,
                                             const double (*world)[4], struct umbs_light *light,
                                             struct umbs_light_extent *extent,
                                             struct umb_error *error);

#endif
