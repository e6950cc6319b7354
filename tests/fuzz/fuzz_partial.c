/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile pages of partial assets: the target adds them, queries, wants views, writes the array for
 * a GPU and saves. The first byte picks:
 *   even  a partial file as it is, but for its checksum, which is made right
 *   odd   the second byte is the order of coming; then a file of raw pages (fuzz_pages.h)
 */
#include "fuzz_gpu.h"
#include "fuzz_pages.h"
#include "umbrage/partial.h"
#include "umbrage/query.h"

static void query_everywhere(struct umb_partial *partial)
{
    const struct umb_query_settings settings = {.taps = 5};
    const struct umb_partial_view views[] = {
        {.light = UINT32_MAX, .max_error_m = 4},
        {.has_box = 1, .box = {{3, 3, 3}, {20, 20, 20}}, .taps = 1},
        {.has_camera = 1,
         .camera.eye = {5, 5, 5},
         .camera.forward = {1, 1, 1},
         .camera.up = {0, 0, 1},
         .camera.fov_y = 1,
         .camera.aspect = 1,
         .camera.far_m = 20,
         .max_error_rad = 0.01},
    };
    double positions[64][3];
    float values[64], low[64], high[64], error_m[64];
    uint64_t seed = 97;
    for (size_t i = 0; i < 64 * 3; i++) {
        positions[i / 3][i % 3] = random_unit(&seed) * 70 - 3;
    }
    const struct umb_points points = {.positions = positions, .format = UMB_POINT_F64, .count = 64};
    struct umb_partial_answers answers = {
        .values = values, .low = low, .high = high, .error_m = error_m};
    for (size_t i = 0; i < 3; i++) {
        uint32_t list[4];
        (void)!umb_partial_want(partial, &views[i], 0, NULL);
        for (size_t k = 0; k < umb_partial_missing(partial, list, 4, 0); k++) {
            FUZZ_DEMAND(!umb_partial_has(partial, list[k]));
        }
        if (umb_partial_query(partial, &settings, &points, 1, &answers, NULL) == UMB_OK) {
            for (size_t k = 0; k < 64; k++) {
                FUZZ_DEMAND(low[k] <= values[k] && values[k] <= high[k]);
            }
        }
    }
    fuzz_gpu(umb_partial_lower(partial), partial);
}

static enum umb_status drop_bytes(void *user, const void *bytes, size_t count)
{
    (void)bytes;
    *(size_t *)user += count;
    return UMB_OK;
}

static void try_saved(const uint8_t *data, size_t size)
{
    const struct umb_partial_options options = {.sha256 = &test_digest,
                                                .max_memory_bytes = 8 << 20};
    uint8_t *file = malloc(size ? size : 1);
    struct umb_partial *partial;
    FUZZ_DEMAND(file != NULL);
    memcpy(file, data, size);
    if (size >= 40) {
        const uint64_t length = umb__load64(file + 16) + 4 * (uint64_t)umb__load32(file + 12) +
                                4 * (uint64_t)umb__load32(file + 32);
        if (length <= size - 40) {
            umb__store64(file + 24, XXH3_64bits(file + 32, 8 + (size_t)length));
        }
    }
    if (umb_partial_open_saved(file, size, &options, &partial, NULL) == UMB_OK) {
        query_everywhere(partial);
        umb_partial_close(partial);
    }
    free(file);
}

/* The same file as the next version: its hostile directory meets pages that are held already. */
static void try_next_version(const struct bytes *file, struct umb_partial *partial,
                             const struct umb_partial_options *options)
{
    struct umb_partial *next;
    struct umb_partial_stats before, after;
    umb_partial_get_stats(partial, &before);
    if (umb_partial_open(file->data, file->size, options, &next, NULL) == UMB_OK) {
        FUZZ_DEMAND(umb_partial_inherit(next, partial, NULL) == UMB_OK);
        umb_partial_get_stats(next, &after);
        FUZZ_DEMAND(after.pages_inherited <= before.pages_held);
        if (umb_partial_build(next, NULL) == UMB_OK) {
            query_everywhere(next);
        }
        umb_partial_close(next);
    }
}

static void try_pages(const uint8_t *data, size_t size)
{
    const struct umb_partial_options options = {.sha256 = &test_digest,
                                                .max_memory_bytes = 8 << 20};
    struct bytes file = fuzz_file_of_pages(data + 1, size - 1);
    struct umb_partial *partial;
    struct umb_partial_stats stats;
    if (umb_partial_open(file.data, file.size, &options, &partial, NULL) == UMB_OK) {
        (void)!umb_partial_build(partial, NULL);
        umb_partial_get_stats(partial, &stats);
        for (uint32_t i = 0; i < stats.page_count; i++) {
            const uint32_t page = (i * (1 + 2U * (data[0] & 3)) + data[0] / 4) % stats.page_count;
            uint64_t offset;
            uint32_t length;
            (void)umb_partial_locate(partial, page, &offset, &length);
            (void)!umb_partial_add(partial, page, file.data + offset, length, NULL);
            if (umb_partial_build(partial, NULL) == UMB_OK) {
                query_everywhere(partial);
            }
        }
        size_t written = 0;
        const struct umb_sink sink = {.write = drop_bytes, .user = &written};
        FUZZ_DEMAND(umb_partial_save(partial, &sink, NULL) == UMB_OK);
        try_next_version(&file, partial, &options);
        umb_partial_close(partial);
    }
    bytes_finish(&file);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 2 || size > 1 << 20) {
        return 0;
    }
    if (data[0] % 2 == 0) {
        try_saved(data + 1, size - 1);
    } else {
        try_pages(data + 1, size - 1);
    }
    return 0;
}
