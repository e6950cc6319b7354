/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_TILE_FOLDER_H
#define UMBRAGE_SERVER_BAKE_TILES_TILE_FOLDER_H
/*
 * A folder of tile results as the tile loop's cache (build/tile_loop.h).
 *
 *     umbb_tile_folder_open(&tile_folder, mode, folder, max_bytes, &error);
 *     for each frustum: umbb_tile_folder_frustum(&tile_folder, ...);
 *                       umbb_tile_folder_cached_tiles(&tile_folder)
 *     umbb_tile_folder_close(&tile_folder);
 */
#include "bake/depth/depth.h"
#include "bake/tiles/proofs.h"
#include "bake/tiles/tile_ahead.h"
#include "bake/tiles/tile_cache.h"
#include "bake/tiles/tile_code.h"

/* Mode of a tile folder: what to do if a result is missing, and if a result cannot be written. */
enum umbb_tile_folder_mode {
    UMBB_TILE_FOLDER_CACHE = 0, /* missing: the tile is baked; not written: a notice is printed */
    UMBB_TILE_FOLDER_TILE = 1,  /* missing: the tile is baked; not written: the bake fails */
    UMBB_TILE_FOLDER_MERGE = 2, /* missing: the bake fails; nothing is written */
};

struct umbb_tile_folder {
    struct umbb_tile_cache cache;
    enum umbb_tile_folder_mode mode;
    int quiet;  /* no notices */
    int silent; /* a notice has been given */
    const struct umbb_depth *depth;
    struct umbb_tile_shape shape; /* shape of the frustum and of the current tile */
    uint64_t first;               /* number of the frustum's first tile among those of all frusta */
    struct {
        uint32_t number;
        uint8_t key[UMB_ID_BYTES];
    } missed[2]; /* tiles that were not found and are being baked */
    unsigned next_missed;
    struct umbb_tile_ahead *ahead;     /* reads results of the next tiles */
    struct umb__pool_numbers numbers;  /* working memory */
    struct umbb_proofs *proofs;        /* where tiles are noted; its frusta are NULL: nowhere */
    struct umbb_frustum_proofs *proof; /* Proofs of the frustum; NULL: none */
    struct umbb_base *base;            /* Octree of an earlier bake; NULL: none */
    uint32_t frustum;
};

/* Opens the folder. In: threads: that read results, with the owner. Fails: as
 * umbb_tile_cache_open. */
UMB_CHECKED enum umb_status umbb_tile_folder_open(struct umbb_tile_folder *tile_folder,
                                                  enum umbb_tile_folder_mode mode,
                                                  const char *folder, uint64_t max_bytes,
                                                  unsigned threads, struct umb_error *error);
void umbb_tile_folder_close(struct umbb_tile_folder *tile_folder);

/* Starts the next frustum. depth: a depth path with lists; depth and the shape's occluder depth map
 * are borrowed until the frustum's end. */
void umbb_tile_folder_frustum(struct umbb_tile_folder *tile_folder, uint32_t frustum,
                              const struct umbb_tile_shape *shape, const struct umbb_depth *depth);

/* Ends the frustum, after any result: its depth path may be destroyed afterwards. */
void umbb_tile_folder_frustum_end(struct umbb_tile_folder *tile_folder);

/*
 * Returns the functions of the cache. find fails with E_BUSY in mode merge if a result is missing
 * or damaged (temporary: bake the tile and try again). keep fails in mode tile as umbb_tile_encode
 * and umbb_tile_cache_write do.
 */
struct umbb_cached_tiles umbb_tile_folder_cached_tiles(struct umbb_tile_folder *tile_folder);

/*
 * Computes the key of a tile's result: a hash of everything that the result depends on, and of
 * nothing else.
 *
 * The hash covers the program's version and the bake's (plan.h); size of frustum and tile, and the
 * tile's place; the closed rule, whether squares are proven, and whether first occluders are kept;
 * for spot and point lights the scale of depth. Each caster that may reach the tile enters in the
 * scene's order, with its corners in voxel space, its kind and its marks, and if it is cut out,
 * with its texture coordinates and the texture's content. Corners in voxel space include the
 * frustum's matrix: if an edit of the scene moves the frustum, every key changes; else only those
 * of tiles that an edited triangle reached or now reaches.
 *
 * Not part of the key, because no bit of the result depends on them: threads, memory, instruction
 * sets, the depth path, triangles elsewhere, materials' names, the file.
 *
 * In:   depth: a depth path with lists.
 * Cost: SHA-256 of 74 bytes a caster that may reach the tile; no allocation.
 */
void umbb_tile_key(const struct umbb_depth *depth, const struct umbb_tile_shape *shape,
                   const struct umbb_tile_place *place, uint8_t key[UMB_ID_BYTES]);

#endif
