/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_MAKE_ASSET_H
#define UMBRAGE_TESTS_MAKE_ASSET_H
/*
 * Makes small assets straight from voxels, without a bake: a function says which voxels are lit, an
 * octree is built bottom-up with equal nodes merged, and it is packed into memory.
 */
#include <stddef.h>
#include <stdint.h>
#include "format/content.h"

/* 1 if voxel (x, y, z) of frustum `frustum` is lit. */
typedef int (*voxel_fn)(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z);

struct voxels {
    voxel_fn lit;
    const void *user;
    uint32_t log2_size;
    uint32_t frustum_count; /* one directional light each */
};

/* A growing byte string. */
struct bytes {
    uint8_t *data;
    size_t size, capacity;
};
struct umb_sink bytes_sink(struct bytes *bytes);
void bytes_finish(struct bytes *bytes);

/* A digest for tests that need no real SHA-256: 32 bytes of XXH3. */
extern const struct umb_sha256 test_digest;

/* xorshift64*; any seed but 0. */
uint64_t next_random(uint64_t *state);
double random_unit(uint64_t *state); /* [0, 1) */

/* Random bits for struct voxels. If a point is placed in a wrong voxel, its answer is wrong with a
 * probability of one half. In: log2_size: uint32_t, of the voxels a side. */
int random_voxel(const void *log2_size, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z);

/* Returns how many random cases to try: UMBRAGE_CASES if it is set (long runs: make numerics), else
 * n. */
int case_count(int n);

/* Returns the number of cases of a slow test: `few` if UMBRAGE_SHORT is set, else n. `make test`
 * sets it for sanitizer builds; the release build runs all cases. */
int short_count(int n, int few);

/* Returns a seed, and prints it. It differs between the rounds of a long run (UMBRAGE_ROUND). */
uint64_t round_seed(uint64_t seed);

/* Builds the octree of `voxels`; finish with umb__octree_finish. Aborts the test on failure. */
void make_octree(const struct voxels *voxels, struct umb__octree *octree);

/*
 * Content whose light i travels along +z of a frame where one voxel is voxel_m metres, with the
 * scene origin at `origin`; voxel space is (world - origin) / voxel_m. Static storage inside.
 */
void make_content(const struct voxels *voxels, double voxel_m, const double origin[3],
                  struct umb__content *content);

/* Packs voxels; returns the file's bytes. */
struct bytes make_packed(const struct voxels *voxels, double voxel_m, const double origin[3]);

/* The mapped form of a packed file; data is 64-byte aligned. */
struct bytes make_mapped(const struct bytes *packed);

#endif
