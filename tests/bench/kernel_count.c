/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Runs one kernel over one small batch, so that valgrind can count the instructions
 * (tests/system/test_kernel_counts.sh).
 *
 *     kernel_count write FILE             makes the asset, in its mapped form
 *     kernel_count run FILE KERNEL TAPS   answers the points; KERNEL is a row of KERNELS, or query:
 *                                         by umb_query_run, as a program does. Footprints are FAR
 *                                         windows wide.
 *
 * The ground repeats every 32 texels, so that the asset is small, its grid coarse and every stage
 * of a kernel has work; the points run over it line by line, a few voxels above and below.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "query/kernels.h"

enum {
    LOG2 = 8,
    SIZE = 1 << LOG2,
    SIDE = 64
};

static const double voxel_m = 0.5;
static const double origin[3] = {0, 0, 0};

static uint32_t height(uint32_t x, uint32_t y)
{
    return SIZE / 2 + (x % 32 * 5 + y % 32 * 3) % 11 + 8 * (x % 32 / 20);
}

static int ground(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < height(x, y);
}

/* Turns light 1 into a spot light 64 voxels before the frustum, whose slices of depth are those of
 * the sun. */
static void set_spot(struct umb__content *content)
{
    const double half = 0.5 * SIZE, before = 64, tangent = 0.7;
    double(*m)[4] = content->frusta[1].world_to_voxel;
    content->lights[1].kind = UMB_LIGHT_SPOT;
    content->lights[1].position[0] = content->lights[1].position[1] = half * voxel_m;
    content->lights[1].position[2] = -before * voxel_m;
    memset(m, 0, sizeof content->frusta[1].world_to_voxel);
    for (int i = 0; i < 2; i++) {
        m[i][i] = half / tangent;
        m[i][2] = half;
        m[i][3] = half * (before - half / tangent) * voxel_m;
    }
    m[2][2] = 1 / voxel_m;
    m[3][2] = 1;
    m[3][3] = before * voxel_m;
}

static int write_asset(const char *path)
{
    const struct voxels voxels = {ground, NULL, LOG2, 2};
    struct bytes packed = {0};
    struct umb_sink sink = bytes_sink(&packed);
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, voxel_m, origin, &content);
    set_spot(&content);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    umb__octree_finish(&octree);
    struct bytes mapped = make_mapped(&packed);
    FILE *file = fopen(path, "wb");
    int ok = file && fwrite(mapped.data, 1, mapped.size, file) == mapped.size;
    ok = file && fclose(file) == 0 && ok;
    bytes_finish(&mapped);
    bytes_finish(&packed);
    return ok ? 0 : 1;
}

static void make_points(float points[][3])
{
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        uint32_t x = 12 + i % SIDE * 7 / 2, y = 12 + i / SIDE * 7 / 2;
        float above = (float)(i * 2654435761U >> 28) - 12; /* voxels */
        points[i][0] = ((float)x + 0.5F) * (float)voxel_m;
        points[i][1] = ((float)y + 0.5F) * (float)voxel_m;
        points[i][2] = ((float)height(x, y) + above) * (float)voxel_m;
    }
}

#define FAR 12 /* Footprints in windows: between two levels above the window */

static const struct row {
    const char *name;
    enum umb_filter filter;
    umb__kernel *run; /* NULL: the query's own, with these kernels of footprints */
    struct umb__kernels kernels;
    bool lamp; /* True: the spot light, and points with normals; false: the sun */
} KERNELS[] = {
    {"base", UMB_FILTER_BOX, umb__kernel_base, {0}, false},
    {"avx2", UMB_FILTER_BOX, umb__kernel_avx2, {0}, false},
    {"tent_base", UMB_FILTER_TENT, umb__tent_base, {0}, false},
    {"tent_avx2", UMB_FILTER_TENT, umb__tent_avx2, {0}, false},
    {"penumbra", UMB_FILTER_PENUMBRA, umb__kernel_penumbra, {0}, false},
    {"footprint_base",
     UMB_FILTER_FOOTPRINT,
     NULL,
     {.receivers = umb__receivers_base, .squares = umb__squares_base},
     false},
    {"footprint_avx2",
     UMB_FILTER_FOOTPRINT,
     NULL,
     {.receivers = umb__receivers_avx2, .squares = umb__squares_avx2},
     false},
    {"lamp_footprint_base",
     UMB_FILTER_FOOTPRINT,
     NULL,
     {.receivers = umb__receivers_base, .squares = umb__squares_base},
     true},
    {"lamp_footprint_avx2",
     UMB_FILTER_FOOTPRINT,
     NULL,
     {.receivers = umb__receivers_avx2, .squares = umb__squares_avx2},
     true},
    {"lamp_query", UMB_FILTER_BOX, NULL, {0}, true},
    {"query", UMB_FILTER_BOX, NULL, {0}, false},
};

static const struct row *row_of(const char *name)
{
    const struct row *row = KERNELS, *last = KERNELS + sizeof KERNELS / sizeof KERNELS[0] - 1;
    while (row < last && strcmp(row->name, name) != 0) {
        row++;
    }
    return row;
}

static int run(const char *path, const char *kernel, uint32_t taps)
{
    static float points[SIDE * SIDE][3], normals[SIDE * SIDE][3], values[SIDE * SIDE];
    const struct row *row = row_of(kernel);
    struct umb_open_options options = {.trust = UMB_TRUST_VALIDATED};
    struct umb_query_settings settings = {.taps = taps, .filter = row->filter};
    settings.light = row->lamp ? 1 : 0;
    settings.bias_mode = row->lamp ? UMB_BIAS_AUTO : UMB_BIAS_NONE;
    settings.light_extent = row->filter == UMB_FILTER_PENUMBRA ? 0.1 : 0;
    settings.footprint_m = row->filter == UMB_FILTER_FOOTPRINT ? FAR * taps * voxel_m : 0;
    struct umb_asset *asset;
    struct umb_query query;
    struct umb_error error;
    if (umb_asset_open_file(path, &options, &asset, &error) != UMB_OK ||
        umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    make_points(points);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        normals[i][2] = -1;
    }
    struct umb_points batch = {
        .positions = points, .normals = row->lamp ? normals : NULL, .count = SIDE * SIDE};
    struct umb_answers answers = {.values = values};
    struct umb__query q;
    memcpy(&q, query.opaque, sizeof q);
    q.kernels = row->filter == UMB_FILTER_FOOTPRINT ? &row->kernels : q.kernels;
    memcpy(query.opaque, &q, sizeof q);
    if (row->run != NULL) {
        row->run(&q, &batch, 0, batch.count, &answers);
    } else {
        umb_query_run(&query, &batch, 0, batch.count, &answers);
    }
    printf("points=%llu bricks=%llu\n", (unsigned long long)answers.stats.points,
           (unsigned long long)answers.stats.bricks);
    umb_asset_close(asset);
    return 0;
}

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "write") == 0) {
        return write_asset(argv[2]);
    }
    if (argc == 5 && strcmp(argv[1], "run") == 0) {
        return run(argv[2], argv[3], (uint32_t)strtoul(argv[4], NULL, 10));
    }
    (void)fprintf(stderr, "usage: kernel_count write FILE | run FILE KERNEL TAPS\n");
    return 2;
}
