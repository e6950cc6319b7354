/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_AHEAD_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_AHEAD_H
/*
 * Reads results of tiles ahead of the bake: all threads name, read, unpack and check a few tiles,
 * while the owner joins them in order.
 *
 *     umbb_tile_ahead_create(threads, &ahead, &error);
 *     for each frustum: umbb_tile_ahead_begin(ahead, &depth, &shape);
 *                       for ascending tiles: umbb_tile_ahead_get(ahead, cache, number, max_bytes)
 *                       umbb_tile_ahead_end(ahead);
 *     umbb_tile_ahead_destroy(ahead);
 */
#include "bake/depth/depth.h"
#include "bake/tiles/base_octree.h"
#include "bake/tiles/tile_cache.h"
#include "bake/tiles/tile_code.h"

struct umbb_tile_ahead; /* opaque */

/* A tile that was looked up. */
struct umbb_tile_read {
    uint8_t key[UMB_ID_BYTES];
    uint8_t digest[UMB_ID_BYTES]; /* SHA-256 of the result's bytes */
    struct umbb_tile_parsed parsed;
    int is_whole; /* 1: a result was found and parsed; 0: there is none, it was damaged, or it was
                     larger than what a tile may take ahead */
    uint8_t *bytes;
    const struct umbb_base_tile *base; /* the tile of the base; then nothing was read. NULL: none */
};

/* Fails: E_NO_MEMORY. In: threads: with the owner. */
UMB_CHECKED enum umb_status umbb_tile_ahead_create(unsigned threads, struct umbb_tile_ahead **out,
                                                   struct umb_error *error);
void umbb_tile_ahead_destroy(struct umbb_tile_ahead *ahead); /* NULL is allowed */

/* Starts a frustum. In: depth: a depth path with lists, borrowed until the end. base: tiles that
 * need not be read, borrowed; NULL: none. */
void umbb_tile_ahead_begin(struct umbb_tile_ahead *ahead, const struct umbb_depth *depth,
                           const struct umbb_tile_shape *shape, uint32_t frustum,
                           const struct umbb_base *base);

/* Ends a frustum: waits for tiles that are being read, and leaves the others. */
void umbb_tile_ahead_end(struct umbb_tile_ahead *ahead);

/*
 * Returns a tile, and starts others. It is valid until the next call.
 *
 * In: cache: its count of damaged files grows. max_bytes: memory of all tiles that are read ahead.
 */
const struct umbb_tile_read *umbb_tile_ahead_get(struct umbb_tile_ahead *ahead,
                                                 struct umbb_tile_cache *cache, uint32_t number,
                                                 size_t max_bytes);

#endif
