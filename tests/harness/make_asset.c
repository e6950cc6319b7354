/* SPDX-License-Identifier: Apache-2.0 */
/* See make_asset.h. */
#include "make_asset.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "format/node_pool.h"

static void demand(int ok, const char *what)
{
    if (!ok) {
        (void)fprintf(stderr, "harness: %s\n", what);
        abort();
    }
}

static enum umb_status append(void *user, const void *data, size_t count)
{
    struct bytes *bytes = user;
    demand(data != NULL, "a sink was given no address");
    if (bytes->size + count > bytes->capacity) {
        size_t capacity = (bytes->size + count) * 2 + 64;
        uint8_t *grown = aligned_alloc(64, (capacity + 63) / 64 * 64);
        if (!grown) {
            return UMB_E_NO_MEMORY;
        }
        if (bytes->size > 0) {
            memcpy(grown, bytes->data, bytes->size);
        }
        free(bytes->data);
        bytes->data = grown;
        bytes->capacity = capacity;
    }
    memcpy(bytes->data + bytes->size, data, count);
    bytes->size += count;
    return UMB_OK;
}

struct umb_sink bytes_sink(struct bytes *bytes)
{
    return (struct umb_sink){append, bytes};
}

void bytes_finish(struct bytes *bytes)
{
    free(bytes->data);
    memset(bytes, 0, sizeof *bytes);
}

static void digest(void *user, const void *const *parts, const size_t *sizes, size_t part_count,
                   uint8_t out[UMB_ID_BYTES])
{
    (void)user;
    for (uint64_t k = 0; k < 4; k++) {
        uint64_t hash = k;
        for (size_t i = 0; i < part_count; i++) {
            hash = XXH3_64bits_withSeed(parts[i], sizes[i], hash + k);
        }
        memcpy(out + 8 * k, &hash, sizeof hash);
    }
}

const struct umb_sha256 test_digest = {.digest = digest};

uint64_t next_random(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return *state * 0x2545f4914f6cdd1dU;
}

double random_unit(uint64_t *state)
{
    return (double)(next_random(state) >> 11) * 0x1p-53;
}

int case_count(int n)
{
    const char *text = getenv("UMBRAGE_CASES");
    const long asked = text != NULL ? strtol(text, NULL, 10) : 0;
    return asked > 0 && asked <= 100000000 ? (int)asked : n;
}

int short_count(int n, int few)
{
    return getenv("UMBRAGE_SHORT") != NULL ? few : n;
}

uint64_t round_seed(uint64_t seed)
{
    const char *text = getenv("UMBRAGE_ROUND");
    seed += text != NULL ? strtoull(text, NULL, 10) * 0x9e3779b97f4a7c15U : 0;
    (void)printf("seed %llu\n", (unsigned long long)seed);
    return seed;
}

struct cube {
    uint32_t frustum, level, x, y, z; /* in voxels */
};

static void build(const struct voxels *voxels, struct umb__pool *pool, struct cube cube,
                  uint32_t *ref)
{
    if (cube.level == UMB_LEVEL_BRICK) {
        uint64_t brick[8] = {0};
        for (uint32_t i = 0; i < 512; i++) {
            uint32_t x = i % 8, y = i / 8 % 8, z = i / 64;
            uint64_t lit =
                voxels->lit(voxels->user, cube.frustum, cube.x + x, cube.y + y, cube.z + z) != 0;
            brick[z] |= lit << (x + 8 * y);
        }
        demand(umb__pool_brick(pool, brick, ref, NULL) == UMB_OK, "brick");
        return;
    }
    uint32_t children[8];
    uint32_t half = 1U << (cube.level - 1);
    for (unsigned c = 0; c < 8; c++) {
        struct cube part = {cube.frustum, cube.level - 1, cube.x + (c & 1) * half,
                            cube.y + (c >> 1 & 1) * half, cube.z + (c >> 2) * half};
        build(voxels, pool, part, &children[c]);
    }
    demand(umb__pool_node(pool, cube.level, children, ref, NULL) == UMB_OK, "node");
}

enum {
    HARNESS_LIGHTS = 16
};

void make_octree(const struct voxels *voxels, struct umb__octree *octree)
{
    struct umb__pool pool;
    uint32_t refs[HARNESS_LIGHTS], levels[HARNESS_LIGHTS];
    demand(voxels->frustum_count <= HARNESS_LIGHTS, "too many lights");
    umb__pool_init(&pool, NULL, SIZE_MAX);
    for (uint32_t i = 0; i < voxels->frustum_count; i++) {
        struct cube whole = {i, voxels->log2_size, 0, 0, 0};
        levels[i] = voxels->log2_size;
        build(voxels, &pool, whole, &refs[i]);
    }
    demand(umb__pool_take(&pool, refs, levels, voxels->frustum_count, octree, NULL) == UMB_OK,
           "roots");
}

void make_content(const struct voxels *voxels, double voxel_m, const double origin[3],
                  struct umb__content *content)
{
    static struct umb_light_info lights[HARNESS_LIGHTS];
    static struct umb_frustum_info frusta[HARNESS_LIGHTS];
    static char plan[] = "effect=closed state=off reason=\"made for a test\" cost=\"none\"\n";
    static char settings[] = "resolution=test\n";
    static char notes[] = "writer=test\n";
    memset(lights, 0, sizeof lights);
    memset(frusta, 0, sizeof frusta);
    memset(content, 0, sizeof *content);
    for (uint32_t i = 0; i < voxels->frustum_count; i++) {
        (void)snprintf(lights[i].name, sizeof lights[i].name, "sun%u", i);
        lights[i].direction[2] = 1;
        lights[i].first_frustum = i;
        lights[i].frustum_count = 1;
        frusta[i].log2_size = voxels->log2_size;
        frusta[i].light = i;
        for (size_t k = 0; k < 3; k++) {
            frusta[i].world_to_voxel[k][k] = 1 / voxel_m;
        }
        frusta[i].world_to_voxel[3][3] = 1;
    }
    content->light_count = voxels->frustum_count;
    content->frustum_count = voxels->frustum_count;
    content->lights = lights;
    content->frusta = frusta;
    content->plan = plan;
    content->settings = settings;
    content->notes = notes;
    for (size_t k = 0; k < 3; k++) {
        content->origin[k] = origin[k];
        content->bounds.min[k] = origin[k];
        content->bounds.max[k] = origin[k] + voxel_m * (double)(1U << voxels->log2_size);
    }
}

struct bytes make_packed(const struct voxels *voxels, double voxel_m, const double origin[3])
{
    struct bytes bytes = {0};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(voxels, &octree);
    make_content(voxels, voxel_m, origin, &content);
    struct umb_sink sink = bytes_sink(&bytes);
    enum umb_status status = umb__pack_write(&content, &octree, &test_digest, &sink, id, &error);
    demand(status == UMB_OK, error.message);
    umb__octree_finish(&octree);
    return bytes;
}

struct bytes make_mapped(const struct bytes *packed)
{
    struct bytes bytes = {0};
    struct umb_asset *asset;
    struct umb_error error = {0};
    struct umb_sink sink = bytes_sink(&bytes);
    demand(umb_asset_open_bytes(packed->data, packed->size, NULL, &asset, &error) == UMB_OK,
           error.message);
    demand(umb__mapped_write(asset, &sink, &error) == UMB_OK, error.message);
    umb_asset_close(asset);
    return bytes;
}

int random_voxel(const void *log2_size, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const uint32_t log2 = *(const uint32_t *)log2_size;
    (void)frustum;
    uint64_t bits = (x | y << log2 | z << (2 * log2)) * 0x9e3779b97f4a7c15U;
    bits = (bits ^ (bits >> 29)) * 0xbf58476d1ce4e5b9U;
    return (int)(bits >> 40 & 1);
}
