/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_VOLUME_FIXTURE_H
#define UMBRAGE_TESTS_VOLUME_FIXTURE_H
/*
 * An asset made from voxels for tests of segments, columns and boxes: uniform cubes of every level
 * and noise, in a frame along the axes (where voxel boundaries are met exactly) or turned.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/volume.h"

static const double fixture_origin[3] = {1000000.5, -5, 12};

struct volume_fixture {
    struct bytes file;
    struct umb_asset *asset;
    struct umb_volume volume;
    struct umb_frustum_info frustum;
    uint32_t size;
    uint8_t *lit; /* [size^3], x fastest */
};

static inline uint64_t fixture_hash(uint64_t x, uint64_t y, uint64_t z)
{
    uint64_t h = x * 0x9e3779b97f4a7c15U ^ y * 0xc2b2ae3d27d4eb4fU ^ z * 0x165667b19e3779f9U;
    h = (h ^ h >> 31) * 0xbf58476d1ce4e5b9U;
    return h ^ h >> 29;
}

/* Cubes of 32, 16, 8 and 2 voxels that are lit or shadowed, and single voxels. */
static inline int fixture_noise(const void *user, uint32_t frustum, uint32_t x, uint32_t y,
                                uint32_t z)
{
    (void)user;
    (void)frustum;
    for (uint32_t level = 5; level >= 3; level--) {
        uint64_t h = fixture_hash(x >> level, y >> level, (z >> level) + level * 1000);
        if (h % 8 < 3) {
            return h >> 8 & 1;
        }
    }
    uint32_t fine = fixture_hash(x >> 3, y >> 3, z >> 3) >> 20 & 1;
    return fixture_hash(x >> fine, y >> fine, z >> fine) >> 10 & 1;
}

/* An open scene: hills, lit down to the first occluder. */
static inline int fixture_hills(const void *user, uint32_t frustum, uint32_t x, uint32_t y,
                                uint32_t z)
{
    (void)user;
    (void)frustum;
    uint32_t height = 20 + (x * 7 + y * 3) % 13 + (x / 16 * 5 + y / 16 * 11) % 40;
    return x % 29 == 3 || z < height;
}

/* Turns the frame by a fixed rotation and gives its axes different voxel sizes. */
static inline void fixture_turn(struct umb_frustum_info *frustum)
{
    static const double rows[3][3] = {{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}};
    static const double voxel_m[3] = {0.3, 0.21, 0.47};
    static const double middle[3] = {5, 7, 9};
    for (unsigned i = 0; i < 3; i++) {
        double at = 0.5 * (double)(1U << frustum->log2_size);
        for (unsigned k = 0; k < 3; k++) {
            frustum->world_to_voxel[i][k] = rows[i][k] / voxel_m[i];
            at -= frustum->world_to_voxel[i][k] * middle[k];
        }
        frustum->world_to_voxel[i][3] = at;
    }
}

static inline void volume_fixture_open(struct volume_fixture *f, voxel_fn lit, uint32_t log2_size,
                                       int turned, int closed)
{
    struct voxels voxels = {lit, NULL, log2_size, 1};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    memset(f, 0, sizeof *f);
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.25, fixture_origin, &content);
    content.frusta[0].closed = closed;
    if (turned) {
        fixture_turn(&content.frusta[0]);
    }
    struct umb_sink sink = bytes_sink(&f->file);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK ||
        umb_asset_open_bytes(f->file.data, f->file.size, NULL, &f->asset, &error) != UMB_OK ||
        umb_asset_get_frustum(f->asset, 0, &f->frustum) != UMB_OK ||
        umb_volume_prepare(f->asset, 0, &f->volume, &error) != UMB_OK) {
        (void)fprintf(stderr, "fixture: %s\n", error.message);
        abort();
    }
    umb__octree_finish(&octree);
    f->size = 1U << log2_size;
    f->lit = malloc((size_t)f->size * f->size * f->size);
    for (uint32_t z = 0; z < f->size; z++) {
        for (uint32_t y = 0; y < f->size; y++) {
            for (uint32_t x = 0; x < f->size; x++) {
                f->lit[x + (size_t)f->size * (y + (size_t)f->size * z)] =
                    (uint8_t)(lit(NULL, 0, x, y, z) != 0);
            }
        }
    }
}

static inline void volume_fixture_close(struct volume_fixture *f)
{
    umb_asset_close(f->asset);
    bytes_finish(&f->file);
    free(f->lit);
}

/* Returns the state of a voxel, also outside the frustum by the rules for that space. */
static inline int fixture_voxel(const struct volume_fixture *f, int64_t x, int64_t y, int64_t z)
{
    int64_t size = f->size;
    if (x < 0 || x >= size || y < 0 || y >= size || z < 0) {
        return 1;
    }
    z = z >= size ? size - 1 : z;
    return f->lit[(size_t)x + f->size * ((size_t)y + f->size * (size_t)z)];
}

/* Computes the world position, minus the asset's origin, of a voxel-space position. */
static inline void fixture_world(const struct volume_fixture *f, const double v[3], double p[3])
{
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] = 0;
        for (unsigned k = 0; k < 3; k++) {
            p[axis] += (v[k] - f->frustum.world_to_voxel[k][3]) * f->frustum.voxel_step[k][axis];
        }
    }
}

static inline void fixture_voxel_of(const struct volume_fixture *f, const double p[3], double v[3])
{
    for (unsigned k = 0; k < 3; k++) {
        const double *m = f->frustum.world_to_voxel[k];
        v[k] = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
    }
}

#endif
