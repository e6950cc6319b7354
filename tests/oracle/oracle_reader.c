/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: opening, the walk from the root to a voxel, and the small helpers its other
 * files share. Source: docs/reference/umb-format.md, section 1.
 */
#include "oracle_reader.h"
#include "oracle_parts.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

uint64_t oracle_number(const uint8_t *bytes, uint32_t width)
{
    uint64_t value = 0;
    for (uint32_t i = 0; i < width; i++) {
        value |= (uint64_t)bytes[i] << (8 * i);
    }
    return value;
}

double oracle_double(const uint8_t *bytes)
{
    uint64_t bits = oracle_number(bytes, 8);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

int oracle_all_zero(const uint8_t *bytes, uint64_t size)
{
    for (uint64_t i = 0; i < size; i++) {
        if (bytes[i] != 0) {
            return 0;
        }
    }
    return 1;
}

/* Returns the length in bytes of a UTF-8 sequence, from its first byte; 0 if it is malformed. RFC
 * 3629, section 4. */
static uint64_t sequence_length(uint8_t first)
{
    if (first < 0x80) {
        return 1;
    }
    if (first >= 0xc2 && first <= 0xdf) {
        return 2;
    }
    if (first >= 0xe0 && first <= 0xef) {
        return 3;
    }
    return first >= 0xf0 && first <= 0xf4 ? 4 : 0;
}

int oracle_is_utf8(const uint8_t *bytes, uint64_t size)
{
    for (uint64_t i = 0; i < size;) {
        uint64_t length = sequence_length(bytes[i]);
        if (length == 0 || length > size - i) {
            return 0;
        }
        for (uint64_t k = 1; k < length; k++) {
            if ((bytes[i + k] & 0xc0) != 0x80) {
                return 0;
            }
        }
        uint8_t second = length > 1 ? bytes[i + 1] : 0;
        if ((bytes[i] == 0xe0 && second < 0xa0) || (bytes[i] == 0xed && second > 0x9f) ||
            (bytes[i] == 0xf0 && second < 0x90) || (bytes[i] == 0xf4 && second > 0x8f)) {
            return 0;
        }
        i += length;
    }
    return 1;
}

const uint8_t *oracle_take_bytes(struct oracle_cursor *cursor, uint64_t size)
{
    if (size > cursor->size - cursor->at) {
        cursor->at = cursor->size;
        cursor->overrun = 1;
        return NULL;
    }
    const uint8_t *bytes = cursor->data + cursor->at;
    cursor->at += size;
    return bytes;
}

uint64_t oracle_take(struct oracle_cursor *cursor, uint32_t width)
{
    const uint8_t *bytes = oracle_take_bytes(cursor, width);
    return bytes != NULL ? oracle_number(bytes, width) : 0;
}

uint64_t oracle_take_number(struct oracle_cursor *cursor)
{
    uint64_t value = 0, factor = 1;
    for (int i = 0; i < 5; i++) {
        const uint64_t byte = oracle_take(cursor, 1);
        value += byte % 128 * factor;
        factor *= 128;
        if (byte < 128) {
            if (value >= (uint64_t)1 << 32 || (byte == 0 && i > 0)) {
                cursor->overrun = 1; /* too large, or longer than need be */
            }
            return value;
        }
    }
    cursor->overrun = 1;
    return 0;
}

int oracle_refuse(char error[ORACLE_ERROR_SIZE], const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(error, ORACLE_ERROR_SIZE, format, arguments);
    va_end(arguments);
    return 0;
}

int oracle_open(struct oracle *oracle, const uint8_t *bytes, size_t size,
                char error[ORACLE_ERROR_SIZE])
{
    *oracle = (struct oracle){.bytes = bytes, .size = size};
    error[0] = '\0';
    if (!oracle_read_head(oracle, error) || !oracle_read_block(oracle, error)) {
        return 0;
    }
    if (oracle->form == ORACLE_MAPPED) {
        return oracle_read_mapped(oracle, error);
    }
    return oracle_read_pages(oracle, error) && oracle_check_tree(oracle, error);
}

void oracle_close(struct oracle *oracle)
{
    for (uint32_t l = 0; l < ORACLE_LEVELS; l++) {
        free(oracle->nodes[l]);
    }
    free(oracle->bricks);
    free(oracle->map_squares);
    free(oracle->frusta);
    free(oracle->lights);
    *oracle = (struct oracle){0};
}

int oracle_packed_voxel(const struct oracle *oracle, uint32_t frustum, const uint32_t at[3])
{
    const struct oracle_frustum *f = &oracle->frusta[frustum];
    if (f->root_state != 2) {
        return (int)f->root_state;
    }
    uint32_t number = f->root;
    for (uint32_t level = f->n; level > 3; level--) {
        const struct oracle_node *node = &oracle->nodes[level][number];
        uint32_t half = level - 1;
        uint32_t c = ((at[0] >> half) & 1) + 2 * ((at[1] >> half) & 1) + 4 * ((at[2] >> half) & 1);
        int state = (node->mask >> (2 * c)) & 3;
        if (state != 2) {
            return state;
        }
        number = node->child[c];
    }
    uint64_t slice = oracle->bricks[number].slice[at[2] & 7];
    return (int)((slice >> ((at[0] & 7) + 8 * (at[1] & 7))) & 1);
}

int oracle_voxel(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    if (frustum >= oracle->frustum_count) {
        return -1;
    }
    uint32_t side = (uint32_t)1 << oracle->frusta[frustum].n;
    if (x >= side || y >= side || z >= side) {
        return -1;
    }
    const uint32_t at[3] = {x, y, z};
    return oracle->form == ORACLE_PACKED ? oracle_packed_voxel(oracle, frustum, at)
                                         : oracle_mapped_voxel(oracle, frustum, at);
}
