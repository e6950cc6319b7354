/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One asset has four readers: packed, mapped, partial, and the explanation of a point. Their
 * answers must agree to the bit, and a partial asset with only some pages must give bounds around
 * them. The first byte chooses the pages that are missing, the second the points; then raw pages
 * (fuzz_pages.h), in a file whose checks are all right. Files that the packed reader refuses are
 * skipped.
 */
#include <string.h>

#include "fuzz_pages.h"
#include "umbrage/partial.h"
#include "umbrage/query.h"

enum {
    POINTS = 70, /* more than a block of the kernels */
    TOLD = 6,    /* of them are explained */
};

static const struct umb_query_settings WAYS[] = {
    {.taps = 1},
    {.taps = 9},
    {.taps = 17, .bias_mode = UMB_BIAS_NONE},
    {.taps = 5, .filter = UMB_FILTER_TENT},
    {.taps = 7, .filter = UMB_FILTER_GAUSSIAN},
};

/* What is asked of every reader. */
struct volume_queries {
    double positions[POINTS][3];
    float normals[POINTS][3];
    struct umb_points points;
};

static void make_points(struct volume_queries *q, const struct umb_asset *asset, uint8_t choice)
{
    struct umb_frustum_info frustum;
    uint64_t seed = choice + (uint64_t)1;
    FUZZ_DEMAND(umb_asset_get_frustum(asset, 0, &frustum) == UMB_OK);
    const double size = (double)(1U << frustum.log2_size);
    for (size_t i = 0; i < POINTS * (size_t)3; i++) {
        q->positions[i / 3][i % 3] = (random_unit(&seed) * 1.1 - 0.05) * size;
        q->normals[i / 3][i % 3] = i / 3 % 2 ? (float)random_unit(&seed) - 0.7F : 0;
    }
    q->points = (struct umb_points){.positions = q->positions,
                                    .normals = &q->normals[0][0],
                                    .format = UMB_POINT_F64,
                                    .count = POINTS};
}

static struct umb_query ask(const struct umb_asset *asset, const struct umb_query_settings *way,
                            const struct volume_queries *q, float values[POINTS])
{
    struct umb_query query;
    struct umb_answers answers = {.values = values};
    FUZZ_DEMAND(umb_query_prepare(asset, way, &query, NULL) == UMB_OK);
    umb_query_run(&query, &q->points, 0, POINTS, &answers);
    return query;
}

/* The explanation looks up each texel by itself. */
static void expect_told(const struct umb_query *query, const struct umb_query_settings *way,
                        const struct volume_queries *q, const float values[POINTS])
{
    for (size_t i = 0; i < TOLD; i++) {
        struct umb_explanation told;
        umb_query_explain(query, &q->points, i * (POINTS / TOLD), &told);
        const float value = values[i * (POINTS / TOLD)];
        FUZZ_DEMAND((float)told.answer == value);
        FUZZ_DEMAND(way->filter != UMB_FILTER_BOX ||
                    (float)told.lit_taps / (float)(told.taps * told.taps) == value);
    }
}

static void expect_bounds(struct umb_partial *partial, const struct umb_query_settings *way,
                          const struct volume_queries *q, const float truth[POINTS], int whole)
{
    float values[POINTS], low[POINTS], high[POINTS];
    struct umb_partial_answers answers = {.values = values, .low = low, .high = high};
    FUZZ_DEMAND(umb_partial_query(partial, way, &q->points, 0, &answers, NULL) == UMB_OK);
    for (size_t i = 0; i < POINTS; i++) {
        FUZZ_DEMAND(low[i] <= truth[i] && truth[i] <= high[i]);
        FUZZ_DEMAND(low[i] <= values[i] && values[i] <= high[i]);
    }
    FUZZ_DEMAND(!whole || (answers.exact == POINTS && memcmp(values, truth, sizeof values) == 0));
}

/* The pages whose bits are set in `missing` stay away. */
static struct umb_partial *open_partial(const struct bytes *file, uint8_t missing)
{
    const struct umb_partial_options options = {.sha256 = &test_digest,
                                                .max_memory_bytes = 64 << 20};
    struct umb_partial *partial;
    struct umb_partial_stats stats;
    FUZZ_DEMAND(umb_partial_open(file->data, file->size, &options, &partial, NULL) == UMB_OK);
    umb_partial_get_stats(partial, &stats);
    for (uint32_t page = 0; page < stats.page_count; page++) {
        uint64_t offset;
        uint32_t length;
        (void)umb_partial_locate(partial, page, &offset, &length);
        if (!(missing >> page & 1)) {
            FUZZ_DEMAND(umb_partial_add(partial, page, file->data + offset, length, NULL) ==
                        UMB_OK);
        }
    }
    FUZZ_DEMAND(umb_partial_build(partial, NULL) == UMB_OK);
    return partial;
}

static struct umb_asset *open_mapped(const struct umb_asset *packed, struct bytes *file)
{
    struct umb_asset *mapped;
    struct umb_sink sink = bytes_sink(file);
    FUZZ_DEMAND(umb__mapped_write(packed, &sink, NULL) == UMB_OK);
    FUZZ_DEMAND(umb_asset_open_bytes(file->data, file->size, NULL, &mapped, NULL) == UMB_OK);
    return mapped;
}

static void compare(const struct umb_asset *packed, const struct bytes *file, uint8_t missing,
                    uint8_t choice)
{
    struct bytes mapped_file = {0};
    struct umb_asset *mapped = open_mapped(packed, &mapped_file);
    struct umb_partial *all = open_partial(file, 0), *some = open_partial(file, missing);
    struct volume_queries volume_queries;
    make_points(&volume_queries, packed, choice);
    for (size_t i = 0; i < sizeof WAYS / sizeof WAYS[0]; i++) {
        float truth[POINTS], values[POINTS];
        const struct umb_query query = ask(packed, &WAYS[i], &volume_queries, truth);
        expect_told(&query, &WAYS[i], &volume_queries, truth);
        (void)ask(mapped, &WAYS[i], &volume_queries, values);
        FUZZ_DEMAND(memcmp(values, truth, sizeof values) == 0);
        expect_bounds(all, &WAYS[i], &volume_queries, truth, 1);
        expect_bounds(some, &WAYS[i], &volume_queries, truth, 0);
    }
    umb_partial_close(all);
    umb_partial_close(some);
    umb_asset_close(mapped);
    bytes_finish(&mapped_file);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 3 || size > 1 << 18) {
        return 0;
    }
    const struct umb_open_options options = {.max_memory_bytes = (uint64_t)64 << 20};
    struct bytes file = fuzz_file_of_pages(data + 2, size - 2);
    struct umb_asset *packed;
    if (umb_asset_open_bytes(file.data, file.size, &options, &packed, NULL) == UMB_OK) {
        compare(packed, &file, data[0], data[1]);
        umb_asset_close(packed);
    }
    bytes_finish(&file);
    return 0;
}
