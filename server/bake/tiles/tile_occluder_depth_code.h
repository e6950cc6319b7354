/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_OCCLUDER_DEPTH_CODE_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_OCCLUDER_DEPTH_CODE_H
/*
 * The last part of a tile's result if first occluders are kept (tile_code.h):
 *
 *     uint32 squares              of 64 x 64 texels that have any
 *     then for each, in ascending order:
 *       uint32 number             in the tile, row by row
 *       uint32 words[words[0]]    format/occluder_depth_build.h
 *
 * Words do not depend on the square's place or frustum, nor on squares added before.
 */
#include "bake/tiles/tile_code.h"

/* Bytes of the part; 0 if shape->occluder_depth is NULL. */
uint64_t umbb_tile_occluder_depth_bytes(const struct umbb_tile_shape *shape);

/* Writes the part. */
void umbb_tile_occluder_depth_put(const struct umbb_tile_shape *shape, uint8_t *at);

/*
 * Reads the part and checks it.
 *
 * Out:   words: malloced, to be freed with free: the part as numbers of this machine.
 * Fails: E_CORRUPT, E_NO_MEMORY. Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umbb_tile_occluder_depth_read(const struct umbb_tile_shape *shape,
                                                          const uint8_t *bytes, size_t size,
                                                          uint32_t **words,
                                                          struct umb_error *error);

/* Adds the squares that were read to shape->occluder_depth. Fails: as
 * umb__occluder_depth_add_square. */
UMB_CHECKED enum umb_status umbb_tile_occluder_depth_add(const struct umbb_tile_shape *shape,
                                                         const uint32_t *words,
                                                         struct umb_error *error);

#endif
