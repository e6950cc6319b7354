/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reads the occluder depth map (FRNT) as docs/reference/umb-format.md, section 3, describes it: bit
 * by bit, a texel at a time. References that lead out of the entry are refused.
 */
#include "oracle_parts.h"

/* A word of the entry; 0 and an overrun beyond its end. */
static uint32_t word_at(struct oracle_cursor *occluder_depth, uint64_t word)
{
    if (word >= occluder_depth->size / 4) {
        occluder_depth->overrun = 1;
        return 0;
    }
    return (uint32_t)oracle_number(occluder_depth->data + 4 * word, 4);
}

static int64_t long_at(struct oracle_cursor *occluder_depth, uint64_t word)
{
    return (int64_t)(word_at(occluder_depth, word) | (uint64_t)word_at(occluder_depth, word + 1)
                                                         << 32);
}

/* `width` bits of the words from `word` on, low bits first. */
static uint32_t bits_at(struct oracle_cursor *occluder_depth, uint64_t word, uint32_t first,
                        uint32_t width)
{
    uint32_t value = 0;
    for (uint32_t i = 0; i < width; i++) {
        const uint32_t bit = first + i;
        value |= (word_at(occluder_depth, word + bit / 32) >> bit % 32 & 1) << i;
    }
    return value;
}

static uint32_t ones_below(uint64_t mask, uint32_t bit)
{
    uint32_t ones = 0;
    for (uint32_t i = 0; i < bit; i++) {
        ones += (uint32_t)(mask >> i & 1);
    }
    return ones;
}

/* Floor of a sum over 2^bits; division in C rounds towards zero. */
static int64_t floor_of(int64_t sum, uint32_t bits)
{
    const int64_t one = (int64_t)1 << bits;
    return sum / one - (sum % one < 0);
}

static int64_t wide_plane(struct oracle_cursor *occluder_depth, uint64_t word, uint32_t x,
                          uint32_t y)
{
    const int64_t a = (int32_t)word_at(occluder_depth, word + 2),
                  b = (int32_t)word_at(occluder_depth, word + 3);
    const int64_t c = long_at(occluder_depth, word), most = (int64_t)1 << 56;
    if (c <= -most || c >= most) {
        occluder_depth->overrun = 1;
        return -1;
    }
    return floor_of(c + a * x + b * y, 20);
}

/* A block's record; -1: the tree answers. In: x, y: from the square's corner; planes: their words.
 */
static int64_t block_value(struct oracle_cursor *occluder_depth, uint32_t reference,
                           uint64_t planes, uint32_t x, uint32_t y)
{
    const uint32_t kind = reference >> 26, texel = x % 8 + 8 * (y % 8);
    uint64_t word = reference & 0x3ffffff;
    if (kind > 24 && kind <= 28) {
        const uint32_t width = kind - 24,
                       plane = bits_at(occluder_depth, word, texel * width, width);
        return plane == 0 ? -1
                          : wide_plane(occluder_depth, planes + 6 * (uint64_t)(plane - 1), x, y);
    }
    const uint32_t width = kind % 32;
    const int64_t c = (int32_t)word_at(occluder_depth, word),
                  a = (int32_t)word_at(occluder_depth, word + 1);
    const int64_t b = (int32_t)word_at(occluder_depth, word + 2);
    word += 3;
    if (kind >= 32) {
        if (bits_at(occluder_depth, word, texel, 1) == 0) {
            return -1;
        }
        word += 2;
    }
    return floor_of(c + a * (x % 8) + b * (y % 8), 12) -
           bits_at(occluder_depth, word, texel * width, width);
}

/* A square of planes. */
static int64_t square_value(struct oracle_cursor *occluder_depth, uint64_t word, uint32_t x,
                            uint32_t y)
{
    const uint32_t planes = word_at(occluder_depth, word), block = x / 8 + 8 * (y / 8);
    if (planes > 15) {
        occluder_depth->overrun = 1;
        return -1;
    }
    for (uint32_t i = 0; i < planes; i++) {
        const uint64_t plane = word + 1 + 6 * (uint64_t)i;
        if (bits_at(occluder_depth, plane + 4, block, 1) == 1) {
            return wide_plane(occluder_depth, plane, x, y);
        }
    }
    const uint64_t rest = word + 1 + 6 * (uint64_t)planes;
    const uint64_t mask = (uint64_t)long_at(occluder_depth, rest);
    if ((mask >> block & 1) == 0) {
        return -1;
    }
    const uint32_t reference = word_at(occluder_depth, rest + 2 + ones_below(mask, block));
    return block_value(occluder_depth, reference, word + 1, x, y);
}

int64_t oracle_occluder_depth(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y)
{
    struct oracle_cursor occluder_depth = {.data = oracle->frnt.data, .size = oracle->frnt.size};
    if (occluder_depth.data == NULL) {
        return -1;
    }
    uint32_t level = (oracle->frusta[frustum].n + 2) / 3 * 3;
    uint32_t reference = word_at(&occluder_depth, frustum);
    while (reference >> 26 == 63 && level > 6) {
        const uint64_t word = reference & 0x3ffffff;
        const uint64_t mask = (uint64_t)long_at(&occluder_depth, word);
        level -= 3;
        const uint32_t child = (x >> level & 7) + 8 * (y >> level & 7);
        reference = (mask >> child & 1) == 0
                        ? 0
                        : word_at(&occluder_depth, word + 2 + ones_below(mask, child));
    }
    if (reference == 0) {
        return occluder_depth.overrun ? -2 : -1;
    }
    const uint64_t word = reference & 0x3ffffff;
    const int64_t value = reference >> 26 == 0 ? wide_plane(&occluder_depth, word, x % 64, y % 64)
                          : reference >> 26 == 62
                              ? square_value(&occluder_depth, word, x % 64, y % 64)
                              : -2;
    return occluder_depth.overrun || level != 6 ? -2 : value;
}
