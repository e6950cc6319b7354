/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_TILE_OCCLUDER_DEPTH_H
#define UMBRAGE_SERVER_BAKE_BUILD_TILE_OCCLUDER_DEPTH_H
/* First occluders of a tile's texels, for the effect `front`. */
#include "bake/depth/tile.h"
#include "format/occluder_depth_build.h"

/*
 * Adds a tile's texels to its frustum's occluder depth map.
 *
 * In:    tile: texels and level 3 of the pyramid filled, no square proven from bounds.
 * Fails: the errors of umb__occluder_depth_add.
 */
UMB_CHECKED enum umb_status umbb_tile_occluder_depth(const struct umbb_tile *tile,
                                                     struct umb__occluder_depth *occluder_depth,
                                                     struct umb_error *error);

#endif
