/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_CASTER_BYTES_H
#define UMBRAGE_SERVER_BAKE_TILES_CASTER_BYTES_H
/*
 * A caster as bytes, as the depth computation reads it: its corners in voxel space, its kind and
 * its marks, and if it is cut out, its texture coordinates and its texture's digest. Keys of tiles
 * and digests of squares are made of them. Numbers are little-endian, doubles are their bits.
 */
#include "bake/depth/depth.h"
#include "bake/tiles/tile_code.h"

#define UMBB_CASTER_BYTES     ((size_t)74)
#define UMBB_CASTER_CUT_BYTES ((size_t)19 * 8 + UMB_ID_BYTES)
#define UMBB_CASTER_BYTES_MAX (UMBB_CASTER_BYTES + UMBB_CASTER_CUT_BYTES)

/* Writes a caster's bytes. Returns their number. */
size_t umbb_caster_bytes(const struct umbb_casters *casters, size_t number,
                         uint8_t bytes[UMBB_CASTER_BYTES_MAX]);

/*
 * Computes a digest of the casters that may reach each square of a tile, in the scene's order.
 *
 * In:    depth: a depth path with lists. square_log2: at most tile_log2.
 * Out:   digests: [squares][16], row by row.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_casters_of_squares(const struct umbb_depth *depth,
                                                    const struct umbb_tile_place *place,
                                                    uint32_t tile_log2, uint32_t square_log2,
                                                    uint8_t (*digests)[16],
                                                    struct umb_error *error);

#endif
