/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_BASE_OCTREE_H
#define UMBRAGE_SERVER_BAKE_TILES_BASE_OCTREE_H
/*
 * The merged octree of an earlier bake, kept in a cache beside the tiles. A bake after an edit
 * loads it as a whole, which takes a fraction of the time of reading and merging the same tiles one
 * by one. Tiles that the edit changed are then baked, or read, as without it.
 *
 *     umbb_base_open(&base, &proofs, &job);
 *     umbb_base_load(&base, &pool, &error);
 *     umbb_base_find(&base, frustum, tile, key) says whether the pool has a tile
 *     umbb_base_note(&base, ...) for each tile, found or baked
 *     umbb_base_compact(&base, &octree, &error);
 *     the octree is written as an asset, with base.kept
 *     umbb_base_keep(&base, cuts, pages, page_count, &error);
 *     umbb_base_close(&base);
 *
 * Layout, little-endian: magic "UMBBASE1", the base's name (32 bytes); for each tile of each
 * frustum its key and the SHA-256 of its result (32 bytes each), int32 max_lit, min_end, uint32
 * runs; then for each run of each tile uint32 z_end, ref (tile_code.h; ref is a number of the
 * octree); then uint64 bytes of the octree; the octree (format/octree_image.h); the cuts and pages
 * of the asset that was written (format/pack_kept.h).
 *
 * The name is a hash of the names of the frusta's records (proofs.h), which say where all voxels
 * are. A base is trusted as tiles' results are, and as records only in a folder that no other user
 * can change. A base that is cut, damaged, or of other frusta is not used.
 *
 * A base is written anew when more than an eighth of its tiles have changed, so most edits write
 * their own tiles only.
 */
#include "bake/tiles/proofs.h"
#include "bake/tiles/tile_code.h"
#include "format/octree_image.h"
#include "format/pack_kept.h"

/* A tile of a base. */
struct umbb_base_tile {
    struct umbb_tile_proof proof; /* its key, and the digest of its result; zero: no tile */
    struct umbb_tile_result result;
    size_t run_first; /* index of the first of its runs; their number is in the result */
};

struct umbb_base_tiles {
    struct umbb_base_tile *tiles; /* [tile_count] of all frusta; NULL: none */
    struct umbb_runs runs;
};

struct umbb_base {
    struct umbb_tile_cache *cache; /* borrowed; NULL: no base is used or kept */
    const struct umbb_proofs *proofs;
    uint8_t name[UMB_ID_BYTES];
    size_t tile_count;           /* of all frusta */
    uint8_t *bytes;              /* the file; NULL: there is no base */
    size_t size, image, kept_at; /* size of the file; places of the octree and of what is kept */
    uint32_t counts[UMB_LEVEL_MAX + 1]; /* nodes of the octree that was loaded */
    struct umb__pack_kept kept;         /* cuts and pages of its nodes that this bake has, too */
    int is_loaded;                      /* 1: the pool holds the base */
    size_t found;                       /* number of tiles of this bake that the base has */
    struct umbb_base_tiles before, now;
};

/* Reads the base of an earlier bake. In: proofs: opened, borrowed. cache: borrowed. max_bytes:
 * limit of the file; a larger one is not used. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_base_open(struct umbb_base *base, const struct umbb_proofs *proofs,
                                           struct umbb_tile_cache *cache, size_t max_bytes,
                                           struct umb_error *error);
void umbb_base_close(struct umbb_base *base);

/* Loads the octree into an empty pool. A damaged one is removed, and the pool left empty. */
void umbb_base_load(struct umbb_base *base, struct umb__pool *pool);

/* Returns the tile of a base that was loaded; NULL: it has none with this key. Threads: any. */
const struct umbb_base_tile *umbb_base_find(const struct umbb_base *base, uint32_t frustum,
                                            uint32_t tile, const uint8_t key[UMB_ID_BYTES]);

/* Appends a tile's runs to those of the column. Out: result. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_base_take(struct umbb_base *base,
                                           const struct umbb_base_tile *tile,
                                           struct umbb_runs *runs, struct umbb_tile_result *result,
                                           struct umb_error *error);

/* Notes a tile of this bake, found or baked. In: runs: hold those of its column. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_base_note(struct umbb_base *base, uint32_t frustum, uint32_t tile,
                                           const struct umbb_tile_proof *proof,
                                           const struct umbb_tile_result *result,
                                           const struct umbb_runs *runs, struct umb_error *error);

/* Removes the nodes that only tiles of the base reached which this bake has no more, and reads the
 * cuts and pages of the others into base->kept. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_base_compact(struct umbb_base *base, struct umb__octree *octree,
                                              struct umb_error *error);

/* Writes the base of this bake, if there is none or its tiles differ from too many of the one that
 * was read. In: cuts, pages: of the asset that was written. Fails: as umbb_tile_cache_write. */
UMB_CHECKED enum umb_status umbb_base_keep(const struct umbb_base *base,
                                           const struct umb__pack_cuts *cuts,
                                           const struct umb__kept_page *pages, uint32_t page_count,
                                           struct umb_error *error);

/* Frees what only the writing of the asset needs. */
void umbb_base_release(struct umbb_base *base);

/* Removes the base: a self-check refused the bake. */
void umbb_base_drop(const struct umbb_base *base);

#endif
