/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_KEY_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_KEY_H
/*
 * The key of a tile's result: a hash of everything that it depends on, and of nothing else.
 *
 * That is: the program's version and the bake's (plan.h); size of frustum and tile, and the tile's
 * place; the closed rule, whether squares are proven, and whether first occluders are kept; for
 * spot and point lights the scale of depth. Each caster that may reach the tile enters in the
 * scene's order, with its corners in voxel space, its kind and its marks, and if it is cut out,
 * with its texture coordinates and the texture's content. Corners in voxel space include the
 * frustum's matrix: if an edit of the scene moves the frustum, every key changes; else only those
 * of tiles that an edited triangle reached or now reaches.
 *
 * Not part of it, because no bit depends on it: threads, memory, instruction sets, the depth path,
 * triangles elsewhere, materials' names, the file.
 */
#include "bake/depth/depth.h"
#include "bake/tiles/tile_code.h"

/*
 * Computes a key.
 *
 * In:   depth: one with lists.
 * Cost: SHA-256 of 74 bytes a caster that may reach the tile; no allocation.
 */
void umbb_tile_key(const struct umbb_depth *depth, const struct umbb_tile_shape *shape,
                   const struct umbb_tile_place *place, uint8_t key[UMB_ID_BYTES]);

#endif
