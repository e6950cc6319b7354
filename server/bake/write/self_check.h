/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_SELF_CHECK_H
#define UMBRAGE_SERVER_BAKE_WRITE_SELF_CHECK_H
/*
 * The self-check of a bake: an opened asset against traced rays.
 *
 * Without records of earlier bakes, points are drawn at random in the whole asset. With records
 * (tiles/proofs.h), tiles and squares that were compared before as closely, from the same casters
 * and with the same voxels, are left out. In the others every voxel is compared
 * (rays/verify_squares.h), which finds one wrong voxel for certain. If that would trace more than
 * four columns for each point of the random check, the random check is made.
 */
#include "bake/tiles/proofs.h"
#include "rays/verify.h"

/* Reference for an asset. */
struct umbb_check {
    const double (*corners)[3][3]; /* world */
    const uint8_t *closed;         /* [count] not 0: of a closed part; NULL: no closed rule */
    const struct umbs_cuts *cuts;  /* `of`: [count] */
    size_t count;
    size_t open_on_word; /* parts that --closed on treats as closed and that are open */
    uint64_t points;     /* points of all lights together; 0 = open and validate only */
    unsigned threads;
    int quiet; /* no progress on a terminal */
    uint64_t max_memory_bytes;
    struct umbb_proofs *proofs; /* records to use and to fill in; NULL: none */
};

/* What the self-check compared and what it inherited. */
struct umbb_checked {
    struct umbr_verify_result verified; /* sums; zero if it was not requested */
    int sampled;                        /* 1: points were drawn in the whole asset */
    uint64_t tiles, tiles_inherited;    /* tiles; tiles that earlier bakes compared */
    uint64_t squares;           /* squares of other tiles that were compared voxel by voxel */
    uint64_t columns;           /* columns traced for them */
    uint64_t squares_inherited; /* squares of other tiles that earlier bakes compared */
    uint64_t oldest_s;          /* seconds since 1970 of the oldest comparison inherited; 0: none */
};

/* Returns the points of a random check for each light: an equal share of `points`, but enough to
 * reveal a wrong matrix. In: lights: at least 1. */
uint64_t umbb_check_points(uint64_t points, uint32_t lights);

/*
 * Compares the part of an asset that no earlier bake compared.
 *
 * In:    asset: needs the voxels of tiles that were not inherited, and of the eight tiles around
 *        each of them (write/octree_part.h).
 * Out:   checked: zeroed first; also set on failure, as far as known. check->proofs: records of
 *        this bake. sample: 1 if random points must be compared, too: there are no records, or too
 *        much is to be compared.
 * Fails: E_INTERNAL if the asset disagrees with rays outside the band of one voxel (how many, and
 *        where), E_BAD_SCENE if it disagrees with open_on_word parts; E_NO_MEMORY, E_CANCELLED, and
 *        the errors of umbr_rays_build.
 */
UMB_CHECKED enum umb_status umbb_self_check_part(const struct umb_asset *asset,
                                                 const struct umbb_check *check,
                                                 struct umbb_checked *checked, int *sample,
                                                 struct umb_error *error);

/* Compares random points of a whole asset, and notes them in check->proofs. Out: checked: as
 * umbb_self_check_part left it, with the points added. Fails: as umbb_self_check_part. */
UMB_CHECKED enum umb_status umbb_self_check_points(const struct umb_asset *asset,
                                                   const struct umbb_check *check,
                                                   struct umbb_checked *checked,
                                                   struct umb_error *error);

#endif
