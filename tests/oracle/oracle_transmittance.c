/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reads the maps of translucent casters (TRNS) as docs/reference/umb-format.md, section 3,
 * describes them: from the start of a square, list after list.
 */
#include <stdlib.h>

#include "oracle_parts.h"

enum {
    ALL_LIGHT = 1 << 21,
};

/* What a walk through a square looks for. */
struct wanted {
    uint32_t x, y, z; /* texel within the square, voxel */
    int64_t left;     /* found so far */
};

/* Reads one list. In: is_it: true for the wanted list. Out: first_z: depth at which the list
 * begins. */
static void take_list(struct oracle_cursor *cursor, int64_t size, int is_it, struct wanted *wanted,
                      int64_t *first_z, int64_t drops[8])
{
    int64_t z = -1, left = ALL_LIGHT;
    for (int step = 0; !cursor->overrun; step++) {
        const uint64_t number = oracle_take_number(cursor);
        const int64_t way = (int64_t)(number / 4);
        int64_t drop = drops[step % 8];
        if (number / 2 % 2 == 0) {
            drop = (int64_t)oracle_take_number(cursor) + 1;
            cursor->overrun |= drop == drops[step % 8];
        }
        drops[step % 8] = drop;
        if (drop == 0) {
            cursor->overrun = 1;
        }
        if (step == 0) {
            z = *first_z + (way % 2 == 0 ? way / 2 : -(way + 1) / 2);
            *first_z = z;
        } else {
            z += way + 1;
        }
        left -= drop;
        if (z < 0 || z >= size || left < 0) {
            cursor->overrun = 1;
        }
        if (is_it && z <= (int64_t)wanted->z) {
            wanted->left = left;
        }
        if (number % 2 == 0) {
            return;
        }
    }
}

/* A whole square from the cursor on. */
static void take_square(struct oracle_cursor *cursor, int64_t size, struct wanted *wanted)
{
    const uint64_t blocks = oracle_take(cursor, 8);
    int64_t first_z = 0, drops[8] = {0};
    for (uint32_t block = 0; block < 64 && !cursor->overrun; block++) {
        if ((blocks >> block & 1) == 0) {
            continue;
        }
        const uint64_t texels = oracle_take(cursor, 8);
        if (texels == 0) {
            cursor->overrun = 1;
        }
        for (uint32_t texel = 0; texel < 64; texel++) {
            if ((texels >> texel & 1) == 1) {
                const uint32_t x = block % 8 * 8 + texel % 8, y = block / 8 * 8 + texel / 8;
                take_list(cursor, size, x == wanted->x && y == wanted->y, wanted, &first_z, drops);
            }
        }
    }
}

int oracle_read_transmittance(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    struct oracle_cursor cursor = {.data = oracle->trns.data, .size = oracle->trns.size};
    struct wanted nothing = {UINT32_MAX, UINT32_MAX, 0, 0};
    uint64_t squares = 0;
    if (cursor.data == NULL) {
        return 1;
    }
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const uint64_t level = oracle_take(&cursor, 1);
        if (cursor.overrun || (level != 0 && (level < 6 || level > oracle->frusta[i].n))) {
            return oracle_refuse(error, "TRNS: frustum %u has no level 6 to n, or 0", i);
        }
        oracle->frusta[i].map_level = (uint32_t)level;
        oracle->frusta[i].map_first = squares;
        squares += level == 0 ? 0 : (uint64_t)1 << (2 * (level - 6));
        if (squares > oracle->trns.size) {
            return oracle_refuse(error, "TRNS: more squares than bytes");
        }
    }
    oracle->map_squares = calloc((size_t)squares + 1, sizeof *oracle->map_squares);
    if (oracle->map_squares == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    squares = 0;
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const uint32_t level = oracle->frusta[i].map_level;
        const uint64_t count = level == 0 ? 0 : (uint64_t)1 << (2 * (level - 6));
        for (uint64_t k = 0; k < count; k++) {
            oracle->map_squares[squares++] = cursor.at;
            take_square(&cursor, (int64_t)1 << oracle->frusta[i].n, &nothing);
        }
    }
    return !cursor.overrun && cursor.at == cursor.size
               ? 1
               : oracle_refuse(error, "TRNS: not what its masks and lists say");
}

int64_t oracle_transmittance(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y,
                             uint32_t z)
{
    const struct oracle_frustum *f = &oracle->frusta[frustum];
    if (oracle->trns.data == NULL || f->map_level == 0) {
        return ALL_LIGHT;
    }
    const uint32_t side = (uint32_t)1 << (f->n - f->map_level);
    x /= side;
    y /= side;
    struct wanted wanted = {x % 64, y % 64, z, ALL_LIGHT};
    const uint64_t number =
        f->map_first + (uint64_t)(y / 64) * ((uint64_t)1 << (f->map_level - 6)) + x / 64;
    struct oracle_cursor cursor = {
        .data = oracle->trns.data, .size = oracle->trns.size, .at = oracle->map_squares[number]};
    take_square(&cursor, (int64_t)1 << f->n, &wanted);
    return wanted.left;
}
