/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The arrays of a tile and its min/max pyramid.
 *
 * One allocation holds everything, so that its size is known exactly beforehand (--memory).
 */
#include "bake/depth/tile.h"

#include <string.h>

#include "base/memory.h"

/* Count of numbers in one pyramid of a tile, levels 3 and up. */
static size_t pyramid_count(uint32_t log2_size)
{
    size_t count = 0;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= log2_size; level++) {
        count += (size_t)1 << (2 * (log2_size - level));
    }
    return count;
}

static size_t square_count(uint32_t log2_size)
{
    return log2_size < UMBB_SQUARE_LOG2 ? 0 : (size_t)1 << (2 * (log2_size - UMBB_SQUARE_LOG2));
}

size_t umbb_tile_bytes(uint32_t log2_size, int closed_rule)
{
    const size_t texels = (size_t)1 << (2 * log2_size);
    return ((closed_rule ? 2 : 1) * texels + 2 * pyramid_count(log2_size)) * sizeof(int32_t) +
           (closed_rule ? square_count(log2_size) * (sizeof(struct umbb_proof) + 1) : 0);
}

enum umb_status umbb_tile_init(struct umbb_tile *tile, uint32_t log2_size, int closed_rule,
                               struct umb_error *error)
{
    memset(tile, 0, sizeof *tile);
    if (log2_size < UMB_LEVEL_BRICK || log2_size > UMB_LEVEL_MAX - 4) {
        return umb_fail(error, UMB_E_INTERNAL, "tile: log2 size %u is not in 3..%u",
                        (unsigned)log2_size, UMB_LEVEL_MAX - 4U);
    }
    const size_t bytes = umbb_tile_bytes(log2_size, closed_rule);
    tile->memory = umb__alloc_large(NULL, bytes, 1);
    if (tile->memory == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "tile of %u texels a side: %zu bytes refused",
                        1U << log2_size, bytes);
    }
    tile->log2_size = log2_size;
    tile->size = (int32_t)1 << log2_size;
    int32_t *next = tile->memory;
    tile->lit = next;
    next += (size_t)1 << (2 * log2_size);
    tile->end = tile->lit;
    if (closed_rule) {
        tile->end = next;
        next += (size_t)1 << (2 * log2_size);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= log2_size; level++) {
        const size_t count = (size_t)1 << (2 * (log2_size - level));
        tile->max_lit[level] = next;
        next += count;
        tile->min_end[level] = next;
        next += count;
    }
    if (closed_rule && log2_size >= UMBB_SQUARE_LOG2) {
        tile->proofs = (struct umbb_proof *)next;
        tile->proven = (uint8_t *)(tile->proofs + square_count(log2_size));
        memset(tile->proven, 0, square_count(log2_size));
    }
    return UMB_OK;
}

void umbb_tile_finish(struct umbb_tile *tile)
{
    umb__free(NULL, tile->memory);
    memset(tile, 0, sizeof *tile);
}

void umbb_tile_clear(struct umbb_tile *tile, int32_t bx, int32_t by, int32_t n, int32_t background)
{
    const int32_t width = tile->size >> 3;
    for (int32_t y = by; y < by + n; y++) {
        for (int32_t x = bx; x < bx + n; x++) {
            const size_t at = (size_t)y * (size_t)width + (size_t)x;
            tile->max_lit[UMB_LEVEL_BRICK][at] = background;
            tile->min_end[UMB_LEVEL_BRICK][at] = background;
        }
    }
}

void umbb_tile_reduce(struct umbb_tile *tile, int32_t bx, int32_t by, int32_t n)
{
    const int32_t width = tile->size >> 3;
    for (int32_t y = by; y < by + n; y++) {
        for (int32_t x = bx; x < bx + n; x++) {
            const size_t at = (size_t)y * (size_t)width + (size_t)x;
            const int32_t *lit = tile->lit + at * 64;
            const int32_t *end = tile->end + at * 64;
            int32_t most = lit[0], least = end[0];
            for (int i = 1; i < 64; i++) {
                most = lit[i] > most ? lit[i] : most;
                least = end[i] < least ? end[i] : least;
            }
            tile->max_lit[UMB_LEVEL_BRICK][at] = most;
            tile->min_end[UMB_LEVEL_BRICK][at] = least;
        }
    }
}

/* Computes squares [x, x + n) x [y, y + n) of a level `width` wide from the level below. */
static void reduce_squares(const int32_t *const from[2], size_t width, const size_t place[2],
                           size_t n, int32_t *const to[2])
{
    const int32_t *lit = from[0], *end = from[1];
    for (size_t y = place[1]; y < place[1] + n; y++) {
        for (size_t x = place[0]; x < place[0] + n; x++) {
            const size_t a = 4 * y * width + 2 * x, b = a + 2 * width;
            int32_t most = lit[a] > lit[a + 1] ? lit[a] : lit[a + 1];
            most = lit[b] > most ? lit[b] : most;
            most = lit[b + 1] > most ? lit[b + 1] : most;
            int32_t least = end[a] < end[a + 1] ? end[a] : end[a + 1];
            least = end[b] < least ? end[b] : least;
            least = end[b + 1] < least ? end[b + 1] : least;
            to[0][y * width + x] = most;
            to[1][y * width + x] = least;
        }
    }
}

void umbb_pyramid_step(const int32_t *lit, const int32_t *end, size_t n, int32_t *max_lit,
                       int32_t *min_end)
{
    const int32_t *const from[2] = {lit, end};
    int32_t *const to[2] = {max_lit, min_end};
    const size_t place[2] = {0, 0};
    reduce_squares(from, n, place, n, to);
}

/* Fills the pyramid's levels 4 to UMBB_SQUARE_LOG2 in square (x, y) of level UMBB_SQUARE_LOG2. */
static void square_pyramid(struct umbb_tile *tile, size_t x, size_t y)
{
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= UMBB_SQUARE_LOG2; level++) {
        const int32_t *const from[2] = {tile->max_lit[level - 1], tile->min_end[level - 1]};
        int32_t *const to[2] = {tile->max_lit[level], tile->min_end[level]};
        const size_t n = (size_t)1 << (UMBB_SQUARE_LOG2 - level), place[2] = {x * n, y * n};
        reduce_squares(from, (size_t)1 << (tile->log2_size - level), place, n, to);
    }
}

void umbb_tile_pyramid(struct umbb_tile *tile)
{
    uint32_t level = UMB_LEVEL_BRICK + 1;
    if (tile->proven != NULL) {
        const size_t across = (size_t)tile->size >> UMBB_SQUARE_LOG2;
        for (size_t square = 0; square < across * across; square++) {
            if (!tile->proven[square]) {
                square_pyramid(tile, square % across, square / across);
            }
        }
        level = UMBB_SQUARE_LOG2 + 1;
    }
    for (; level <= tile->log2_size; level++) {
        umbb_pyramid_step(tile->max_lit[level - 1], tile->min_end[level - 1],
                          (size_t)1 << (tile->log2_size - level), tile->max_lit[level],
                          tile->min_end[level]);
    }
}
