/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pages that come and go, in any order, of hostile files: answers, bounds and marks are those of a
 * layout made anew (partial_oracle.h). Byte 0 picks:
 *   even  eight bytes make an asset of few nodes (deep_asset.h); the rest are steps
 *   odd   byte 1 is the number of steps, which follow; then a file of raw pages (fuzz_pages.h)
 * A step adds or drops one page; every fourth value also builds and compares.
 */
#include "deep_asset.h"
#include "fuzz_pages.h"
#include "partial_oracle.h"

enum {
    POINTS = 32,
    STEPS_MAX = 24,
};

#define SIDE_M 64.0

static void compare_answers(struct umb_partial *partial, struct oracle *oracle, uint8_t way)
{
    const struct umb_query_settings settings = {.taps = way & 1 ? 5 : 1};
    double positions[3 * POINTS];
    float got[4][POINTS], wanted[4][POINTS];
    uint64_t seed = 31U + way;
    for (size_t i = 0; i < 3 * (size_t)POINTS; i++) {
        positions[i] = random_unit(&seed) * SIDE_M;
    }
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_partial_answers ours = {got[0], got[1], got[2], got[3], 0, 0, {0}, {0}};
    struct umb_partial_answers theirs = {wanted[0], wanted[1], wanted[2], wanted[3],
                                         0,         0,         {0},       {0}};
    FUZZ_DEMAND(umb_partial_query(partial, &settings, &points, 1, &ours, NULL) == UMB_OK);
    FUZZ_DEMAND(oracle_query(oracle, &settings, &points, 1, &theirs, NULL) == UMB_OK);
    for (unsigned i = 0; i < 4; i++) {
        FUZZ_DEMAND(memcmp(got[i], wanted[i], sizeof got[i]) == 0);
    }
    FUZZ_DEMAND(ours.exact == theirs.exact);
}

static void compare(struct umb_partial *partial, uint8_t way)
{
    const struct umb_partial_view view = {.light = UINT32_MAX,
                                          .has_box = way & 1,
                                          .box = {{5, 5, 5}, {5.0 + way / 5.0, 40, 20}},
                                          .max_error_m = way & 2 ? 3 : 0,
                                          .taps = 1};
    struct oracle oracle = {.part = partial};
    FUZZ_DEMAND(oracle_build(&oracle, NULL) == UMB_OK);
    FUZZ_DEMAND(umb_partial_want(partial, &view, 0, NULL) == UMB_OK);
    FUZZ_DEMAND(oracle_want(&oracle, &view, 0, NULL) == UMB_OK);
    FUZZ_DEMAND(partial->want_steps <= 1024 + 17 * partial->node_count);
    compare_answers(partial, &oracle, way);
    for (uint32_t page = 0; page < partial->head.page_count; page++) {
        FUZZ_DEMAND(memcmp(&partial->pages[page].benefit, &oracle.benefit[page], sizeof(double)) ==
                    0);
    }
    oracle_finish(&oracle);
}

static void step(struct umb_partial *partial, const struct bytes *file, uint8_t byte, uint8_t page)
{
    const uint32_t number = page % partial->head.page_count;
    if (umb_partial_has(partial, number)) {
        umb_partial_drop(partial, number);
    } else {
        uint64_t offset;
        uint32_t length;
        (void)umb_partial_locate(partial, number, &offset, &length);
        (void)!umb_partial_add(partial, number, file->data + offset, length, NULL);
    }
    if (byte % 4 == 0 && umb_partial_build(partial, NULL) == UMB_OK) {
        compare(partial, byte);
    }
}

static void try_file(const struct bytes *file, const uint8_t *steps, size_t count)
{
    const struct umb_partial_options options = {.sha256 = &test_digest,
                                                .max_memory_bytes = 64 << 20};
    struct umb_partial *partial;
    if (umb_partial_open(file->data, file->size, &options, &partial, NULL) != UMB_OK) {
        return;
    }
    for (uint32_t block = 1; block < partial->head.directory_count; block++) {
        uint64_t offset;
        uint32_t length;
        umb_partial_locate_block(partial, block, &offset, &length);
        FUZZ_DEMAND(umb_partial_add_block(partial, block, file->data + offset, length, NULL) ==
                    UMB_OK);
    }
    for (size_t i = 0; i + 1 < count && i < 2 * STEPS_MAX && partial->head.page_count > 0; i += 2) {
        step(partial, file, steps[i], steps[i + 1]);
    }
    umb_partial_close(partial);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bytes file;
    if (size < 12 || size > 1 << 18) {
        return 0;
    }
    if (data[0] % 2 == 0) {
        const struct deep deep = {.log2_size = 6 + data[1] % 15,
                                  .width = 1 + umb__load16(data + 2) % 100,
                                  .mixed = 1 + data[4] % 8,
                                  .seed = umb__load32(data + 5) + (uint64_t)1};
        file = deep_asset(&deep, SIDE_M);
        try_file(&file, data + 9, size - 9);
    } else {
        const size_t steps = data[1] % (2 * STEPS_MAX);
        if (steps + 3 > size) {
            return 0;
        }
        file = fuzz_file_of_pages(data + 2 + steps, size - 2 - steps);
        try_file(&file, data + 2, steps);
    }
    bytes_finish(&file);
    return 0;
}
