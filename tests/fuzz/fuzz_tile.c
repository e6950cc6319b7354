/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Hostile tile results: what decoding accepts can be encoded, and decodes and encodes to the same
 * bytes from then on; what it refuses leaves pool and occluder depth map alone. The first two
 * bytes choose the sizes and whether there are first occluders.
 */
#include <string.h>

#include "bake/tiles/tile_code.h"
#include "fuzz.h"

#define BUDGET ((size_t)64 << 20)

/* Decodes and encodes again; NULL if the bytes are refused. */
static uint8_t *again(const struct umbb_tile_shape *plain, int with_depths, const uint8_t *bytes,
                      size_t size, size_t *out_size)
{
    struct umbb_tile_shape own = *plain, *shape = &own;
    struct umb__occluder_depth occluder_depth = {0};
    struct umb__pool pool;
    struct umb_error error = {0};
    struct umbb_runs runs = {0};
    struct umbb_tile_result result;
    uint8_t *out = NULL;
    umb__pool_init(&pool, NULL, BUDGET);
    if (with_depths) {
        FUZZ_DEMAND(umb__occluder_depth_init(&occluder_depth, NULL, own.log2_size, BUDGET,
                                             &error) == UMB_OK);
        own.occluder_depth = &occluder_depth;
    }
    const struct umbb_tile_nodes nodes = {&pool, &runs, BUDGET};
    const enum umb_status status = umbb_tile_decode(shape, bytes, size, &nodes, &result, &error);
    if (status == UMB_OK) {
        FUZZ_DEMAND(result.column.run_first + result.column.run_count == runs.count);
        FUZZ_DEMAND(umbb_tile_encode(shape, &nodes, &result, &out, out_size, &error) == UMB_OK);
    } else {
        FUZZ_DEMAND(status == UMB_E_CORRUPT && pool.bytes == 0 && runs.count == 0 &&
                    occluder_depth.count == 0);
    }
    umb__occluder_depth_finish(&occluder_depth);
    umbb_runs_finish(&runs);
    umb__pool_finish(&pool);
    return out;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 2) {
        return 0;
    }
    const uint32_t tile_log2 = 6 + data[0] % 4U;
    const struct umbb_tile_shape shape = {.log2_size = tile_log2 + data[1] % 4U,
                                          .tile_log2 = tile_log2};
    const int with_depths = data[1] >> 7;
    uint8_t *exact = malloc(size); /* the block ends where the data do */
    if (exact == NULL) {
        return 0;
    }
    memcpy(exact, data + 2, size - 2);
    uint8_t *tail = realloc(exact, size - 2 > 0 ? size - 2 : 1);
    exact = tail != NULL ? tail : exact;
    size_t first_size = 0, second_size = 0;
    uint8_t *first = again(&shape, with_depths, exact, size - 2, &first_size);
    if (first != NULL) {
        uint8_t *second = again(&shape, with_depths, first, first_size, &second_size);
        FUZZ_DEMAND(second != NULL && second_size == first_size);
        FUZZ_DEMAND(memcmp(first, second, first_size) == 0);
        free(second);
    }
    free(first);
    free(exact);
    return 0;
}
