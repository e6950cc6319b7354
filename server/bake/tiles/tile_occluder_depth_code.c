/* SPDX-License-Identifier: Apache-2.0 */
/* Squares of first occluders, from a frustum's occluder depth map to bytes and back. */
#include "bake/tiles/tile_code.h"

#include <stdlib.h>

#include "base/bytes.h"
#include "base/try.h"

static uint32_t squares_across(const struct umbb_tile_shape *shape)
{
    return ((uint32_t)1 << shape->tile_log2) / UMB__OCCLUDER_DEPTH_SIDE;
}

/* The words of the tile's square with that number; NULL if it has none. */
static const uint32_t *square_of(const struct umbb_tile_shape *shape, uint32_t number)
{
    const uint32_t across = squares_across(shape);
    return umb__occluder_depth_square(shape->occluder_depth,
                                      shape->occluder_depth_x + number % across,
                                      shape->occluder_depth_y + number / across);
}

uint64_t umbb_tile_occluder_depth_bytes(const struct umbb_tile_shape *shape)
{
    if (shape->occluder_depth == NULL) {
        return 0;
    }
    const uint32_t count = squares_across(shape) * squares_across(shape);
    uint64_t words = 1;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *square = square_of(shape, i);
        words += square != NULL ? 1 + (uint64_t)square[0] : 0;
    }
    return 4 * words;
}

void umbb_tile_occluder_depth_put(const struct umbb_tile_shape *shape, uint8_t *at)
{
    const uint32_t count = squares_across(shape) * squares_across(shape);
    uint8_t *next = at + 4;
    uint32_t squares = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *square = square_of(shape, i);
        if (square == NULL) {
            continue;
        }
        squares++;
        umb__store32(next, i);
        next += 4;
        for (uint32_t w = 0; w < square[0]; w++, next += 4) {
            umb__store32(next, square[w]);
        }
    }
    umb__store32(at, squares);
}

/* 1 if the words are exactly the part. In: count: at least 1. */
static int is_whole(const struct umbb_tile_shape *shape, const uint32_t *words, size_t count)
{
    const uint32_t across = squares_across(shape);
    size_t at = 1;
    uint32_t least = 0; /* least number of the next square */
    for (uint32_t i = 0; i < words[0]; i++) {
        if (count - at < 2 || words[at] < least || words[at] >= across * across ||
            words[at + 1] > count - at - 1 ||
            !umb__occluder_depth_square_fits(shape->log2_size, words + at + 1, words[at + 1])) {
            return 0;
        }
        least = words[at] + 1;
        at += 1 + words[at + 1];
    }
    return at == count;
}

enum umb_status umbb_tile_occluder_depth_read(const struct umbb_tile_shape *shape,
                                              const uint8_t *bytes, size_t size, uint32_t **words,
                                              struct umb_error *error)
{
    *words = NULL;
    if (size < 4 || size % 4 != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "tile result: no first occluders");
    }
    uint32_t *read = malloc(size);
    if (read == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "tile result: memory for %zu bytes refused", size);
    }
    for (size_t i = 0; i < size / 4; i++) {
        read[i] = umb__load32(bytes + 4 * i);
    }
    if (!is_whole(shape, read, size / 4)) {
        free(read);
        return umb_fail(error, UMB_E_CORRUPT, "tile result: malformed first occluders");
    }
    *words = read;
    return UMB_OK;
}

enum umb_status umbb_tile_occluder_depth_add(const struct umbb_tile_shape *shape,
                                             const uint32_t *words, struct umb_error *error)
{
    const uint32_t across = squares_across(shape);
    const uint32_t *next = words + 1;
    for (uint32_t i = 0; i < words[0]; i++, next += 1 + next[1]) {
        UMB__TRY(umb__occluder_depth_add_square(
            shape->occluder_depth, shape->occluder_depth_x + next[0] % across,
            shape->occluder_depth_y + next[0] / across, next + 1, error));
    }
    return UMB_OK;
}
