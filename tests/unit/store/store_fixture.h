/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_STORE_FIXTURE_H
#define UMBRAGE_TESTS_STORE_FIXTURE_H
/* A temporary folder with small assets in it, for tests of the store and of what stands on it. */
#include <time.h>

#include "../common/folder_fixture.h"
#include "tool/output.h"
#include "common/sha256.h"
#include "store/store.h"
#include "make_asset.h"
#include "umbrage/query.h"

/* Everything before voxel `height` along the light is lit, plus a pattern, so that it has nodes. */
static inline int slab_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)frustum;
    return z < *(const uint32_t *)user + (x + y) % 3;
}

/* Writes a 64^3 asset whose surface lies near `height` voxels; gives its id. */
static inline void folder_asset(struct folder *folder, const char *file_name, uint32_t height,
                                uint8_t id[UMB_ID_BYTES])
{
    struct voxels voxels = {.lit = slab_lit, .user = &height, .log2_size = 6, .frustum_count = 1};
    const double origin[3] = {0, 0, 0};
    struct umb__octree octree;
    struct umb__content content;
    struct umbu_output file;
    make_octree(&voxels, &octree);
    make_content(&voxels, 1.0, origin, &content);
    assert_int_equal(umbu_output_begin(folder_file(folder, file_name), 0, &file, NULL), UMB_OK);
    struct umb_sink sink = umbu_output_sink(&file);
    assert_int_equal(umb__pack_write(&content, &octree, &umbs_sha256, &sink, id, NULL), UMB_OK);
    assert_int_equal(umbu_output_commit(&file, NULL), UMB_OK);
    umb__octree_finish(&octree);
}

/* Moves a file's time of change into the past, so that the store takes it for settled. */
static inline void folder_age(struct folder *folder, const char *name, long seconds)
{
    struct timespec times[2];
    clock_gettime(CLOCK_REALTIME, &times[0]);
    times[0].tv_sec -= seconds;
    times[1] = times[0];
    assert_int_equal(utimensat(AT_FDCWD, folder_file(folder, name), times, 0), 0);
}

/* Flips one bit of a file, in place. */
static inline void folder_flip(struct folder *folder, const char *name, long offset)
{
    FILE *file = fopen(folder_file(folder, name), "r+b");
    assert_non_null(file);
    assert_int_equal(fseek(file, offset, SEEK_SET), 0);
    int byte = fgetc(file);
    assert_true(byte >= 0);
    assert_int_equal(fseek(file, offset, SEEK_SET), 0);
    fputc(byte ^ 1, file);
    assert_int_equal(fclose(file), 0);
}

/* Answer of one point on the axis at voxel depth z: 1 lit. */
static inline int is_lit(const struct umb_asset *asset, float z)
{
    struct umb_query_settings settings = {
        .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    float position[3] = {32.5F, 32.5F, z};
    uint8_t value = 77;
    struct umb_query query;
    struct umb_points points = {.positions = position, .format = UMB_POINT_F32, .count = 1};
    struct umb_answers answers = {.values = &value};
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    umb_query_run(&query, &points, 0, 1, &answers);
    assert_true(value == 0 || value == 255);
    return value == 255;
}

#endif
