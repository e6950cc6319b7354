/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile asset files: open, validate, query, export, pack again. The first byte picks how the rest
 * is used, because checksums would stop a fuzzer at the door:
 *   0  the file as it is
 *   1  a mapped file whose section and head checksums are made right
 *   2  raw pages (u16 length, bytes, ...) in an otherwise right packed file
 */
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "format/layout.h"
#include "fuzz_gpu.h"
#include "fuzz_pages.h"
#include "make_asset.h"
#include "umbrage/query.h"
#include "umbrage/sample.h"
#include "umbrage/volume.h"

enum {
    MAX_FILE = 1 << 20
};

static void query_everywhere(const struct umb_asset *asset)
{
    struct umb_query_settings settings = {.taps = 17, .format = UMB_ANSWER_U8};
    struct umb_query_settings point = {.taps = 1};
    struct umb_query_settings tent = {.taps = 9, .filter = UMB_FILTER_TENT};
    struct umb_query_settings soft = {.filter = UMB_FILTER_PENUMBRA, .light_extent = 0.05};
    struct umb_query_settings patch = {.filter = UMB_FILTER_FOOTPRINT, .pixel_rad = 0.1};
    struct umb_query query;
    double points[64][3];
    uint8_t values[64];
    uint64_t seed = 99;
    struct umb_frustum_info frustum;
    if (umb_query_prepare(asset, &settings, &query, NULL) != UMB_OK ||
        umb_asset_get_frustum(asset, 0, &frustum) != UMB_OK) {
        return;
    }
    for (size_t i = 0; i < 64 * 3; i++) {
        double extent = (double)(1U << frustum.log2_size) * frustum.voxel_step[i % 3][i % 3];
        points[i / 3][i % 3] = (random_unit(&seed) * 1.1 - 0.05) * extent;
    }
    struct umb_points batch = {.positions = points, .format = UMB_POINT_F64, .count = 64};
    struct umb_answers answers = {.values = values};
    umb_query_run(&query, &batch, 0, 64, &answers);
    struct umb_explanation explanation;
    umb_query_explain(&query, &batch, 3, &explanation);
    float wide[64];
    answers.values = wide;
    if (umb_query_prepare(asset, &point, &query, NULL) == UMB_OK) {
        umb_query_run(&query, &batch, 0, 61, &answers); /* not a whole block */
    }
    if (umb_query_prepare(asset, &tent, &query, NULL) == UMB_OK) {
        umb_query_run(&query, &batch, 0, 64, &answers);
    }
    if (umb_query_prepare(asset, &soft, &query, NULL) == UMB_OK) {
        umb_query_run(&query, &batch, 0, 64, &answers);
    }
    soft.light_extent = 0; /* the light's own; lamps take no other */
    if (umb_query_prepare(asset, &soft, &query, NULL) == UMB_OK) {
        umb_query_run(&query, &batch, 0, 16, &answers);
    }
    if (umb_query_prepare(asset, &patch, &query, NULL) == UMB_OK) {
        umb_query_run(&query, &batch, 0, 8, &answers);
        umb_query_explain(&query, &batch, 8, &explanation);
    }
    fuzz_gpu(asset, NULL);
}

/* Checks that each light's sample points lie in a voxel that queries read, or that a note explains
 * why there are none. */
static void sample_everywhere(const struct umb_asset *asset)
{
    const struct umb_query_settings point = {.bias_mode = UMB_BIAS_NONE};
    struct umb_sample_settings settings = {.count = 32, .seed = 7, .scattered = 0.25};
    struct umb_sample sample;
    struct umb_query query;
    double positions[3 * 32];
    float values[32];
    if (umb_asset_sample(asset, &settings, positions, &sample, NULL) == UMB_OK &&
        umb_query_prepare(asset, &point, &query, NULL) == UMB_OK) {
        struct umb_points points = {
            .positions = positions, .format = UMB_POINT_F64, .count = sample.count};
        struct umb_answers answers = {.values = values};
        memcpy(points.origin, sample.origin, sizeof points.origin);
        FUZZ_DEMAND(sample.count == 32 || sample.note[0] != '\0');
        FUZZ_DEMAND(umb_points_check(&points, NULL) == UMB_OK);
        umb_query_run(&query, &points, 0, points.count, &answers);
    }
}

/* Queries segments, columns and small boxes; a large box of a hostile tree may take hours. */
static void walk_everywhere(const struct umb_asset *asset)
{
    struct umb_volume volume;
    struct umb_frustum_info frustum;
    struct umb_segment_answer segments[8];
    struct umb_interval intervals[8 * 4];
    struct umb_column_answer columns[16];
    struct umb_box_answer boxes[8];
    struct umb_voxel_box corners[8];
    double ends[16][3];
    uint64_t seed = 98;
    if (umb_volume_prepare(asset, 0, &volume, NULL) != UMB_OK ||
        umb_asset_get_frustum(asset, 0, &frustum) != UMB_OK) {
        return;
    }
    double size = (double)(1U << frustum.log2_size);
    for (size_t i = 0; i < 16 * 3; i++) {
        ends[i / 3][i % 3] =
            (random_unit(&seed) * 1.1 - 0.05) * size * frustum.voxel_step[i % 3][i % 3];
    }
    for (size_t i = 0; i < 8 * 3; i++) {
        corners[i / 3].min[i % 3] = (int64_t)((random_unit(&seed) * 1.1 - 0.05) * size);
        corners[i / 3].max[i % 3] = corners[i / 3].min[i % 3] + (int64_t)i;
    }
    struct umb_segments lines = {.ends = ends, .format = UMB_POINT_F64, .count = 8};
    struct umb_points points = {.positions = ends, .format = UMB_POINT_F64, .count = 16};
    struct umb_segment_answers lit = {
        .segments = segments, .intervals = intervals, .interval_max = 4};
    struct umb_column_answers depths = {.columns = columns};
    struct umb_box_answers shares = {.boxes = boxes};
    umb_volume_segments(&volume, &lines, 0, 8, &lit);
    umb_volume_columns(&volume, &points, 0, 16, &depths);
    FUZZ_DEMAND(umb_volume_voxel_boxes(&volume, corners, 0, 8, NULL, &shares, NULL) == UMB_OK);
    for (size_t i = 0; i < 8; i++) {
        FUZZ_DEMAND(segments[i].lit >= 0 && segments[i].lit <= 1.0 + 1e-9);
        FUZZ_DEMAND(boxes[i].lit <= boxes[i].voxels);
    }
}

/* An asset that opened must survive being exported, packed and opened again. */
static void round_trip(const struct umb_asset *asset)
{
    struct umb__octree octree;
    struct umb__content content;
    struct bytes again = {0};
    struct umb_sink sink = bytes_sink(&again);
    uint8_t id[UMB_ID_BYTES];
    struct umb_asset *reopened;
    if (umb__asset_export(asset, &octree, &content, NULL) == UMB_OK) {
        FUZZ_DEMAND(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL) == UMB_OK);
        FUZZ_DEMAND(umb_asset_open_bytes(again.data, again.size, NULL, &reopened, NULL) == UMB_OK);
        umb_asset_close(reopened);
        bytes_finish(&again);
    }
    umb__octree_finish(&octree);
}

static void try_file(const uint8_t *bytes, size_t size)
{
    struct umb_open_options options = {.max_memory_bytes = (uint64_t)64 << 20};
    struct umb_asset *asset;
    uint8_t *exact = aligned_alloc(64, (size + 63) / 64 * 64 + 64);
    if (!exact) {
        return;
    }
    memcpy(exact, bytes, size);
    if (umb_asset_open_bytes(exact, size, &options, &asset, NULL) == UMB_OK) {
        query_everywhere(asset);
        walk_everywhere(asset);
        sample_everywhere(asset);
        round_trip(asset);
        umb_asset_close(asset);
    }
    free(exact);
}

/* Makes the checksums of a mapped file right, as far as its lengths allow. */
static void seal_mapped(uint8_t *file, size_t size)
{
    if (size < UMB__HEAD_SIZE) {
        return;
    }
    uint64_t canonical = umb__load64(file + UMB__HEAD_CANONICAL_LENGTH);
    uint64_t head = umb__load64(file + UMB__HEAD_LENGTH);
    uint32_t count = umb__load32(file + UMB__HEAD_DIRECTORY_COUNT);
    umb__store64(file + UMB__HEAD_FILE_LENGTH, size);
    if (head < UMB__HEAD_SIZE || head > size || canonical > head || count > 7 ||
        UMB__HEAD_SIZE + canonical + count * UMB__SECTION_ENTRY > head) {
        return;
    }
    for (uint32_t i = 0; i < count; i++) {
        uint8_t *entry = file + UMB__HEAD_SIZE + canonical + i * UMB__SECTION_ENTRY;
        uint64_t offset = umb__load64(entry + UMB__SECTION_OFFSET);
        uint64_t length = umb__load64(entry + UMB__SECTION_LENGTH);
        if (offset <= size && length <= size - offset) {
            umb__store64(entry + UMB__SECTION_CHECK, XXH3_64bits(file + offset, (size_t)length));
        }
    }
    uint8_t both[16];
    umb__store64(both, XXH3_64bits(file, UMB__HEAD_CHECK));
    umb__store64(both + 8, XXH3_64bits(file + UMB__HEAD_SIZE, (size_t)(head - UMB__HEAD_SIZE)));
    umb__store64(file + UMB__HEAD_CHECK, XXH3_64bits(both, sizeof both));
}

static void try_pages(const uint8_t *data, size_t size)
{
    struct bytes file = fuzz_file_of_pages(data, size);
    try_file(file.data, file.size);
    bytes_finish(&file);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 1 || size > MAX_FILE) {
        return 0;
    }
    uint8_t mode = data[0] % 3;
    if (mode == 2) {
        try_pages(data + 1, size - 1);
        return 0;
    }
    uint8_t *file = malloc(size);
    if (file) {
        memcpy(file, data + 1, size - 1);
        if (mode == 1) {
            seal_mapped(file, size - 1);
        }
        try_file(file, size - 1);
    }
    free(file);
    return 0;
}
