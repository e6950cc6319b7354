/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_PARTIAL_FIXTURE_H
#define UMBRAGE_TESTS_PARTIAL_FIXTURE_H
/*
 * A packed asset of some dozen pages in memory, whole and as a partial asset of which a test adds
 * pages as it likes; two lights in a turned frame.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/compat.h"
#include "format/layout.h"
#include "make_asset.h"
#include "umbrage/partial.h"
#include "volume_fixture.h"

#if UMB__SANITIZED
#define PARTIAL_POINTS 100000U
#else
#define PARTIAL_POINTS 1000000U
#endif

/* Blocks under a cloud of noise: below a certain height voxels are lit; above it they are
 * random. */
static inline int partial_scene(const void *user, uint32_t frustum, uint32_t x, uint32_t y,
                                uint32_t z)
{
    (void)user;
    const uint64_t coarse = fixture_hash(x / 16, y / 16, frustum);
    const uint32_t height = 20 + (uint32_t)(coarse % 200);
    return z < height || (z < height + 90 && (fixture_hash(x, y, z) & 3) == 0);
}

struct partial_fixture {
    struct bytes file;
    struct umb_asset *whole;
    struct umb_partial *partial;
    struct umb_frustum_info frustum;
    uint32_t page_count;
    float *truth, *values, *low, *high, *error_m; /* [PARTIAL_POINTS] */
    double *points;                               /* [3 * PARTIAL_POINTS] minus fixture_origin */
    float *normals;
};

static inline struct umb_partial *partial_open(const struct bytes *file, uint64_t budget)
{
    const struct umb_partial_options options = {.sha256 = &test_digest, .max_memory_bytes = budget};
    struct umb_error error = {0};
    struct umb_partial *partial;
    if (umb_partial_open(file->data, file->size, &options, &partial, &error) != UMB_OK) {
        fail_msg("open: %s", error.message);
    }
    struct umb_partial_stats stats;
    umb_partial_get_stats(partial, &stats);
    for (uint32_t block = stats.blocks_held; block < stats.block_count; block++) {
        uint64_t offset;
        uint32_t length;
        umb_partial_locate_block(partial, block, &offset, &length);
        if (umb_partial_add_block(partial, block, file->data + offset, length, &error) != UMB_OK) {
            fail_msg("open: %s", error.message);
        }
    }
    return partial;
}

static inline const uint8_t *partial_page(const struct partial_fixture *f, uint32_t page,
                                          uint32_t *length)
{
    uint64_t offset;
    (void)umb_partial_locate(f->partial, page, &offset, length);
    return f->file.data + offset;
}

static inline void partial_add(struct partial_fixture *f, uint32_t page)
{
    struct umb_error error = {0};
    uint32_t length;
    const uint8_t *stored = partial_page(f, page, &length);
    if (umb_partial_add(f->partial, page, stored, length, &error) != UMB_OK) {
        fail_msg("page %u: %s", page, error.message);
    }
}

static inline void partial_build(struct partial_fixture *f)
{
    struct umb_error error = {0};
    if (umb_partial_build(f->partial, &error) != UMB_OK) {
        fail_msg("build: %s", error.message);
    }
}

/* Random points in and around the frustum, every third with a normal. */
static inline void partial_points(struct partial_fixture *f)
{
    uint64_t seed = 4711;
    for (size_t i = 0; i < PARTIAL_POINTS; i++) {
        double voxel[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            voxel[axis] = (random_unit(&seed) * 1.06 - 0.03) * (double)(1U << f->frustum.log2_size);
        }
        for (unsigned axis = 0; axis < 3; axis++) {
            double world = 0;
            for (unsigned k = 0; k < 3; k++) {
                world +=
                    (voxel[k] - f->frustum.world_to_voxel[k][3]) * f->frustum.voxel_step[k][axis];
            }
            f->points[3 * i + axis] = world;
            f->normals[3 * i + axis] = i % 3 ? 0.0F : (float)(random_unit(&seed) - 0.5);
        }
    }
}

static inline void partial_fixture_open_size(struct partial_fixture *f, uint32_t log2_size,
                                             uint64_t budget)
{
    const struct voxels voxels = {partial_scene, NULL, log2_size, 2};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    struct umb_partial_stats stats;
    uint8_t id[UMB_ID_BYTES];
    memset(f, 0, sizeof *f);
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.25, fixture_origin, &content);
    fixture_turn(&content.frusta[0]);
    struct umb_sink sink = bytes_sink(&f->file);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK ||
        umb_asset_open_bytes(f->file.data, f->file.size, NULL, &f->whole, &error) != UMB_OK ||
        umb_asset_get_frustum(f->whole, 0, &f->frustum) != UMB_OK) {
        fail_msg("fixture: %s", error.message);
    }
    umb__octree_finish(&octree);
    f->partial = partial_open(&f->file, budget);
    umb_partial_get_stats(f->partial, &stats);
    f->page_count = stats.page_count;
    f->truth = calloc(PARTIAL_POINTS, 4);
    f->values = calloc(PARTIAL_POINTS, 4);
    f->low = calloc(PARTIAL_POINTS, 4);
    f->high = calloc(PARTIAL_POINTS, 4);
    f->error_m = calloc(PARTIAL_POINTS, 4);
    f->points = calloc(PARTIAL_POINTS, 24);
    f->normals = calloc(PARTIAL_POINTS, 12);
    partial_points(f);
}

static inline void partial_fixture_open(struct partial_fixture *f, uint64_t budget)
{
    partial_fixture_open_size(f, 8, budget);
}

static inline void partial_fixture_close(struct partial_fixture *f)
{
    umb_partial_close(f->partial);
    umb_asset_close(f->whole);
    bytes_finish(&f->file);
    free(f->truth);
    free(f->values);
    free(f->low);
    free(f->high);
    free(f->error_m);
    free(f->points);
    free(f->normals);
}

/* Queries the whole and the partial asset; returns how many of the first `count` points are exact.
 * Checks all promises that hold at any time. */
static inline uint64_t partial_compare(struct partial_fixture *f,
                                       const struct umb_query_settings *s, size_t count, int want)
{
    struct umb_points points = {.positions = f->points,
                                .format = UMB_POINT_F64,
                                .origin = {fixture_origin[0], fixture_origin[1], fixture_origin[2]},
                                .normals = f->normals,
                                .count = count};
    struct umb_partial_answers answers = {
        .values = f->values, .low = f->low, .high = f->high, .error_m = f->error_m};
    struct umb_answers truth = {.values = f->truth};
    struct umb_error error = {0};
    struct umb_query query;
    if (umb_query_prepare(f->whole, s, &query, &error) != UMB_OK ||
        umb_partial_query(f->partial, s, &points, want, &answers, &error) != UMB_OK) {
        fail_msg("query: %s", error.message);
    }
    umb_query_run(&query, &points, 0, count, &truth);
    uint64_t exact = 0;
    for (size_t i = 0; i < count; i++) {
        if (!(f->low[i] <= f->truth[i] && f->truth[i] <= f->high[i] && f->low[i] <= f->values[i] &&
              f->values[i] <= f->high[i])) {
            fail_msg("point %zu: truth %g, %g between %g and %g", i, (double)f->truth[i],
                     (double)f->values[i], (double)f->low[i], (double)f->high[i]);
        }
        if ((f->error_m[i] > 0) != (f->low[i] < f->high[i])) {
            fail_msg("point %zu: error %g m, %g to %g", i, (double)f->error_m[i], (double)f->low[i],
                     (double)f->high[i]);
        }
        exact += f->low[i] >= f->high[i];
    }
    assert_int_equal(exact, answers.exact);
    return exact;
}

#endif
