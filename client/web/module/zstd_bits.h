/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WEB_ZSTD_BITS_H
#define UMBRAGE_WEB_ZSTD_BITS_H
/* Bits that are read from the last byte of a stream to the first (RFC 8878, section 4). */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

struct umbx_bits {
    const uint8_t *bytes;
    size_t size;
    int64_t left; /* Number of bits left to read; below 0 if more were read than there are */
};

/* Returns the position of the highest bit that is set. In: value: not 0. */
static inline unsigned umbx_highest_bit(uint32_t value)
{
    return 31U - (unsigned)__builtin_clz(value);
}

/* Begins to read a stream. The highest set bit of its last byte marks the end. Returns false if
 * that byte is 0. */
static inline bool umbx_bits_open(struct umbx_bits *bits, const uint8_t *bytes, size_t size)
{
    if (size == 0 || bytes[size - 1] == 0) {
        return false;
    }
    *bits = (struct umbx_bits){bytes, size, 0};
    bits->left = (int64_t)(8 * (size - 1) + umbx_highest_bit(bytes[size - 1]));
    return true;
}

/* Returns `count` bits below the position `at`, at most 56. Bits before the stream are 0. */
static inline uint64_t umbx_bits_below(const struct umbx_bits *bits, int64_t at, unsigned count)
{
    const uint64_t mask = ((uint64_t)1 << count) - 1;
    int64_t first = at - (int64_t)count;
    unsigned absent = 0;
    uint64_t word = 0;
    if (first < 0) {
        if (at <= 0) {
            return 0;
        }
        absent = (unsigned)-first;
        first = 0;
    }
    const size_t byte = (size_t)first >> 3, rest = bits->size - byte;
    if (rest >= sizeof word) {
        memcpy(&word, bits->bytes + byte, sizeof word);
    } else {
        for (size_t i = 0; i < rest; i++) {
            word |= (uint64_t)bits->bytes[byte + i] << 8 * i;
        }
    }
    return word >> (first & 7) << absent & mask;
}

/* Looks at the next `count` bits, at most 56. */
static inline uint64_t umbx_bits_peek(const struct umbx_bits *bits, unsigned count)
{
    return umbx_bits_below(bits, bits->left, count);
}

/* Reads the next `count` bits, at most 56. */
static inline uint64_t umbx_bits_take(struct umbx_bits *bits, unsigned count)
{
    const uint64_t value = umbx_bits_below(bits, bits->left, count);
    bits->left -= count;
    return value;
}

#endif
