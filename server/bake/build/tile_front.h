/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BUILD_TILE_FRONT_H
#define UMBRAGE_SERVER_BAKE_BUILD_TILE_FRONT_H
/* First occluders of a tile's texels, for the effect `front`. */
#include "bake/depth/tile.h"
#include "format/front_build.h"

/*
 * Adds a tile's texels to its frustum's front.
 *
 * In:    tile: texels and level 3 of the pyramid filled, no square proven from bounds.
 * Fails: as umb_front_add.
 */
UMB_CHECKED enum umb_status umbb_tile_front(const struct umbb_tile *tile, struct umb_front *front,
                                            struct umb_error *error);

#endif
