/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_NANOVDB_PEER_H
#define UMBRAGE_SERVER_STUDY_NANOVDB_PEER_H
/*
 * A peer of the study, that is another program's method to compare with: NanoVDB's mask grid, a
 * sparse volume, over the voxels of an asset, with the look-ups that its users write.
 *
 * A voxel that is on is shadowed. Mixed blocks of 8^3 voxels are leaves with a mask of 64 bytes;
 * blocks and squares of blocks that are shadowed throughout are tiles.
 *
 * The code is written for speed. Vectors transform points in blocks of 64. Single taps go through
 * the tree or an accessor, whichever is faster. Windows go through an accessor tap by tap or, with
 * UMBT_NANOVDB_LEAVES, leaf by leaf with a popcount a row: the library has no such call, but its
 * layout allows it.
 */
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct umbt_nanovdb;

/* Returns 1 if this build has the library; else no grid can be made (nanovdb_absent.c). */
int umbt_nanovdb_is_built(void);

/* Returns the state of the block of 8^3 voxels at (8 x, 8 y, 8 z): 0 shadowed, 1 lit, 2 mixed.
 * slices, set if mixed: slices[k] is the slice at depth k, with bit x + 8 * y set if lit. */
typedef int (*umbt_nanovdb_block_fn)(const void *user, uint32_t x, uint32_t y, uint32_t z,
                                     uint64_t slices[8]);

/* Makes a grid of 2^log2_size voxels a side. world: transform to voxels of points relative to the
 * asset's origin. Returns NULL if the grid could not be made. */
struct umbt_nanovdb *umbt_nanovdb_make(uint32_t log2_size, const double world[3][4],
                                       umbt_nanovdb_block_fn block, const void *user);
void umbt_nanovdb_destroy(struct umbt_nanovdb *peer);
size_t umbt_nanovdb_bytes(const struct umbt_nanovdb *peer);

enum umbt_nanovdb_way {
    UMBT_NANOVDB_TREE = 0, /* look-ups from the root; single taps only */
    UMBT_NANOVDB_ACCESSOR, /* look-ups by the library's accessor */
    UMBT_NANOVDB_LEAVES,   /* counts leaf by leaf; windows only */
    UMBT_NANOVDB_WAYS,
};

/* A query: answers[i] is the lit share of the taps x taps window around point i. */
struct umbt_nanovdb_query {
    const struct umbt_nanovdb *peer;
    const float *points; /* [3 * count] */
    size_t count;
    int taps; /* 1, 3, 5, 9 or 17 */
    enum umbt_nanovdb_way way;
    float *answers; /* [count] */
};

void umbt_nanovdb_run(const struct umbt_nanovdb_query *query);

#ifdef __cplusplus
}
#endif

#endif
