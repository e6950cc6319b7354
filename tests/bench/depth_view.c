/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Computes the bytes that a 16-bit depth map of one view would take, to compare with fetched pages
 * (docs/results/paging.md).
 *
 *     depth_view ASSET.umb POINTS.f32 TAPS        points with normals, six floats each
 *
 * The map is made to measure: the depths of the asset's own texels, cropped to the rectangle that
 * the windows of the points facing the light meet, or to the blocks of 8 x 8 texels that some
 * window meets. Only a server that knows the points could do the latter. Each texel is coded as its
 * difference to the one before it, with low and high bytes apart or together, and compressed by
 * zstd at level 19. The smaller result counts. Prints one JSON object.
 * Of a closed asset the depths are where the tree turns to shadow: smoother than true ones.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#include "query/query_parts.h"
#include "query/voxel_tree.h"
#include "umbrage/asset.h"

enum {
    BLOCK = 8,
    ZSTD_LEVEL = 19
};

struct view {
    struct umb__query q;
    struct umb__tree tree;
    uint32_t size, half;     /* texels a side; half of a window */
    uint32_t x0, x1, y0, y1; /* inclusive: what windows meet */
    uint8_t *met;            /* [blocks a side squared] */
};

static uint32_t inside(double v, uint32_t size)
{
    return v <= 0 ? 0 : v >= size ? size - 1 : (uint32_t)v;
}

static void add_point(struct view *v, const struct umb_points *points, size_t i)
{
    double voxel[3];
    if (!umb__voxel_at(&v->q, points, i, voxel)) {
        return;
    }
    const uint32_t x0 = inside(floor(voxel[0]) - v->half, v->size);
    const uint32_t x1 = inside(floor(voxel[0]) + v->half, v->size);
    const uint32_t y0 = inside(floor(voxel[1]) - v->half, v->size);
    const uint32_t y1 = inside(floor(voxel[1]) + v->half, v->size);
    v->x0 = x0 < v->x0 ? x0 : v->x0;
    v->x1 = x1 > v->x1 ? x1 : v->x1;
    v->y0 = y0 < v->y0 ? y0 : v->y0;
    v->y1 = y1 > v->y1 ? y1 : v->y1;
    for (uint32_t y = y0 / BLOCK; y <= y1 / BLOCK; y++) {
        for (uint32_t x = x0 / BLOCK; x <= x1 / BLOCK; x++) {
            v->met[(size_t)y * (v->size / BLOCK) + x] = 1;
        }
    }
}

/* Returns the number of voxels before the first shadowed one of each column, in 16 bits. */
static uint16_t depth_of(const struct view *v, uint32_t x, uint32_t y)
{
    struct umb_volume_stats stats = {0};
    uint32_t z = 0;
    while (z < v->size) {
        const struct umb__place place = umb__tree_locate(&v->tree, x, y, z, &stats);
        if (place.brick ? !umb__brick_voxel(place.brick, x, y, z) : !place.lit) {
            break;
        }
        z = place.brick ? z + 1 : ((z >> place.level) + 1) << place.level;
    }
    return (uint16_t)(v->tree.log2_size > 16 ? z >> (v->tree.log2_size - 16) : z);
}

/* Codes depths block by block and row by row, each as its difference to its left or upper
 * neighbour. */
static size_t code_blocks(const struct view *v, int only_met, uint16_t *out)
{
    size_t count = 0;
    uint16_t before = 0;
    for (uint32_t by = v->y0 / BLOCK; by <= v->y1 / BLOCK; by++) {
        for (uint32_t bx = v->x0 / BLOCK; bx <= v->x1 / BLOCK; bx++) {
            uint16_t depth[BLOCK * BLOCK];
            if (only_met && !v->met[(size_t)by * (v->size / BLOCK) + bx]) {
                continue;
            }
            for (uint32_t i = 0; i < BLOCK * BLOCK; i++) {
                depth[i] = depth_of(v, bx * BLOCK + i % BLOCK, by * BLOCK + i / BLOCK);
                const uint16_t near = i % BLOCK ? depth[i - 1] : i ? depth[i - BLOCK] : before;
                out[count++] = (uint16_t)(depth[i] - near);
            }
            before = depth[0];
        }
    }
    return count;
}

static size_t compressed(const void *bytes, size_t size)
{
    const size_t room = ZSTD_compressBound(size);
    void *out = malloc(room);
    const size_t length = out ? ZSTD_compress(out, room, bytes, size, ZSTD_LEVEL) : 0;
    free(out);
    return length;
}

static size_t map_bytes(const struct view *v, int only_met)
{
    const size_t wide = v->x1 / BLOCK - v->x0 / BLOCK + 1, tall = v->y1 / BLOCK - v->y0 / BLOCK + 1;
    uint16_t *coded = malloc(wide * tall * BLOCK * BLOCK * sizeof *coded);
    uint8_t *split = malloc(wide * tall * BLOCK * BLOCK * sizeof *coded);
    if (!coded || !split) {
        exit(75);
    }
    const size_t count = code_blocks(v, only_met, coded);
    for (size_t i = 0; i < count; i++) {
        split[i] = (uint8_t)coded[i];
        split[count + i] = (uint8_t)(coded[i] >> 8);
    }
    const size_t whole = compressed(coded, count * sizeof *coded);
    const size_t parts = compressed(split, count * sizeof *coded);
    free(coded);
    free(split);
    return whole < parts ? whole : parts;
}

static float *read_points(const char *path, size_t *count)
{
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END) != 0) {
        return NULL;
    }
    *count = (size_t)ftell(file) / 24;
    rewind(file);
    float *raw = malloc(*count * 24 + 1), *apart = malloc(*count * 24 + 1);
    if (!raw || !apart || fread(raw, 24, *count, file) != *count) {
        return NULL;
    }
    for (size_t i = 0; i < *count; i++) { /* positions, then normals */
        memcpy(apart + 3 * i, raw + 6 * i, 12);
        memcpy(apart + 3 * (*count + i), raw + 6 * i + 3, 12);
    }
    free(raw);
    (void)fclose(file);
    return apart;
}

int main(int argc, char **argv)
{
    struct umb_asset *asset;
    struct umb_error error;
    struct umb_query query;
    size_t count;
    float *points = argc == 4 ? read_points(argv[2], &count) : NULL;
    if (!points) {
        (void)fprintf(stderr, "usage: depth_view ASSET.umb POINTS.f32 TAPS\n");
        return 2;
    }
    const struct umb_query_settings settings = {.taps = (uint32_t)strtoul(argv[3], NULL, 10)};
    if (umb_asset_open_file(argv[1], NULL, &asset, &error) != UMB_OK ||
        umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        (void)fprintf(stderr, "depth_view: %s\n", error.message);
        return 65;
    }
    struct view v = {.x0 = UINT32_MAX, .y0 = UINT32_MAX};
    memcpy(&v.q, query.opaque, sizeof v.q);
    v.tree = (struct umb__tree){.grid = v.q.grid,
                                .nodes = v.q.nodes,
                                .bricks = v.q.bricks,
                                .log2_size = v.q.log2_size,
                                .grid_log2 = v.q.grid_log2};
    v.size = 1U << v.q.log2_size;
    v.half = settings.taps / 2;
    v.met = calloc(v.size / BLOCK, v.size / BLOCK);
    const struct umb_points batch = {.positions = points,
                                     .normals = points + 3 * count,
                                     .format = UMB_POINT_F32,
                                     .count = count};
    for (size_t i = 0; v.met && i < count; i++) {
        add_point(&v, &batch, i);
    }
    if (v.x0 > v.x1 || !v.met) {
        (void)fprintf(stderr, "depth_view: no point faces the light\n");
        return 65;
    }
    (void)printf("{\"width\":%u,\"height\":%u,\"rectangle_bytes\":%zu,\"blocks_bytes\":%zu}\n",
                 v.x1 - v.x0 + 1, v.y1 - v.y0 + 1, map_bytes(&v, 0), map_bytes(&v, 1));
    free(v.met);
    free(points);
    umb_asset_close(asset);
    return 0;
}
