/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_TILES_PROOFS_H
#define UMBRAGE_SERVER_BAKE_TILES_PROOFS_H
/*
 * Records of which voxels were compared with traced rays, kept beside the tiles of a cache, so that
 * a self-check need not compare again what an edit left alone.
 *
 *     umbb_proofs_open(&proofs, &job, &error);
 *     the tile folder notes each tile's key and result, and the casters of a tile not proven before
 *     the self-check compares what is not proven, and notes it (write/self_check.h)
 *     umbb_proofs_keep(&proofs, &error);
 *     umbb_proofs_close(&proofs);
 *
 * A frustum's record lies in the cache under a hash of everything that says where its voxels are in
 * the world. It holds, for each tile, the tile's key (all its casters) and the digest of its
 * result. It also holds, for each square of a tile, a digest of the square's casters and voxels,
 * when rays were cast in it, and how many. A later bake inherits
 *
 * - a whole tile with the same key and the same result;
 * - else a square with the same casters and the same voxels.
 *
 * Layout, little-endian: magic "UMBPRF1\n", uint32 tiles, uint32 squares of a tile; for each tile
 * its key and the SHA-256 of its result (32 bytes each); for each square of each tile its digest
 * (16 bytes), uint64 seconds since 1970, uint32 columns (rays through every texel; 0: points drawn
 * at random), uint32 points of the light; then the SHA-256 of all bytes before.
 *
 * Trust: a record that is cut, damaged, or of another frustum is not used. A record says that
 * something was compared, so only a folder that no other user can change may hold one
 * (common/private_folder.h).
 */
#include "bake/analysis/analysis.h"
#include "bake/depth/depth.h"
#include "bake/tiles/tile_cache.h"
#include "bake/tiles/tile_code.h"

#define UMBB_SQUARE_DIGEST 16U /* bytes of a square's digest */

/* Record of a square. */
struct umbb_square_proof {
    uint8_t digest[UMBB_SQUARE_DIGEST]; /* Hash of the square's casters and voxels */
    uint64_t time_s;                    /* seconds since 1970 of the comparison; 0: no proof */
    uint32_t columns;                   /* rays cast, one a column; 0: points drawn at random */
    uint32_t points;                    /* points of the light that were drawn then */
};

/* Identity of a tile. */
struct umbb_tile_proof {
    uint8_t key[UMB_ID_BYTES];    /* tile_folder.h; zero: no tile */
    uint8_t result[UMB_ID_BYTES]; /* SHA-256 of umbb_tile_encode's bytes */
};

/* Records of one frustum. */
struct umbb_frustum_proofs {
    uint8_t place[UMB_ID_BYTES];     /* name of the record in the cache */
    uint32_t log2_size, tile_log2;   /* voxels a side of the frustum, texels a side of a tile */
    uint32_t square_log2;            /* texels a side of a square */
    uint64_t points;                 /* least points of a random check that is inherited */
    size_t tile_count, square_count; /* number of tiles; of squares in a tile */
    struct umbb_tile_proof *before, *now;    /* [tile_count] the record found; this bake's */
    struct umbb_square_proof *squares;       /* [tile_count][square_count] the record found */
    struct umbb_square_proof *squares_now;   /* [tile_count][square_count] this bake's */
    uint8_t *inherited;                      /* [tile_count] 1: same key, same result */
    uint8_t (**casters)[UMBB_SQUARE_DIGEST]; /* [tile_count] [square_count] digests of a tile's
                                                casters; NULL: inherited, or not known */
};

struct umbb_proofs {
    struct umbb_frustum_proofs *frusta; /* [frustum_count]; NULL: no proofs are kept */
    uint32_t frustum_count;
    struct umbb_tile_cache *cache; /* borrowed */
};

struct umbb_proofs_job {
    const struct umbb_analysis *analysis;
    uint32_t tile_log2;
    int occluder_depth; /* 1: tiles hold first occluders */
    uint64_t points;    /* points of a light that a random check would draw: a random check of fewer
                           is not inherited */
    size_t max_bytes;   /* limit of the memory of all records */
    struct umbb_tile_cache *cache;
};

/* Reads the records of all frusta. Above max_bytes, proofs->frusta is NULL. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_proofs_open(struct umbb_proofs *proofs,
                                             const struct umbb_proofs_job *job,
                                             struct umb_error *error);
void umbb_proofs_close(struct umbb_proofs *proofs);

/* Returns 1 if the record names another result for a tile's key. Equal keys have equal results, so
 * the result that was found is not what a bake wrote. */
int umbb_proofs_contradict(const struct umbb_frustum_proofs *proofs, uint32_t tile,
                           const uint8_t key[UMB_ID_BYTES], const uint8_t digest[UMB_ID_BYTES]);

/* Returns 1 if a record says that its square was compared as closely as this bake wants it. */
int umbb_square_is_proven(const struct umbb_frustum_proofs *proofs,
                          const struct umbb_square_proof *square);

/* Notes a tile that was found or baked. In: key: its name; digest: SHA-256 of umbb_tile_encode's
 * bytes. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status
umbb_proofs_note(struct umbb_frustum_proofs *proofs, const struct umbb_depth *depth,
                 const struct umbb_tile_place *place, const uint8_t key[UMB_ID_BYTES],
                 const uint8_t digest[UMB_ID_BYTES], struct umb_error *error);

/* Removes the results of all tiles that were not inherited: the self-check refused one of them. */
void umbb_proofs_refuse(const struct umbb_proofs *proofs);

/* Writes the records that changed. Fails: as umbb_tile_cache_write. */
UMB_CHECKED enum umb_status umbb_proofs_keep(const struct umbb_proofs *proofs,
                                             struct umb_error *error);

#endif
