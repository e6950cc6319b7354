/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_KEEPING_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_KEEPING_H
/*
 * A folder of tile results as the tile loop's keeper (build/tile_keeper.h).
 *
 *     umbb_tile_keeping_open(&keeping, folder, max_bytes, &error);
 *     for each frustum: umbb_tile_keeping_frustum(&keeping, ...); umbb_tile_keeping_keeper(...)
 *     umbb_tile_keeping_close(&keeping);
 */
#include "bake/tiles/tile_cache.h"
#include "bake/tiles/tile_code.h"

/* What is to happen if a result is not there, or cannot be kept. */
enum umbb_keeping_mode {
    UMBB_KEEPING_CACHE = 0, /* the tile is baked; not kept, with a notice */
    UMBB_KEEPING_TILE = 1,  /* the tile is baked; the bake fails */
    UMBB_KEEPING_MERGE = 2, /* the bake fails; nothing is kept */
};

struct umbb_tile_keeping {
    struct umbb_tile_cache cache;
    enum umbb_keeping_mode mode;
    int quiet;  /* no notices */
    int silent; /* a notice has been given */
    const struct umbb_depth *depth;
    struct umbb_tile_shape shape; /* of the frustum, and of the tile that is under way */
    uint32_t frustum;             /* its number */
    uint64_t first;               /* number of its first tile among those of all frusta */
    uint64_t found, baked;
    struct {
        uint32_t number;
        uint8_t key[UMB_ID_BYTES];
    } missed[2]; /* tiles that were asked for and are under way */
    unsigned next_missed;
};

/* Opens the folder. Fails: as umbb_tile_cache_open. */
UMB_CHECKED enum umb_status umbb_tile_keeping_open(struct umbb_tile_keeping *keeping,
                                                   enum umbb_keeping_mode mode, const char *folder,
                                                   uint64_t max_bytes, struct umb_error *error);
void umbb_tile_keeping_close(struct umbb_tile_keeping *keeping);

/* Turns to the next frustum. In: depth: one with reach; it and shape's front are borrowed until the
 * next call. */
void umbb_tile_keeping_frustum(struct umbb_tile_keeping *keeping, uint32_t frustum,
                               const struct umbb_tile_shape *shape, const struct umbb_depth *depth);

/*
 * The keeper. find fails with E_BUSY in mode merge if a result is missing or damaged (which is
 * temporary: bake it and try again); keep fails in mode tile as umbb_tile_encode and
 * umbb_tile_cache_write do.
 */
struct umbb_tile_keeper umbb_tile_keeping_keeper(struct umbb_tile_keeping *keeping);

#endif
