/* SPDX-License-Identifier: Apache-2.0 */
#include "web/module/zstd_literals.h"

#define WEIGHTS_MAX 255U /* The last byte's weight is not written */

/* Reads weights that are coded with finite state entropy (FSE), by two decoder states in turn.
 * Returns their number; 0: they are damaged. */
static unsigned read_packed_weights(struct umbx_fse_table *table, const uint8_t *from, size_t size,
                                    uint8_t *weight)
{
    struct umbx_bits bits;
    const size_t described = umbx_fse_read(table, from, size, 6, UMBX_HUFFMAN_LOG + 1);
    if (described == 0 || !umbx_bits_open(&bits, from + described, size - described)) {
        return 0;
    }
    uint32_t state[2];
    state[0] = (uint32_t)umbx_bits_take(&bits, table->log);
    state[1] = (uint32_t)umbx_bits_take(&bits, table->log);
    if (bits.left < 0) {
        return 0;
    }
    for (unsigned count = 0; count + 2 <= WEIGHTS_MAX; count++) {
        uint32_t *turn = &state[count & 1];
        weight[count] = table->state[*turn].symbol;
        *turn = umbx_fse_next(table, *turn, &bits);
        if (bits.left < 0) { /* The stream is at its end: the other state has the last weight */
            weight[count + 1] = table->state[state[(count & 1) ^ 1]].symbol;
            return count + 2;
        }
    }
    return 0;
}

/* Makes the Huffman code of `count` weights and of a last weight, which follows from the others. */
static bool make_code(struct umbx_huffman *huffman, uint8_t *weight, unsigned count)
{
    uint32_t sum = 0, longest = 0, next[UMBX_HUFFMAN_LOG + 2] = {0};
    for (unsigned i = 0; i < count; i++) {
        if (weight[i] > UMBX_HUFFMAN_LOG) {
            return false;
        }
        sum += weight[i] > 0 ? 1U << (weight[i] - 1) : 0;
    }
    if (sum == 0) {
        return false;
    }
    const unsigned log = umbx_highest_bit(sum) + 1;
    const uint32_t left = log <= UMBX_HUFFMAN_LOG ? (1U << log) - sum : 0;
    if (left == 0 || (left & (left - 1)) != 0) {
        return false;
    }
    weight[count] = (uint8_t)(umbx_highest_bit(left) + 1);
    for (unsigned i = 0; i <= count; i++) {
        next[weight[i] + 1] += weight[i] > 0 ? 1U << (weight[i] - 1) : 0;
        longest += weight[i] == 1;
    }
    if (longest < 2) { /* The code would be longer than it need be */
        return false;
    }
    for (unsigned w = 1; w <= UMBX_HUFFMAN_LOG + 1; w++) {
        next[w] += next[w - 1];
    }
    for (unsigned i = 0; i <= count; i++) {
        for (uint32_t n = weight[i] > 0 ? 1U << (weight[i] - 1) : 0; n > 0; n--) {
            const uint32_t place = next[weight[i]]++;
            huffman->at[place].byte = (uint8_t)i;
            huffman->at[place].bits = (uint8_t)(log + 1 - weight[i]);
        }
    }
    huffman->log = log;
    return true;
}

/* Reads the description of a code. Returns its length in bytes; 0: it is damaged. */
static size_t read_code(struct umbx_literals *literals, const uint8_t *from, size_t size)
{
    uint8_t weight[WEIGHTS_MAX + 1];
    unsigned count = 0;
    literals->huffman.log = 0;
    if (size == 0) {
        return 0;
    }
    size_t bytes = 1;
    if (from[0] < 128) {
        bytes += from[0];
        if (bytes > size) {
            return 0;
        }
        count = read_packed_weights(&literals->weights, from + 1, from[0], weight);
    } else {
        count = from[0] - 127U;
        bytes += (count + 1) / 2;
        if (bytes > size) {
            return 0;
        }
        for (unsigned i = 0; i < count; i++) {
            weight[i] = from[1 + i / 2] >> (i % 2 == 0 ? 4 : 0) & 15;
        }
    }
    return count > 0 && make_code(&literals->huffman, weight, count) ? bytes : 0;
}

/* Decodes one stream of `count` literals. A stream has no bits left behind its last literal. */
static bool decode_stream(const struct umbx_huffman *huffman, const uint8_t *from, size_t size,
                          uint8_t *to, size_t count)
{
    struct umbx_bits bits;
    if (!umbx_bits_open(&bits, from, size)) {
        return false;
    }
    const unsigned log = huffman->log, at_once = 56 / log;
    const uint32_t mask = (1U << log) - 1;
    size_t i = 0;
    while (i < count && bits.left >= 56) {
        const uint64_t word = umbx_bits_peek(&bits, 56);
        unsigned used = 0;
        for (unsigned k = 0; k < at_once && i < count; k++) {
            const uint32_t place = (uint32_t)(word >> (56 - log - used)) & mask;
            to[i++] = huffman->at[place].byte;
            used += huffman->at[place].bits;
        }
        bits.left -= used;
    }
    while (i < count && bits.left > 0) {
        const size_t place = (size_t)umbx_bits_peek(&bits, log);
        to[i++] = huffman->at[place].byte;
        bits.left -= huffman->at[place].bits;
    }
    return i == count && bits.left == 0;
}

/* Decodes literals in one stream, or in four with the lengths of three of them first. */
static bool decode_streams(struct umbx_literals *literals, const uint8_t *from, size_t size,
                           bool four)
{
    const struct umbx_huffman *huffman = &literals->huffman;
    if (!four) {
        return decode_stream(huffman, from, size, literals->own, literals->count);
    }
    const size_t each = (literals->count + 3) / 4;
    size_t at = 6, done = 0;
    if (size < at || 3 * each > literals->count) {
        return false;
    }
    for (unsigned i = 0; i < 4; i++) {
        const size_t length =
            i < 3 ? (size_t)from[2 * i] | (size_t)from[2 * i + 1] << 8 : size - at;
        const size_t count = i < 3 ? each : literals->count - done;
        if (length > size - at ||
            !decode_stream(huffman, from + at, length, literals->own + done, count)) {
            return false;
        }
        at += length;
        done += count;
    }
    return true;
}

/* Literals as they are, or one byte that repeats. */
static size_t read_plain(struct umbx_literals *literals, const uint8_t *from, size_t size)
{
    const bool repeats = (from[0] & 3) == 1;
    const unsigned format = from[0] >> 2 & 3;
    const size_t header = format == 1 ? 2 : format == 3 ? 3 : 1;
    size_t count = 0;
    if (size < header) {
        return 0;
    }
    for (size_t i = 0; i < header; i++) {
        count |= (size_t)from[i] << 8 * i;
    }
    count >>= format == 0 || format == 2 ? 3 : 4;
    const size_t stored = repeats ? 1 : count;
    if (count > UMBX_BLOCK_MAX || stored > size - header) {
        return 0;
    }
    literals->count = count;
    literals->bytes = from + header;
    if (repeats) {
        memset(literals->own, from[header], count);
        literals->bytes = literals->own;
    }
    return header + stored;
}

static size_t read_compressed(struct umbx_literals *literals, const uint8_t *from, size_t size)
{
    const bool same_code = (from[0] & 3) == 3;
    const unsigned format = from[0] >> 2 & 3, width = format < 2 ? 10 : 6 + 4 * format;
    const size_t header = format < 2 ? 3 : 2 + (size_t)format;
    uint64_t word = 0;
    if (size < header) {
        return 0;
    }
    for (size_t i = 0; i < header; i++) {
        word |= (uint64_t)from[i] << 8 * i;
    }
    const uint64_t mask = ((uint64_t)1 << width) - 1;
    const size_t stored = (size_t)(word >> (4 + width) & mask);
    literals->count = (size_t)(word >> 4 & mask);
    if (literals->count > UMBX_BLOCK_MAX || stored > size - header) {
        return 0;
    }
    const size_t described = same_code ? 0 : read_code(literals, from + header, stored);
    if (literals->huffman.log == 0 || (!same_code && described == 0) ||
        !decode_streams(literals, from + header + described, stored - described, format != 0)) {
        return 0;
    }
    literals->bytes = literals->own;
    return header + stored;
}

size_t umbx_literals_read(struct umbx_literals *literals, const uint8_t *from, size_t size)
{
    if (size == 0) {
        return 0;
    }
    return (from[0] & 2) == 0 ? read_plain(literals, from, size)
                              : read_compressed(literals, from, size);
}
